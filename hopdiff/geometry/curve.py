"""A smooth curve on the ground, by arc length."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import CubicSpline
from scipy.ndimage import gaussian_filter1d
from torch import Tensor

from hopdiff.types import HopdiffError

Array = NDArray[np.float64]

SAMPLES = 4000  # of the arc length along the curve, at least
PER_PIECE = 64  # and at least so many between two points
COINCIDENT = 1e-6  # m; points closer than this are one
FARTHEST = 1e5  # m; from the origin: beyond it, rounding shows
TAIL = 4.0  # standard deviations after which a Gaussian is nothing


@dataclass(frozen=True, eq=False)
class PlaneCurve:
    """A curve with continuous curvature in the ground plane, x to the left and z forward.

    closed: whether it ends where it began, in the same direction. length: [m]. Arc lengths may lie beyond both ends:
    a closed curve goes round again, an open one goes straight on along its end tangents.
    """

    closed: bool
    length: float
    _parameter: Callable[[Array], Array]  # of an arc length within the curve
    _spline: Callable[[Array, int], Array]  # (derivative of the) point at a parameter, (T, 2)
    _heading: Callable[[Array], Array]  # at an arc length within the curve, unwrapped
    _turn: float  # heading gained in a lap [rad]

    def position(self, arc: Tensor) -> Tensor:
        """(T, 2) x and z [m] at arc lengths (T,) [m]."""
        inside, beyond, _ = self._split(arc)
        point = self._spline(self._parameter(inside), 0)
        heading = self._heading(inside)
        straight = beyond[:, None] * np.stack((np.sin(heading), np.cos(heading)), axis=-1)
        return torch.as_tensor(point + straight)

    def heading(self, arc: Tensor) -> Tensor:
        """(T,) angle of the tangent from +z towards +x [rad], without jumps."""
        inside, _, laps = self._split(arc)
        return torch.as_tensor(self._heading(inside) + self._turn * laps)

    def curvature(self, arc: Tensor) -> Tensor:
        """(T,) change of heading with arc length, positive in a turn to the left [1/m]."""
        inside, beyond, _ = self._split(arc)
        parameter = self._parameter(inside)
        (dx, dz), (ddx, ddz) = (self._spline(parameter, order).T for order in (1, 2))
        bend = (ddx * dz - dx * ddz) / np.hypot(dx, dz) ** 3
        return torch.as_tensor(np.where(beyond == 0.0, bend, 0.0))

    def _split(self, arc: Tensor) -> tuple[Array, Array, Array]:
        """Arc length within the curve, what lies beyond its ends, and whole laps."""
        value = arc.detach().cpu().double().numpy()
        if self.closed:
            laps = np.floor(value / self.length)
            return value - laps * self.length, np.zeros_like(value), laps
        inside = np.clip(value, 0.0, self.length)
        return inside, value - inside, np.zeros_like(value)


def curve_through(points: ArrayLike, closed: bool | None = None, smooth: float = 0.0) -> PlaneCurve:
    """A cubic spline through points (K, 2), x and z [m].

    closed: None if the last point shall tell, by being the first. smooth: length of the way over which the curve is
    then averaged, the standard deviation of a Gaussian [m]; it rounds corners and no longer meets the points, but both
    ends of an open curve. The parameter is the square root of the distance between points (centripetal): it makes no
    loops and the least overshoot where distances differ (Lee 1989). Ends are not bent.

    Raises HopdiffError if points are not pairs of finite numbers, too few, too far away, two neighbours are one, or
    nothing is left of a curve that is smoothed.
    """
    nodes = _checked(points)
    ring = bool(np.hypot(*(nodes[-1] - nodes[0])) <= COINCIDENT)
    if closed is None:
        closed = ring
    if closed:
        nodes = np.concatenate((nodes[:-1] if ring else nodes, nodes[:1]))
    if closed and len(nodes) < 4:
        raise HopdiffError("path.points: a closed path needs at least three different points.")
    steps = np.hypot(*np.diff(nodes, axis=0).T)
    if (short := np.flatnonzero(steps <= COINCIDENT)).size:
        k = int(short[0])
        raise HopdiffError(f"path.points: points {k + 1} and {k + 2} are the same, {nodes[k].tolist()}.")
    knots = np.concatenate(([0.0], np.cumsum(np.sqrt(steps))))
    curve = _by_arc_length(_interpolated(nodes, knots, closed), knots, closed)
    return _smoothed(curve, smooth) if smooth > 0 else curve


def _checked(points: ArrayLike) -> Array:
    try:
        nodes = np.asarray(points, dtype=np.float64)
    except (TypeError, ValueError):
        nodes = np.empty(0)
    if nodes.ndim != 2 or nodes.shape[1] != 2:
        raise HopdiffError("path.points must be a list of pairs of numbers: [[x, z], [x, z], ...].")
    if (broken := np.flatnonzero(~np.isfinite(nodes).all(axis=1))).size:
        k = int(broken[0])
        raise HopdiffError(f"path.points: point {k + 1} is not a pair of finite numbers: {nodes[k].tolist()}.")
    if len(nodes) < 2:
        raise HopdiffError(f"path.points needs at least two points, not {len(nodes)}.")
    if (far := np.flatnonzero(np.abs(nodes).max(axis=1) > FARTHEST)).size:
        k = int(far[0])
        raise HopdiffError(f"path.points: point {k + 1} lies farther than {FARTHEST / 1000:g} km from [0, 0].")
    return nodes


def _interpolated(nodes: Array, knots: Array, closed: bool) -> Callable[[Array, int], Array]:
    spline = CubicSpline(knots, nodes, bc_type="periodic" if closed else "natural")
    return lambda parameter, order: np.asarray(spline(parameter, order))


def _smoothed(curve: PlaneCurve, smooth: float) -> PlaneCurve:
    """A curve whose points are means of its way around them, weighted by a Gaussian; open ends stay in their place."""
    if not smooth < 0.25 * curve.length:
        raise HopdiffError(f"path.smooth must be below a quarter of the path's {curve.length:.3g} m, not {smooth:g}.")
    count = max(SAMPLES // 4, math.ceil(8.0 * curve.length / smooth))
    way = np.linspace(0.0, curve.length, count + 1)
    points = curve.position(torch.as_tensor(way)).numpy()
    width = smooth * count / curve.length
    if curve.closed:
        points = gaussian_filter1d(points[:-1], width, axis=0, mode="wrap", truncate=TAIL)
        points = np.concatenate((points, points[:1]))
    else:
        # Mirrored about its end point, an open curve keeps it and is not bent there.
        reach = min(count, math.ceil(TAIL * width))
        head, tail = 2.0 * points[0] - points[reach:0:-1], 2.0 * points[-1] - points[-2 : -reach - 2 : -1]
        longer = gaussian_filter1d(np.concatenate((head, points, tail)), width, axis=0, truncate=TAIL)
        points = longer[reach : reach + count + 1]
    steps = np.hypot(*np.diff(points, axis=0).T)
    if steps.min() <= 1e-9 * curve.length:
        raise HopdiffError(f"path.smooth={smooth:g} leaves nothing of a turn of the path: choose a smaller one.")
    knots = np.concatenate(([0.0], np.cumsum(steps)))
    return _by_arc_length(_interpolated(points, knots, curve.closed), knots, curve.closed)


def _by_arc_length(spline: Callable[[Array, int], Array], knots: Array, closed: bool) -> PlaneCurve:
    count = max(SAMPLES, PER_PIECE * (len(knots) - 1))
    parameter = np.linspace(0.0, knots[-1], count + 1)

    def pace(at: Array) -> Array:
        return np.asarray(np.hypot(*spline(at, 1).T))

    # Simpson's rule between the samples.
    middles = 0.5 * (parameter[1:] + parameter[:-1])
    ends = pace(parameter)
    pieces = np.diff(parameter) / 6.0 * (ends[1:] + 4.0 * pace(middles) + ends[:-1])
    arcs = np.concatenate(([0.0], np.cumsum(pieces)))
    dx, dz = spline(parameter, 1).T
    headings = np.unwrap(np.arctan2(dx, dz))
    inverse = CubicSpline(arcs, parameter)

    def parameter_at(arc: Array) -> Array:
        found: Array = np.clip(inverse(arc), 0.0, knots[-1])
        return found

    def heading_at(arc: Array) -> Array:
        # Exact from the tangent, on the branch that the samples tell.
        dx, dz = spline(parameter_at(arc), 1).T
        exact, near = np.arctan2(dx, dz), np.interp(arc, arcs, headings)
        return np.asarray(exact + 2.0 * np.pi * np.round((near - exact) / (2.0 * np.pi)))

    lap = float(headings[-1] - headings[0]) if closed else 0.0
    return PlaneCurve(closed, float(arcs[-1]), parameter_at, spline, heading_at, lap)
