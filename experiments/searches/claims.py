"""What this project claims of its searches, held against every problem."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from statistics import median

from experiments.searches.analysis import CLAIMED_TARGET, Clock, Study, seconds
from experiments.searches.cases import Case
from experiments.searches.methods import claimed, name_of, own

FEWER, LESS_TIME = 20.0, 10.0  # that the hybrid needs to reach what the genetic algorithm ends at
NEAR = 1.2  # times the evaluations of the best method
SHARE = 0.9  # of the problems on which a claim must hold


@dataclass(frozen=True)
class Verdict:
    """Whether a claim holds at a problem, and what it was told by."""

    case: Case
    holds: bool
    told: str


def hybrid_beats_ga(study: Study, hybrid: str, ga: str, clock: Clock) -> list[Verdict]:
    """The hybrid reaches the median final cost of the genetic algorithm with FEWER times fewer evaluations and
    LESS_TIME times less time. Expected running times, restarts counted, against what the genetic algorithm spent."""
    verdicts = []
    for case in study.cases(ga):
        if not study.of(hybrid, case):
            continue
        ends = [trace.points[-1] for trace in study.of(ga, case)]
        cost = median(end.best for end in ends)
        if not math.isfinite(cost):
            verdicts.append(Verdict(case, True, f"{ga} finds nothing in most runs"))
            continue
        ratios = [
            median(map(one, ends)) / study.hits_of_cost(hybrid, case, cost, one).expected for one in (clock, seconds)
        ]
        told = f"{ratios[0]:.1f} x fewer evaluations, {ratios[1]:.1f} x less time"
        verdicts.append(Verdict(case, ratios[0] >= FEWER and ratios[1] >= LESS_TIME, told))
    return verdicts


def ours_beat_peers(study: Study, ours: Sequence[str], clock: Clock, target: float = CLAIMED_TARGET) -> list[Verdict]:
    """One of our methods is sooner than every peer in time, and within NEAR of the best of all in evaluations."""
    peers = [method for method in study.methods if not own(method)]
    verdicts = []
    for case in study.best:
        mine = [method for method in ours if study.of(method, case)]
        theirs = [method for method in peers if study.of(method, case)]
        if not (mine and theirs):
            continue

        def expected(method: str, one: Clock, case: Case = case) -> float:
            return study.hits(method, case, target, one).expected

        time = {method: expected(method, seconds) for method in (*mine, *theirs)}
        count = {method: expected(method, clock) for method in study.methods if study.of(method, case)}
        quickest, least = min(theirs, key=time.__getitem__), min(count, key=count.__getitem__)
        good = [
            m for m in mine if time[m] < time[quickest] and math.isfinite(count[m]) and count[m] <= NEAR * count[least]
        ]
        best = min(good or mine, key=count.__getitem__)
        told = (
            f"{best}: {number(time[best])} s, {number(count[best])} evaluations; soonest peer {quickest}:"
            f" {number(time[quickest])} s; fewest evaluations {least}: {number(count[least])}"
        )
        verdicts.append(Verdict(case, bool(good), told))
    return verdicts


def told(verdicts: Sequence[Verdict]) -> str:
    """The share, and the problems where it does not hold."""
    if not verdicts:
        return "Nothing to judge by: a method that the claim speaks of was not run.\n"
    holds = sum(verdict.holds for verdict in verdicts)
    share = holds / len(verdicts)
    lines = [
        f"Holds on {holds} of {len(verdicts)} problems ({100 * share:.0f} %): **{'yes' if share >= SHARE else 'no'}**."
    ]
    if holds < len(verdicts):
        lines += ["", "Where not:", "", *(f"- {v.case}: {v.told}" for v in verdicts if not v.holds)]
    return "\n".join(lines) + "\n"


def ours(study: Study) -> list[str]:
    return [method for method in study.methods if claimed(method)]


def genetic(study: Study) -> list[str]:
    return [method for method in study.methods if name_of(method) in ("ga", "ga_thesis")]


def hybrids(study: Study) -> list[str]:
    return [method for method in study.methods if own(method) and name_of(method) == "hybrid"]


def number(value: float) -> str:
    if not math.isfinite(value):
        return "never"
    return f"{value:.0f}" if value >= 100 else f"{value:.2g}"
