"""Which search does best, and how do we know? python -m experiments.searches"""

from __future__ import annotations

import argparse
import shutil
import sys
from collections.abc import Sequence
from itertools import product
from pathlib import Path

import torch

from experiments.report import floats, integers, markdown, origin, words
from experiments.searches.analysis import Study
from experiments.searches.cases import BETAS, MODELS, SPEEDS, Case, build_problem, grid
from experiments.searches.methods import METHODS, missing, packages
from experiments.searches.pictures import convergence_figure, ecdf_figure
from experiments.searches.report import Prices, outdated, read_best, report, write_best, write_running_times
from experiments.searches.traces import Plan, machine, path_of, price_of, prices, read_all, run_all
from hopdiff.io.files import write_whole
from hopdiff.plots.save import save_figure
from hopdiff.types import HopdiffError

HERE = Path(__file__).parent
ENOUGH = 5e-5  # excess over a reference at which a run ends: half of the last target's

Todo = list[tuple[str, Case, int]]


def main(arguments: Sequence[str] | None = None) -> None:
    arguments = sys.argv[1:] if arguments is None else list(arguments)
    options = parser().parse_args(arguments)
    torch.set_num_threads(1)
    if options.check:
        check(options.check)
        return
    if options.fresh:
        shutil.rmtree(options.traces, ignore_errors=True)
    skipped = {method: why for method in options.methods if (why := missing(method))}
    methods = [method for method in options.methods if method not in skipped]
    for method, why in skipped.items():
        print(f"{method} is left out: {why}")
    cases = [
        case for model in options.models for case in grid(model, options.characters, options.speeds, options.betas)
    ]
    # Seeds outermost: a study that is broken off has a few seeds of everything.
    todo = [(method, case, seed) for seed, case, method in product(options.seeds, cases, methods)]
    if not todo:
        sys.exit("Nothing to do: no method of --methods can be run here.")
    rows = {model: prices(model, _first(cases, model), options.traces, options.repeats) for model in options.models}
    earlier = {c: float(one["cost"]) for c, one in read_best(options.reference).items()} if options.reference else {}
    stops = {case.label: cost + ENOUGH * abs(cost) for case, cost in earlier.items()}
    plan = Plan(options.traces, options.evaluations, {m: price_of(rows[m]) for m in rows}, stops)
    if options.plan:
        print(forecast(todo, plan, rows))
        return
    if not options.report:
        run_all(todo, plan, options.workers)
    try:
        study = Study(list(read_all(todo, plan)), earlier)
    except HopdiffError as error:
        sys.exit(str(error))
    if not study.best:
        sys.exit("There is nothing to tell yet: no run of these problems found anything.")
    write_results(study, plan, rows, head(arguments, options, study, skipped), options.out, options.name)


def _first(cases: Sequence[Case], model: str) -> Case:
    return next(case for case in cases if case.model == model)


def write_results(study: Study, plan: Plan, rows: dict[str, Prices], lines: list[str], out: Path, name: str) -> None:
    out.mkdir(parents=True, exist_ok=True)
    text = report(study, plan.prices, rows, lines, plan.folder)
    write_whole(out / f"{name}.md", text)
    write_running_times(out / f"{name}_running_times.csv", study, plan.prices)
    write_best(out / f"{name}_best.json", study, plan.folder)
    for model in dict.fromkeys(case.model for case in study.best):
        part, price = study.only(model), plan.prices[model]
        save_figure(ecdf_figure(part, price), out / f"{name}_ecdf_{model}.png", dpi=90)
        for body in dict.fromkeys(case.character for case in part.best):
            one = Study([trace for trace in part.traces if trace.case.character == body], part.earlier)
            save_figure(convergence_figure(one, price), out / f"{name}_convergence_{model}_{body}.png", dpi=80)
    print(text)


def head(arguments: Sequence[str], options: argparse.Namespace, study: Study, skipped: dict[str, str]) -> list[str]:
    commits = dict.fromkeys(trace.commit for trace in study.traces)
    whole = len(options.seeds) * len(study.methods)
    runs = {case: sum(trace.case == case for trace in study.traces) for case in (*study.best, *study.unsolved)}
    lines = [
        f"Tables: {origin('searches', arguments, ('--traces', '--out', '--reference'))}",
        f"Runs: commit{'s' if len(commits) > 1 else ''} {', '.join(f'`{one}`' for one in commits)}",
        f"Budget of a run: {options.evaluations} evaluations, gradients at the price below",
        f"Machine: {machine()}; {options.workers} runs side by side",
        f"Versions: {', '.join(f'{name} {number}' for name, number in packages(study.methods).items())}",
    ]
    if "body" in options.models:
        problem = build_problem(next(case for case in runs if case.model == "body"), options.traces)
        how = (
            "compiled kernels"
            if getattr(problem, "kernels", None) is not None
            else "PyTorch's operations, not compiled"
        )
        lines.append(f"Candidates of model=body are priced by {how}")
    if options.reference:
        lines.append(f"Runs end {100 * ENOUGH:g} % above the best cost of an earlier study, where it has one")
    lines += [f"Left out: `{method}`: {why}" for method, why in skipped.items()]
    if short := [case for case, count in runs.items() if count < whole]:
        lines.append(f"Not all runs are there yet: {len(short)} of {len(runs)} problems lack some")
    return lines


def forecast(todo: Todo, plan: Plan, rows: dict[str, Prices]) -> str:
    """What is left to do, and how long it takes if every run uses up its budget, 16 candidates at a time. Runs that end
    by themselves take less, those that price one candidate at a time several times as long."""
    value = {model: next(v / b for b, v, _ in rows[model] if b == 16) for model in rows}
    left = [one for one in todo if not path_of(plan.folder, *one).is_file()]
    table, total = [], 0.0
    for method in dict.fromkeys(method for method, _, _ in todo):
        mine = [case.model for m, case, _ in left if m == method]
        hours = sum(value[model] for model in mine) * plan.evaluations / 3600
        total += hours
        table.append((method, len(mine), f"{hours:.2f}"))
    return markdown(("method", "runs left", "hours of a core"), [*table, ("all", len(left), f"{total:.2f}")])


def check(path: Path) -> None:
    """Whether the tables beside a file of best runs still hold: its genes cost what they did."""
    changed = outdated(read_best(path).values())
    if changed:
        sys.exit("The objective or the model has changed since; make the study anew:\n" + "\n".join(changed))
    print("The best runs cost what they did.")


def parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m experiments.searches", description=__doc__)
    parser.add_argument("--models", type=words, default=["body"], help=f"of {', '.join(MODELS)}, each with its costs")
    parser.add_argument("--methods", nargs="+", default=METHODS, help='"hybrid:generations=4,climbers=16" is one too')
    parser.add_argument("--speeds", type=floats, default=SPEEDS, help="m/s")
    parser.add_argument("--betas", type=floats, default=BETAS)
    parser.add_argument("--characters", type=words, default=[], help="all three bodies; of the thesis, its one")
    parser.add_argument("--seeds", type=integers, default=list(range(15)), help="0-14 for instance")
    parser.add_argument("--evaluations", type=int, default=10_000, help="budget of every run")
    parser.add_argument("--workers", type=int, default=1, help="runs side by side")
    parser.add_argument("--reference", type=Path, help="NAME_best.json of an earlier study: runs end where it got to")
    parser.add_argument("--repeats", type=int, default=10, help="timings, of which the least gives a gradient's price")
    parser.add_argument("--traces", type=Path, default=Path("outputs/searches"), help="where finished runs are kept")
    parser.add_argument("--fresh", action="store_true", help="throw the finished runs away first")
    parser.add_argument("--plan", action="store_true", help="only tell what is left to do, and how long it takes")
    parser.add_argument("--report", action="store_true", help="no runs: tables and pictures of those that are there")
    parser.add_argument("--check", type=Path, help="NAME_best.json: do the tables made with it still hold?")
    parser.add_argument("--out", type=Path, default=HERE, help="folder of the report")
    parser.add_argument("--name", default="results", help="first part of the names of the report's files")
    return parser


if __name__ == "__main__":
    main()
