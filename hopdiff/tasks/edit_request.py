# No `from __future__ import annotations`: Hydra reads the types of the settings classes.
"""What a user asks of an edit, read and checked."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hopdiff.editing.follow import follow
from hopdiff.editing.paper import PaperSettings
from hopdiff.editing.root_path import RootPath
from hopdiff.editing.solve import SolveSettings
from hopdiff.editing.targets import Constraint
from hopdiff.geometry.curve import PlaneCurve, curve_through
from hopdiff.io.points import read_points
from hopdiff.messages import choose, near
from hopdiff.tasks.path import PathSettings
from hopdiff.types import HopdiffError

VARIANTS = ("hopdiff", "paper")
KEYS = ("frame", "position", "heading")


@dataclass
class TargetSettings:
    """position: [x, z] of the last frame [m]. heading: degrees from +z towards +x, keep, or free."""

    position: list[Any] | None = None
    heading: Any = None


@dataclass
class EditSettings:
    """See conf/config.yaml. alpha and the others of the two solvers: null for the solver's own."""

    variant: str = "hopdiff"
    alpha: float | None = None
    epsilon: float = 0.01
    side: float = 30.0
    ahead: float = 1.0
    turning: float = 0.002
    ridge: float = 1e-4
    standing: float = 50.0
    turn: str = "nearest"
    theta: str = "turn"
    smooth: bool = False
    repeat: int | None = None
    strides: int = 8
    feet: bool = True
    unit: Any = None
    up: str | None = None
    joints: dict[str, str] = field(default_factory=dict)

    def solver(self) -> SolveSettings:
        """Of hopdiff's own solver. Raises HopdiffError, naming the setting, for a number out of its range."""
        self._check()
        weights = (self.side, self.ahead, self.turning, self.ridge, self.standing)
        alpha = SolveSettings.alpha if self.alpha is None else self.alpha
        return SolveSettings(alpha, self.epsilon, *weights)

    def paper(self) -> PaperSettings:
        """Of the paper's solver. Raises as `solver` does."""
        self._check()
        alpha = PaperSettings.alpha if self.alpha is None else self.alpha
        return PaperSettings(alpha=alpha, epsilon=self.epsilon, theta=self.theta, smooth=self.smooth)

    def _check(self) -> None:
        choose("edit.variant", self.variant, VARIANTS)
        for name in ("alpha", "epsilon", "side", "ahead", "turning", "ridge", "standing"):
            value = getattr(self, name)
            if value is not None and not value > 0:
                raise HopdiffError(f"edit.{name} must be a number above 0, not {value:g}.")
        for name in ("epsilon", "side", "ahead", "turning", "ridge", "standing"):
            if not math.isfinite(getattr(self, name)):
                raise HopdiffError(f"edit.{name} must be a finite number.")
        for name in ("repeat", "strides"):
            value = getattr(self, name)
            if value is not None and not 1 <= value <= 1000:
                raise HopdiffError(f"edit.{name} must be from 1 to 1000, not {value}.")


@dataclass(frozen=True)
class Request:
    """wishes: frame, position and heading as typed. curve, points: a path to be followed in their place."""

    wishes: tuple[Mapping[str, Any], ...]
    curve: PlaneCurve | None
    points: NDArray[np.float64] | None

    def constraints(self, path: RootPath, frame_time: float) -> tuple[RootPath | None, list[Constraint]]:
        """A guess and the constraints for a clip's path; without any wish, an eighth of a turn to the left.

        Raises HopdiffError, naming the frame, for a frame outside the clip.
        """
        if self.curve is not None:
            return follow(path, frame_time, self.curve)
        wishes = self.wishes or (_turned(path),)
        return None, [_constraint(wish, path.frames) for wish in wishes]


def request_of(target: TargetSettings, constraints: Sequence[Any], path: PathSettings) -> Request:
    """What the settings ask for. Raises HopdiffError, naming the setting, if that is nothing sensible."""
    wishes = [_wish(f"constraints[{k}]", one) for k, one in enumerate(constraints)]
    if target.position is not None or target.heading is not None:
        wishes.append(_wish("target", {"frame": -1, "position": target.position, "heading": target.heading}))
    along = bool(path.points) or path.file is not None
    if along and wishes:
        raise HopdiffError("an edit follows either a path or target and constraints: give one of them.")
    if not along:
        return Request(tuple(wishes), None, None)
    if not (math.isfinite(path.scale) and path.scale > 0):
        raise HopdiffError(f"path.scale must be a number above 0, not {path.scale:g}.")
    if not (math.isfinite(path.smooth) and path.smooth >= 0):
        raise HopdiffError(f"path.smooth must be a number of 0 or more, not {path.smooth:g}.")
    points: Any = path.points if path.file is None else read_points(Path(path.file), path.scale)
    curve = curve_through(points, path.closed, path.smooth)
    return Request((), curve, np.asarray(points, dtype=np.float64))


def _wish(where: str, wish: Any) -> Mapping[str, Any]:
    """One wish, its form checked; heading in radians, "keep" or "free"."""
    if not isinstance(wish, Mapping):
        raise HopdiffError(f"{where} must be {{frame: K, position: [x, z], heading: DEGREES}}, not {wish!r}.")
    for key in wish:
        if key not in KEYS:
            raise HopdiffError(f"{where} has an unknown entry {key!r}.{near(str(key), KEYS)}")
    frame, position, heading = (wish.get(key) for key in KEYS)
    if isinstance(frame, bool) or not isinstance(frame, int):
        raise HopdiffError(f"{where}.frame must be a whole number, not {frame!r}.")
    if position is None and heading is None:
        raise HopdiffError(f"{where} asks for nothing: give a position, a heading, or both.")
    if position is not None:
        if not (isinstance(position, Sequence) and len(position) == 2 and all(map(_is_number, position))):
            raise HopdiffError(f"{where}.position must be two finite numbers [x, z], not {_plain(position)!r}.")
        position = (float(position[0]), float(position[1]))
    if heading is None:
        heading = "keep"
    elif _is_number(heading):
        heading = math.radians(float(heading))
    elif heading not in ("keep", "free"):
        raise HopdiffError(f"{where}.heading must be a number of degrees, keep or free, not {heading!r}.")
    return {"frame": frame, "position": position, "heading": heading}


def _constraint(wish: Mapping[str, Any], frames: int) -> Constraint:
    frame, heading = wish["frame"], wish["heading"]
    if not -frames <= frame < frames:
        raise HopdiffError(
            f"frame {frame} lies outside the clip, whose frames are 0 to {frames - 1} (or -1 for the last)."
        )
    yaw = heading if isinstance(heading, float) else None
    return Constraint(frame % frames, wish["position"], yaw, keep=heading == "keep")


def _turned(path: RootPath) -> Mapping[str, Any]:
    """The end of a path turned to the left about its start by an eighth of a turn."""
    way = path.place[-1] - path.place[0]
    angle = math.pi / 4.0
    c, s = math.cos(angle), math.sin(angle)
    x, z = (float(value) for value in way)
    x, z = c * x + s * z + float(path.place[0, 0]), c * z - s * x + float(path.place[0, 1])
    return {"frame": -1, "position": (x, z), "heading": float(path.yaw[-1]) + angle}


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


def _plain(value: Any) -> Any:
    return list(value) if isinstance(value, Sequence) and not isinstance(value, str) else value
