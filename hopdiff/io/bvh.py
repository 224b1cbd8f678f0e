"""Read BVH files of any make, and write clips as BVH: y up, facing +z, angles in degrees."""

from __future__ import annotations

import math
import os
import re
from dataclasses import replace

import numpy as np
import torch

from hopdiff.geometry.clip import Clip
from hopdiff.geometry.euler import continuous_euler
from hopdiff.geometry.skeleton import Skeleton
from hopdiff.io.bvh_carrier import above_of, below_of, carrier_of
from hopdiff.io.bvh_channels import BvhJoint, columns
from hopdiff.io.bvh_file import AXES, BvhFile
from hopdiff.io.bvh_guess import guess_unit, guess_up, unit_of, up_of
from hopdiff.io.bvh_parse import parse_bvh, read_bytes
from hopdiff.messages import plural
from hopdiff.types import HopdiffError

__all__ = ["EULER_ORDERS", "BvhFile", "BvhJoint", "continuous_euler", "read_bvh", "write_bvh"]

EULER_ORDERS = ("XYZ", "XZY", "YXZ", "YZX", "ZXY", "ZYX")


def read_bvh(path: str | os.PathLike[str], unit: float | str | None = None, up: str | None = None) -> BvhFile:
    """Read a BVH file.

    unit: metres in a file unit, or m, cm, mm, inch or cmu (0.0254 / 0.45 m); None guesses it from the length of
    the legs. up: "y" or "z"; None guesses it from where head, feet and ground are. The file's notes
    tell what was mended, and where joint 0 of the clip is not the root.
    Raises HopdiffError, naming file and line, for a file that is not a whole, sensible BVH file with one skeleton, and
    for a unit or axis that there is not.
    """
    metres = None if unit is None else unit_of(unit)
    axis = None if up is None else up_of(up)
    parsed = parse_bvh(read_bytes(path), str(path))
    values = torch.from_numpy(parsed.values)
    axis = axis or guess_up(parsed.joints, values)
    metres = metres or guess_unit(parsed.joints, values, axis)
    decimals = (parsed.decimals, parsed.offset_decimals)
    file = BvhFile(parsed.joints, values, parsed.frame_time, *decimals, metres, axis, parsed.encoding)
    layout = None if parsed.layout is None else (parsed.joints, parsed.layout)
    return with_carrier(replace(file, notes=parsed.notes, layout=layout))


def with_carrier(file: BvhFile) -> BvhFile:
    """The file with the joint that carries its body found, and a note for the user if that is not the root."""
    carrier = carrier_of(file.joints, file.whole_skeleton(), file.moving)
    if not carrier:
        return file
    found = replace(file, carrier=carrier)
    names, taken = file.names, {*above_of(file.joints, carrier), *below_of(file.joints, carrier)}
    note = f"the way is that of joint {names[carrier]!r}, not of {names[0]!r}, which does not carry the body."
    first = columns(file.joints)
    moved = (file.values != file.values[:1]).any(dim=0)
    left = [names[at] for at in range(len(names)) if at not in taken and bool(moved[first[at] : first[at + 1]].any())]
    also = f" {plural(len(left), 'moving joint')} beside it, {left[0]!r} first, stay as they are." if left else ""
    return replace(found, notes=(*file.notes, note + also))


def write_bvh(path: str | os.PathLike[str], clip: Clip, order: str = "ZXY", unit: float = 1.0, up: str = "y") -> None:
    """Write a clip as BVH; the file appears whole or not at all.

    order: Euler order of every joint's channels. unit: file units in a metre (1 writes metres, 100 centimetres). up:
    the file's axis that points up; with z the body faces the file's -y. Positions are written to a micrometre or
    finer, angles to 1e-6 degrees and without jumps along time. The root has no offset of its own, so readers that add
    it to the root channels and readers that do not agree; joints that move against their parents have position
    channels, which take the place of their offset.
    Raises HopdiffError for an unknown order, a unit that is not positive, a motion without frames, numbers that are
    not finite, joint names that are the same once blanks are replaced, or a file that cannot be written.
    """
    if order not in EULER_ORDERS:
        raise HopdiffError(f"BVH order must be one of {', '.join(EULER_ORDERS)}, not {order!r}.")
    if not (math.isfinite(unit) and unit > 0):
        raise HopdiffError(f"BVH unit must be a positive number of file units in a metre, not {unit}.")
    if clip.frames == 0:
        raise HopdiffError(f"cannot write {path}: the motion has no frames.")
    moving = clip.skeleton.offsets if clip.offsets is None else clip.offsets
    if not all(bool(torch.isfinite(values).all()) for values in (clip.root_position, clip.rotations, moving)):
        raise HopdiffError(f"cannot write {path}: the motion holds a number that is not finite.")
    if not (math.isfinite(clip.frame_time) and clip.frame_time > 0):
        raise HopdiffError(f"cannot write {path}: the time between frames must be positive, not {clip.frame_time}.")
    axes = torch.tensor(AXES[up_of(up)], dtype=torch.float64)
    decimals = 6 + max(0, math.ceil(-math.log10(unit)))
    numbering = _depth_first(clip.skeleton)
    # Rows of places and columns of rotations, in the file's axes.
    places = (moving.detach().double().cpu() @ axes * unit).expand(clip.frames, -1, -1)
    root = clip.root_position.detach().double().cpu() @ axes * unit
    rotations = axes.T @ clip.rotations[:, numbering].detach().double().cpu() @ axes
    angles = torch.rad2deg(continuous_euler(rotations, order)).round(decimals=6)
    free = [joint == 0 or bool((places[:, joint] != places[0, joint]).any()) for joint in range(len(numbering))]
    joints = _joints(clip.skeleton, numbering, order, axes * unit, decimals, free)
    columns = []
    for at, joint in enumerate(numbering):
        if free[joint]:
            columns.append((root if joint == 0 else places[:, joint]).round(decimals=decimals))
        columns.append(angles[:, at])
    values = torch.cat(columns, dim=1)
    frame_time = round(clip.frame_time, 10) or clip.frame_time
    BvhFile(joints, values, frame_time, decimals, decimals, 1.0 / unit, up_of(up)).write(path)


def _depth_first(skeleton: Skeleton) -> list[int]:
    """Joint indices in the order in which a BVH file lists them."""
    joints, waiting = [], [0]
    while waiting:
        joints.append(waiting.pop())
        waiting += reversed(skeleton.children(joints[-1]))
    return joints


def _joints(
    skeleton: Skeleton, numbering: list[int], order: str, axes: torch.Tensor, decimals: int, free: list[bool]
) -> tuple[BvhJoint, ...]:
    """A skeleton as the joints of a file: six channels for the free ones, three for the others, all ends closed.

    axes: (3, 3), takes places in metres (as rows) into the file's axes and units.
    """
    names = [re.sub(r"\s+", "_", name.strip()) for name in skeleton.names]
    if len(set(names)) < len(names):
        twice = next(name for name in names if names.count(name) > 1)
        raise HopdiffError(f"BVH needs different joint names, but {twice!r} occurs twice.")
    rotations = tuple(f"{axis}rotation" for axis in order)
    nowhere = torch.zeros(3, dtype=torch.float64)

    def place(metres: torch.Tensor) -> tuple[float, float, float]:
        x, y, z = np.round((metres.detach().double().cpu() @ axes.double()).numpy(), decimals).tolist()
        return x, y, z

    joints = []
    for joint in numbering:
        parent, name = skeleton.parents[joint], skeleton.names[joint]
        channels = ("Xposition", "Yposition", "Zposition", *rotations) if free[joint] else rotations
        leaf = not skeleton.children(joint)
        ends = (place(skeleton.end_sites.get(name, nowhere)),) if leaf else ()
        offset = place(nowhere if parent < 0 else skeleton.offsets[joint])
        joints.append(BvhJoint(names[joint], -1 if parent < 0 else numbering.index(parent), offset, channels, ends))
    return tuple(joints)
