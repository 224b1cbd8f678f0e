"""The clips of the study and the edits that are asked of each."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product
from pathlib import Path

import torch

from hopdiff.composing import compose
from hopdiff.config import build_job
from hopdiff.editing.loop import repeated
from hopdiff.editing.root_path import RootPath
from hopdiff.editing.targets import Constraint
from hopdiff.geometry.clip import Clip
from hopdiff.io.bvh import read_bvh
from hopdiff.job import search_run
from hopdiff.types import HopdiffError

TURNS = (-90, -45, 0, 45, 90, 135, 180)  # degrees to the left
SHIFTS = ((0.0, 0.0), (0.3, 0.0), (0.0, 0.1))  # to the left and ahead, in shares of the net way
OWN = "run of our own"


@dataclass(frozen=True)
class Case:
    """What an edit asks of the last frame. left, ahead: of where the clip ends, in shares of its net way; from_start:
    of where it starts instead. turn: to the left [degrees], None to keep the clip's headings."""

    name: str
    left: float
    ahead: float
    turn: float | None
    from_start: bool = False

    def constraint(self, path: RootPath) -> Constraint:
        way = path.place[-1] - path.place[0]
        start = path.place[0] if self.from_start else path.place[-1]
        place = start + self.ahead * way + self.left * torch.stack((way[1], -way[0]))
        yaw = None if self.turn is None else float(path.yaw[-1]) + math.radians(self.turn)
        return Constraint(path.frames - 1, (float(place[0]), float(place[1])), yaw, keep=self.turn is None)


def grid() -> Iterator[Case]:
    for turn, (left, ahead) in product(TURNS, SHIFTS):
        yield Case(f"{turn} deg, {left:g} aside, {ahead:g} ahead", left, ahead, float(turn))


def clips(folder: Path | None) -> dict[str, Clip]:
    """The BVH files of a folder by name, those aside that are refused; without one, six strides of a run of our own."""
    if folder is not None:
        found = {}
        for file in sorted(folder.glob("*.bvh")):
            with contextlib.suppress(HopdiffError):  # which their edits' verdicts tell
                found[file.stem] = read_bvh(file).clip()
        return found
    job = build_job(compose(["model=smooth", "speed=3", "beta=0.2", "search=ordinary"]))
    return {OWN: repeated(search_run(job).clip, 6)}
