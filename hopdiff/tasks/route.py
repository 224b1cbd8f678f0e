# No `from __future__ import annotations`: OmegaConf reads the types of the settings classes.
"""Curves on the ground as users give them, and what a body can run along them."""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from hopdiff.genes import FROUDE_RANGE
from hopdiff.geometry.curve import PlaneCurve, curve_through
from hopdiff.io.points import read_points
from hopdiff.numerics import GRAVITY
from hopdiff.types import HopdiffError

HOLD = 1.0  # of gravity: what a foot on level ground can push sideways
MAX_FRAMES = 100_000
MAX_SAMPLES = 1_000_000  # along a path, in the search for its tightest turn


@dataclass
class CurveSettings:
    """points: [[x, z], ...] [m]. file: a CSV or SVG file, which goes before the points. closed: None if the points
    shall tell. scale: metres a unit of the file. smooth: length of the way over which the curve is averaged [m].
    """

    points: list[Any]  # of pairs; whole numbers would be refused for floats
    file: str | None
    closed: bool | None
    scale: float
    smooth: float

    def curve(self) -> tuple[PlaneCurve, NDArray[np.float64]]:
        """The curve and the points that it goes through. Raises HopdiffError, naming the setting or the file."""
        if not (math.isfinite(self.scale) and self.scale > 0):
            raise HopdiffError(f"path.scale must be a number above 0, not {self.scale:g}.")
        if not (math.isfinite(self.smooth) and self.smooth >= 0):
            raise HopdiffError(f"path.smooth must be a number of 0 or more, not {self.smooth:g}.")
        points: Any = self.points if self.file is None else read_points(Path(self.file), self.scale)
        return curve_through(points, self.closed, self.smooth), np.asarray(points, dtype=np.float64)


@dataclass
class PathSettings(CurveSettings):
    """time [s]: for the whole curve. max_lean_deg: of the body into a turn."""

    time: float | None
    max_lean_deg: float


@dataclass(frozen=True)
class Route:
    """What is asked for. points: (K, 2) as given, x and z [m]. time [s]. max_lean [rad]."""

    points: NDArray[np.float64]
    curve: PlaneCurve
    time: float
    max_lean: float

    @property
    def speed(self) -> float:
        return self.curve.length / self.time

    def tightest(self) -> tuple[float, Tensor]:
        """The least radius of a turn [m] and the place (2,) where it is."""
        count = min(max(1000, math.ceil(self.curve.length / 0.02)), MAX_SAMPLES)
        arc = torch.linspace(0.0, self.curve.length, count + 1, dtype=torch.float64)
        bend = self.curve.curvature(arc).abs()
        # A turn about on the spot has no curvature before or after it, only another heading.
        turn = self.curve.heading(arc).diff().abs() * (count / self.curve.length)
        bend[1:] = torch.maximum(bend[1:], turn)
        worst = int(bend.argmax())
        return 1.0 / max(float(bend[worst]), 1e-9), self.curve.position(arc[worst : worst + 1])[0]


def plan(settings: PathSettings, leg_length: float, body: str, fps: float) -> Route:
    """The route of the settings. leg_length [m] and name of the body bound its speed, fps [frames/s] its time.

    Raises HopdiffError, naming the setting and the range that is possible, for points or a file that make no curve,
    a number out of range, a time for which the body would have to be too fast or too slow, or a turn too sharp.
    """
    if not settings.points and settings.file is None:
        raise HopdiffError("task=path needs either path.points=[[x,z],...] or path.file=FILE.")
    if settings.time is None:
        raise HopdiffError("task=path needs path.time, the seconds from the first point to the last.")
    if not (math.isfinite(settings.time) and settings.time > 0):
        raise HopdiffError(f"path.time must be a number above 0, not {settings.time:g}.")
    if not 0.0 <= settings.max_lean_deg <= 45.0:
        raise HopdiffError(f"path.max_lean_deg must lie between 0 and 45, not {settings.max_lean_deg:g}.")
    curve, points = settings.curve()
    route = Route(points, curve, settings.time, math.radians(settings.max_lean_deg))
    _check_speed(route, leg_length, body)
    if settings.time * fps > MAX_FRAMES:
        raise HopdiffError(
            f"path.time={settings.time:g} at fps={fps:g} makes more than {MAX_FRAMES} frames: {MAX_FRAMES / fps:.0f} s"
            " are the most."
        )
    return route


def _check_speed(route: Route, leg_length: float, body: str) -> None:
    slowest, fastest = (froude * math.sqrt(GRAVITY * leg_length) for froude in FROUDE_RANGE)
    length, (radius, place) = route.curve.length, route.tightest()
    most = min(fastest, math.sqrt(HOLD * GRAVITY * radius))
    where = f"the path turns with a radius of {radius:.2f} m near [{place[0] + 0.0:.1f}, {place[1] + 0.0:.1f}]"
    if most < slowest:
        raise HopdiffError(
            f"{where}: too sharp at any speed; the character {body} needs {slowest**2 / (HOLD * GRAVITY):.2f} m or more"
            " (path.smooth rounds it, 0.5 over about a metre)."
        )
    # Rounded inwards, so that both ends are allowed.
    times = (
        f"path.time must lie between {math.ceil(10.0 * length / most) / 10.0:g}"
        f" and {math.floor(10.0 * length / slowest) / 10.0:g} s"
    )
    if route.speed > fastest or route.speed < slowest:
        raise HopdiffError(
            f"path.time={route.time:g} asks for {route.speed:.1f} m/s over {length:.1f} m, and the character {body}"
            f" runs at {slowest:.1f} to {fastest:.1f} m/s: {times}."
        )
    if route.speed > most:
        raise HopdiffError(
            f"{where}, where {route.speed:.1f} m/s need {route.speed**2 / (HOLD * GRAVITY):.2f} m: {times}, or the"
            " turn be wider."
        )
