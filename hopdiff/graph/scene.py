"""Rooms to walk in: what is floor, what stands on it, and named places."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import shapely
from numpy.typing import ArrayLike, NDArray
from shapely import LineString, MultiPolygon, Polygon

from hopdiff.messages import near
from hopdiff.types import HopdiffError

Points = NDArray[np.float64]

TOUCH = 1e-6  # m by which passages reach into the rooms that they join, so that floors that touch become one


@dataclass(frozen=True)
class Place:
    """position: x and z [m]. heading: from +z towards +x [rad]."""

    position: tuple[float, float]
    heading: float


@dataclass(frozen=True)
class Passage:
    """A door or a passage between two rooms. start, end: the middles of its two openings [m]. width: [m]."""

    rooms: tuple[str, str]
    start: tuple[float, float]
    end: tuple[float, float]
    width: float

    def polygon(self) -> Polygon:
        """Its floor, a rectangle."""
        return _band(self.start, self.end, self.width, TOUCH)


@dataclass(frozen=True)
class Wall:
    """A wall that stands on the floor of a room. start, end: of its middle line [m]. thickness: [m]."""

    start: tuple[float, float]
    end: tuple[float, float]
    thickness: float

    def polygon(self) -> Polygon:
        return _band(self.start, self.end, self.thickness, 0.0)


@dataclass(frozen=True, eq=False)
class Scene:
    """rooms: outline of the floor of each (K, 2), x and z [m]. Rooms do not overlap: what lies between them is wall.

    furniture: outline of each piece (K, 2) [m]. thickness: of the walls around everything, for pictures [m]. ground:
    settings of what feet stand on, as of the group `ground`; none where it is flat.
    """

    name: str
    rooms: Mapping[str, Points]
    passages: Mapping[str, Passage] = field(default_factory=dict)
    walls: Mapping[str, Wall] = field(default_factory=dict)
    furniture: Mapping[str, Points] = field(default_factory=dict)
    places: Mapping[str, Place] = field(default_factory=dict)
    thickness: float = 0.1
    ground: Mapping[str, Any] = field(default_factory=dict)

    def floor(self) -> Polygon | MultiPolygon:
        """Rooms and passages, with all that stands there."""
        parts = [Polygon(outline) for outline in self.rooms.values()]
        return shapely.union_all([*parts, *(passage.polygon() for passage in self.passages.values())])

    def obstacles(self) -> dict[tuple[str, str], Polygon]:
        """What stands on the floor, by section ("walls" or "furniture") and name."""
        return {
            **{("walls", name): wall.polygon() for name, wall in self.walls.items()},
            **{("furniture", name): Polygon(outline) for name, outline in self.furniture.items()},
        }

    def free(self) -> Polygon | MultiPolygon:
        """The floor that nothing stands on."""
        return shapely.difference(self.floor(), shapely.union_all(list(self.obstacles().values())))

    def place(self, name: str) -> Place:
        """A named place. Raises HopdiffError for a name that there is not."""
        if name not in self.places:
            known = f"it has {', '.join(sorted(self.places))}" if self.places else "it has none"
            raise HopdiffError(f"scene {self.name} has no place {name!r}: {known}.{near(name, self.places)}")
        return self.places[name]


def _nowhere(*_: str) -> str:
    return ""


def check_scene(scene: Scene, where: Callable[..., str] = _nowhere) -> None:
    """See that a scene can be walked in.

    where: words, for the section and name of an entry, that an error starts with. Raises HopdiffError for a scene
    without rooms, outlines that are not simple polygons of some size, rooms that overlap, sizes that are not above 0,
    passages that do not join their two rooms, furniture and walls that touch no floor, and numbers that are not
    finite.
    """
    if not scene.rooms:
        raise HopdiffError(f"{where('rooms')}the scene {scene.name} has no rooms.")
    if not (math.isfinite(scene.thickness) and scene.thickness >= 0):
        said = where("wall_thickness")
        raise HopdiffError(f"{said}wall_thickness must be 0 or more metres, not {scene.thickness:g}.")
    for section, outlines in (("rooms", scene.rooms), ("furniture", scene.furniture)):
        for name, outline in outlines.items():
            _check_outline(where(section, name), f"{section}.{name}", outline)
    rooms = {name: Polygon(outline) for name, outline in scene.rooms.items()}
    for k, (name, room) in enumerate(rooms.items()):
        for other, there in list(rooms.items())[:k]:
            if room.intersection(there).area > TOUCH:
                raise HopdiffError(f"{where('rooms', name)}rooms.{name} overlaps rooms.{other}.")
    for name, wall in scene.walls.items():
        _check_band(where("walls", name), f"walls.{name}", wall.start, wall.end, "thickness", wall.thickness)
    for name, passage in scene.passages.items():
        said = where("passages", name)
        _check_band(said, f"passages.{name}", passage.start, passage.end, "width", passage.width)
        _check_ends(said, f"passages.{name}", passage, rooms)
    floor = scene.floor()
    for (section, name), polygon in scene.obstacles().items():
        if not polygon.intersects(floor):
            raise HopdiffError(f"{where(section, name)}{section}.{name} stands on no room's floor.")
    for name, place in scene.places.items():
        if not all(map(math.isfinite, (*place.position, place.heading))):
            raise HopdiffError(f"{where('places', name)}places.{name} holds a number that is not finite.")


def _check_outline(said: str, name: str, outline: ArrayLike) -> None:
    points = np.asarray(outline, dtype=float)
    if points.ndim != 2 or points.shape[1] != 2:
        raise HopdiffError(f"{said}{name} must be a list of points [x, z].")
    if not np.isfinite(points).all():
        raise HopdiffError(f"{said}{name} holds a number that is not finite.")
    corners = points[:-1] if len(points) > 1 and (points[0] == points[-1]).all() else points
    if len(corners) < 3:
        raise HopdiffError(f"{said}{name} needs at least 3 corners, not {len(corners)}.")
    polygon = Polygon(corners)
    if not polygon.is_valid:
        raise HopdiffError(f"{said}the outline of {name} crosses or touches itself.")
    if polygon.area < TOUCH:
        raise HopdiffError(f"{said}the outline of {name} encloses nothing.")


def _check_band(said: str, name: str, start: ArrayLike, end: ArrayLike, what: str, size: float) -> None:
    ends = np.array([start, end], dtype=float)
    if not np.isfinite(ends).all():
        raise HopdiffError(f"{said}{name} holds a number that is not finite.")
    if not (math.isfinite(size) and size > 0):
        raise HopdiffError(f"{said}{name}.{what} must be a number of metres above 0, not {size:g}.")
    if np.hypot(*(ends[1] - ends[0])) < TOUCH:
        raise HopdiffError(f"{said}{name} starts and ends at the same point.")


def _check_ends(said: str, name: str, passage: Passage, rooms: Mapping[str, Polygon]) -> None:
    for room in passage.rooms:
        if room not in rooms:
            raise HopdiffError(f"{said}{name} joins {room!r}, which is no room.{near(room, rooms)}")
    if passage.rooms[0] == passage.rooms[1]:
        raise HopdiffError(f"{said}{name} must join two different rooms, not {passage.rooms[0]!r} with itself.")
    floor = passage.polygon()
    for room, end in zip(passage.rooms, (passage.start, passage.end), strict=True):
        # Both corners of the opening, not only its middle.
        corners = _ends(passage.start, passage.end, passage.width, at_end=end is passage.end)
        if LineString(corners).intersection(rooms[room].buffer(10 * TOUCH)).length < passage.width - 1e-3:
            raise HopdiffError(
                f"{said}{name} does not open into {room!r} over its whole width at [{end[0]:g}, {end[1]:g}]."
            )
    for room, polygon in rooms.items():
        if room not in passage.rooms and floor.intersection(polygon).area > 1e-3:
            raise HopdiffError(f"{said}{name} runs through {room!r}, which it does not join.")


def _ends(start: ArrayLike, end: ArrayLike, width: float, at_end: bool) -> Points:
    """The two corners (2, 2) at one end of a band."""
    a, b = np.asarray(start, dtype=float), np.asarray(end, dtype=float)
    along = (b - a) / np.hypot(*(b - a))
    aside = 0.5 * width * np.array([along[1], -along[0]])
    middle = b if at_end else a
    return np.array([middle + aside, middle - aside])


def _band(start: ArrayLike, end: ArrayLike, width: float, more: float) -> Polygon:
    """The rectangle about a line, longer by `more` at both ends."""
    a, b = np.asarray(start, dtype=float), np.asarray(end, dtype=float)
    along = (b - a) / np.hypot(*(b - a))
    aside = 0.5 * width * np.array([along[1], -along[0]])
    a, b = a - more * along, b + more * along
    return Polygon([a + aside, b + aside, b - aside, a - aside])
