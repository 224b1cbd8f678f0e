"""Write a clip as a BVH file: y up, facing +z, angles in degrees."""

from __future__ import annotations

import math
import os
import re

import numpy as np
import torch
from torch import Tensor

from hopdiff.geometry.clip import Clip
from hopdiff.geometry.rotation import matrix_to_euler, unwrap
from hopdiff.geometry.skeleton import Skeleton
from hopdiff.io.files import write_whole
from hopdiff.types import HopdiffError

EULER_ORDERS = ("XYZ", "XZY", "YXZ", "YZX", "ZXY", "ZYX")


def write_bvh(path: str | os.PathLike[str], clip: Clip, order: str = "ZXY", unit: float = 1.0) -> None:
    """Write a clip as BVH; the file appears whole or not at all.

    order: Euler order of every joint's channels. unit: file units in a metre (1 writes metres, 100 centimetres).
    Positions are written to a micrometre or finer, angles to 1e-6 degrees and without jumps along time. The root has
    no offset of its own, so readers that add it to the root channels and readers that do not agree.
    Raises HopdiffError for an unknown order, a unit that is not positive, numbers that are not finite, joint names
    that are the same once blanks are replaced, or a file that cannot be written.
    """
    if order not in EULER_ORDERS:
        raise HopdiffError(f"BVH order must be one of {', '.join(EULER_ORDERS)}, not {order!r}.")
    if not (math.isfinite(unit) and unit > 0):
        raise HopdiffError(f"BVH unit must be a positive number of file units in a metre, not {unit}.")
    if not (torch.isfinite(clip.root_position).all() and torch.isfinite(clip.rotations).all()):
        raise HopdiffError(f"cannot write {path}: the motion holds a number that is not finite.")
    if not (math.isfinite(clip.frame_time) and clip.frame_time > 0):
        raise HopdiffError(f"cannot write {path}: the time between frames must be positive, not {clip.frame_time}.")
    decimals = 6 + max(0, math.ceil(-math.log10(unit)))
    joints = _depth_first(clip.skeleton)
    head = _hierarchy(clip.skeleton, joints, order, unit, decimals)
    head += ["MOTION", f"Frames: {clip.frames}", f"Frame Time: {clip.frame_time:.10f}"]
    write_whole(path, "\n".join(head + _frames(clip, joints, order, unit, decimals)) + "\n")


def continuous_euler(rotations: Tensor, order: str) -> Tensor:
    """Euler angles that follow a motion without flips.

    rotations: (T, ..., 3, 3). Returns (T, ..., 3) [rad], each frame the nearest to its predecessor of all triples
    that mean the same rotation: besides full turns, (a, b, c) and (a + pi, pi - b, c + pi) are one rotation. A knee
    that bends past a right angle about the middle axis needs the second form.
    """
    near = matrix_to_euler(rotations, order)
    half_turn = torch.full_like(near[..., 0], math.pi)
    far = torch.stack((near[..., 0] + half_turn, half_turn - near[..., 1], near[..., 2] + half_turn), dim=-1)
    # Whether a frame changes form with respect to its predecessor does not depend on which form that one has.
    changes = _turn_distance(far[1:], near[:-1]) < _turn_distance(near[1:], near[:-1])
    first = torch.zeros_like(near[:1, ..., 0], dtype=torch.bool)
    use_far = torch.cat((first, torch.cumsum(changes, dim=0) % 2 == 1))
    return unwrap(torch.where(use_far[..., None], far, near))


def _turn_distance(a: Tensor, b: Tensor) -> Tensor:
    """Sum over the three angles of the distance between two triples, full turns left out."""
    turn = 2 * math.pi
    return (torch.remainder(a - b + math.pi, turn) - math.pi).abs().sum(dim=-1)


def _depth_first(skeleton: Skeleton) -> list[int]:
    """Joint indices in the order in which a BVH file lists them."""
    joints, waiting = [], [0]
    while waiting:
        joints.append(waiting.pop())
        waiting += reversed(skeleton.children(joints[-1]))
    return joints


def _hierarchy(skeleton: Skeleton, joints: list[int], order: str, unit: float, decimals: int) -> list[str]:
    names = [re.sub(r"\s+", "_", name.strip()) for name in skeleton.names]
    if len(set(names)) < len(names):
        twice = next(name for name in names if names.count(name) > 1)
        raise HopdiffError(f"BVH needs different joint names, but {twice!r} occurs twice.")
    rotations = " ".join(f"{axis}rotation" for axis in order)
    depth = {-1: -1}
    lines, open_braces = ["HIERARCHY"], 0

    def close(level: int) -> None:
        nonlocal open_braces
        while open_braces > level:
            open_braces -= 1
            lines.append("  " * open_braces + "}")

    def offset(values: Tensor) -> str:
        return "OFFSET " + " ".join(f"{value * unit + 0.0:.{decimals}f}" for value in values.tolist())

    for joint in joints:
        depth[joint] = level = depth[skeleton.parents[joint]] + 1
        close(level)
        outer, inner = "  " * level, "  " * (level + 1)
        is_root = joint == 0
        place = torch.zeros(3) if is_root else skeleton.offsets[joint]
        position = "Xposition Yposition Zposition " if is_root else ""
        lines += [outer + ("ROOT " if is_root else "JOINT ") + names[joint], outer + "{", inner + offset(place)]
        lines += [f"{inner}CHANNELS {6 if is_root else 3} {position}{rotations}"]
        open_braces = level + 1
        if not skeleton.children(joint):
            end = skeleton.end_sites.get(skeleton.names[joint], torch.zeros(3))
            lines += [inner + "End Site", inner + "{", inner + "  " + offset(end), inner + "}"]
    close(0)
    return lines


def _frames(clip: Clip, joints: list[int], order: str, unit: float, decimals: int) -> list[str]:
    """One line of numbers a frame."""
    root = (clip.root_position.detach().double() * unit).cpu().numpy().round(decimals)
    angles = torch.rad2deg(continuous_euler(clip.rotations[:, joints].detach().double(), order))
    degrees = angles.reshape(clip.frames, -1).cpu().numpy().round(6)
    line = " ".join([f"%.{decimals}f"] * 3 + ["%.6f"] * degrees.shape[1])
    rows = np.concatenate((root, degrees), axis=1) + 0.0  # + 0.0 turns -0.0 into 0.0
    return [line % tuple(row) for row in rows.tolist()]
