"""BVH files read for the studies that judge them, with numpy alone: nothing here knows hopdiff.

For well-formed files: words may be laid out as one likes, and names may hold anything but blanks and braces.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
# Metres in a unit: metres, centimetres, millimetres, inches, and an inch over 0.45, as the CMU database has it.
UNITS = (1.0, 0.01, 0.001, 0.0254, 0.0254 / 0.45)
LEG = 0.85  # m from hip to ankle of a grown-up
SIDES = ("left", "right")


@dataclass(frozen=True)
class Bvh:
    """names: J joints, parents first. parents: -1 for the root. offsets: (J, 3). channels: of each joint, lower case.
    ends: joint -> (3,) of its end site. values: (T, C), file units and degrees. frame_time: [s]."""

    names: tuple[str, ...]
    parents: tuple[int, ...]
    offsets: Floats
    channels: tuple[tuple[str, ...], ...]
    ends: dict[int, Floats]
    values: Floats
    frame_time: float

    def forward(self) -> tuple[Floats, Floats]:
        """Places (T, J, 3) in file units and orientations (T, J, 3, 3) in the world."""
        frames, column = len(self.values), 0
        places = np.zeros((frames, len(self.names), 3))
        turns = np.zeros((frames, len(self.names), 3, 3))
        for joint, words in enumerate(self.channels):
            place = np.tile(self.offsets[joint], (frames, 1))
            turn = np.tile(np.eye(3), (frames, 1, 1))
            if any(word.endswith("position") for word in words):
                # Channels of place stand for the offset, those that a file leaves out aside.
                for k, word in enumerate(words):
                    if word.endswith("position"):
                        place[:, "xyz".index(word[0])] = self.values[:, column + k]
            for k, word in enumerate(words):
                if word.endswith("rotation"):
                    turn = turn @ about("xyz".index(word[0]), np.radians(self.values[:, column + k]))
            column += len(words)
            above = self.parents[joint]
            if above < 0:
                places[:, joint], turns[:, joint] = place, turn
            else:
                places[:, joint] = places[:, above] + np.einsum("tij,tj->ti", turns[:, above], place)
                turns[:, joint] = turns[:, above] @ turn
        return places, turns


def about(axis: int, angle: Floats) -> Floats:
    """(T, 3, 3) turns about a main axis by angles (T,) [rad]."""
    c, s = np.cos(angle), np.sin(angle)
    found = np.zeros((len(angle), 3, 3))
    one, two = (axis + 1) % 3, (axis + 2) % 3
    found[:, axis, axis] = 1.0
    found[:, one, one] = found[:, two, two] = c
    found[:, one, two], found[:, two, one] = -s, s
    return found


def read(path: Path) -> Bvh:
    """A file. Raises ValueError, naming it, for one that is not well formed."""
    try:
        return _parsed(path.read_text(encoding="utf-8-sig", errors="replace"))
    except (IndexError, ValueError) as error:
        raise ValueError(f"{path}: no well-formed BVH file ({error})") from error


def _parsed(text: str) -> Bvh:
    head, motion = re.split(r"^\s*MOTION\s*$", text, maxsplit=1, flags=re.MULTILINE | re.IGNORECASE)
    names: list[str] = []
    parents: list[int] = []
    offsets: list[Floats] = []
    channels: list[tuple[str, ...]] = []
    ends: dict[int, Floats] = {}
    opened: list[int] = []  # -1: an end site
    coming = -1
    lines = (line.split() for line in re.sub(r"([{}])", r"\n\1\n", head).splitlines() if line.strip())
    for words in lines:
        word = words[0].upper()
        if word in ("ROOT", "JOINT"):
            coming = len(names)
            parents.append(opened[-1] if opened else -1)
            names.append(" ".join(words[1:]))
            offsets.append(np.zeros(3))
            channels.append(())
        elif word == "END":
            coming = -1
        elif word == "{":
            opened.append(coming)
        elif word == "}":
            opened.pop()
        elif word == "OFFSET":
            numbers = np.array([float(one) for one in words[1:4]])
            if opened[-1] < 0:
                ends[opened[-2]] = numbers
            else:
                offsets[opened[-1]] = numbers
        elif word == "CHANNELS":
            channels[opened[-1]] = tuple(one.lower() for one in words[2 : 2 + int(words[1])])
    rows = motion.split("\n")
    count = next(int(row.split()[1]) for row in rows if row.split()[:1] == ["Frames:"])
    at = next(k for k, row in enumerate(rows) if row.split()[:2] == ["Frame", "Time:"])
    width = sum(map(len, channels))
    values = np.array(" ".join(rows[at + 1 :]).split(), dtype=np.float64).reshape(-1, width)
    if len(values) != count:
        raise ValueError(f"{count} frames declared, {len(values)} found")
    return Bvh(
        tuple(names), tuple(parents), np.array(offsets), tuple(channels), ends, values, float(rows[at].split()[2])
    )


@dataclass(frozen=True)
class Leg:
    """Points of a leg, as `Body.places` counts them; toe: None where nothing hangs on the ankle."""

    hip: int
    knee: int
    ankle: int
    toe: int | None

    @property
    def feet(self) -> tuple[int, ...]:
        return (self.ankle,) if self.toe is None else (self.ankle, self.toe)


@dataclass(frozen=True)
class Body:
    """A motion in metres with y up. places: (T, P, 3), the joints and after them the end sites; turns: (T, J, 3, 3) in
    the world. parents: of the points. mover: the joint that carries the body along. unit: metres in a file unit."""

    bvh: Bvh
    places: Floats
    turns: Floats
    parents: tuple[int, ...]
    legs: tuple[Leg, Leg]
    mover: int
    unit: float
    frame_time: float

    @property
    def frames(self) -> int:
        return len(self.places)


def body(path: Path, like: Body | None = None) -> Body:
    """A file as a body. like: another of the same skeleton, whose unit, axes and legs are taken.

    Raises ValueError if it has no legs that can be told, or other joints than `like`.
    """
    bvh = read(path)
    places, turns = bvh.forward()
    for joint, end in bvh.ends.items():
        places = np.concatenate((places, (places[:, joint] + turns[:, joint] @ end)[:, None]), axis=1)
    parents = (*bvh.parents, *bvh.ends)
    if like is not None:
        if (bvh.names, bvh.channels) != (like.bvh.names, like.bvh.channels):
            raise ValueError(f"{path}: other joints than the source")
        legs, unit = like.legs, like.unit
    else:
        legs = _legs(bvh)
        chain = places[0, [legs[0].hip, legs[0].knee, legs[0].ankle]]
        size = float(np.linalg.norm(np.diff(chain, axis=0), axis=-1).sum())
        unit = min(UNITS, key=lambda one: abs(math.log(one * size / LEG)))
    above = places[:, legs[0].hip] + places[:, legs[1].hip] - places[:, legs[0].ankle] - places[:, legs[1].ankle]
    if np.abs(above.mean(axis=0)).argmax() == 2:  # z up: x stays
        axes = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
        places, turns = places @ axes.T, axes @ turns @ axes.T
    places = places * unit
    mover = like.mover if like is not None else _mover(places, bvh.parents, legs)
    return Body(bvh, places, turns, parents, legs, mover, unit, bvh.frame_time)


def _mover(places: Floats, parents: Sequence[int], legs: tuple[Leg, Leg]) -> int:
    """The root, or the joint that both legs hang on if the root stands while that goes along."""
    left, right = (_above(parents, leg.hip) for leg in legs)
    pelvis = next(joint for joint in left if joint in right)
    way = [float(np.linalg.norm(np.diff(places[:, k, ::2], axis=0), axis=-1).sum()) for k in (0, pelvis)]
    return pelvis if way[0] < 0.1 * way[1] else 0


def _above(parents: Sequence[int], joint: int) -> list[int]:
    found = []
    while (joint := parents[joint]) >= 0:
        found.append(joint)
    return found


def _legs(bvh: Bvh) -> tuple[Leg, Leg]:
    """The left and the right leg by name: a joint called a foot or an ankle, and the two bones above it; where there is
    none, a knee and the end site that hangs on it."""
    legs = []
    for side in SIDES:
        joints = [joint for joint, name in enumerate(bvh.names) if _side(name) == side]
        found = [leg for find in (_leg, _footless) for joint in joints if (leg := find(bvh, joint))]
        if not found:
            raise ValueError(f"no {side} leg found among {', '.join(bvh.names)}")
        legs.append(found[0])
    return legs[0], legs[1]


def _side(name: str) -> str | None:
    """left or right, as names of joints say it: LeftFoot, mixamorig:LeftFoot, foot_l, L_Foot, Bip01 L Foot, lFoot."""
    for side in SIDES:
        letter = f"[{side[0]}{side[0].upper()}]"
        if side in name.lower() or re.search(rf"(^|[\s_.:-]){letter}([\s_.:-]|$|(?=[A-Z]))", name):
            return side
    return None


def _leg(bvh: Bvh, ankle: int) -> Leg | None:
    if not re.search(r"foot|ankle", bvh.names[ankle], re.IGNORECASE) or bvh.parents[ankle] < 0:
        return None
    if re.search(r"foot|ankle", bvh.names[bvh.parents[ankle]], re.IGNORECASE):
        return None
    chain, joint = [ankle], ankle
    while len(chain) < 3 and (joint := bvh.parents[joint]) >= 0:
        if not re.search(r"twist|roll", bvh.names[joint], re.IGNORECASE):
            chain.append(joint)
    if len(chain) < 3 or bvh.parents[chain[2]] < 0:
        return None
    joints = len(bvh.names)
    below = [k for k, above in enumerate(bvh.parents) if above == ankle]
    toes = [k for k in below if re.search(r"toe|ball", bvh.names[k], re.IGNORECASE)] or below
    end = [joints + k for k, above in enumerate(bvh.ends) if above == ankle]
    return Leg(chain[2], chain[1], ankle, next(iter(toes or end), None))


def _footless(bvh: Bvh, knee: int) -> Leg | None:
    end = [len(bvh.names) + k for k, above in enumerate(bvh.ends) if above == knee]
    if not end or not re.search(r"knee|shin|calf|leg", bvh.names[knee], re.IGNORECASE):
        return None
    return Leg(bvh.parents[knee], knee, end[0], None)
