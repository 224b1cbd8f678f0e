"""Joints of a BVH file, and what its channels mean: positions in the parent's frame and rotations.

Everything here is in the file's own unit and axes.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby

import torch
from torch import Tensor

from hopdiff.geometry.euler import joined_euler
from hopdiff.geometry.rotation import euler_to_matrix
from hopdiff.types import HopdiffError

CHANNEL = re.compile(r"([xyz])[ _-]?(?:(pos(?:ition)?|trans(?:lation)?)|rot(?:ation)?)", re.IGNORECASE)
EXPRESSIBLE_DEG = 1e-3  # by how much channels may miss a rotation
SURE_DEG = 1e-9  # rounding of the arithmetic


@dataclass(frozen=True)
class BvhJoint:
    """One joint as the file has it.

    name, channels: as written. parent: index, -1 for the root. offset, end_sites: in file units, in the joint's
    parent's and in its own frame.
    """

    name: str
    parent: int
    offset: tuple[float, float, float]
    channels: tuple[str, ...]
    end_sites: tuple[tuple[float, float, float], ...] = ()

    @property
    def places(self) -> dict[int, int]:
        """Axis (0 to 2) -> channel, of the position channels."""
        kinds = enumerate(map(channel_kind, self.channels))
        return {"XYZ".index(kind[1]): at for at, kind in kinds if kind and kind[0] == "position"}

    @property
    def turns(self) -> list[int]:
        """The rotation channels, in their order."""
        kinds = enumerate(map(channel_kind, self.channels))
        return [at for at, kind in kinds if kind and kind[0] == "rotation"]

    @property
    def order(self) -> str:
        """Axes of the rotation channels, any number of letters."""
        kinds = (channel_kind(self.channels[at]) for at in self.turns)
        return "".join(kind[1] for kind in kinds if kind)


def channel_kind(name: str) -> tuple[str, str] | None:
    """("position" or "rotation", "X", "Y" or "Z") of a channel name in any case, None for what is no channel."""
    match = CHANNEL.fullmatch(name)
    return ("position" if match.group(2) else "rotation", match.group(1).upper()) if match else None


def columns(joints: Sequence[BvhJoint]) -> list[int]:
    """The first column of each joint in the rows of numbers, and how many columns there are."""
    first = [0]
    for joint in joints:
        first.append(first[-1] + len(joint.channels))
    return first


def offsets_of(joints: Sequence[BvhJoint], values: Tensor) -> Tensor:
    """(T, J, 3) position of each joint in its parent's frame; position channels take the place of OFFSET."""
    rest = torch.tensor([joint.offset for joint in joints], dtype=values.dtype)
    offsets = rest.expand(len(values), *rest.shape).clone()
    for at, (joint, column) in enumerate(zip(joints, columns(joints), strict=False)):
        for axis, channel in joint.places.items():
            offsets[:, at, axis] = values[:, column + channel]
    return offsets


def rotations_of(joints: Sequence[BvhJoint], values: Tensor) -> Tensor:
    """(T, J, 3, 3) rotation of each joint in its parent's frame; values hold degrees."""
    first = columns(joints)
    rotations = values.new_empty(len(values), len(joints), 3, 3)
    orders = [joint.order for joint in joints]
    for order in set(orders):
        alike = [at for at, other in enumerate(orders) if other == order]
        channels = [[first[at] + channel for channel in joints[at].turns] for at in alike]
        index = torch.tensor(channels, dtype=torch.long).reshape(len(alike), len(order))
        rotations[:, alike] = euler_to_matrix(torch.deg2rad(values[:, index]), order)
    return rotations


def encode(
    joints: Sequence[BvhJoint], offsets: Tensor, rotations: Tensor, old: Tensor, decimals: int
) -> tuple[Tensor, bool]:
    """Numbers (T, C) of a motion in the channels of a file, and whether any is new.

    offsets (T, J, 3), rotations (T, J, 3, 3): what the channels shall express. old: (T0, C), the file's numbers. What
    differs from them by less than half a unit of the last of `decimals` stays as it is if T is T0; new numbers are
    rounded to `decimals`. Raises HopdiffError, naming joint and frame, where a joint lacks the channels.
    """
    same_frames = len(old) == len(rotations)
    values = old.clone() if same_frames else old[:1].repeat(len(rotations), 1)
    last_digit = 0.5 * 10.0**-decimals
    before = rotations_of(joints, old) if same_frames else None
    for at, (joint, column) in enumerate(zip(joints, columns(joints), strict=False)):
        _put_places(joint, values[:, column : column + len(joint.channels)], offsets[:, at], last_digit)
        if before is None:
            kept = torch.zeros(len(values), dtype=torch.bool)
        else:
            # A small turn changes the nine numbers of a matrix by sqrt(2) times its angle, in the root of squares.
            change = torch.linalg.matrix_norm(rotations[:, at] - before[:, at]) / math.sqrt(2)
            kept = change <= math.radians(max(last_digit, SURE_DEG))
        if not bool(kept.all()):
            turns = [column + channel for channel in joint.turns]
            values[:, turns] = _turned(joint, rotations[:, at], values[:, turns], kept)
    if same_frames:
        small = (values - old).abs() <= last_digit + 4 * torch.finfo(old.dtype).eps * old.abs()
        rounded = torch.where(small, old, values.round(decimals=decimals))
        return rounded, not bool(small.all())
    return values.round(decimals=decimals), True


def _put_places(joint: BvhJoint, channels: Tensor, offsets: Tensor, tolerance: float) -> None:
    """Write positions (T, 3) into the channels (T, n) of a joint, in place."""
    for axis in range(3):
        if axis in joint.places:
            channels[:, joint.places[axis]] = offsets[:, axis]
            continue
        miss = (offsets[:, axis] - joint.offset[axis]).abs()
        allowed = max(tolerance, 1e-6 * max(map(abs, joint.offset)))
        if bool((miss > allowed).any()):
            frame, name = int((miss > allowed).int().argmax()), "XYZ"[axis]
            raise HopdiffError(
                f"joint {joint.name!r} has no channel {name}position, so it cannot be moved as frame {frame} needs."
            )


def _turned(joint: BvhJoint, rotations: Tensor, old: Tensor, kept: Tensor) -> Tensor:
    """Rotation channels (T, n) [degrees] of a joint that give rotations (T, 3, 3), near the old ones."""
    # Neighbours about one axis act as one; the first of them takes what changes.
    runs = [[at for at, _ in run] for _, run in groupby(enumerate(joint.order), key=lambda pair: pair[1])]
    used, spare = runs[:3], [at for run in runs[3:] for at in run]
    order = "".join(joint.order[run[0]] for run in used)
    angles = torch.deg2rad(old)
    goal = rotations
    if spare:
        rest = euler_to_matrix(angles[:, spare], "".join(joint.order[at] for at in spare))
        goal = rotations @ rest.transpose(-1, -2)
    sums = torch.stack([angles[:, run].sum(dim=-1) for run in used], dim=-1) if used else angles[:, :0]
    solved = joined_euler(goal, order, sums, kept) if used else sums
    miss = torch.linalg.matrix_norm(euler_to_matrix(solved, order) - goal) / math.sqrt(2)
    missed = (miss > math.radians(EXPRESSIBLE_DEG)) & ~kept
    if bool(missed.any()):
        frame = int(missed.int().argmax())
        have = ", ".join(joint.channels[at] for at in joint.turns) or "none"
        raise HopdiffError(
            f"joint {joint.name!r} cannot be turned as frame {frame} needs: its rotation channels are {have}"
            f" (off by {math.degrees(float(miss[frame])):.3g} degrees)."
        )
    new = old.clone()
    for at, run in enumerate(used):
        changed = torch.rad2deg(solved[:, at]) - old[:, run[1:]].sum(dim=-1)
        new[:, run[0]] = torch.where(kept, old[:, run[0]], changed)
    return new
