"""Where a body goes, as against where it faces: the way without the sway and surge of its steps."""

from __future__ import annotations

import math

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d
from torch import Tensor

from hopdiff.editing.root_path import RootPath

CENTRE = 0.4  # s; a walker's sway and surge are gone from a path averaged over this (standard deviation)
TAIL = 4.0  # standard deviations


def course_of(path: RootPath, frame_time: float) -> Tensor:
    """(T,) direction of the way against where the body faces: 0 straight ahead, to the left above 0 [rad]."""
    return direction_of(middle_line(path.place, frame_time).diff(dim=0), path.yaw) - path.yaw


def middle_line(place: Tensor, frame_time: float) -> Tensor:
    """A path (T, 2) averaged over time; mirrored about its ends, which stay where they are."""
    width = CENTRE / frame_time
    points: NDArray[np.float64] = place.detach().cpu().numpy()
    reach = min(len(points) - 1, math.ceil(TAIL * width))
    head, tail = 2.0 * points[0] - points[reach:0:-1], 2.0 * points[-1] - points[-2 : -reach - 2 : -1]
    longer = gaussian_filter1d(np.concatenate((head, points, tail)), width, axis=0, truncate=TAIL)
    return torch.from_numpy(longer[reach : reach + len(points)].copy())


def direction_of(moved: Tensor, yaw: Tensor) -> Tensor:
    """(T,) direction of the way (T - 1, 2), from +z towards +x without jumps [rad]; that of the body if it stands."""
    pace = moved.norm(dim=-1)
    going = (pace > 0.1 * pace.max()).numpy()
    if not going.any() or float(pace.max()) < 1e-9:
        return yaw
    angle = np.unwrap(torch.atan2(moved[going, 0], moved[going, 1]).numpy())
    # A step lies between two frames.
    at = np.flatnonzero(going) + 0.5
    return torch.from_numpy(np.interp(np.arange(len(yaw)), at, angle))
