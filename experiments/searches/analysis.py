"""From traces to numbers: targets, when they were hit, expected running times."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from statistics import median

from experiments.searches.bench import Case, Point, Trace

TARGETS = (1.0, 0.3, 0.1, 0.03, 0.01, 0.003, 0.001)  # excess over the best known cost, relative to it

Clock = Callable[[Point], float]


def priced(price: float) -> Clock:
    """The clock that counts evaluations, a gradient as `price` more."""
    return lambda point: point.evaluations + price * point.gradient_evaluations


def seconds(point: Point) -> float:
    return point.seconds


@dataclass(frozen=True)
class Study:
    """All traces, and the lowest cost that any search found for every problem."""

    traces: list[Trace]

    @cached_property
    def best(self) -> dict[Case, float]:
        cases = dict.fromkeys(trace.case for trace in self.traces)
        return {case: min(t.points[-1].best for t in self.traces if t.case == case) for case in cases}

    @property
    def searches(self) -> list[str]:
        return list(dict.fromkeys(trace.search for trace in self.traces))

    def of(self, search: str, case: Case | None = None) -> list[Trace]:
        return [t for t in self.traces if t.search == search and case in (None, t.case)]

    def excess(self, case: Case, cost: float) -> float:
        """How far a cost lies above the best known one, relative to that."""
        return cost / self.best[case] - 1

    def final(self, trace: Trace) -> float:
        return self.excess(trace.case, trace.points[-1].best)

    def hit(self, trace: Trace, target: float, clock: Clock) -> float:
        """Clock at which a trace gets within `target`; infinite if it never does."""
        enough = (1 + target) * self.best[trace.case]
        return next((clock(point) for point in trace.points if point.best <= enough), math.inf)

    def success(self, search: str, target: float, case: Case | None = None) -> float:
        traces = self.of(search, case)
        return sum(math.isfinite(self.hit(trace, target, clock=seconds)) for trace in traces) / len(traces)

    def expected_time(self, search: str, case: Case, target: float, clock: Clock) -> float:
        """Expected running time to a target if a search that misses it is started again with the next seed."""
        traces = self.of(search, case)
        hits = [self.hit(trace, target, clock) for trace in traces]
        spent = [min(hit, clock(trace.points[-1])) for hit, trace in zip(hits, traces, strict=True)]
        successes = sum(math.isfinite(hit) for hit in hits)
        return sum(spent) / successes if successes else math.inf

    def typical_time(self, search: str, target: float, clock: Clock) -> float:
        """Median over the problems of the expected running time."""
        return median(self.expected_time(search, case, target, clock) for case in self.best)

    def ecdf(self, search: str, clock: Clock) -> tuple[list[float], list[float]]:
        """Clock, and share of all (problem, seed, target) hit by then."""
        hits = sorted(self.hit(trace, target, clock) for trace in self.of(search) for target in TARGETS)
        reached = [hit for hit in hits if math.isfinite(hit)]
        return reached, [(i + 1) / len(hits) for i in range(len(reached))]
