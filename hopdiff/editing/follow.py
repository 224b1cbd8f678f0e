"""A clip led along a drawn curve: which frame has to be where."""

from __future__ import annotations

import torch

from hopdiff.editing.course import middle_line, turn_onto
from hopdiff.editing.root_path import RootPath
from hopdiff.editing.targets import Constraint
from hopdiff.geometry.curve import PlaneCurve

APART = 0.2  # s between frames that are bound to the curve
MOST = 60  # of them; the time of the solution grows with their square


def follow(path: RootPath, frame_time: float, curve: PlaneCurve) -> tuple[RootPath, list[Constraint]]:
    """A clip's path laid along a curve, from end to end, and the constraints that hold it there.

    The middle line of the path, without the sway of each step, is laid on the curve, each frame at its share of the
    length; sway and the angle between way and facing stay as they are, so that a sideways walk stays one. The steps of
    the path as it is laid are squeezed in bends; `edit_path` with it as a guess brings them back to what they were.
    """
    middle = middle_line(path.place, frame_time)
    moved = middle.diff(dim=0)
    way = torch.cat((torch.zeros(1, dtype=middle.dtype), moved.norm(dim=-1).cumsum(0)))
    frames = bound_frames(path.frames, frame_time)
    arc = curve.length * way / way[-1].clamp_min(1e-9)
    heading = curve.heading(arc)
    # One who only stands faces along the curve.
    turn = turn_onto(middle, heading, frame_time) if float(way[-1]) > 1e-6 else heading - path.yaw
    sway = path.place - middle
    c, s = torch.cos(turn), torch.sin(turn)
    x, z = sway.unbind(-1)
    place = curve.position(arc) + torch.stack((c * x + s * z, c * z - s * x), dim=-1)
    yaw = path.yaw + turn
    bound = [Constraint(k, (float(place[k, 0]), float(place[k, 1])), float(yaw[k])) for k in frames]
    return RootPath(place, yaw), bound


def bound_frames(frames: int, frame_time: float) -> list[int]:
    """First and last frame and some in between, evenly."""
    pieces = min(max(1, round((frames - 1) * frame_time / APART)), MOST, frames - 1)
    return sorted({round(k * (frames - 1) / pieces) for k in range(pieces + 1)})
