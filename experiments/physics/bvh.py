"""A plain reader of BVH files, y up."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from experiments.physics.recording import Array, UnfitError

# Metres in a unit; the third is an inch, the last what the CMU motion capture database counts in.
UNITS = (1.0, 0.01, 0.0254, 0.001, 0.0254 / 0.45)
LEG = 0.85  # m, thigh and shank of a grown-up person


@dataclass(frozen=True, eq=False)
class Bvh:
    """offsets: (J, 3), root: (T, 3), both in units of the file; ends: by joint (3,); rotations: (T, J, 3, 3)."""

    names: tuple[str, ...]
    parents: tuple[int, ...]
    offsets: Array
    ends: dict[str, Array]
    root: Array
    rotations: Array
    frame_time: float


def read_bvh(path: Path) -> Bvh:
    """The motion in a BVH file. Joints other than the root may only turn. Raises UnfitError for what is no BVH file."""
    try:
        return _read(path.read_text(encoding="utf-8-sig"))
    except (OSError, ValueError, LookupError, StopIteration) as error:
        raise UnfitError(f"{path.name} cannot be read as BVH ({error})") from error


def _read(text: str) -> Bvh:
    head, _, motion = text.partition("MOTION")
    words = iter(head.split())
    names: list[str] = []
    parents: list[int] = []
    offsets: dict[int, Array] = {}
    channels: list[list[str]] = []
    ends: dict[str, Array] = {}
    above: list[int] = []  # joints whose braces are open; -1 for an end site
    next_one = -1
    for word in words:
        if word in ("ROOT", "JOINT"):
            names.append(next(words))
            parents.append(above[-1] if above else -1)
            channels.append([])
            next_one = len(names) - 1
        elif word == "End":
            next_one = -1
        elif word == "{":
            above.append(next_one)
        elif word == "}":
            above.pop()
        elif word == "OFFSET":
            offset = np.array([float(next(words)) for _ in range(3)])
            if above[-1] >= 0:
                offsets[above[-1]] = offset
            else:
                ends[names[above[-2]]] = offset
        elif word == "CHANNELS":
            channels[-1] = [next(words).lower() for _ in range(int(next(words)))]
    lines = motion.split("\n")
    start = next((i for i, line in enumerate(lines) if line.strip().lower().startswith("frame time")), None)
    if start is None:
        raise ValueError("no frames")
    values = np.array([line.split() for line in lines[start + 1 :] if line.strip()], dtype=np.float64)
    root, rotations, column = np.zeros((len(values), 3)), [], 0
    for joint, own in enumerate(channels):
        cells = dict(zip(own, values[:, column : column + len(own)].T, strict=True))
        column += len(own)
        if joint == 0:
            root = np.stack([cells.get(f"{axis}position", np.zeros(len(values))) for axis in "xyz"], axis=-1)
        turns = [name for name in own if name.endswith("rotation")]
        order = "".join(name[0].upper() for name in turns)
        angles = np.stack([cells[name] for name in turns], axis=-1)
        rotations.append(Rotation.from_euler(order, angles, degrees=True).as_matrix())
    placed = np.stack([offsets[joint] for joint in range(len(names))])
    frame_time = float(lines[start].split(":")[1])
    return Bvh(tuple(names), tuple(parents), placed, ends, root, np.stack(rotations, axis=1), frame_time)


def unit_of(leg: float) -> float:
    """Metres in a unit of a file whose thigh and shank have this length in it."""
    return min(UNITS, key=lambda unit: abs(np.log(unit * leg / LEG)))
