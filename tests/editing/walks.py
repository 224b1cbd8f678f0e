"""Paths and clips that tests of edits start from."""

from __future__ import annotations

import math
from functools import cache

import torch

from hopdiff.editing.root_path import RootPath, root_path
from hopdiff.geometry.clip import Clip
from hopdiff.motion import Motion
from tests.builders import make_problem, valid_genes
from tests.people import clip_of


def walk(frames: int = 120, frame_time: float = 1.0 / 30.0, bend: float = 0.0, facing: float = 0.0) -> RootPath:
    """A walk at 1.3 m/s that sways and surges with its steps. bend: turn over the whole way; facing: off the way."""
    time = frame_time * torch.arange(frames, dtype=torch.float64)
    share = time / time[-1]
    way = 1.3 * time + 0.02 * torch.sin(2.0 * math.pi * 1.9 * time)
    sway = 0.03 * torch.sin(2.0 * math.pi * 0.95 * time)
    heading = bend * share + 0.3
    ahead = torch.stack((torch.sin(heading), torch.cos(heading)), dim=-1)
    left = torch.stack((torch.cos(heading), -torch.sin(heading)), dim=-1)
    moved = way.diff()[:, None] * ahead[:-1]
    place = torch.cat((torch.zeros(1, 2, dtype=torch.float64), moved.cumsum(0))) + sway[:, None] * left
    return RootPath(place + 1.0, heading + facing + 0.05 * torch.sin(2.0 * math.pi * 0.95 * time))


@cache
def stride_motion() -> Motion:
    """One stride of a run of our own, with all that is known of it."""
    problem = make_problem("speed=3", "beta=0.2")
    return problem.motion(valid_genes(problem, 1, seed=2)[0], 60.0)


def stride() -> Clip:
    return stride_motion().clip


def path_of_clip(name: str) -> tuple[RootPath, float]:
    """Of a walk that is made or captured, and its seconds a frame."""
    clip = clip_of(name)
    return root_path(clip), clip.frame_time
