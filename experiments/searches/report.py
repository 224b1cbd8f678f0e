"""The tables of the study."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import product
from pathlib import Path
from statistics import median
from typing import Any

from experiments.report import markdown
from experiments.searches import claims
from experiments.searches.analysis import TARGETS, Clock, Study, best_of, priced, seconds
from experiments.searches.cases import MODELS, Case, build_problem, objective, settings, typical_cost
from experiments.searches.claims import number
from experiments.searches.methods import own, takes_gradients
from experiments.searches.traces import PRICED_BATCH
from hopdiff.composing import compose
from hopdiff.config import build_job
from hopdiff.io.files import read_json
from hopdiff.io.record import write_json, write_table

Prices = Sequence[tuple[int, float, float]]

BIAS = """\
- The settings of `ga`, `hybrid` and `gradient` were chosen on problems of the models `smooth` and `body` that are among
  these; those of the peers are their libraries' own, and nobody tuned them.
- Impossible runs count as infinite. hopdiff's searches drop or rank them; to peers without gradients they are numbers
  above every possible cost, in the order of their merit (`meter.finite_values`); descents follow the merit, which is
  finite there.
- The best known cost is the lowest that any of these runs found: a target is missed by all where all miss the optimum.
- Time is that of one core, all threads counted, the method's own work too; setting up the problem and one warm
  evaluation come before. Methods that price many points at once gain from that in time, not in evaluations:
  `scipy_lbfgsb` runs as many descents side by side as hopdiff would, NGOpt is asked for 16 points at a time.
- Peers that begin with one distribution begin at the problem's start with its spread; all others with points drawn
  from the same. The run of least cost that a briskness is told in is given to all, and none begins there.
"""


def clocks_of(price: float) -> dict[str, Clock]:
    return {
        f"evaluations, a gradient as {price:.2f} more": priced(price),
        "evaluations, a gradient as 1 more": priced(1.0),
        "seconds of one core": seconds,
    }


def report(
    study: Study, prices: Mapping[str, float], rows: Mapping[str, Prices], head: Sequence[str], folder: Path
) -> str:
    """head: lines about where it all comes from. rows: timings by model. folder: of the traces."""
    parts = ["# Searches: which does best, and how do we know?\n", *(f"- {line}" for line in head), ""]
    parts += ["Targets and excesses: per cent above the lowest cost known of a problem. In brackets: 95 % by the"]
    parts += ["bootstrap over seeds.\n", "## Known sources of bias\n", BIAS]
    for model in dict.fromkeys(trace.case.model for trace in study.traces):
        parts += _of_model(study.only(model), model, prices[model], rows[model], folder)
    return "\n".join(parts)


def _of_model(study: Study, model: str, price: float, rows: Prices, folder: Path) -> Iterator[str]:
    clocks = clocks_of(price)
    seeds = {len(traces) for method in study.methods for case in study.best if (traces := study.of(method, case))}
    counts = " to ".join(str(count) for count in sorted({min(seeds, default=0), max(seeds, default=0)}))
    yield f"## `{' '.join(MODELS[model])}`: {len(study.best)} problem{'s' * (len(study.best) != 1)}, {counts} seeds\n"
    if study.unsolved:
        yield f"No method found a possible run of: {'; '.join(map(str, study.unsolved))}. They are left out.\n"
    if not study.best:
        return
    yield "### What is minimised\n"
    terms = objective(build_problem(next(iter(study.best)), folder))
    yield markdown(("term of the first problem", "weight", "puts in"), ((n, f"{w:g}", f"{p}") for n, w, p in terms))
    yield "### At the end of the budget\n"
    yield finals(study)
    yield "### Share of runs that reach a target\n"
    cells = ((m, *(f"{100 * study.success(m, t):.0f} %" for t in TARGETS)) for m in study.methods)
    yield markdown(("method", *map(_percent, TARGETS)), cells)
    for label, clock in clocks.items():
        yield f"### Expected running time: {label}\n"
        yield "Median over the problems.\n"
        yield times(study, clock)
    yield "### Claims\n"
    yield from _claims(study, priced(price))
    yield "### Where gradients lose\n"
    yield losses(study, clocks)
    yield "### Problems\n"
    yield problems(study, folder)
    yield "### Price of a gradient\n"
    yield f"Of uniform candidates; that at {PRICED_BATCH} is the one that budgets are counted with.\n"
    timed = ((b, f"{1e3 * v:.2f}", f"{1e3 * g:.2f}", f"{g / v - 1:.2f}") for b, v, g in rows)
    yield markdown(("batch", "value ms", "value and gradient ms", "price of a gradient"), timed)


def finals(study: Study) -> str:
    rows = []
    for method in study.methods:
        traces = [trace for case in study.cases(method) for trace in study.of(method, case)]
        excess = sorted(100 * study.final(trace) for trace in traces)
        ends = [trace.points[-1] for trace in traces]
        rows.append(
            (
                f"{method}{'' if own(method) else ' (peer)'}",
                f"{median(excess):.3f}",
                f"{excess[math.ceil(0.9 * len(excess)) - 1]:.2f}",
                f"{excess[-1]:.2f}",
                f"{median(end.evaluations for end in ends):.0f}",
                f"{median(end.gradient_evaluations for end in ends):.0f}",
                f"{median(end.seconds for end in ends):.1f}",
            )
        )
    heading = ("method", "median excess %", "90 % of runs below", "worst", "evaluations", "gradients", "seconds")
    return markdown(heading, rows)


def times(study: Study, clock: Clock) -> str:
    cells = ((m, *(_interval(study.typical(m, t, clock)) for t in TARGETS)) for m in study.methods)
    return markdown(("method", *map(_percent, TARGETS)), cells)


def _interval(found: tuple[float, float, float]) -> str:
    middle, low, high = found
    if not math.isfinite(middle):
        return "never" if not math.isfinite(low) else f"never [{number(low)}, never]"
    return f"{number(middle)} [{number(low)}, {number(high)}]"


def _claims(study: Study, clock: Clock) -> Iterator[str]:
    ours, hybrids = claims.ours(study), claims.hybrids(study)
    for hybrid, ga in product(hybrids, claims.genetic(study)):
        yield (
            f"**`{hybrid}` reaches what `{ga}` ends at (median of its seeds) with {claims.FEWER:g} x fewer evaluations"
            f" and {claims.LESS_TIME:g} x less time.** {claims.told(claims.hybrid_beats_ga(study, hybrid, ga, clock))}"
        )
    at = _percent(claims.CLAIMED_TARGET)
    for some, name in ((ours, "Quasi-Newton, least squares or hybrid, whichever does best,"), *_each(ours)):
        yield (
            f"**{name} beats every peer to {at} in time, and is within {claims.NEAR:g} x of the best method in"
            f" evaluations.** {claims.told(claims.ours_beat_peers(study, some, clock))}"
        )


def _each(methods: Sequence[str]) -> list[tuple[list[str], str]]:
    return [([method], f"`{method}` alone") for method in methods]


def lost(study: Study, clocks: Mapping[str, Clock]) -> list[tuple[str, str, str, str, float, str, float]]:
    """Problems and targets that a method without gradients is expected to reach sooner than all with: (clock, problem,
    target, sooner, its time, best with gradients, its time)."""
    found = []
    for (label, clock), case, target in product(clocks.items(), study.best, TARGETS):
        expected = {m: study.hits(m, case, target, clock).expected for m in study.methods if study.of(m, case)}
        without = [m for m in expected if not takes_gradients(m)]
        with_gradients = [m for m in expected if takes_gradients(m)]
        if not (without and with_gradients):
            continue
        first, second = min(without, key=expected.__getitem__), min(with_gradients, key=expected.__getitem__)
        if expected[first] < expected[second]:
            found.append((label, str(case), _percent(target), first, expected[first], second, expected[second]))
    return found


def losses(study: Study, clocks: Mapping[str, Clock]) -> str:
    """Counts of `lost`, and its rows where it is a matter of 1 % or less."""
    rows = lost(study, clocks)
    if not rows:
        return "Nowhere: on every problem, for every target and clock, a method with gradients is sooner.\n"
    counts = [
        (label, *(sum(row[0] == label and row[2] == _percent(target) for row in rows) for target in TARGETS))
        for label in clocks
    ]
    close = {_percent(target) for target in TARGETS if target <= 0.01}
    table = markdown((f"of {len(study.best)} problems", *map(_percent, TARGETS)), counts)
    shown = [
        (*row[:3], f"{row[3]}: {number(row[4])}", f"{row[5]}: {number(row[6])}") for row in rows if row[2] in close
    ]
    if not shown:
        return f"{table}\nNone at targets of 1 % or less.\n"
    heading = ("clock", "problem", "target", "sooner", "best with gradients")
    return (
        f"Problems on which a method without gradients is sooner than all with:\n\n{table}\n{markdown(heading, shown)}"
    )


def problems(study: Study, folder: Path) -> str:
    rows = []
    for case, best in study.best.items():
        middle, valid = typical_cost(build_problem(case, folder))
        finder = best_of([trace for trace in study.traces if trace.case == case])
        by = finder.method if finder.points[-1].best <= best else "an earlier study"
        typical = f"{middle:.3f}" if math.isfinite(middle) else "none"
        rows.append((case, f"{best:.6f}", by, typical, f"{100 * valid:.0f} %"))
    return markdown(
        ("problem", "best known cost", "found by", "median of uniform candidates", "of them possible"), rows
    )


def write_running_times(path: Path, study: Study, prices: Mapping[str, float]) -> None:
    """Every expected running time with its interval, as CSV."""
    columns = ("problem", "method", "target", "clock", "expected", "low", "high", "reached", "runs")

    def rows() -> Iterator[tuple[Any, ...]]:
        for method, case, target in product(study.methods, study.best, TARGETS):
            if not study.of(method, case):
                continue
            names = "priced", "one", "seconds"
            for name, clock in zip(names, clocks_of(prices[case.model]).values(), strict=True):
                hits = study.hits(method, case, target, clock)
                counts = int((hits.when < math.inf).sum()), len(hits.when)
                numbers = (f"{x:.6g}" for x in (hits.expected, *hits.interval()))
                yield case.label, method, target, name, *numbers, *counts

    write_table(path, columns, rows())


def write_best(path: Path, study: Study, folder: Path) -> None:
    """The best run of every problem: what must be put in to make it, its genes and its cost."""
    found = {}
    for case in study.best:
        trace = best_of([one for one in study.traces if one.case == case])
        found[case.label] = {
            "case": list(case),
            "settings": settings(case, folder),
            "cost": trace.points[-1].best,
            "method": trace.method,
            "seed": trace.seed,
            "commit": trace.commit,
            "genes": list(trace.genes),
        }
    write_json(path, found)


def read_best(path: Path) -> dict[Case, dict[str, Any]]:
    """What `write_best` wrote, by problem."""
    return {Case(*one["case"]): one for one in read_json(path).values()}


def outdated(entries: Iterable[Mapping[str, Any]], tolerance: float = 1e-6) -> list[str]:
    """Problems whose best genes no longer cost what they did, so that the tables no longer hold."""
    changed = []
    for one in entries:
        problem = build_job(compose(one["settings"])).problem
        genes = problem.table.low.new_tensor(one["genes"]).unsqueeze(0)
        cost = float(problem.evaluate(genes, False).cost) if genes.shape[1] == problem.dimension else math.nan
        if not abs(cost - one["cost"]) <= tolerance * abs(one["cost"]):
            changed.append(f"{Case(*one['case'])}: {one['cost']:.8g} then, {cost:.8g} now")
    return changed


def _percent(target: float) -> str:
    return f"{100 * target:g} %"
