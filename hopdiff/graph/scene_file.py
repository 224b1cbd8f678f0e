"""Scenes as YAML files.

    name: two_rooms            # optional, the file's name by default
    wall_thickness: 0.15       # optional [m]: of the walls around everything, drawn only
    rooms:                     # name: corners [x, z] of the floor, in order around it [m]
      bedroom: [[0, 0], [4.5, 0], [4.5, 4], [0, 4]]
      study: [[0, 5], [4.5, 5], [4.5, 9], [0, 9]]
    passages:                  # doors too: from the middle of one opening to that of the other
      hall: {between: [bedroom, study], from: [2, 4], to: [2, 5], width: 1.2}
    walls:                     # optional: walls that stand inside a room, by their middle line
      screen: {from: [0, 2], to: [1, 2], thickness: 0.1}
    furniture:                 # optional: name: corners [x, z]
      bed: [[3, 1], [4.5, 1], [4.5, 3], [3, 3]]
    places:                    # optional: where ways start and end
      start: {position: [1, 1], heading: 90}   # heading: degrees from +z towards +x
    ground:                    # optional: what feet stand on, with the settings of a file in conf/ground/
      kind: polygons
      patches: [{outline: study, height: 0.17}]   # outlines may be names of rooms, passages and furniture

All lengths are metres. Floor that is neither room nor passage is wall; what two rooms leave between them is the
thickness of that wall, and the way through it a passage as long as the wall is thick.
"""

from __future__ import annotations

import math
import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from hopdiff.graph.scene import Passage, Place, Points, Scene, Wall, check_scene
from hopdiff.io.files import read_text
from hopdiff.messages import near
from hopdiff.types import HopdiffError

SECTIONS = ("name", "wall_thickness", "rooms", "passages", "walls", "furniture", "places", "ground")

LARGEST = 1_000_000  # characters of a file
DEEPEST = 20  # lists and mappings inside each other

Lines = dict[tuple[str, ...], int]


def read_scene(path: str | os.PathLike[str]) -> Scene:
    """Read a scene file. Raises HopdiffError, naming file and line, where it is not a sensible scene."""
    text = read_text(path)
    try:
        _check_events(text, str(path))
        root = yaml.compose(text, Loader=yaml.SafeLoader)
        lines: Lines = {}
        if root is not None:
            _find_lines(root, (), lines, str(path))
        data = yaml.safe_load(text)
    except yaml.MarkedYAMLError as error:
        line = error.problem_mark.line + 1 if error.problem_mark else 1
        raise HopdiffError(f"{path}, line {line}: not YAML ({error.problem or error.context}).") from error
    except yaml.YAMLError as error:
        raise HopdiffError(f"{path}: not YAML ({str(error).splitlines()[0]}).") from error
    except (ValueError, RecursionError) as error:
        raise HopdiffError(f"{path}: not a sensible scene file ({type(error).__name__}).") from error
    return scene_of(data, str(path), lines, Path(path).stem)


def scene_of(
    data: Any, where: str = "scene", lines: Mapping[tuple[str, ...], int] | None = None, name: str = "scene"
) -> Scene:
    """A scene from what a scene file holds.

    where: what errors name first. lines: of the entries, by section and name. name: where the data have none.
    Raises HopdiffError where it is not a sensible scene.
    """
    return _Reader(where, lines or {}).scene(data, name)


def _check_events(text: str, file: str) -> None:
    """Refuse what can make a small file endless or slow, and has no use in a scene."""
    if len(text) > LARGEST:
        raise HopdiffError(f"{file}: a scene file has at most {LARGEST} characters, not {len(text)}.")
    depth = 0
    for event in yaml.parse(text, Loader=yaml.SafeLoader):
        line = event.start_mark.line + 1
        if isinstance(event, yaml.AliasEvent):
            raise HopdiffError(f"{file}, line {line}: a scene file must not use YAML aliases (*name).")
        depth += isinstance(event, yaml.CollectionStartEvent) - isinstance(event, yaml.CollectionEndEvent)
        if depth > DEEPEST:
            raise HopdiffError(f"{file}, line {line}: not a sensible scene file (nested too deeply).")


def _find_lines(node: yaml.Node, at: tuple[str, ...], lines: Lines, file: str) -> None:
    """Note the line of every entry of a file, and see that no name comes twice in one place."""
    if not isinstance(node, yaml.MappingNode):
        return
    for key, value in node.value:
        entry = (*at, str(key.value))
        line = key.start_mark.line + 1
        if entry in lines:
            raise HopdiffError(f"{file}, line {line}: {'.'.join(entry)} was already given in line {lines[entry]}.")
        lines[entry] = line
        _find_lines(value, entry, lines, file)


class _Reader:
    """Turns plain data into a scene; every error says where."""

    def __init__(self, where: str, lines: Mapping[tuple[str, ...], int]) -> None:
        self.where = where
        self.lines = lines

    def said(self, *at: str) -> str:
        """File and line of an entry, or of the nearest one around it."""
        while at and at not in self.lines:
            at = at[:-1]
        return f"{self.where}, line {self.lines[at]}: " if at else f"{self.where}: "

    def scene(self, data: Any, name: str) -> Scene:
        entries = self._mapping((), data, SECTIONS, required=("rooms",))
        given = entries.get("name", name)
        if not isinstance(given, str):
            raise HopdiffError(f"{self.said('name')}name must be text, not {given!r}.")
        thickness = self._number(("wall_thickness",), entries.get("wall_thickness", 0.1))
        scene = Scene(
            given,
            {key: self._points(("rooms", key), value) for key, value in self._section(entries, "rooms")},
            {key: self._passage(("passages", key), value) for key, value in self._section(entries, "passages")},
            {key: self._wall(("walls", key), value) for key, value in self._section(entries, "walls")},
            {key: self._points(("furniture", key), value) for key, value in self._section(entries, "furniture")},
            {key: self._place(("places", key), value) for key, value in self._section(entries, "places")},
            thickness,
        )
        check_scene(scene, self.said)
        ground = entries.get("ground")
        return scene if ground is None else replace(scene, ground=self._ground(ground, scene))

    def _section(self, entries: Mapping[str, Any], name: str) -> Iterable[tuple[str, Any]]:
        section = entries.get(name)
        return () if section is None else self._mapping((name,), section).items()

    def _ground(self, data: Any, scene: Scene) -> Mapping[str, Any]:
        """Settings of a ground, which what builds it checks; names of parts of the scene are replaced by outlines."""
        entry = dict(self._mapping(("ground",), data))
        if _is_list(entry.get("patches")):
            entry["patches"] = [self._patch(one, scene) for one in entry["patches"]]
        return entry

    def _patch(self, data: Any, scene: Scene) -> Any:
        name = data.get("outline") if isinstance(data, Mapping) else None
        if not isinstance(name, str):
            return data
        floors = {key: passage.polygon().exterior.coords[:-1] for key, passage in scene.passages.items()}
        known = {**floors, **scene.furniture, **scene.rooms}
        if name not in known:
            said = self.said("ground", "patches")
            raise HopdiffError(f"{said}ground.patches: there is no {name!r} in the scene.{near(name, known)}")
        return {**data, "outline": np.asarray(known[name]).tolist()}

    def _passage(self, at: tuple[str, str], data: Any) -> Passage:
        keys = ("between", "from", "to", "width")
        entry = self._mapping(at, data, keys, required=keys)
        rooms = entry["between"]
        if not (_is_list(rooms) and len(rooms) == 2 and all(isinstance(room, str) for room in rooms)):
            raise HopdiffError(f"{self.said(*at, 'between')}{'.'.join(at)}.between must name two rooms, not {rooms!r}.")
        start, end = self._pair((*at, "from"), entry["from"]), self._pair((*at, "to"), entry["to"])
        return Passage((rooms[0], rooms[1]), start, end, self._number((*at, "width"), entry["width"]))

    def _wall(self, at: tuple[str, str], data: Any) -> Wall:
        keys = ("from", "to", "thickness")
        entry = self._mapping(at, data, keys, required=keys)
        start, end = self._pair((*at, "from"), entry["from"]), self._pair((*at, "to"), entry["to"])
        return Wall(start, end, self._number((*at, "thickness"), entry["thickness"]))

    def _place(self, at: tuple[str, str], data: Any) -> Place:
        keys = ("position", "heading")
        entry = self._mapping(at, data, keys, required=keys)
        heading = math.radians(self._number((*at, "heading"), entry["heading"]))
        return Place(self._pair((*at, "position"), entry["position"]), heading)

    def _mapping(
        self, at: tuple[str, ...], data: Any, keys: Sequence[str] = (), required: Sequence[str] = ()
    ) -> Mapping[str, Any]:
        """A mapping with text as keys: only `keys`, if given, and all of `required`."""
        name = ".".join(at) or "a scene"
        if not isinstance(data, Mapping):
            wanted = f"entries {', '.join(keys)}" if keys else "named entries"
            raise HopdiffError(f"{self.said(*at)}{name} must have {wanted}, not {_short(data)}.")
        for key in data:
            if not isinstance(key, str):
                raise HopdiffError(f"{self.said(*at)}{name}: the name {key!r} must be text (write it in quotes).")
            if keys and key not in keys:
                raise HopdiffError(
                    f"{self.said(*at, key)}{name} has an unknown entry {key!r}: "
                    f"there are {', '.join(keys)}.{near(key, keys)}"
                )
        for key in required:
            if key not in data:
                raise HopdiffError(f"{self.said(*at)}{name} needs the entry {key!r}.")
        return data

    def _points(self, at: tuple[str, ...], data: Any) -> Points:
        if not _is_list(data):
            raise HopdiffError(f"{self.said(*at)}{'.'.join(at)} must be a list of points [x, z], not {_short(data)}.")
        return np.array([self._pair(at, point) for point in data], dtype=np.float64).reshape(-1, 2)

    def _pair(self, at: tuple[str, ...], data: Any) -> tuple[float, float]:
        if not (_is_list(data) and len(data) == 2):
            raise HopdiffError(f"{self.said(*at)}{'.'.join(at)}: a point must be [x, z] in metres, not {_short(data)}.")
        return self._number(at, data[0]), self._number(at, data[1])

    def _number(self, at: tuple[str, ...], data: Any) -> float:
        if isinstance(data, bool) or not isinstance(data, int | float) or not math.isfinite(data):
            raise HopdiffError(f"{self.said(*at)}{'.'.join(at)} must be made of finite numbers, not {_short(data)}.")
        return float(data)


def _is_list(data: Any) -> bool:
    return isinstance(data, Sequence) and not isinstance(data, str)


def _short(data: Any) -> str:
    text = repr(data)
    return text if len(text) <= 40 else f"{text[:37]}..."
