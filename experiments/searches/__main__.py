"""Which search does best, and how do we know? python -m experiments.searches"""

from __future__ import annotations

import argparse
import math
import shutil
from collections.abc import Sequence
from itertools import product
from pathlib import Path
from statistics import median

import torch

from experiments.report import floats, integers, markdown, read_table, words
from experiments.searches.analysis import TARGETS, Clock, Study, priced, seconds
from experiments.searches.bench import Case, build_problem, gradient_prices, run_all, typical_cost
from experiments.searches.pictures import convergence_figure, ecdf_figure
from hopdiff.io.files import write_whole
from hopdiff.io.record import write_table
from hopdiff.plots.save import save_figure

HERE = Path(__file__).parent
SEARCHES = ["random", "ga", "cmaes", "gradient:method=adam", "gradient", "hybrid"]
PRICED_BATCH = 16  # candidates side by side in a gradient search


def main(arguments: Sequence[str] | None = None) -> None:
    options = parser().parse_args(arguments)
    torch.set_num_threads(1)
    if options.fresh:
        shutil.rmtree(options.traces, ignore_errors=True)
    options.out.mkdir(parents=True, exist_ok=True)
    options.traces.mkdir(parents=True, exist_ok=True)
    cases = [Case(*case) for case in product(options.speeds, options.betas, options.characters)]
    prices = measured_prices(options.traces / "prices.csv", cases[0], options.repeats)
    price = next(with_grad / without - 1 for batch, without, with_grad in prices if batch == PRICED_BATCH)
    traces = run_all(options.searches, cases, options.seeds, options.evaluations, price, options.traces)
    study = Study(traces)
    text = report(study, price, prices)
    write_whole(options.out / f"{options.name}.md", text)
    save_figure(ecdf_figure(study, price), options.out / f"{options.name}_ecdf.png", dpi=100)
    save_figure(convergence_figure(study, price), options.out / f"{options.name}_convergence.png", dpi=90)
    print(text)


def parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m experiments.searches", description=__doc__)
    parser.add_argument("--searches", nargs="+", default=SEARCHES, help='"hybrid:generations=4,climbers=16" is one too')
    parser.add_argument("--speeds", type=floats, default=[3, 5, 8], help="m/s")
    parser.add_argument("--betas", type=floats, default=[0.2, 0.5, 0.7])
    parser.add_argument("--characters", type=words, default=["human"])
    parser.add_argument("--seeds", type=integers, default=list(range(15)), help="0-14 for instance")
    parser.add_argument("--evaluations", type=int, default=10_000, help="budget of every search")
    parser.add_argument("--repeats", type=int, default=30, help="timings, of which the least gives a gradient's price")
    parser.add_argument("--traces", type=Path, default=Path("outputs/searches"), help="where finished runs are kept")
    parser.add_argument("--fresh", action="store_true", help="throw the finished runs away first")
    parser.add_argument("--out", type=Path, default=HERE, help="folder of the report")
    parser.add_argument("--name", default="results", help="first part of the names of the report's files")
    return parser


def measured_prices(path: Path, case: Case, repeats: int) -> list[tuple[int, float, float]]:
    """As `gradient_prices`; measured once and kept with the traces that were run at it."""
    columns = ("batch", "value", "value_and_gradient")
    if not path.is_file():
        write_table(path, columns, gradient_prices(build_problem(case), repeats))
    return [(int(row["batch"]), float(row["value"]), float(row["value_and_gradient"])) for row in read_table(path)]


def report(study: Study, price: float, prices: Sequence[tuple[int, float, float]]) -> str:
    clocks: dict[str, Clock] = {
        f"evaluations, a gradient as {price:.2f} more": priced(price),
        "evaluations, a gradient as 1 more": priced(1.0),
        "seconds of one core": seconds,
    }
    seeds = {len(study.of(search, case)) for search in study.searches for case in study.best}
    parts = [
        f"# Searches: {len(study.best)} problems, {min(seeds)} seeds\n",
        "Targets and excesses: per cent above the lowest cost that any of them found, problem by problem.\n",
        "## At the end of the budget\n",
        finals(study),
        "## Share of runs that reach a target\n",
        markdown(
            ("search", *map(_percent, TARGETS)),
            ((s, *(f"{100 * study.success(s, t):.0f} %" for t in TARGETS)) for s in study.searches),
        ),
    ]
    for label, clock in clocks.items():
        parts += [f"## Expected running time: {label}\n", "Median over the problems.\n", times(study, clock)]
    parts += ["## Where the gradient loses\n", losses(study, clocks)]
    parts += ["## Problems\n", problems(study), "## Price of a gradient\n"]
    parts += [
        markdown(
            ("batch", "value ms", "value and gradient ms", "price of a gradient"),
            ((b, f"{1e3 * v:.2f}", f"{1e3 * g:.2f}", f"{g / v - 1:.2f}") for b, v, g in prices),
        )
    ]
    return "\n".join(parts)


def finals(study: Study) -> str:
    rows = []
    for search in study.searches:
        excess = sorted(100 * study.final(trace) for trace in study.of(search))
        took = median(trace.points[-1].seconds for trace in study.of(search))
        rows.append(
            (
                search,
                f"{median(excess):.3f}",
                f"{excess[math.ceil(0.9 * len(excess)) - 1]:.2f}",
                f"{excess[-1]:.2f}",
                f"{took:.1f}",
            )
        )
    return markdown(("search", "median excess %", "90 % of runs below", "worst", "median seconds"), rows)


def times(study: Study, clock: Clock) -> str:
    cells = ((s, *(_number(study.typical_time(s, t, clock)) for t in TARGETS)) for s in study.searches)
    return markdown(("search", *map(_percent, TARGETS)), cells)


def losses(study: Study, clocks: dict[str, Clock]) -> str:
    """Problems and targets that a search without gradients is expected to reach sooner than all with."""
    with_gradient = [s for s in study.searches if s.startswith(("gradient", "hybrid"))]
    without = [s for s in study.searches if s not in with_gradient]
    if not (with_gradient and without):
        return "Nothing to compare.\n"
    rows = []
    for (label, clock), case, target in product(clocks.items(), study.best, TARGETS):
        expected = {s: study.expected_time(s, case, target, clock) for s in study.searches}
        first, second = min(without, key=expected.__getitem__), min(with_gradient, key=expected.__getitem__)
        if expected[first] < expected[second]:
            cells = f"{first}: {_number(expected[first])}", f"{second}: {_number(expected[second])}"
            rows.append((label, str(case), _percent(target), *cells))
    heading = ("clock", "problem", "target", "sooner", "best with gradients")
    return markdown(heading, rows) if rows else "Nowhere: on every problem, for every target and clock, it is sooner.\n"


def problems(study: Study) -> str:
    rows = []
    for case, best in study.best.items():
        median_cost, valid = typical_cost(build_problem(case))
        rows.append((case, f"{best:.5f}", f"{median_cost:.3f}", f"{100 * valid:.0f} %"))
    return markdown(("problem", "best known cost", "median of random runs", "random runs possible"), rows)


def _percent(target: float) -> str:
    return f"{100 * target:g} %"


def _number(value: float) -> str:
    if not math.isfinite(value):
        return "never"
    return f"{value:.0f}" if value >= 100 else f"{value:.2g}"


if __name__ == "__main__":
    main()
