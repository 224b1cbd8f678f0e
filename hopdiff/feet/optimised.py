"""Feet and root of a whole clip found together, by least squares over all frames: contacts as an optimisation.

The paper (Kim & Lee 2021, algorithm 1, line 20) keeps contacts by an optimisation: a motion is bent as a graph is by
its Laplacian, while contacts stay where they are. Here the graph is the clip's frames in a row. Unknown are how far
each ankle is moved over the ground in each frame, where each contact is, and how far the root is lowered. Their
differences between frames, and how far feet are from where the edit leads them, are as little as can be, while feet
that stand do what they did in the source, and their legs reach them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.linalg import splu
from torch import Tensor

from hopdiff.feet.reach import EASY, heel_up, longest, most_heel, turned_up
from hopdiff.feet.way import FootWay, sunk

ROUNDS = 5  # of which each has the legs' reach as a tangent
STEPS = 20  # of Newton's method in a round
LEAST_PART = 1e-3  # of such a step
EASE = 0.15  # s within which a foot gets over to a contact and away from it
SETTLE = 0.2  # s within which the root comes down
DEAR = 30.0  # m² that a foot may be away for a m² of a lowered root
FIRM = 1e6  # the same for a leg that is too short
NEAR = 0.03  # m before its end from which on a leg's reach counts
ENOUGH = 1e-5  # m

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Stand:
    """A contact. frames: of it. ankle: (T', 3) where it would be [m]. turn: (T',) of the foot since the source [rad].
    free: whether it may be elsewhere over the ground."""

    frames: slice
    ankle: Tensor
    turn: Tensor
    free: bool


@dataclass(frozen=True, eq=False)
class Sliding:
    """A foot as an edit leads it, and its contacts. ankle: (T, 3) [m]. turn: (T,) of the body since the source [rad].
    way: what the ankle (T, 3) of a foot turned by (T,) comes to on its ground."""

    ankle: Tensor
    turn: Tensor
    stands: Sequence[Stand]
    way: Callable[[Tensor, Tensor], FootWay]


def optimised_ways(
    feet: Sequence[Sliding], frame_time: float, most: float, kept: tuple[int, int]
) -> tuple[list[FootWay], Tensor]:
    """The ways of the feet, and (T,) by how much the root is lowered [m], not by more than most.

    Frames up to one and from another one on (kept) stay as the edit leads them.
    """
    inner = np.zeros(len(feet[0].ankle), dtype=bool)
    inner[kept[0] + 1 : kept[1]] = True
    unknowns = _Unknowns(inner)
    places = [[unknowns.foot(foot, axis) for axis in (0, 2)] for foot in feet]
    root = unknowns.free(inner)
    rows = [_smooth(one, EASE / frame_time, 3) for pair in places for one in pair]
    rows += [one for pair in places for one in pair]
    rows += [one.times(DEAR**0.5) for one in (_smooth(root, SETTLE / frame_time, 2), root)]
    turns = [foot.turn + _turning(foot, frame_time, inner) for foot in feet]
    found = np.zeros(unknowns.count)
    reach: list[_Rows] = []
    for _ in range(ROUNDS):
        before = found
        found = unknowns.least(rows, reach, before)
        lowered = torch.from_numpy(root.value(found))
        ways = [
            foot.way(_moved(foot.ankle, pair, found), turn)
            for foot, pair, turn in zip(feet, places, turns, strict=True)
        ]
        reach = [_over(root, lowered, most)]
        reach += [_reach(way, pair, root, lowered, found) for way, pair in zip(ways, places, strict=True)]
        if np.abs(found - before).max(initial=0.0) < ENOUGH:
            break
    return ways, lowered.clamp_max(most)


@dataclass(frozen=True, eq=False)
class _Rows:
    """Numbers (R,) that are linear in the unknowns: matrix times these, plus fixed."""

    matrix: sparse.csr_matrix
    fixed: Floats

    def value(self, found: Floats) -> Floats:
        numbers: Floats = self.matrix @ found[: self.matrix.shape[1]] + self.fixed
        return numbers

    def times(self, weight: float | Floats) -> _Rows:
        scale = sparse.diags(np.broadcast_to(weight, self.fixed.shape))
        return _Rows((scale @ self.matrix).tocsr(), weight * self.fixed)

    def at(self, frames: NDArray[np.intp]) -> _Rows:
        return _Rows(self.matrix[frames], self.fixed[frames])


class _Unknowns:
    """Counts unknowns out, one after the other. inner: (T,) frames in which anything may be unknown."""

    def __init__(self, inner: NDArray[np.bool_]) -> None:
        self.inner, self.frames, self.count = inner, len(inner), 0

    def free(self, which: NDArray[np.bool_]) -> _Rows:
        """(T,) numbers, unknown in some frames and 0 in the others."""
        return self._rows(*self._one_each(which), np.zeros(self.frames))

    def foot(self, foot: Sliding, axis: int) -> _Rows:
        """(T,) by how much an ankle is moved along an axis: unknown in the air, in a contact as that asks for."""
        fixed, air = np.zeros(self.frames), self.inner.copy()
        frames, columns = [], []
        for one in foot.stands:
            fixed[one.frames] = (one.ankle - foot.ankle[one.frames])[:, axis].numpy()
            air[one.frames] = False
            if one.free:
                own = np.arange(self.frames)[one.frames]
                frames.append(own)
                columns.append(np.full(len(own), self.count))
                self.count += 1
        each, column = self._one_each(air)
        return self._rows(np.concatenate([*frames, each]), np.concatenate([*columns, column]), fixed)

    def _one_each(self, which: NDArray[np.bool_]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        frames = np.flatnonzero(which)
        columns = self.count + np.arange(len(frames))
        self.count += len(frames)
        return frames, columns

    def _rows(self, frames: NDArray[np.intp], columns: NDArray[np.intp], fixed: Floats) -> _Rows:
        shape = (self.frames, self.count)
        return _Rows(sparse.csr_matrix((np.ones(len(frames)), (frames, columns)), shape=shape), fixed)

    def least(self, rows: Sequence[_Rows], limits: Sequence[_Rows], start: Floats) -> Floats:
        """The unknowns with which the sum of squares of all rows is the least, and of all limits that are exceeded.

        Newton's method: of limits those count that are exceeded where it begins, until they are the same.
        """
        if not self.count:
            return start
        all_rows, all_limits = self._together(rows), self._together(limits)

        def cost(found: Floats) -> float:
            over = np.maximum(all_limits.value(found), 0.0)
            return float(np.sum(all_rows.value(found) ** 2) + np.sum(over**2))

        plain = (all_rows.matrix.T @ all_rows.matrix).tocsc()
        pull = all_rows.matrix.T @ all_rows.fixed
        found, least = start, cost(start)
        for _ in range(STEPS):
            active = np.flatnonzero(all_limits.value(found) > 0.0)
            over = all_limits.at(active)
            factor = splu(
                (plain + over.matrix.T @ over.matrix).tocsc(),
                permc_spec="MMD_AT_PLUS_A",
                options={"SymmetricMode": True},
            )
            step = -factor.solve(pull + over.matrix.T @ over.fixed) - found
            part = 1.0
            while (now := cost(found + part * step)) > least and part > LEAST_PART:
                part *= 0.5
            if now > least:
                break
            found, least = found + part * step, now
            if part == 1.0 and np.array_equal(active, np.flatnonzero(all_limits.value(found) > 0.0)):
                break
        return found

    def _together(self, rows: Sequence[_Rows]) -> _Rows:
        if not rows:
            return _Rows(sparse.csr_matrix((0, self.count)), np.zeros(0))
        for one in rows:
            one.matrix.resize(one.matrix.shape[0], self.count)
        return _Rows(sparse.vstack([one.matrix for one in rows]).tocsr(), np.concatenate([one.fixed for one in rows]))


def _smooth(one: _Rows, frames: float, order: int) -> _Rows:
    """Differences of some order of (T,) numbers, over a time of so many frames."""
    matrix, fixed = one.matrix, one.fixed
    for _ in range(min(order, len(fixed) - 1)):
        matrix, fixed = matrix[1:] - matrix[:-1], np.diff(fixed)
    return _Rows(matrix, fixed).times(frames**order)


def _turning(foot: Sliding, frame_time: float, inner: NDArray[np.bool_]) -> Tensor:
    """(T,) by how much a foot is turned since it was led: as its contacts ask for, smoothly from one to the next."""
    unknowns = _Unknowns(inner)
    fixed, air = np.zeros(len(foot.turn)), inner.copy()
    for one in foot.stands:
        fixed[one.frames] = (one.turn - foot.turn[one.frames]).numpy()
        air[one.frames] = False
    free = unknowns.free(air)
    turn = _Rows(free.matrix, fixed)
    found = unknowns.least([_smooth(turn, EASE / frame_time, 3), turn], [], np.zeros(unknowns.count))
    return torch.from_numpy(turn.value(found))


def _moved(ankle: Tensor, pair: Sequence[_Rows], found: Floats) -> Tensor:
    x, z = (torch.from_numpy(one.value(found)) for one in pair)
    return ankle + torch.stack((x, torch.zeros_like(x), z), dim=-1)


def _over(root: _Rows, lowered: Tensor, most: float) -> _Rows:
    """By how much the root is lowered too far, in frames in which it nearly is."""
    one = root.at(np.flatnonzero((lowered > most - NEAR).numpy()))
    return _Rows(one.matrix, one.fixed - most).times(FIRM**0.5)


def _reach(way: FootWay, pair: Sequence[_Rows], root: _Rows, lowered: Tensor, found: Floats) -> _Rows:
    """By how much a standing leg is too short, its heel raised as far as it easily is, to first order."""
    hip, ankle, reach = sunk(way.hip, lowered), way.ankle, longest(way.track)
    if way.ball is not None:
        up = EASY * (1.0 - way.flat) * most_heel(hip, way.ball, way.axis)
        ankle = turned_up(ankle, way.ball, way.axis, heel_up(hip, ankle, way.ball, way.axis, reach, up))
    gap = ankle - hip
    distance = gap.norm(dim=-1)
    over = (distance - reach).numpy()
    frames = np.flatnonzero(way.stands.numpy() & (over > -NEAR))
    x, y, z = ((gap / distance[:, None]).numpy()[frames]).T
    parts = [one.at(frames).times(along) for one, along in zip((*pair, root), (x, z, y), strict=True)]
    matrix = sum((one.matrix for one in parts[1:]), parts[0].matrix)
    now = sum(one.value(found) for one in parts)
    fixed = over[frames] + sum(one.fixed for one in parts) - now
    return _Rows(matrix.tocsr(), fixed).times(FIRM**0.5)
