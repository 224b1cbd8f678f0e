"""The variant of the paper (Kim & Lee 2021, eq. 3-15): the end is bound through the last state vector alone.

The constraint c_T on the last state that brings the end of the sum to its target is found by Newton's method on the
response of the end to c_T. Taken literally, as the target seen from the frame before, it does not converge.

So bound, the change of the states is one ramp over the whole clip, three numbers in all. With the paper's own theta,
the angle between way and facing, they do not lead a walk back to beside its start: the rounds end in a fold, where the
end hardly answers any more (figure 4a). What the paper eases there with a B-spline are the differential coordinates:
here their change becomes a spline over the whole clip, one of the least that arrive (figure 4b).
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.interpolate import BSpline
from torch import Tensor

from hopdiff.editing.laplacian import Banded, squared_bands
from hopdiff.editing.measure import MOVING
from hopdiff.editing.root_path import RootPath, path_of, steps_of
from hopdiff.editing.targets import EditedPath
from hopdiff.types import HopdiffError

KNOTS = 1.0 / 3.0  # s between the knots of the spline
THETAS = ("tangent", "turn")
GAIN = 0.1  # share of what a round promises that it must bring
RIDGE = 1e-6  # weight of a change of the states against that of their differential coordinates, in a spline's cost
EASILY = 0.2  # of a round to the least of a spline: with less than that the nearest that arrives is sought
SHORTEST = 1e-3  # of a round: with less than that no way leads on


@dataclass(frozen=True)
class PaperSettings:
    """alpha, epsilon: see `SolveSettings`. weight: of the two constraints against the Laplacian. rounds: at most.

    theta: "tangent" takes the angle between way and facing as third state, as the paper says. "turn" takes the turn of
    the body. smooth: whether the change of the differential coordinates is a B-spline over the whole clip, in place of
    the last state's alone. rise: how much higher the last frame shall be, y solved as a state of its own [m]; None
    leaves all heights as they are.
    """

    alpha: float = 0.3
    epsilon: float = 0.01
    weight: float = 1.0
    theta: str = "turn"
    smooth: bool = False
    rise: float | None = None
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
    response, inverse = _responses(len(states), frame_time, settings)
    bound = 2 if yaw is None else 3
    target = torch.tensor((*place, math.nan if yaw is None else yaw), dtype=torch.float64)[:bound]
    ready = time.perf_counter()

    share = _share(states, settings)[:, :bound]

    def changed(numbers: Tensor) -> Tensor:
        return torch.cat((states[:, :bound] + share * (response @ numbers), states[:, bound:]), dim=-1)

    def ends(found: Tensor) -> Tensor:
        return _end(found, path, settings.theta)[:bound]

    # Places alone are linear in the states if no frame turns.
    linear = yaw is None and settings.theta == "turn"
    numbers, rounds = _rounds(changed, ends, target, share, response, inverse, settings, linear)
    found = path_from(changed(numbers), path, settings.theta)
    rise = None
    if settings.rise is not None:
        rise = torch.cat((response.new_zeros(1), _raised(response, inverse, settings.rise)))
    done = time.perf_counter()
    error = target - torch.cat((found.place[-1], found.yaw[-1:]))[:bound]
    return EditedPath(
        found,
        rounds,
        float(error[:2].norm()),
        float(error[2:].abs().sum()),
        _size(error) <= settings.epsilon,
        {"set_up": 1e3 * (ready - begun), "solve": 1e3 * (done - ready)},
        rise,
    )


def _rounds(
    changed: Callable[[Tensor], Tensor],
    ends: Callable[[Tensor], Tensor],
    target: Tensor,
    weight: Tensor,
    response: Tensor,
    inverse: Tensor,
    settings: PaperSettings,
    linear: bool,
) -> tuple[Tensor, int]:
    """(P, bound) numbers whose change of the states brings the end to the target, and the rounds that they took.

    Of those that meet the linearised target the least; a round that leads away is made shorter. Where even a short one
    does, the rounds end.
    """
    numbers = response.new_zeros(response.shape[1], len(target))
    error = target - ends(changed(numbers))
    rounds = 0
    while (size := _size(error)) > settings.epsilon and rounds < settings.rounds:
        rounds += 1
        share = 1.0 if linear else min(1.0, settings.alpha / size)
        slope = torch.autograd.functional.jacobian(ends, changed(numbers))[..., : len(target)]
        rows = torch.einsum("etd,tp->epd", slope * weight, response)
        eased = torch.einsum("pq,eqd->epd", inverse, rows)
        kept = (rows * numbers).sum((1, 2))
        least, nearest = (
            torch.einsum("epd,e->pd", eased, torch.linalg.solve(_inner(rows, eased), wanted))
            for wanted in (share * error + kept, share * error)
        )

        def left(step: Tensor, numbers: Tensor = numbers) -> float:
            return _size(target - ends(changed(numbers + step)))

        # To the least numbers that arrive, or else to the nearest ones that do.
        step = _shortened(least - numbers, left, size, share, EASILY)
        if step is None:
            step = _shortened(nearest, left, size, share, SHORTEST)
        if step is None:
            break
        numbers = numbers + step
        error = target - ends(changed(numbers))
    return numbers, rounds


def _shortened(
    step: Tensor, left: Callable[[Tensor], float], size: float, share: float, shortest: float
) -> Tensor | None:
    """As much of a step as leaves less of an error than there is; None where even a little of it does not.

    size: of the error, of which the step is meant to take a share.
    """
    part = 1.0
    while left(part * step) > (1.0 - GAIN * part * share) * size:
        part *= 0.5
        if part < shortest:
            return None
    return part * step


def _share(states: Tensor, settings: PaperSettings) -> Tensor:
    """(N, 3) of a change that states take: short steps take less of a spline, as their direction is noise."""
    share = torch.ones_like(states)
    if settings.smooth and settings.theta == "tangent":
        pace = states[:, :2].norm(dim=-1)
        share[:, :2] = (pace / (MOVING * pace.mean())).clamp_max(1.0)[:, None]
    return share


def _responses(count: int, frame_time: float, settings: PaperSettings) -> tuple[Tensor, Tensor]:
    """(N, P) what P numbers do to the states, and (P, P) the inverse of what these cost.

    The numbers are the constraint on the last state, or the coefficients of a spline that is added to the differential
    coordinates (eq. 10-13). The cost of a spline is its sum of squares over the frames, and a little of the states'.
    """
    bands = squared_bands(count)
    if not settings.smooth:
        bands[0, [0, -1]] += settings.weight**2
        impulse = torch.zeros(count, 1, dtype=torch.float64)
        impulse[-1] = settings.weight**2
        return Banded(bands).solve(impulse), torch.ones(1, 1, dtype=torch.float64)
    bands[0, 0] += settings.weight**2
    basis = torch.from_numpy(spline_basis(count, frame_time))
    response = Banded(bands).solve(laplacian_transposed(basis))
    return response, torch.linalg.inv(basis.T @ basis + RIDGE * response.T @ response)


def _raised(response: Tensor, inverse: Tensor, rise: float) -> Tensor:
    """(N,) by how much each frame is raised for the last one to be by rise [m]. Heights are linear in their states."""
    row = response[-1]
    eased = inverse @ row
    return response @ (eased * (rise / (row @ eased)))


def _inner(rows: Tensor, eased: Tensor) -> Tensor:
    return torch.einsum("epd,fpd->ef", rows, eased)


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


def spline_basis(count: int, frame_time: float) -> NDArray[np.float64]:
    """(N, P) cubic B-splines with few knots over N frames."""
    pieces = max(1, min(round((count - 1) * frame_time / KNOTS), count - 3))
    if count < 4:
        return np.eye(count)
    inner = np.linspace(0.0, count - 1.0, pieces + 1)
    knots = np.concatenate((np.zeros(3), inner, np.full(3, count - 1.0)))
    found: NDArray[np.float64] = BSpline.design_matrix(np.arange(count, dtype=np.float64), knots, 3).toarray()
    return found
