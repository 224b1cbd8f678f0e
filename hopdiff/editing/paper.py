"""The variant of the paper (Kim & Lee 2021, eq. 10-15): the end is bound through the last state vector alone.

The constraint c_T on the last state that brings the end of the sum to its target is found by Newton's method on the
response of the end to c_T. Taken literally, as the target seen from the frame before, it does not converge.
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass

import numpy as np
import torch
from scipy.interpolate import make_lsq_spline
from torch import Tensor

from hopdiff.editing.laplacian import Banded, laplacian, squared_bands
from hopdiff.editing.root_path import RootPath, path_of, steps_of
from hopdiff.editing.targets import EditedPath
from hopdiff.types import HopdiffError

KNOTS = 1.0 / 3.0  # s between the knots of the spline
THETAS = ("tangent", "turn")


@dataclass(frozen=True)
class PaperSettings:
    """alpha, epsilon: see `SolveSettings`. weight: of the two constraints against the Laplacian. rounds: at most.

    theta: "tangent" takes the angle between way and facing as third state, as the paper says; it is bent wildly where
    the body hardly moves. "turn" takes the turn of the body. smooth: whether the differential coordinates are those of
    a B-spline through the states, whose own detail is put back afterwards.
    """

    alpha: float = 0.3
    epsilon: float = 0.01
    weight: float = 1.0
    theta: str = "turn"
    smooth: bool = False
    rounds: int = 100


def edit_path_as_paper(
    path: RootPath,
    frame_time: float,
    place: tuple[float, float],
    yaw: float | None,
    settings: PaperSettings,
) -> EditedPath:
    """The path whose last frame is at a place [m] and, if a yaw is given [rad], faces it.

    Raises HopdiffError for an unknown theta or a path of fewer than three frames.
    """
    if settings.theta not in THETAS:
        raise HopdiffError(f"edit.theta must be one of {', '.join(THETAS)}, not {settings.theta!r}.")
    if path.frames < 3:
        raise HopdiffError(f"an edit needs a clip of at least 3 frames, not {path.frames}.")
    begun = time.perf_counter()
    states = states_of(path, settings.theta)
    detail = states - splined(states, frame_time) if settings.smooth else torch.zeros_like(states)
    bands = squared_bands(len(states))
    bands[0, [0, -1]] += settings.weight**2
    matrix = Banded(bands)
    right = laplacian_transposed(laplacian(states - detail))
    right[0] += settings.weight**2 * (states - detail)[0]
    impulse = torch.zeros(len(states), 1, dtype=states.dtype)
    impulse[-1] = settings.weight**2
    base, response = matrix.solve(torch.cat((right, impulse), dim=-1)).split((3, 1), dim=-1)
    bound = 2 if yaw is None else 3
    target = torch.tensor((*place, math.nan if yaw is None else yaw), dtype=torch.float64)[:bound]
    ready = time.perf_counter()

    def ends(constraint: Tensor) -> Tensor:
        return _end(base + response * constraint + detail, path, settings.theta)

    constraint = (states - detail)[-1].clone()
    rounds = 0
    while (size := _size(error := target - ends(constraint)[:bound])) > settings.epsilon and rounds < settings.rounds:
        rounds += 1
        # Places alone are linear in the states if no frame turns.
        linear = yaw is None and settings.theta == "turn"
        share = 1.0 if linear else min(1.0, settings.alpha / size)
        slope = torch.autograd.functional.jacobian(ends, constraint)[:bound, :bound]
        constraint[:bound] += torch.linalg.solve(slope, share * error)
    found = path_from(base + response * constraint + detail, path, settings.theta)
    done = time.perf_counter()
    error = target - torch.cat((found.place[-1], found.yaw[-1:]))[:bound]
    return EditedPath(
        found,
        rounds,
        float(error[:2].norm()),
        float(error[2:].abs().sum()),
        _size(error) <= settings.epsilon,
        {"set_up": 1e3 * (ready - begun), "solve": 1e3 * (done - ready)},
    )


def states_of(path: RootPath, theta: str) -> Tensor:
    """(T - 1, 3) steps to the left and ahead [m], and theta [rad] (eq. 3)."""
    steps = steps_of(path)
    if theta == "turn":
        return steps
    way = torch.atan2(steps[:, 0], steps[:, 1])
    angle = torch.remainder(steps[:, 2] - way + math.pi, math.tau) - math.pi
    return torch.cat((steps[:, :2], angle.unsqueeze(-1)), dim=-1)


def path_from(states: Tensor, path: RootPath, theta: str) -> RootPath:
    """The inverse of `states_of`, from the first frame of a path."""
    if theta == "tangent":
        way = torch.atan2(states[:, 0], states[:, 1])
        turn = torch.remainder(states[:, 2] + way + math.pi, math.tau) - math.pi
        states = torch.cat((states[:, :2], turn.unsqueeze(-1)), dim=-1)
    return path_of(states, path.place[0], path.yaw[0])


def _end(states: Tensor, path: RootPath, theta: str) -> Tensor:
    """(3,) x, z and yaw of the last frame."""
    found = path_from(states, path, theta)
    return torch.cat((found.place[-1], found.yaw[-1:]))


def _size(error: Tensor) -> float:
    return max(float(error[:2].norm()), float(error[2:].abs().sum()))


def laplacian_transposed(values: Tensor) -> Tensor:
    """The transposed Laplacian of (N, D)."""
    weight = torch.full((len(values), 1), 0.5, dtype=values.dtype)
    weight[0] = weight[-1] = 1.0
    passed = weight * values
    found = values.clone()
    found[1:] -= passed[:-1]
    found[:-1] -= passed[1:]
    return found


def splined(values: Tensor, frame_time: float) -> Tensor:
    """A cubic B-spline with few knots through (N, D), least squares."""
    count = len(values)
    pieces = max(1, round((count - 1) * frame_time / KNOTS))
    inner = np.linspace(0.0, count - 1.0, pieces + 1)
    if count < pieces + 4:
        return values
    knots = np.concatenate((np.zeros(3), inner, np.full(3, count - 1.0)))
    at = np.arange(count, dtype=np.float64)
    return torch.from_numpy(make_lsq_spline(at, values.numpy(), knots, k=3)(at))
