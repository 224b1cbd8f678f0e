"""Running the study: one trace a (method, problem, seed), a file each, so that a study that was broken off goes on.

A file appears whole or not at all, and a lock beside it says that a process is at it: as many processes as one likes,
of one command or of several, share a folder. hopdiff's own sweep is not used: it writes a run's motion and knows
neither peers nor the time of one core; on runs of seconds that is more than a second of overhead each.
"""

from __future__ import annotations

import json
import math
import platform
import re
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import cache
from multiprocessing import get_context
from pathlib import Path
from typing import Any, NamedTuple

import torch
from filelock import FileLock, Timeout

from experiments.searches.cases import Case, build_problem, gradient_prices
from experiments.searches.meter import Log, Point
from experiments.searches.methods import run
from hopdiff.io.files import read_json, write_whole
from hopdiff.io.record import git_state, write_json
from hopdiff.types import HopdiffError

PRICED_BATCH = 16  # candidates side by side at which the price of a gradient is taken


class Plan(NamedTuple):
    """What every run of a study has in common. prices: of a gradient, by model, in evaluations. stops: cost at which a
    run of a problem has nothing left to show, by label; none without a reference."""

    folder: Path
    evaluations: int
    prices: dict[str, float]
    stops: dict[str, float]


@dataclass(frozen=True)
class Trace:
    """One run. genes: of its best candidate, empty if none was valid. commit: of the checkout that ran it."""

    method: str
    case: Case
    seed: int
    points: list[Point]
    genes: tuple[float, ...] = ()
    commit: str = ""


def path_of(folder: Path, method: str, case: Case, seed: int) -> Path:
    return folder / re.sub("[:,=]", "_", method) / f"{case.label}_{seed}.json"


def run_all(todo: Sequence[tuple[str, Case, int]], plan: Plan, workers: int = 1) -> None:
    """Make what the folder lacks. Several processes may do so at once."""
    missing = [one for one in todo if not path_of(plan.folder, *one).is_file()]
    if workers == 1 or len(missing) < 2:
        _work(missing, plan)
        return
    # Of every worker its own share first, then whatever nobody is at.
    shares = [[*missing[at::workers], *missing] for at in range(workers)]
    with ProcessPoolExecutor(workers, mp_context=get_context("spawn")) as pool:
        for done in [pool.submit(_work, share, plan) for share in shares]:
            done.result()


def _work(todo: Sequence[tuple[str, Case, int]], plan: Plan) -> None:
    torch.set_num_threads(1)
    for method, case, seed in todo:
        path = path_of(plan.folder, method, case, seed)
        if path.is_file():
            continue
        path.parent.mkdir(parents=True, exist_ok=True)
        try:
            with FileLock(path.with_suffix(".lock"), timeout=0):
                if path.is_file():
                    continue
                price, stop = plan.prices[case.model], plan.stops.get(case.label, -math.inf)
                log = run(method, case, seed, plan.evaluations, price, plan.folder, stop)
                write(path, method, case, seed, log, plan)
        except Timeout:
            continue  # another process is at it
        path.with_suffix(".lock").unlink(missing_ok=True)
        told = log.points[-1]
        print(f"{method}; {case}; seed {seed}: {told.best:.5f}, {told.seconds:.1f} s", flush=True)


def write(path: Path, method: str, case: Case, seed: int, log: Log, plan: Plan) -> None:
    content = {
        "method": method,
        "case": list(case),
        "seed": seed,
        "evaluations": plan.evaluations,
        "price": plan.prices[case.model],
        "commit": commit(),
        "columns": list(Point._fields),
        "points": [list(point) for point in log.points],
        "genes": [] if log.genes is None else log.genes.double().tolist(),
    }
    write_whole(path, json.dumps(content) + "\n")


def read_all(todo: Sequence[tuple[str, Case, int]], plan: Plan) -> Iterator[Trace]:
    """Those of the traces that are there. Raises HopdiffError for one that was run under another budget."""
    for one in todo:
        path = path_of(plan.folder, *one)
        if not path.is_file():
            continue
        found: dict[str, Any] = read_json(path)
        kept, asked = (found["evaluations"], found["price"]), (plan.evaluations, plan.prices[one[1].model])
        if kept != asked:
            raise HopdiffError(f"{path} was run with a budget of {kept[0]}, not {asked[0]}: take another --traces.")
        points = [Point(int(a), int(b), float(c), float(d)) for a, b, c, d in found["points"]]
        yield Trace(*one, points, tuple(found["genes"]), found["commit"])


def prices(model: str, case: Case, folder: Path, repeats: int) -> list[tuple[int, float, float]]:
    """As `gradient_prices`; measured once and kept with the traces that are run at it."""
    path = folder / f"prices_{model}.json"
    path.parent.mkdir(parents=True, exist_ok=True)
    with FileLock(path.with_suffix(".lock")):
        if not path.is_file():
            write_json(path, {"rows": gradient_prices(build_problem(case, folder), repeats)})
    return [(int(batch), float(value), float(both)) for batch, value, both in read_json(path)["rows"]]


def price_of(rows: Sequence[tuple[int, float, float]]) -> float:
    """Of a gradient, in evaluations, at PRICED_BATCH; never below nothing, which noise could make it."""
    return next(max(both / value - 1.0, 0.0) for batch, value, both in rows if batch == PRICED_BATCH)


@cache
def commit() -> str:
    state = git_state(Path(__file__).parent)
    return f"{state['commit'][:12]}{', with changes' if state['dirty'] else ''}" if state["checkout"] else "unknown"


def machine() -> str:
    """In general terms."""
    return f"{platform.machine()}, {platform.system()}, Python {platform.python_version()}, one core a run"
