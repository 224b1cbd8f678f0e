"""How fast found genes become frames, as a multiple of real time."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable
from typing import NamedTuple

import torch
from torch import Tensor

from hopdiff.composing import compose
from hopdiff.config import build_job
from hopdiff.models.gait import Gait
from hopdiff.problem import RunProblem

TRIED = 512  # random candidates among which possible runs are looked for


class Playback(NamedTuple):
    """Median seconds for a batch: solving the run, all its frames in one call, and its frames one by one."""

    solving: float
    frames: float
    one_by_one: float


def play(model: str, size: int, rounds: int, seconds: float, fps: float) -> Playback:
    """Time the frames of `size` runs of `seconds` [s] each, in turns. A frame is the travel of the root and the
    rotations of all joints."""
    torch.set_num_threads(1)
    problem = build_job(compose([f"model={model}"])).problem
    genes = possible(problem, size)
    gait = problem.gait(genes)
    times = torch.arange(round(seconds * fps), dtype=genes.dtype) / fps
    calls: dict[str, Callable[[], object]] = {
        "solving": lambda: problem.gait(genes),
        "frames": lambda: frames(gait, times),
        "one_by_one": lambda: [frames(gait, moment) for moment in times.split(1)],
    }
    taken: dict[str, list[float]] = {name: [] for name in calls}
    for call in calls.values():
        call()
    for _ in range(rounds):
        for name, call in calls.items():
            start = time.perf_counter()
            call()
            taken[name].append(time.perf_counter() - start)
    return Playback(**{name: statistics.median(values) for name, values in taken.items()})


def possible(problem: RunProblem, size: int) -> Tensor:
    """(size, G) random candidates that are possible runs, the same ones again where there are not enough."""
    tried = torch.rand(TRIED, problem.dimension, dtype=problem.dtype, generator=torch.Generator().manual_seed(0))
    found = tried[torch.isfinite(problem.evaluate(tried, with_grad=False).cost)]
    return found[torch.arange(size) % len(found)]


@torch.no_grad()
def frames(gait: Gait, times: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Travel and height of HIP (P, T) [m] and joint rotations (P, T, J, 3, 3) at times (T,) [s]."""
    pose = gait.sample(times)
    return pose.travel, pose.height, gait.character.rotations(pose.channels)
