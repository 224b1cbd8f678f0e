# No `from __future__ import annotations`: OmegaConf reads the types of the settings classes.
"""The group `ground`: its settings by kind, their checks, and the grounds made from them."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from shapely import Polygon

from hopdiff.choices import structured
from hopdiff.composing import defaults_of
from hopdiff.io.heights import read_heights
from hopdiff.messages import choose, near
from hopdiff.terrain.ground import Flat, Ground
from hopdiff.terrain.height_map import HeightMap
from hopdiff.terrain.patches import Patch, Patches, plane_through
from hopdiff.terrain.profile import Profile, slope, stairs
from hopdiff.types import HopdiffError

STEEPEST = 20.0  # degrees; of slopes and of planes
TALLEST, SHORTEST = 0.3, 0.15  # m; of the steps of stairs
FARTHEST = 1e5  # m; of places and heights
KEYS = ("outline", "height", "corners")


@dataclass
class FlatSettings:
    """See conf/ground/flat.yaml."""

    kind: str

    def build(self) -> Flat:
        return Flat()


@dataclass
class SlopeSettings:
    """See conf/ground/slope.yaml."""

    kind: str
    angle: float
    heading: float
    start: list[Any]
    length: float | None

    def build(self) -> Profile:
        """Raises HopdiffError, naming the setting."""
        if not -STEEPEST <= self.angle <= STEEPEST:
            raise HopdiffError(f"ground.angle must lie between -20 and 20 degrees, not {self.angle:g}.")
        if self.length is not None and not 0.0 < self.length < FARTHEST:
            raise HopdiffError(f"ground.length must be a number of metres above 0, or null, not {self.length:g}.")
        place = _place("ground.start", self.start)
        return slope(math.radians(self.angle), _heading(self.heading), place, self.length)


@dataclass
class StairsSettings:
    """See conf/ground/stairs.yaml."""

    kind: str
    rise: float
    run: float
    heading: float
    start: list[Any]
    steps: int

    def build(self) -> Profile:
        """Raises HopdiffError, naming the setting."""
        if not 0.0 < abs(self.rise) <= TALLEST:
            raise HopdiffError(f"ground.rise must lie between -{TALLEST:g} and {TALLEST:g} m and not be {self.rise:g}.")
        if not SHORTEST <= self.run < FARTHEST:
            raise HopdiffError(f"ground.run must be {SHORTEST:g} m or more, not {self.run:g}.")
        if not 1 <= self.steps <= 1000:
            raise HopdiffError(f"ground.steps must be from 1 to 1000, not {self.steps}.")
        place = _place("ground.start", self.start)
        return stairs(self.rise, self.run, _heading(self.heading), place, self.steps)


@dataclass
class MapSettings:
    """See conf/ground/map.yaml."""

    kind: str
    file: str | None
    cell: float
    origin: list[Any]
    scale: float

    def build(self) -> HeightMap:
        """Raises HopdiffError, naming the setting or the file."""
        if self.file is None:
            raise HopdiffError("ground=map needs ground.file, a PNG picture or a CSV file of heights.")
        if not 0.0 < self.cell < FARTHEST:
            raise HopdiffError(f"ground.cell must be a number of metres above 0, not {self.cell:g}.")
        if not abs(self.scale) < FARTHEST:
            raise HopdiffError(f"ground.scale must be a finite number of metres, not {self.scale:g}.")
        place = _place("ground.origin", self.origin)
        heights = self.scale * read_heights(Path(self.file), "ground.file")
        if not np.abs(heights).max() < FARTHEST:
            raise HopdiffError(f"ground.file {self.file!r} holds heights of more than {FARTHEST / 1000:g} km.")
        return HeightMap(torch.as_tensor(heights), self.cell, place)


@dataclass
class PolygonsSettings:
    """See conf/ground/polygons.yaml."""

    kind: str
    patches: list[Any]

    def build(self) -> Patches:
        """Raises HopdiffError, naming the patch."""
        if not self.patches:
            raise HopdiffError("ground=polygons needs ground.patches=[{outline: [[x, z], ...], height: METRES}, ...].")
        return Patches([_patch(f"ground.patches[{k}]", one) for k, one in enumerate(self.patches)])


AnySettings = FlatSettings | SlopeSettings | StairsSettings | MapSettings | PolygonsSettings
GROUNDS: dict[str, type[AnySettings]] = {
    "flat": FlatSettings,
    "slope": SlopeSettings,
    "stairs": StairsSettings,
    "map": MapSettings,
    "polygons": PolygonsSettings,
}


def build_ground(settings: Mapping[str, Any]) -> Ground:
    """The ground of the settings, by their `kind`; what they leave out is as in conf/ground/.

    Raises HopdiffError, naming the setting or the file, for what cannot be stood on.
    """
    kind = choose("ground.kind", str(settings.get("kind")), GROUNDS)
    found: AnySettings = structured("ground", kind, GROUNDS[kind], {**defaults_of("ground", kind), **settings})
    return found.build()


def _heading(degrees: float) -> float:
    if not math.isfinite(degrees):
        raise HopdiffError(f"ground.heading must be a finite number of degrees, not {degrees:g}.")
    return math.radians(degrees)


def _place(name: str, value: Any) -> tuple[float, float]:
    if not _numbers(value, 2):
        raise HopdiffError(f"{name} must be two finite numbers [x, z], not {value!r}.")
    return float(value[0]), float(value[1])


def _numbers(value: Any, count: int) -> bool:
    """Whether a value is a list of so many numbers of a sensible size."""
    return (
        isinstance(value, Sequence)
        and not isinstance(value, str)
        and len(value) == count
        and all(isinstance(n, int | float) and not isinstance(n, bool) and abs(n) < FARTHEST for n in value)
    )


def _patch(name: str, value: Any) -> Patch:
    if not isinstance(value, Mapping):
        raise HopdiffError(f"{name} must be {{outline: [[x, z], ...], height: METRES}}, not {value!r}.")
    for key in value:
        if key not in KEYS:
            raise HopdiffError(f"{name} has an unknown entry {key!r}.{near(str(key), KEYS)}")
    outline = value.get("outline")
    if not (isinstance(outline, Sequence) and all(_numbers(one, 2) for one in outline) and len(outline) >= 3):
        raise HopdiffError(f"{name}.outline must be three or more places [x, z], not {outline!r}.")
    corners = np.asarray(outline, dtype=np.float64)
    polygon = Polygon(corners)
    if not polygon.is_valid:
        raise HopdiffError(f"{name}.outline crosses or touches itself.")
    if polygon.area < 1e-6:
        raise HopdiffError(f"{name}.outline encloses nothing.")
    return Patch(corners, _plane(name, value))


def _plane(name: str, value: Mapping[str, Any]) -> tuple[float, float, float]:
    height, corners = value.get("height"), value.get("corners")
    if (height is None) == (corners is None):
        raise HopdiffError(f"{name} needs either height or corners.")
    if height is not None:
        if not _numbers([height], 1):
            raise HopdiffError(f"{name}.height must be a finite number of metres, not {height!r}.")
        return float(height), 0.0, 0.0
    if not (isinstance(corners, Sequence) and len(corners) == 3 and all(_numbers(one, 3) for one in corners)):
        raise HopdiffError(f"{name}.corners must be three places [x, height, z], not {corners!r}.")
    try:
        plane = plane_through(corners)
    except ValueError as error:
        raise HopdiffError(f"{name}.corners must not lie on one line.") from error
    steep = math.degrees(math.atan(math.hypot(*plane[1:])))
    if steep > STEEPEST + 1e-6:
        raise HopdiffError(f"{name} is steeper than {STEEPEST:g} degrees: {steep:.1f}.")
    return plane
