"""Timing one kind of call, in a process of its own."""

from __future__ import annotations

import resource
import statistics
import time
from typing import NamedTuple

import torch

from experiments.bench.roofline import core, counted
from hopdiff.composing import compose
from hopdiff.config import build_job
from hopdiff.search.box import Box

MEGABYTE = 1024.0  # ru_maxrss counts kilobytes on Linux


class Measured(NamedTuple):
    """value, gradient: median seconds of a value, and of a value with its gradient. calls: operations of the latter.
    waits: times that the host asks the device for a number. roofline: the least seconds that they can take (see
    `roofline`). memory: megabytes that the process grew by.
    """

    value: float
    gradient: float
    calls: int
    waits: int
    roofline: float
    memory: float


def measure(model: str, dtype: str, size: int, rounds: int) -> Measured:
    """What pricing so many random candidates takes."""
    torch.set_num_threads(1)
    problem = build_job(compose([f"model={model}", f"dtype={dtype}", "beta=0.2"])).problem
    genes = Box.of(problem).first(size, torch.Generator().manual_seed(0))
    problem.evaluate(genes[:1], with_grad=True)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    problem.evaluate(genes, with_grad=True)
    times: dict[bool, list[float]] = {False: [], True: []}
    # Side by side, so that a slow moment of the machine meets both.
    for _ in range(rounds):
        for with_grad in times:
            start = time.perf_counter()
            problem.evaluate(genes, with_grad)
            times[with_grad].append(time.perf_counter() - start)
    grown = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) / MEGABYTE
    work = counted(lambda: problem.evaluate(genes, with_grad=True), core(problem.dtype))
    medians = (statistics.median(times[with_grad]) for with_grad in (False, True))
    return Measured(*medians, work.calls, work.waits, work.seconds, grown)
