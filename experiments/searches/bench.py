"""Running the searches: one trace a (search, problem, seed), kept in a file, so that a broken-off study goes on."""

from __future__ import annotations

import re
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from time import process_time
from typing import NamedTuple

import torch
from torch import Tensor

from experiments.report import read_table
from hopdiff.composing import compose
from hopdiff.config import build_job
from hopdiff.io.record import write_table
from hopdiff.problem import RunProblem
from hopdiff.search.loop import Budget, HistoryRow, SearchResult, run_search

BATCHES = (1, 8, 16, 32, 64, 100)


class Case(NamedTuple):
    """One problem."""

    speed: float
    beta: float
    character: str = "human"

    def __str__(self) -> str:
        return f"{self.speed:g} m/s, beta {self.beta:g}" + f", {self.character}" * (self.character != "human")


class Point(NamedTuple):
    """A step of a search that found something better, or its last. seconds: of one core, the search's own work too."""

    evaluations: int
    gradient_evaluations: int
    seconds: float
    best: float


@dataclass(frozen=True)
class Trace:
    search: str
    case: Case
    seed: int
    points: list[Point]


def overrides(search: str) -> list[str]:
    """Settings that "gradient:method=adam,starts=32" stands for: a search, and departures from its defaults."""
    name, *changes = re.split("[:,]", search)
    return [f"search={name}", *(f"search.{change}" for change in changes)]


def settings(case: Case) -> list[str]:
    """Of the smooth model."""
    return ["model=smooth", f"speed={case.speed}", f"beta={case.beta}", f"character={case.character}"]


def build_problem(case: Case) -> RunProblem:
    return build_job(compose(settings(case))).problem


def gradient_prices(problem: RunProblem, repeats: int) -> list[tuple[int, float, float]]:
    """(batch, seconds a batch without, with gradient), the least of `repeats` each, for random candidates."""

    def seconds(genes: Tensor, with_grad: bool) -> float:
        start = process_time()
        problem.evaluate(genes, with_grad)
        return process_time() - start

    timed = []
    for batch in BATCHES:
        genes = torch.rand(batch, problem.dimension, dtype=problem.dtype, generator=torch.Generator().manual_seed(0))
        without, with_grad = (min(seconds(genes, flag) for _ in range(repeats)) for flag in (False, True))
        timed.append((batch, without, with_grad))
    return timed


def typical_cost(problem: RunProblem, count: int = 1024) -> tuple[float, float]:
    """Median cost of random candidates that are possible runs, and the share of all that are."""
    genes = torch.rand(count, problem.dimension, dtype=problem.dtype, generator=torch.Generator().manual_seed(0))
    cost = problem.evaluate(genes, False).cost
    valid = cost[cost.isfinite()]
    return float(valid.median()), len(valid) / count


def run_all(
    searches: list[str], cases: list[Case], seeds: list[int], evaluations: int, price: float, folder: Path
) -> list[Trace]:
    """All traces; those that the folder holds already are only read."""
    traces = []
    for seed, case, search in product(seeds, cases, searches):
        path = folder / re.sub("[:,]", "_", search) / f"{case.character}_v{case.speed:g}_b{case.beta:g}_{seed}.csv"
        if not path.is_file():
            path.parent.mkdir(parents=True, exist_ok=True)
            points = run_one(search, case, seed, Budget(evaluations, price))
            write_table(path, Point._fields, points)
            print(f"{search}, {case}, seed {seed}: {points[-1].best:.5f}, {points[-1].seconds:.1f} s", flush=True)
        traces.append(Trace(search, case, seed, [_point(row) for row in read_table(path)]))
    return traces


def run_one(search: str, case: Case, seed: int, budget: Budget) -> list[Point]:
    """The trace of one search. Time is that of the process, which other programs do not disturb."""
    job = build_job(compose([*settings(case), *overrides(search)]))
    points: list[Point] = []
    started = process_time()

    def on_step(row: HistoryRow, result: SearchResult) -> None:
        point = Point(row.evaluations, row.gradient_evaluations, process_time() - started, row.best)
        # Of a stretch without progress only its end is kept.
        if len(points) > 1 and points[-1].best == points[-2].best == point.best:
            points.pop()
        points.append(point)

    run_search(job.problem, job.search, budget, torch.Generator().manual_seed(seed), on_step)
    return points


def _point(row: dict[str, str]) -> Point:
    return Point(int(row["evaluations"]), int(row["gradient_evaluations"]), float(row["seconds"]), float(row["best"]))
