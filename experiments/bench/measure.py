"""Timing one kind of call, in a process of its own."""

from __future__ import annotations

import resource
import statistics
import time

import torch

from hopdiff.composing import compose
from hopdiff.config import build_job

MEGABYTE = 1024.0  # ru_maxrss counts kilobytes on Linux


def measure(dtype: str, size: int, rounds: int) -> tuple[float, float, float]:
    """Median seconds of a value and of a value with gradient, and megabytes that the process grew by."""
    torch.set_num_threads(1)
    problem = build_job(compose(["model=smooth", f"dtype={dtype}"])).problem
    genes = torch.rand(size, problem.dimension, dtype=problem.dtype, generator=torch.Generator().manual_seed(0))
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
    grown = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before
    return statistics.median(times[False]), statistics.median(times[True]), grown / MEGABYTE
