"""What a skeleton of any make tells by its joints' names and shape: sides, fingers, the head; its bones as chains."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch

from hopdiff.geometry.clip import Clip
from hopdiff.geometry.joint_names import is_like, side_of
from hopdiff.geometry.skeleton import Skeleton
from hopdiff.plots.view import Array, numbers
from hopdiff.types import HopdiffError

SIDES = ("left", "right", "middle")
_ASIDE = 0.02  # of the height at rest: joints that lie so far from the middle belong to a side if no name tells
_ABOVE = 0.06  # of it, by which a head without a name stands above everything else


@dataclass(frozen=True)
class Chain:
    """Bones in a row. nodes: at least two; side: "left", "right" or "middle"; finger: whether it is one."""

    nodes: tuple[int, ...]
    side: str
    finger: bool


@dataclass(frozen=True)
class Head:
    """tip: the node at or in the head; base: the node before it; bone: their distance [m]."""

    base: int
    tip: int
    bone: float

    def centre(self, points: Array, radius: float) -> Array:
        """Middle (..., 3) of a round head of a radius [m], in points (..., N, 3) of poses.

        Bones end anywhere between the ears and the top: the longer the last one, the nearer to the top.
        """
        way = points[..., self.tip, :] - points[..., self.base, :]
        way = way / np.maximum(np.linalg.norm(way, axis=-1, keepdims=True), 1e-9)
        return np.asarray(points[..., self.tip, :] - np.clip(self.bone - radius, 0.0, radius) * way)


def points_of(clip: Clip) -> Array:
    """(T, J + E, 3) world positions of the joints and, after them, the end sites in the order of their joints [m]."""
    positions, orientations = clip.forward()
    ends = clip.skeleton.end_positions(positions, orientations)
    tracks = [numbers(positions)]
    tracks += [numbers(ends[name])[:, None] for name in clip.skeleton.names if name in ends]
    return np.concatenate(tracks, axis=1)


class Bones:
    """A skeleton as chains of nodes; nodes are the joints and then the end sites, as in `points_of`.

    sides: "left", "right" or "middle" for each joint; None guesses them from the names, joints without a hint like
    the one before them, or, if no name has one, from where they are at rest.
    Raises HopdiffError for sides that do not fit the joints.
    """

    def __init__(self, skeleton: Skeleton, sides: Sequence[str] | None = None) -> None:
        count = len(skeleton.names)
        holders = [joint for joint, name in enumerate(skeleton.names) if name in skeleton.end_sites]
        self.names = (*skeleton.names, *(skeleton.names[joint] for joint in holders))
        self.parents = (*skeleton.parents, *holders)
        ends = [skeleton.end_sites[skeleton.names[joint]] for joint in holders]
        self._offsets = numbers(torch.stack([*skeleton.offsets, *(end.to(skeleton.offsets) for end in ends)]))
        self._rest = np.zeros_like(self._offsets)
        for node in range(1, len(self.parents)):
            self._rest[node] = self._rest[self.parents[node]] + self._offsets[node]
        joint_sides = self._guessed(count) if sides is None else _checked(sides, count)
        self.sides = (*joint_sides, *(joint_sides[joint] for joint in holders))
        self._fingers = self._find_fingers()
        self.chains = self._find_chains()
        self.head = self._find_head(count)

    def _guessed(self, count: int) -> list[str]:
        named = [side_of(name) for name in self.names[:count]]
        if set(named) == {"middle"}:
            aside = _ASIDE * float(np.ptp(self._rest[:, 1]))
            x = self._rest[:count, 0]
            return ["left" if value > aside else "right" if value < -aside else "middle" for value in x]
        for joint in range(1, count):
            if named[joint] == "middle":
                named[joint] = named[self.parents[joint]]
        return named

    def _find_fingers(self) -> list[bool]:
        found = [False] * len(self.names)
        for node in range(1, len(self.names)):
            named = self.sides[node] != "middle" and is_like("finger", self.names[node])
            found[node] = named or found[self.parents[node]]
        return found

    def _find_chains(self) -> tuple[Chain, ...]:
        """A chain goes on along the longest way of its own kind; other children begin chains of their own."""
        beyond = np.zeros(len(self.parents))
        length = np.linalg.norm(self._offsets, axis=1)
        onward: dict[int, int] = {}
        for node in range(len(self.parents) - 1, 0, -1):
            parent, way = self.parents[node], length[node] + beyond[node]
            if self._kind(node) == self._kind(parent) and (parent not in onward or way > beyond[parent]):
                onward[parent], beyond[parent] = node, way
        chains = []
        for node in range(1, len(self.parents)):
            parent = self.parents[node]
            if onward.get(parent) == node and parent != 0:
                continue
            nodes = [parent, node]
            while nodes[-1] in onward:
                nodes.append(onward[nodes[-1]])
            chains.append(Chain(tuple(nodes), self.sides[node], self._fingers[node]))
        return tuple(chains)

    def _kind(self, node: int) -> tuple[str, bool]:
        return self.sides[node], self._fingers[node]

    def _find_head(self, count: int) -> Head | None:
        middle = [node for node in range(1, len(self.names)) if self.sides[node] == "middle"]
        joints = [node for node in middle if node < count]
        heads = [node for node in joints if is_like("head", self.names[node])][:1]
        if named := heads or [node for node in joints if is_like("neck", self.names[node])][-1:]:
            over = [node for node in middle if self.parents[node] == named[0] and not is_like("face", self.names[node])]
            tip = max(over, key=lambda node: float(self._offsets[node, 1]), default=named[0])
            return self._head(tip if np.any(self._offsets[tip]) else named[0])
        leaves = [node for node in middle if node not in self.parents]
        others = [float(self._rest[node, 1]) for node in range(len(self.names)) if self.sides[node] != "middle"]
        if not leaves or not others:
            return None
        tip = max(leaves, key=lambda node: float(self._rest[node, 1]))
        clear = self._rest[tip, 1] - max(others) > _ABOVE * np.ptp(self._rest[:, 1])
        return self._head(tip) if clear else None

    def _head(self, tip: int) -> Head:
        return Head(self.parents[tip], tip, float(np.linalg.norm(self._offsets[tip])))


def _checked(sides: Sequence[str], count: int) -> list[str]:
    if len(sides) != count:
        raise HopdiffError(f"sides must name a side for each of {count} joints, not for {len(sides)}.")
    if wrong := [side for side in sides if side not in SIDES]:
        raise HopdiffError(f"a joint's side must be one of {', '.join(SIDES)}, not {wrong[0]!r}.")
    return list(sides)
