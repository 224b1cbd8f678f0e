"""A clip led along a drawn curve: which frame has to be where."""

from __future__ import annotations

import math

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d
from torch import Tensor

from hopdiff.editing.root_path import RootPath
from hopdiff.editing.targets import Constraint
from hopdiff.geometry.curve import PlaneCurve

CENTRE = 0.4  # s; a walker's sway and surge are gone from a path averaged over this (standard deviation)
APART = 0.2  # s between frames that are bound to the curve
MOST = 60  # of them; the time of the solution grows with their square
TAIL = 4.0  # standard deviations


def follow(path: RootPath, frame_time: float, curve: PlaneCurve) -> tuple[RootPath, list[Constraint]]:
    """A clip's path laid along a curve, from end to end, and the constraints that hold it there.

    The middle line of the path, without the sway of each step, is laid on the curve, each frame at its share of the
    length; sway and the angle between way and facing stay as they are, so that a sideways walk stays one. The steps of
    the path as it is laid are squeezed in bends; `edit_path` with it as a guess brings them back to what they were.
    """
    middle = middle_line(path.place, frame_time)
    moved = middle.diff(dim=0)
    way = torch.cat((torch.zeros(1, dtype=middle.dtype), moved.norm(dim=-1).cumsum(0)))
    # Where the body stands, the way has the direction that it had or will have.
    direction = _direction(moved, path.yaw)
    frames = bound_frames(path.frames, frame_time)
    arc = curve.length * way / way[-1].clamp_min(1e-9)
    heading = curve.heading(arc)
    turn = heading - direction
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


def middle_line(place: Tensor, frame_time: float) -> Tensor:
    """A path (T, 2) averaged over time; mirrored about its ends, which stay where they are."""
    width = CENTRE / frame_time
    points: NDArray[np.float64] = place.detach().cpu().numpy()
    reach = min(len(points) - 1, math.ceil(TAIL * width))
    head, tail = 2.0 * points[0] - points[reach:0:-1], 2.0 * points[-1] - points[-2 : -reach - 2 : -1]
    longer = gaussian_filter1d(np.concatenate((head, points, tail)), width, axis=0, truncate=TAIL)
    return torch.from_numpy(longer[reach : reach + len(points)].copy())


def _direction(moved: Tensor, yaw: Tensor) -> Tensor:
    """(T,) direction of the way (T - 1, 2), from +z towards +x without jumps [rad]; that of the body if it stands."""
    pace = moved.norm(dim=-1)
    going = (pace > 0.1 * pace.max()).numpy()
    if not going.any() or float(pace.max()) < 1e-9:
        return yaw
    angle = np.unwrap(torch.atan2(moved[going, 0], moved[going, 1]).numpy())
    # A step lies between two frames.
    at = np.flatnonzero(going) + 0.5
    return torch.from_numpy(np.interp(np.arange(len(yaw)), at, angle))
