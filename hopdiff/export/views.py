"""From where a figure is looked at in pictures."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hopdiff.messages import choose
from hopdiff.types import HopdiffError


@dataclass(frozen=True)
class View:
    """A view from far away, without perspective.

    azimuth_deg: where the figure then faces: 0 towards us, 90 to the right, 180 away from us. elevation_deg: of the eye
    above the horizontal.
    """

    name: str
    azimuth_deg: float
    elevation_deg: float

    @property
    def axes(self) -> NDArray[np.float64]:
        """(3, 3) rows that take a point of the world (x left, y up, z forward) to right, up and towards the eye."""
        turn, rise = math.radians(self.azimuth_deg), math.radians(self.elevation_deg)
        right = np.array([math.cos(turn), 0.0, math.sin(turn)])
        level = np.array([-math.sin(turn), 0.0, math.cos(turn)])
        above = np.array([0.0, 1.0, 0.0])
        towards = math.cos(rise) * level + math.sin(rise) * above
        return np.stack((right, np.cross(towards, right), towards))


# Of games that are seen from above at an angle: the way that a figure faces on screen, in steps of 45 degrees.
GAME_ELEVATION = 30.0
FACING = ("down", "down_right", "right", "up_right", "up", "up_left", "left", "down_left")
_ROUND = tuple(View(name, 45.0 * k, GAME_ELEVATION) for k, name in enumerate(FACING))
VIEWS = {
    "side": (View("side", 90.0, 0.0),),
    "front": (View("front", 0.0, 0.0),),
    "back": (View("back", 180.0, 0.0),),
    "three_quarter": (View("three_quarter", 45.0, 15.0),),
    "top": (View("top", 90.0, 90.0),),
    "four": _ROUND[::2],
    "eight": _ROUND,
}


def views_of(value: Any, setting: str) -> tuple[View, ...]:
    """The views that a setting names: one of VIEWS, [azimuth, elevation] in degrees, or a list of these.

    Raises HopdiffError, naming the setting, for what is no view, or two views of one name.
    """
    plain = list(value) if isinstance(value, Sequence) and not isinstance(value, str) else value
    several = plain if isinstance(plain, list) and not _is_angles(plain) else [plain]
    found = tuple(view for one in several for view in _of_one(one, setting))
    if not found:
        raise HopdiffError(f"{setting} needs at least one view.")
    names = [view.name for view in found]
    if twice := next((name for name in names if names.count(name) > 1), None):
        raise HopdiffError(f"{setting} has the view {twice!r} twice.")
    return found


def _of_one(value: Any, setting: str) -> tuple[View, ...]:
    if isinstance(value, str):
        return VIEWS[choose(setting, value, VIEWS)]
    angles = list(value) if isinstance(value, Sequence) else value
    if not _is_angles(angles):
        raise HopdiffError(
            f"{setting} must be one of {', '.join(VIEWS)}, or [azimuth, elevation] in degrees, or a list of these,"
            f" not {value!r}."
        )
    azimuth, elevation = (float(angle) for angle in angles)
    if not (math.isfinite(azimuth) and -90.0 <= elevation <= 90.0):
        raise HopdiffError(f"{setting}: an elevation lies between -90 and 90 degrees, not at {elevation:g}.")
    return (View(f"{azimuth:g}_{elevation:g}", azimuth, elevation),)


def _is_angles(value: Any) -> bool:
    return (
        isinstance(value, list)
        and len(value) == 2
        and all(isinstance(one, int | float) and not isinstance(one, bool) for one in value)
    )
