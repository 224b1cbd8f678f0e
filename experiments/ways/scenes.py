"""Scenes drawn at random, as a scene file holds them: flats, a hall and a warehouse with doors .8 m wide."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import shapely
from shapely import Polygon, box

Data = dict[str, Any]
Rectangle = tuple[float, float, float, float]  # low x, low z, high x, high z [m]

DOOR = 0.8  # m
WALL = 0.1  # m
HALF_WIDTH = 0.25  # m; of the body, for which all of a scene must hang together
ATTEMPTS = 200  # to put one thing somewhere, or to draw a flat


@dataclass
class Plan:
    """A scene that is being drawn."""

    name: str
    rooms: dict[str, Any] = field(default_factory=dict)
    passages: dict[str, Any] = field(default_factory=dict)
    walls: dict[str, Any] = field(default_factory=dict)
    furniture: dict[str, Any] = field(default_factory=dict)

    def data(self) -> Data:
        """What a scene file holds."""
        parts = {"passages": self.passages, "walls": self.walls, "furniture": self.furniture}
        return {"name": self.name, "rooms": self.rooms, **{name: part for name, part in parts.items() if part}}


def _cm(number: float) -> float:
    """Rounded to the centimetre, and no longer numpy's."""
    return round(float(number), 2)


def corners(rectangle: Rectangle) -> list[list[float]]:
    """The outline of a rectangle, in centimetres' steps [m]."""
    low_x, low_z, high_x, high_z = (_cm(number) for number in rectangle)
    return [[low_x, low_z], [high_x, low_z], [high_x, high_z], [low_x, high_z]]


def floor_of(data: Mapping[str, Any]) -> Any:
    """The free floor of a scene's data, a polygon of shapely."""
    floors = [Polygon(outline) for outline in data["rooms"].values()]
    for door in data.get("passages", {}).values():
        line = shapely.LineString([door["from"], door["to"]])
        floors.append(line.buffer(door["width"] / 2, cap_style="flat").buffer(1e-6, join_style="mitre"))
    things = [Polygon(outline) for outline in data.get("furniture", {}).values()]
    for wall in data.get("walls", {}).values():
        things.append(shapely.LineString([wall["from"], wall["to"]]).buffer(wall["thickness"] / 2, cap_style="flat"))
    return shapely.difference(shapely.union_all(floors), shapely.union_all(things))


def hangs_together(data: Mapping[str, Any]) -> bool:
    """Whether a body gets from everywhere to everywhere, but for corners smaller than half a square metre."""
    parts = shapely.get_parts(floor_of(data).buffer(-HALF_WIDTH - 0.02))
    return len([part for part in parts if part.area > 0.5]) == 1


def flat(seed: int, rooms: int = 12, wide: float = 14.0, long: float = 11.0) -> Data:
    """A flat: a rectangle that is cut in two again and again, with a door from each room and some doors more."""
    for attempt in range(ATTEMPTS):
        rng = np.random.default_rng((seed, attempt))
        plan = Plan(f"flat_{seed}")
        parts = _parts(rng, (0.0, 0.0, wide, long), rooms)
        plan.rooms = {f"room_{k + 1}": corners(part) for k, part in enumerate(parts)}
        doors = _doors(rng, parts)
        if doors is None:
            continue
        plan.passages = doors
        _furnish(rng, plan, parts, doors)
        if hangs_together(plan.data()):
            return plan.data()
    raise ValueError(f"no flat of {rooms} rooms hangs together")


def _parts(rng: np.random.Generator, whole: Rectangle, count: int) -> list[Rectangle]:
    """The largest rectangle is cut across its long side, until there are enough."""
    parts = [whole]
    while len(parts) < count:
        parts.sort(key=lambda one: (one[2] - one[0]) * (one[3] - one[1]))
        low_x, low_z, high_x, high_z = parts.pop()
        share = rng.uniform(0.38, 0.62)
        if high_x - low_x > high_z - low_z:
            at = low_x + share * (high_x - low_x)
            parts += [(low_x, low_z, at - WALL / 2, high_z), (at + WALL / 2, low_z, high_x, high_z)]
        else:
            at = low_z + share * (high_z - low_z)
            parts += [(low_x, low_z, high_x, at - WALL / 2), (low_x, at + WALL / 2, high_x, high_z)]
    return parts


def _doors(rng: np.random.Generator, parts: list[Rectangle]) -> Data | None:
    """Doors along a random tree of the rooms, and a third of the others that there could be; None without a tree."""
    possible = []
    for a, first in enumerate(parts):
        for b, second in enumerate(parts):
            for x, z in ((0, 1), (1, 0)):
                low, high = max(first[z], second[z]), min(first[z + 2], second[z + 2])
                beside = abs(second[x] - first[x + 2] - WALL) < 1e-6
                if beside and high - low > DOOR + 0.3:
                    at = rng.uniform(low + DOOR / 2 + 0.1, high - DOOR / 2 - 0.1)
                    ends = [[first[x + 2], at], [second[x], at]]
                    possible.append((a, b, [[_cm(n) for n in (end if x == 0 else end[::-1])] for end in ends]))
    order = rng.permutation(len(possible))
    group = list(range(len(parts)))
    doors: Data = {}
    for k in order.tolist():
        a, b, (start, end) = possible[k]
        joins = group[a] != group[b]
        if joins or rng.random() < 0.33:
            group = [group[a] if one == group[b] else one for one in group]
            rooms = [f"room_{a + 1}", f"room_{b + 1}"]
            doors[f"door_{len(doors) + 1}"] = {"between": rooms, "from": start, "to": end, "width": DOOR}
    return doors if len(set(group)) == 1 else None


def _furnish(rng: np.random.Generator, plan: Plan, parts: list[Rectangle], doors: Data) -> None:
    """Two pieces to a room at most, against a wall or free, none before a door."""
    before = shapely.union_all([shapely.LineString([door["from"], door["to"]]).buffer(1.0) for door in doors.values()])
    for part in parts:
        put: list[Any] = []
        for _ in range(12):
            wide, long = rng.uniform(0.5, 1.8), rng.uniform(0.5, 1.0)
            if rng.random() < 0.5:
                wide, long = long, wide
            if wide > part[2] - part[0] - 1.0 or long > part[3] - part[1] - 1.0:
                continue
            x = rng.choice([part[0], part[2] - wide, rng.uniform(part[0], part[2] - wide)])
            z = rng.choice([part[1], part[3] - long, rng.uniform(part[1], part[3] - long)])
            piece = corners((x, z, x + wide, z + long))
            shape = Polygon(piece)
            if shape.intersects(before) or any(shape.distance(other) < 0.8 for other in put):
                continue
            plan.furniture[f"piece_{len(plan.furniture) + 1}"] = piece
            put.append(shape)
            if len(put) == 2:
                break


def hall(seed: int, long: float = 50.0, wide: float = 16.0) -> Data:
    """A hall of 50 m, with walls across it that leave a door of .8 m, and walls and tables at random between."""
    rng = np.random.default_rng(seed)
    plan = Plan(f"hall_{seed}", rooms={"hall": corners((0.0, 0.0, wide, long))})
    for k, at in enumerate((0.33, 0.67)):
        z = _cm(at * long)
        x = _cm(rng.uniform(1.0, wide - 1.0 - DOOR))
        plan.walls[f"across_{k + 1}_left"] = {"from": [0.0, z], "to": [x, z], "thickness": WALL}
        plan.walls[f"across_{k + 1}_right"] = {"from": [_cm(x + DOOR), z], "to": [wide, z], "thickness": WALL}
    for k in range(22):
        _put(rng, plan, f"wall_{k + 1}", (wide, long), wall=True)
    for k in range(22):
        _put(rng, plan, f"table_{k + 1}", (wide, long), wall=False)
    return plan.data()


def _put(rng: np.random.Generator, plan: Plan, name: str, size: tuple[float, float], wall: bool) -> None:
    """A wall in any direction or a table somewhere in the hall, where all still hangs together."""
    for _ in range(ATTEMPTS):
        x, z = rng.uniform(0.5, size[0] - 0.5), rng.uniform(0.5, size[1] - 0.5)
        if wall:
            turn, length = rng.uniform(0.0, np.pi), rng.uniform(2.0, 7.0)
            end = [x + length * np.cos(turn), z + length * np.sin(turn)]
            if not (0.0 < end[0] < size[0] and 0.0 < end[1] < size[1]):
                continue
            ends = [[_cm(n) for n in point] for point in ([x, z], end)]
            plan.walls[name] = {"from": ends[0], "to": ends[1], "thickness": WALL}
        else:
            plan.furniture[name] = corners((x, z, x + rng.uniform(0.4, 2.0), z + rng.uniform(0.4, 2.0)))
            if not box(0.0, 0.0, *size).covers(Polygon(plan.furniture[name])):
                del plan.furniture[name]
                continue
        if hangs_together(plan.data()):
            return
        plan.walls.pop(name, None)
        plan.furniture.pop(name, None)


def warehouse(seed: int, wide: float = 40.0, bays: int = 5, deep: float = 8.0) -> Data:
    """Bays side by side with racks along them, and doors at alternate ends: about 190 m from one end to the other."""
    rng = np.random.default_rng(seed)
    plan = Plan(f"warehouse_{seed}")
    for k in range(bays):
        low = k * (deep + WALL)
        plan.rooms[f"bay_{k + 1}"] = corners((0.0, low, wide, low + deep))
        if k:
            x = wide - 1.0 if k % 2 else 1.0
            ends = {"from": [x, _cm(low - WALL)], "to": [x, _cm(low)]}
            plan.passages[f"door_{k}"] = {"between": [f"bay_{k}", f"bay_{k + 1}"], **ends, "width": DOOR}
        for row in range(2):
            z = low + 2.2 + 2.8 * row
            x = rng.uniform(1.8, 3.0)
            while x < wide - 4.0:
                length = min(rng.uniform(4.0, 10.0), wide - 2.0 - x)
                plan.furniture[f"rack_{len(plan.furniture) + 1}"] = corners((x, z, x + length, z + 0.9))
                x += length + rng.uniform(1.0, 2.0)
    return plan.data()


@dataclass(frozen=True)
class Pair:
    """start, goal: x, z [m] and heading [degrees]."""

    start: tuple[float, float, float]
    goal: tuple[float, float, float]


def pairs(data: Mapping[str, Any], count: int, seed: int, half_width: float = HALF_WIDTH) -> list[Pair]:
    """Places where a body can be, drawn evenly over the floor, with any heading; to the millimetre."""
    rng = np.random.default_rng(seed)
    parts = shapely.get_parts(floor_of(data).buffer(-half_width - 0.01))
    free = max(parts, key=lambda part: part.area)
    low_x, low_z, high_x, high_z = free.bounds
    places: list[tuple[float, float, float]] = []
    while len(places) < 2 * count:
        x, z = rng.uniform(low_x, high_x), rng.uniform(low_z, high_z)
        heading = rng.uniform(-180.0, 180.0)
        if free.covers(shapely.Point(x, z)):
            places.append((round(x, 3), round(z, 3), round(heading, 1)))
    return [Pair(first, second) for first, second in zip(places[::2], places[1::2], strict=True)]


SCENES: Mapping[str, Callable[[], Data]] = {
    "flat_1": lambda: flat(1),
    "flat_2": lambda: flat(2),
    "hall_3": lambda: hall(3),
    "warehouse_4": lambda: warehouse(4),
}
