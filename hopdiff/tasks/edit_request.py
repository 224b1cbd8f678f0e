# No `from __future__ import annotations`: Hydra reads the types of the settings classes.
"""What a user asks of an edit, read and checked."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hopdiff.editing.follow import follow
from hopdiff.editing.paper import THETAS, PaperSettings
from hopdiff.editing.root_path import RootPath
from hopdiff.editing.solve import SolveSettings
from hopdiff.editing.targets import TURNS, Constraint
from hopdiff.feet.planting import FEET_BY
from hopdiff.geometry.curve import PlaneCurve
from hopdiff.messages import choose, near
from hopdiff.tasks.route import CurveSettings
from hopdiff.types import HopdiffError

VARIANTS = ("hopdiff", "paper")
KEYS = ("frame", "position", "heading")
MOST_RISE = 1.0  # m
# Without any wish: the whole way turned to the left about its start by an eighth of a turn.
EIGHTH: Mapping[str, Any] = {
    "frame": -1,
    "position": (math.sqrt(0.5), math.sqrt(0.5) - 1.0),
    "heading": math.pi / 4.0,
    "relative": True,
}


@dataclass
class TargetSettings:
    """position: [x, z] of the last frame [m]. heading: degrees from +z towards +x, keep, or free.

    relative: whether both count from where the clip ends: position as [to the left, ahead] in shares of its net way,
    seen along that, and heading as a turn to the left.
    """

    position: list[Any] | None
    heading: Any
    relative: bool


@dataclass
class EditSettings:
    """See conf/task/edit.yaml. alpha: null for that of the solver."""

    variant: str
    alpha: float | None
    epsilon: float
    side: float
    ahead: float
    turning: float
    ridge: float
    standing: float
    ends: float
    turn: str
    theta: str
    smooth: bool
    rise: float | None
    frames: list[Any] | None
    repeat: int | None
    strides: int
    feet: bool
    feet_by: str
    unit: Any
    up: str | None
    joints: dict[str, str]

    def solver(self) -> SolveSettings:
        """Of hopdiff's own solver."""
        weights = (self.side, self.ahead, self.turning, self.ridge, self.standing, self.ends)
        alpha = SolveSettings.alpha if self.alpha is None else self.alpha
        return SolveSettings(alpha, self.epsilon, *weights)

    def paper(self) -> PaperSettings:
        """Of the paper's solver."""
        alpha = PaperSettings.alpha if self.alpha is None else self.alpha
        return PaperSettings(alpha, self.epsilon, theta=self.theta, smooth=self.smooth, rise=self.rise)

    def check(self) -> None:
        """Raises HopdiffError, naming the setting, for a choice that there is not or a number out of its range."""
        choose("edit.variant", self.variant, VARIANTS)
        choose("edit.turn", self.turn, TURNS)
        choose("edit.theta", self.theta, THETAS)
        choose("edit.feet_by", self.feet_by, FEET_BY)
        for name in ("alpha", "epsilon", "side", "ahead", "turning", "ridge", "standing", "ends"):
            value = getattr(self, name)
            if value is not None and not value > 0:
                raise HopdiffError(f"edit.{name} must be a number above 0, not {value:g}.")
        for name in ("epsilon", "side", "ahead", "turning", "ridge", "standing", "ends"):
            if not math.isfinite(getattr(self, name)):
                raise HopdiffError(f"edit.{name} must be a finite number.")
        if self.rise is not None and not (self.variant == "paper" and abs(self.rise) <= MOST_RISE):
            raise HopdiffError(
                f"edit.rise={self.rise:g} goes with edit.variant=paper and must be from {-MOST_RISE:g} to"
                f" {MOST_RISE:g} m."
            )
        if self.frames is not None and not (len(self.frames) == 2 and all(type(one) is int for one in self.frames)):
            raise HopdiffError(f"edit.frames must be the first and the last frame, not {_plain(self.frames)!r}.")
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
        wishes = self.wishes or (EIGHTH,)
        return None, [_constraint(wish, path) for wish in wishes]


def request_of(target: TargetSettings, constraints: Sequence[Any], path: CurveSettings) -> Request:
    """What the settings ask for. Raises HopdiffError, naming the setting, if that is nothing sensible."""
    wishes = [_wish(f"constraints[{k}]", one) for k, one in enumerate(constraints)]
    if target.position is not None or target.heading is not None:
        wish = _wish("target", {"frame": -1, "position": target.position, "heading": target.heading})
        wishes.append({**wish, "relative": target.relative})
    along = bool(path.points) or path.file is not None
    if along and wishes:
        raise HopdiffError("an edit follows either a path or target and constraints: give one of them.")
    if not along:
        return Request(tuple(wishes), None, None)
    curve, points = path.curve()
    return Request((), curve, points)


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


def _constraint(wish: Mapping[str, Any], path: RootPath) -> Constraint:
    frame, place, heading = wish["frame"], wish["position"], wish["heading"]
    if not -path.frames <= frame < path.frames:
        last = path.frames - 1
        raise HopdiffError(f"frame {frame} lies outside the clip, whose frames are 0 to {last} (-1 for the last).")
    yaw = heading if isinstance(heading, float) else None
    if wish.get("relative", False):
        yaw = None if yaw is None else yaw + float(path.yaw[frame])
        place = None if place is None else _beside(path, *place)
    return Constraint(frame % path.frames, place, yaw, keep=heading == "keep")


def _beside(path: RootPath, left: float, ahead: float) -> tuple[float, float]:
    """A place to the left and ahead of the end of a path, in shares of its net way."""
    x, z = (path.place[-1] - path.place[0]).tolist()
    end_x, end_z = path.place[-1].tolist()
    return end_x + ahead * x + left * z, end_z + ahead * z - left * x


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


def _plain(value: Any) -> Any:
    return list(value) if isinstance(value, Sequence) and not isinstance(value, str) else value
