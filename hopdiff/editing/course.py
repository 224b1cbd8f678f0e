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
SURE = 2.0  # power of the speed with which a direction counts
TAIL = 4.0  # standard deviations


def course_of(path: RootPath, frame_time: float) -> Tensor:
    """(T,) direction of the way against where the body faces: 0 straight ahead, to the left above 0 [rad]."""
    way = going(middle_line(path.place, frame_time))
    return calm_angle(way * torch.polar(way.abs(), -path.yaw), frame_time)


def turn_onto(middle: Tensor, heading: Tensor, frame_time: float) -> Tensor:
    """(T,) turns about y that lay a way (T, 2) along headings (T,) [rad].

    An about-turn on the spot, in which the way says nothing of where a body faces, is gone over slowly.
    """
    way = going(middle)
    # Where a body hardly goes its sway says little of a way.
    return calm_angle(way.conj() * torch.polar(way.abs() ** SURE, heading), frame_time)


def going(middle: Tensor) -> Tensor:
    """(T,) complex: the step along a way (T, 2) about every frame, z + i x, as a share of the largest."""
    moved = middle.diff(dim=0)
    moved = torch.cat((moved, moved[-1:])) + torch.cat((moved[:1], moved))
    way = torch.complex(moved[:, 1], moved[:, 0])
    return way / way.abs().max().clamp_min(1e-9)


def calm_angle(turns: Tensor, frame_time: float) -> Tensor:
    """(T,) angles of complex numbers (T,), averaged over time by their sizes, without jumps [rad]; 0 if all are 0."""
    if float(turns.abs().max()) < 1e-9:
        return torch.zeros_like(turns.real)
    numbers, width = turns.resolve_conj().numpy(), CENTRE / frame_time
    reach = min(len(numbers) - 1, math.ceil(TAIL * width))
    # Mirrored about both ends, so that a steady turn goes on there.
    head, tail = (
        end * end / max(abs(end) ** 2, 1e-24) * part.conj()
        for end, part in ((numbers[0], numbers[reach:0:-1]), (numbers[-1], numbers[-2 : -reach - 2 : -1]))
    )
    mean = gaussian_filter1d(np.concatenate((head, numbers, tail)), width, truncate=TAIL)
    angle = gaussian_filter1d(np.unwrap(np.angle(mean)), width, mode="nearest")
    return torch.from_numpy(angle[reach : reach + len(numbers)].copy())


def middle_line(place: Tensor, frame_time: float) -> Tensor:
    """A path (T, 2) averaged over time; mirrored about its ends, which stay where they are."""
    width = CENTRE / frame_time
    points: NDArray[np.float64] = place.detach().cpu().numpy()
    if len(points) < 2:
        return place
    reach = math.ceil(TAIL * width)
    longer = np.pad(points, ((reach, reach), (0, 0)), mode="reflect", reflect_type="odd")
    longer = gaussian_filter1d(longer, width, axis=0, truncate=TAIL)
    return torch.from_numpy(longer[reach : reach + len(points)].copy())
