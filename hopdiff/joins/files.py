"""Clips before and after a walk, read as clips of the walk's skeleton, and the one file that all three become."""

from __future__ import annotations

import os
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from hopdiff.geometry.clip import Clip
from hopdiff.geometry.quaternion import slerp
from hopdiff.io.bvh import read_bvh
from hopdiff.io.bvh_channels import BvhJoint
from hopdiff.io.bvh_file import BvhFile
from hopdiff.io.bvh_layout import Layout
from hopdiff.types import HopdiffError

SAME_BONE = 2e-3  # of the longest bone by which bones may differ
SAME_TIME = 1e-3  # of the time between frames


@dataclass(frozen=True, eq=False)
class Neighbour:
    """name: for people. clip: of the walk's skeleton and frame time. values: (T, C) its numbers in the channels of the
    walk's file. layout: how these are written in its own file, None where they are others. notes: for the user."""

    name: str
    clip: Clip
    values: Tensor
    layout: Layout | None
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class Neighbours:
    """The clips before and after a walk; at least one."""

    before: Neighbour | None
    after: Neighbour | None

    @property
    def two(self) -> tuple[Clip | None, Clip | None]:
        return None if self.before is None else self.before.clip, None if self.after is None else self.after.clip

    def seams(self, frames: int) -> list[int]:
        """The last frame of the clip before and the first of the clip after, in so many frames of all."""
        before, after = self.two
        ends = [] if before is None else [before.frames - 1]
        return ends if after is None else [*ends, frames - after.frames]

    @property
    def clips(self) -> list[Clip]:
        return [one.clip for one in (self.before, self.after) if one is not None]

    @property
    def notes(self) -> list[str]:
        return [note for one in (self.before, self.after) if one is not None for note in one.notes]


def read_neighbour(path: str | os.PathLike[str], walk: BvhFile, walk_name: str) -> Neighbour:
    """A clip before or after a walk, in the scene as it is written.

    Unit and up axis are those with which its bones are as long, and lie, as the walk's. Another frame rate becomes the
    walk's. Raises HopdiffError, naming the file, for one that cannot be read or is of another skeleton.
    """
    name = Path(path).name
    file = _alike(read_bvh(path, walk.unit, walk.up), walk, name, walk_name)
    notes: tuple[str, ...] = ()
    layout = None if file.layout is None else file.layout[1]
    if not _same_channels(file, walk):
        if file.carrier or walk.carrier:
            raise HopdiffError(
                f"{name} has other channels than {walk_name}, and joint {walk.names[walk.carrier]!r} there carries the"
                " body in place of the root: write both with the same channels."
            )
        clip = replace(file.clip(), skeleton=walk.skeleton())
        if walk.clip().offsets is None:
            clip = replace(clip, offsets=None)
        file = walk.with_motion(replace(clip, frame_time=walk.frame_time))
        file, layout = replace(file, frame_time=clip.frame_time), None
    if abs(file.frame_time - walk.frame_time) > SAME_TIME * walk.frame_time:
        clip = _resampled(_clip(walk, file.values), file.frame_time, walk.frame_time)
        notes += (
            f"{name} has {1.0 / file.frame_time:.6g} frames a second, and now {1.0 / walk.frame_time:.6g} as"
            f" {walk_name} has.",
        )
        file, layout = walk.with_motion(clip), None
    return Neighbour(name, _clip(walk, file.values), file.values, layout, notes)


def _clip(walk: BvhFile, values: Tensor) -> Clip:
    """The motion of some rows; how a body stands is read from the walk's first."""
    return replace(walk, values=torch.cat((walk.values[:1], values))).clip().part(slice(1, None))


def together(walk: BvhFile, clip: Clip, neighbours: Neighbours) -> BvhFile:
    """The walk's file with the motion of all three: rows of the clips before and after as they are.

    clip: all of it. Raises HopdiffError where the motion needs channels that the file lacks.
    """
    before, after = neighbours.before, neighbours.after
    head = 0 if before is None else len(before.values)
    tail = 0 if after is None else len(after.values)
    # Angles of the walk go on from those before.
    known = [walk.values[:1], *([] if before is None else [before.values[-1:]])]
    at = slice(head - (before is not None), clip.frames - tail)
    own = clip.part(at)
    first = walk.clip().part(slice(0, 1))
    whole = replace(
        own,
        root_position=torch.cat((first.root_position, own.root_position)),
        rotations=torch.cat((first.rotations, own.rotations)),
        offsets=None if own.offsets is None or first.offsets is None else torch.cat((first.offsets, own.offsets)),
    )
    rows = torch.cat((*known, known[-1].expand(clip.frames - tail - head, -1)))
    made = replace(walk, values=rows).with_motion(whole)
    new = made.values[len(known) :]
    parts = [one.values for one in (before,) if one is not None] + [new]
    parts += [] if after is None else [after.values]
    decimals = max(made.decimals, *(_decimals(one) for one in (before, after)))
    found = replace(made, values=torch.cat(parts), decimals=decimals)
    return replace(found, layout=_layout(walk, before, new, after))


def _decimals(one: Neighbour | None) -> int:
    """With how many a clip's numbers are written at most, so that none is cut short."""
    if one is None:
        return 0
    values = one.values
    return next((d for d in range(6, 15) if bool(torch.equal(values.round(decimals=d), values))), 15)


def _layout(
    walk: BvhFile, before: Neighbour | None, new: Tensor, after: Neighbour | None
) -> tuple[tuple[BvhJoint, ...], Layout] | None:
    """How the file is written: its head is the walk's, rows of the others stand as in their files."""
    if walk.layout is None:
        return None
    joints, own = walk.layout
    lines, values = [], []
    for one in (before, new, after):
        if one is None:
            continue
        layout = None if isinstance(one, Tensor) else one.layout
        written = [] if layout is None else [line for line in layout.rows.splitlines() if line.strip()]
        if layout is not None and len(written) == len(layout.values):
            lines += written
            values.append(layout.values)
        else:
            # Not a number is never what a row says: it is written anew.
            count = len(one if isinstance(one, Tensor) else one.values)
            lines += [b"0"] * count
            values.append(np.full((count, new.shape[1]), np.nan))
    return joints, replace(own, rows=own.line_end.join(lines) + own.line_end, values=np.concatenate(values))


def _alike(file: BvhFile, walk: BvhFile, name: str, walk_name: str) -> BvhFile:
    """The file read with the unit and the axis that make its bones the walk's. Raises HopdiffError if none do."""
    if file.names != walk.names:
        own = [
            (at, here, there)
            for at, (here, there) in enumerate(zip(file.names, walk.names, strict=False))
            if here != there
        ]
        what = (
            f"joint {own[0][0] + 1} is {own[0][1]!r}, there {own[0][2]!r}"
            if own
            else f"it has {len(file.names)} joints, there are {len(walk.names)}"
        )
        raise HopdiffError(f"{name} has another skeleton than {walk_name}: {what}.")
    if [one.parent for one in file.joints] != [one.parent for one in walk.joints]:
        raise HopdiffError(f"{name} has another skeleton than {walk_name}: its joints hang on others.")
    wanted = walk.whole_skeleton().offsets[1:]
    size = float(wanted.norm(dim=-1).sum())
    own_size = float(file.whole_skeleton().offsets[1:].norm(dim=-1).sum())
    scale = size / own_size if own_size > 0 else 1.0
    unit = walk.unit if abs(scale - 1.0) < SAME_BONE else walk.unit * scale
    tried = [replace(file, unit=unit, up=up) for up in (walk.up, "z" if walk.up == "y" else "y")]
    off = [(one.whole_skeleton().offsets[1:] - wanted).norm(dim=-1) for one in tried]
    best = min((0, 1), key=lambda k: float(off[k].max()))
    longest = float(wanted.norm(dim=-1).max())
    if float(off[best].max()) > SAME_BONE * longest:
        worst = int(off[best].argmax())
        raise HopdiffError(
            f"{name} has another skeleton than {walk_name}: the bone to {walk.names[worst + 1]!r} is"
            f" {1000 * float(off[best][worst]):.0f} mm off (lengths apart from the unit, or directions)."
        )
    return replace(tried[best], carrier=walk.carrier)


def _same_channels(file: BvhFile, walk: BvhFile) -> bool:
    """Whether rows of the one mean in the other what they mean."""
    same = all(a.channels == b.channels for a, b in zip(file.joints, walk.joints, strict=True))
    return same and file.up == walk.up and abs(file.unit / walk.unit - 1.0) < 1e-9


def _resampled(clip: Clip, old: float, new: float) -> Clip:
    """The clip with another time between frames [s]; its first frame stays, and its last if it falls on one."""
    times = torch.arange(clip.frames, dtype=torch.float64) * old
    wanted = torch.arange(int((float(times[-1]) + 1e-6 * new) / new) + 1, dtype=torch.float64) * new
    wanted = wanted.clamp_max(float(times[-1]))
    if clip.frames < 2:
        return replace(clip, frame_time=new)
    after = torch.searchsorted(times, wanted).clamp(1, clip.frames - 1)
    share = (wanted - times[after - 1]) / old
    share_of = share[:, None]
    root = torch.lerp(clip.root_position[after - 1], clip.root_position[after], share_of)
    rotations = slerp(clip.rotations[after - 1], clip.rotations[after], share_of)
    offsets = clip.offsets
    if offsets is not None:
        offsets = torch.lerp(offsets[after - 1], offsets[after], share[:, None, None])
    return replace(clip, root_position=root, rotations=rotations, offsets=offsets, frame_time=new)
