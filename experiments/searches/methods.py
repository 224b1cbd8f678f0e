"""The methods that are compared, each by a text: a name, and departures from its settings after a colon.

"gradient:method=adam" is a search of hopdiff (conf/search/gradient.yaml) with search.method=adam;
"scipy_lbfgsb:starts=1" is a library behind an adapter of `experiments.searches.peers`.
"""

from __future__ import annotations

import importlib
import importlib.util
import math
import re
from contextlib import suppress
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path
from typing import Any

import torch
import yaml

from experiments.searches.cases import Case, build, build_problem
from experiments.searches.meter import Log, Meter, Spent
from hopdiff.doors import SEARCHES
from hopdiff.search.loop import HistoryRow, SearchResult, run_search
from hopdiff.types import HopdiffError

# Adapters: what must be installed, as it is imported and as it is called in an index.
PEERS = {
    "pycma": ("cma", "cma"),
    "scipy_lbfgsb": ("scipy", "scipy"),
    "scipy_de": ("scipy", "scipy"),
    "evotorch_snes": ("evotorch", "evotorch"),
    "nevergrad_ngopt": ("nevergrad", "nevergrad"),
    "pymoo_ga": ("pymoo", "pymoo"),
}
METHODS = [
    "random",
    "ga_thesis",
    "ga",
    "cmaes",
    "gradient:method=adam",
    "gradient:method=bfgs",
    "gradient:method=lm",
    "hybrid",
    "hybrid:write_back=false",
    *PEERS,
    "scipy_lbfgsb:starts=1",
    "scipy_lbfgsb:screened=true",
]
DESCENTS = ("gradient", "hybrid", "scipy_lbfgsb")  # that take gradients


def name_of(method: str) -> str:
    return re.split("[:,]", method)[0]


def changes_of(method: str) -> list[str]:
    """NAME=VALUE of every departure."""
    return re.split("[:,]", method)[1:]


def own(method: str) -> bool:
    """Whether it is a search of hopdiff, or of an installed package, and no peer."""
    return name_of(method) not in PEERS


def takes_gradients(method: str) -> bool:
    return name_of(method) in DESCENTS


def claimed(method: str) -> bool:
    """Whether it is one of those that this project claims to be best: quasi-Newton, least squares, hybrid."""
    return own(method) and takes_gradients(method) and "method=adam" not in method


def missing(method: str) -> str | None:
    """Why a method cannot be run here, or None."""
    name = name_of(method)
    if own(method):
        return None if name in SEARCHES.names() else f"hopdiff has no search {name!r}"
    module, package = PEERS[name]
    if importlib.util.find_spec(module) is None:
        return f"{package} is not installed: pip install -e '.[peers]'"
    return None


def packages(methods: list[str]) -> dict[str, str]:
    """Versions of what the methods run on."""
    names = ["torch", *(PEERS[name_of(method)][1] for method in methods if not own(method))]
    if any(name_of(method) == "cmaes" for method in methods):
        names.append("cma")
    return {name: version(name) for name in dict.fromkeys(names)}


def run(
    method: str, case: Case, seed: int, evaluations: int, price: float, folder: Path, target: float = -math.inf
) -> Log:
    """The trace of one run.

    Building the problem and one evaluation with and without gradient come before the clock starts. Raises HopdiffError
    for settings that cannot be; a run that finds nothing valid has a trace of infinite costs.
    """
    if not own(method):
        peer = importlib.import_module(f"experiments.searches.peers.{name_of(method)}")
        problem = build_problem(case, folder)
        _warm(problem)
        meter = Meter(problem, evaluations, price, target)
        with suppress(Spent):
            peer.run(meter, torch.Generator().manual_seed(seed), **_read(method))
        meter.log.enter(meter.evaluations, meter.gradient_evaluations, meter.best, torch.empty(0))
        return meter.log
    more = [f"search={name_of(method)}", *(f"search.{change}" for change in changes_of(method))]
    job = build(case, folder, more)
    _warm(job.problem)
    log = Log()

    def on_step(row: HistoryRow, result: SearchResult) -> None:
        log.enter(row.evaluations, row.gradient_evaluations, row.best, result.best_genes)

    # replace: whatever else a budget holds by now, as a rule to stop by, stays as it is set by default
    budget = replace(job.budget, evaluations=evaluations, gradient_price=price)
    budget = replace(budget, target=target) if math.isfinite(target) else budget
    try:
        run_search(job.problem, job.search, budget, torch.Generator().manual_seed(seed), on_step)
    except HopdiffError:
        if not log.points or math.isfinite(log.points[-1].best):
            raise
    return log


def _read(method: str) -> dict[str, Any]:
    """Settings of an adapter as plain data."""
    pairs = (change.split("=", 1) for change in changes_of(method))
    return {name: yaml.safe_load(value) for name, value in pairs}


def _warm(problem: Any) -> None:
    """PyTorch sets up much at its first call."""
    genes = torch.full((1, problem.dimension), 0.5, dtype=problem.dtype, device=problem.device)
    for with_grad in (False, True):
        problem.evaluate(genes, with_grad)
