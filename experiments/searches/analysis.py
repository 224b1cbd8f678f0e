"""From traces to numbers: targets, when they were hit, running times of searches that are started again.

After COCO (Hansen, Auger, Ros, Mersmann, Tusar and Brockhoff 2021; Hansen, Auger, Brockhoff, Tusar and Tusar 2016).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from statistics import median

import numpy as np

from experiments.searches.cases import Case
from experiments.searches.meter import Point
from experiments.searches.traces import Trace

TARGETS = (1.0, 0.3, 0.1, 0.03, 0.01, 0.003, 0.001, 0.0001)  # excess over the best known cost, relative to it
CLAIMED_TARGET = 0.001
DRAWS = 200  # of simulated restarts, and of the bootstrap

Clock = Callable[[Point], float]


def priced(price: float) -> Clock:
    """The clock that counts evaluations, a gradient as `price` more."""
    return lambda point: point.evaluations + price * point.gradient_evaluations


def seconds(point: Point) -> float:
    return point.seconds


@dataclass(frozen=True)
class Hits:
    """When the runs of one method at one problem reached a target. when: (S,) inf where it was missed. spent: (S,) on
    the way there, or in vain."""

    when: np.ndarray
    spent: np.ndarray

    @property
    def expected(self) -> float:
        """Expected running time to the target if a search that misses it is started again with the next seed."""
        return _expected(self.when, self.spent)

    def interval(self, draws: int = DRAWS) -> tuple[float, float]:
        """95 % of the expected running time, by drawing seeds with replacement; inf where a draw has no success."""
        low, high = np.quantile(self.resampled(draws), [0.025, 0.975], method="nearest")
        return float(low), float(high)

    def resampled(self, draws: int = DRAWS, seed: int = 0) -> np.ndarray:
        """(draws,) expected running times of seeds drawn with replacement."""
        chosen = np.random.default_rng(seed).integers(len(self.when), size=(draws, len(self.when)))
        successes = np.isfinite(self.when[chosen]).sum(1)
        total = self.spent[chosen].sum(1)
        return np.where(successes > 0, total / np.maximum(successes, 1), math.inf)

    def restarted(self, draws: int = DRAWS, seed: int = 0) -> np.ndarray:
        """(draws,) simulated running times: runs drawn one after the other until one hits; inf if none ever did."""
        if not np.isfinite(self.when).any():
            return np.full(draws, math.inf)
        random, total, going = np.random.default_rng(seed), np.zeros(draws), np.ones(draws, dtype=bool)
        while going.any():
            chosen = random.integers(len(self.when), size=draws)
            total += going * self.spent[chosen]
            going &= ~np.isfinite(self.when[chosen])
        return total


def _expected(when: np.ndarray, spent: np.ndarray) -> float:
    successes = int(np.isfinite(when).sum())
    return float(spent.sum()) / successes if successes else math.inf


@dataclass(frozen=True)
class Study:
    """All traces, and the lowest cost known for every problem: of them, and of earlier ones.

    earlier: costs by problem that other studies found.
    """

    traces: list[Trace]
    earlier: dict[Case, float] = field(default_factory=dict)

    @cached_property
    def best(self) -> dict[Case, float]:
        """Problems that any run solved; the others can tell nothing."""
        cases = dict.fromkeys(trace.case for trace in self.traces)
        known = {c: min([self.earlier.get(c, math.inf), *(t.points[-1].best for t in self._of(c))]) for c in cases}
        return {case: cost for case, cost in known.items() if math.isfinite(cost)}

    @cached_property
    def unsolved(self) -> list[Case]:
        return [case for case in dict.fromkeys(trace.case for trace in self.traces) if case not in self.best]

    @cached_property
    def methods(self) -> list[str]:
        return list(dict.fromkeys(trace.method for trace in self.traces))

    @cached_property
    def _by(self) -> dict[tuple[str, Case], list[Trace]]:
        found: dict[tuple[str, Case], list[Trace]] = {}
        for trace in self.traces:
            found.setdefault((trace.method, trace.case), []).append(trace)
        return found

    def _of(self, case: Case) -> list[Trace]:
        return [trace for trace in self.traces if trace.case == case]

    def of(self, method: str, case: Case) -> list[Trace]:
        return self._by.get((method, case), [])

    def cases(self, method: str) -> list[Case]:
        """Solved problems that a method was run on."""
        return [case for case in self.best if self.of(method, case)]

    def only(self, model: str) -> Study:
        """The part of one model."""
        return Study([t for t in self.traces if t.case.model == model], self.earlier)

    def excess(self, case: Case, cost: float) -> float:
        """How far a cost lies above the best known one, relative to that."""
        return (cost - self.best[case]) / abs(self.best[case])

    def final(self, trace: Trace) -> float:
        return self.excess(trace.case, trace.points[-1].best)

    def hits(self, method: str, case: Case, target: float, clock: Clock) -> Hits:
        """Of a target that is told as an excess."""
        return self.hits_of_cost(method, case, self.best[case] + target * abs(self.best[case]), clock)

    def hits_of_cost(self, method: str, case: Case, cost: float, clock: Clock) -> Hits:
        traces = self.of(method, case)
        when = [next((clock(p) for p in trace.points if p.best <= cost), math.inf) for trace in traces]
        ends = [clock(trace.points[-1]) for trace in traces]
        return Hits(np.array(when), np.minimum(when, ends))

    def success(self, method: str, target: float) -> float:
        """Share of all runs that reach a target."""
        found = [np.isfinite(self.hits(method, c, target, seconds).when) for c in self.cases(method)]
        return float(np.concatenate(found).mean())

    def typical(self, method: str, target: float, clock: Clock) -> tuple[float, float, float]:
        """Median over the problems of the expected running time, and 95 % of it by the bootstrap over seeds."""
        hits = [self.hits(method, case, target, clock) for case in self.cases(method)]
        draws = np.median([hit.resampled(seed=at) for at, hit in enumerate(hits)], axis=0)
        low, high = np.quantile(draws, [0.025, 0.975], method="nearest")
        return median(hit.expected for hit in hits), float(low), float(high)

    def ecdf(self, method: str, clock: Clock) -> tuple[np.ndarray, np.ndarray]:
        """Clock, and share of all (problem, target) pairs hit by then, with simulated restarts."""
        times = [
            self.hits(method, case, target, clock).restarted(seed=at)
            for at, case in enumerate(self.cases(method))
            for target in TARGETS
        ]
        every = np.sort(np.concatenate(times))
        reached = every[np.isfinite(every)]
        return reached, np.arange(1, len(reached) + 1) / len(every)

    def end(self, method: str, clock: Clock) -> float:
        """Where the longest run ended: what lies beyond is made of restarts alone."""
        return max(clock(t.points[-1]) for case in self.cases(method) for t in self.of(method, case))


def best_of(traces: Sequence[Trace]) -> Trace:
    return min(traces, key=lambda trace: trace.points[-1].best)
