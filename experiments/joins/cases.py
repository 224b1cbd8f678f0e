"""Clips cut into what goes before a walk, the walk, and what comes after, and put anywhere."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch

from hopdiff.editing.root_path import root_path
from hopdiff.feet.prints import GroundMove
from hopdiff.geometry.clip import Clip
from hopdiff.io.bvh import BvhFile, read_bvh
from hopdiff.joins.seams import placed

SHORT, LONG = (1.0, 3.0), (2.5, 6.0)  # s of a neighbour and of a walk
LONGER = 0.25  # of the walk's way by which its end is moved, at most
TURN = math.radians(60.0)  # by which each of way and facing is turned, at most


@dataclass(frozen=True)
class Case:
    """name: of the three clips. before, walk, after: files."""

    name: str
    before: Path
    walk: Path
    after: Path


def groups(files: Sequence[Path]) -> list[list[Path]]:
    """Files of one skeleton, channels and frame time each."""
    found: dict[object, list[Path]] = {}
    for file in files:
        bvh = read_bvh(file)
        key = (round(bvh.frame_time, 5), *((one.name, one.channels, one.offset) for one in bvh.joints))
        found.setdefault(key, []).append(file)
    return list(found.values())


def cases(files: Sequence[Path], each: int, folder: Path, seed: int = 0) -> Iterator[Case]:
    """For every file as the walk some random neighbours out of its group, written into a folder."""
    chance = np.random.default_rng(seed)
    folder.mkdir(parents=True, exist_ok=True)
    for group in groups(files):
        for file in group:
            for number in range(each):
                three = [group[int(chance.integers(len(group)))], file, group[int(chance.integers(len(group)))]]
                made = _case(three, f"{file.stem}_{number}", folder, chance)
                if made is not None:
                    yield made


def _case(three: Sequence[Path], name: str, folder: Path, chance: np.random.Generator) -> Case | None:
    read = [read_bvh(file) for file in three]
    parts = [_cut(one, LONG if k == 1 else SHORT, chance) for k, one in enumerate(read)]
    walk = root_path(parts[1])
    way = walk.place[-1] - walk.place[0]
    before = _turned(parts[0], float(chance.uniform(-math.pi, math.pi)), chance.uniform(-5.0, 5.0, 2))
    begin = root_path(before)
    # Where the walk would end, and from there somewhat astray.
    turn = float(begin.yaw[-1] - walk.yaw[0] + chance.uniform(-TURN, TURN))
    c, s = math.cos(turn), math.sin(turn)
    ahead = torch.tensor((c * way[0] + s * way[1], c * way[1] - s * way[0]), dtype=torch.float64)
    end = begin.place[-1] + ahead * (1.0 + chance.uniform(-LONGER, LONGER))
    after = root_path(parts[2])
    facing = float(walk.yaw[-1]) + turn + chance.uniform(-TURN, TURN)
    last = _turned(parts[2], facing - float(after.yaw[0]), np.zeros(2))
    by = (end - root_path(last).place[0]).numpy()
    parts = [before, parts[1], _turned(last, 0.0, by)]
    paths = [folder / f"{name}_{what}.bvh" for what in ("before", "walk", "after")]
    for file, clip, path in zip(read, parts, paths, strict=True):
        file.with_motion(clip).write(path)
    return Case(f"{three[0].stem} / {three[1].stem} / {three[2].stem}", *paths)


def _cut(file: BvhFile, seconds: tuple[float, float], chance: np.random.Generator) -> Clip:
    clip = file.clip()
    count = min(clip.frames, round(float(chance.uniform(*seconds)) / clip.frame_time))
    start = int(chance.integers(clip.frames - count + 1))
    return clip.part(slice(start, start + count))


def _turned(clip: Clip, turn: float, by: np.ndarray[tuple[int, ...], np.dtype[np.float64]]) -> Clip:
    return placed(clip, GroundMove(torch.tensor(turn, dtype=torch.float64), torch.from_numpy(by)))
