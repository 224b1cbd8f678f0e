"""Skeletons as programs write them: names, which hangs on which, and what parts of ours they are.

A table for tests and experiments, from the files of `families`, without places: whoever makes a body puts the parts
where a human of 1.7 m in T pose has them, and every other joint beside its parent. Axes: x left, y up, z forward; m.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

BESIDE = (0.0, 0.0, -0.02)  # m, where a joint that is no part lies from its parent if nothing else is said


class Bone(NamedTuple):
    """part: of ours, None for a helper. offset: of helpers, from their parent, of a root from the origin [m]."""

    name: str
    parent: str | None
    part: str | None
    offset: tuple[float, float, float] = BESIDE


@dataclass(frozen=True)
class Family:
    """bones: parents first."""

    bones: tuple[Bone, ...]

    @property
    def parts(self) -> dict[str, str]:
        """Part -> name of the joint."""
        return {bone.part: bone.name for bone in self.bones if bone.part is not None}


def family(tree: str, sides: tuple[str, str] = ("Left", "Right")) -> Family:
    """tree: a joint a line, indented by two below what it hangs on: `name`, `name = part`, or `name @ x y z`, the place
    of a helper from its parent. A joint with # in its name is there with all below it for the left side and, mirrored,
    for the right one, # being the side."""
    lines = [line for line in tree.splitlines() if line.strip()]
    bones: list[Bone] = []
    at = 0
    while at < len(lines):
        end = at + 1
        if "#" in lines[at]:
            while end < len(lines) and _depth(lines[end]) > _depth(lines[at]):
                end += 1
        above = _line_above(lines, at)
        parent = None if above is None else _read(above, "", "").name
        for side, word in zip(("left", "right"), sides, strict=True) if "#" in lines[at] else (("", ""),):
            bones += _branch(lines[at:end], parent, side, word)
        at = end
    return Family(tuple(bones))


def _branch(lines: list[str], parent: str | None, side: str, word: str) -> list[Bone]:
    found: list[Bone] = []
    for at, line in enumerate(lines):
        above = _line_above(lines, at)
        found.append(_read(line, side, word)._replace(parent=_read(above, side, word).name if above else parent))
    return found


def _line_above(lines: list[str], at: int) -> str | None:
    return next((line for line in reversed(lines[:at]) if _depth(line) < _depth(lines[at])), None)


def _depth(line: str) -> int:
    return len(line) - len(line.lstrip())


def _read(line: str, side: str, word: str) -> Bone:
    name, _, place = line.strip().partition(" @ ")
    name, _, part = name.partition(" = ")
    x, y, z = (float(one) for one in place.split()) if place else BESIDE
    part = f"{side}_{part}" if part and side else part
    return Bone(name.replace("#", word), None, part or None, (-x if side == "right" else x, y, z))


def _called(given: Family, names: Mapping[str, str]) -> Family:
    return Family(tuple(b._replace(name=names[b.name], parent=b.parent and names[b.parent]) for b in given.bones))


def _behind(before: str, given: Family) -> Family:
    return _called(given, {bone.name: before + bone.name for bone in given.bones})


def _numbered(given: Family) -> Family:
    """The same skeleton as Blender calls new bones: Bone, Bone.001 and so on."""
    return _called(given, {bone.name: f"Bone.{k:03d}" if k else "Bone" for k, bone in enumerate(given.bones)})


# The words for the sides in the files of `families`.
SIDES = {
    "mixamo": ("Left", "Right"),
    "capture": ("Left", "Right"),
    "roblox": ("Left", "Right"),
    "smpl_x": ("left", "right"),
    "mmd": ("左", "右"),
    "mmd_later": ("左", "右"),
    "daz_genesis_8": ("l", "r"),
    "daz_genesis_9": ("l", "r"),
    "unreal_4": ("l", "r"),
    "unreal_5": ("l", "r"),
}
WRITTEN = {
    path.stem: family(path.read_text(encoding="utf-8"), SIDES.get(path.stem, ("L", "R")))
    for path in sorted((Path(__file__).parent / "families").glob("*.txt"))
}
FAMILIES: dict[str, Family] = {
    **{name: given for name, given in WRITTEN.items() if name != "mixamo"},
    "mixamo": _behind("mixamorig:", WRITTEN["mixamo"]),
    "mixamo_9": _behind("mixamorig9:", WRITTEN["mixamo"]),
    "mixamo_underscore": _behind("mixamorig_", WRITTEN["mixamo"]),
    "ready_player_me": WRITTEN["mixamo"],
    "numbered": _numbered(WRITTEN["mixamo"]),
}
