"""What searches need to come near the best, beside SciPy: pytest tests/benchmarks -m slow -k search_cost.

A table is printed: evaluations, a gradient counted as one more, and batches one after the other, until 1 % and .1 %
above the lowest cost that any of them found; medians over problems and seeds. Nothing is asserted but that runs end.
"""

from __future__ import annotations

import math
import statistics
from collections.abc import Callable

import pytest
import torch
from scipy.optimize import minimize
from torch import Tensor

from hopdiff.composing import compose
from hopdiff.config import build_job
from hopdiff.search.base import Problem, Search
from hopdiff.search.box import Box
from hopdiff.search.gradient import Gradient
from hopdiff.search.hybrid import Hybrid
from hopdiff.search.loop import Budget, run_search

pytestmark = pytest.mark.slow
PRICE = 1.0  # of a gradient, in values
SEARCHES: dict[str, Search] = {
    "gradient": Gradient(),
    "gradient bfgs": Gradient(method="bfgs"),
    "hybrid": Hybrid(),
    "hybrid baldwin": Hybrid(write_back=False),
}
Trace = list[tuple[float, int, float]]  # spent, batches, best so far


class SpentError(Exception):
    """The budget is."""


def scipy_starts(problem: Problem, evaluations: int, seed: int) -> Trace:
    """L-BFGS-B from points that searches begin at, one after the other."""
    generator, box = torch.Generator().manual_seed(seed), Box.of(problem)
    trace: Trace = []

    def price(x: Tensor) -> tuple[float, Tensor]:
        spent = (1.0 + PRICE) * (len(trace) + 1)
        if spent > evaluations:
            raise SpentError
        found = problem.evaluate(torch.as_tensor(x)[None], True)
        assert found.grad is not None
        best = min(float(found.cost), trace[-1][2] if trace else math.inf)
        trace.append((spent, len(trace) + 1, best))
        value = float(found.merit)
        return (value if math.isfinite(value) else 1e3), found.grad[0].numpy()

    try:
        while True:
            start = box.first(1, generator)[0].numpy()
            minimize(price, start, jac=True, bounds=[(0.0, 1.0)] * len(start), method="L-BFGS-B")
    except SpentError:
        return trace


def ours(search: Search) -> Callable[[Problem, int, int], Trace]:
    def run(problem: Problem, evaluations: int, seed: int) -> Trace:
        result = run_search(problem, search, Budget(evaluations, PRICE), torch.Generator().manual_seed(seed))
        return [(row.spent, row.step + 1, row.best) for row in result.history]

    return run


METHODS = {"scipy L-BFGS-B": scipy_starts, **{name: ours(search) for name, search in SEARCHES.items()}}


def reached(trace: Trace, cost: float) -> tuple[float, float]:
    """Spent and batches until a cost, inf if never."""
    return next(((spent, batches) for spent, batches, best in trace if best <= cost), (math.inf, math.inf))


@pytest.mark.parametrize(
    ("model", "evaluations", "seeds", "betas"), [("smooth", 4000, 2, (0.2, 0.5, 0.7)), ("body", 1500, 1, (0.2,))]
)
def test_search_cost(
    model: str, evaluations: int, seeds: int, betas: tuple[float, ...], capsys: pytest.CaptureFixture[str]
) -> None:
    found: dict[str, list[tuple[float, ...]]] = {name: [] for name in METHODS}
    for speed in (3, 5, 8):
        for beta in betas:
            problem = build_job(compose([f"model={model}", f"speed={speed}", f"beta={beta}"])).problem
            for seed in range(seeds):
                traces = {name: run(problem, evaluations, seed) for name, run in METHODS.items()}
                best = min(trace[-1][2] for trace in traces.values())
                for name, trace in traces.items():
                    found[name].append((*reached(trace, 1.01 * best), *reached(trace, 1.001 * best), *trace[-1][:2]))
    with capsys.disabled():
        print(f"\n{model}: spent and batches to 1 %, to .1 %, to the end")
        for name, rows in found.items():
            print(f"{name:16}", *(f"{statistics.median(column):8.0f}" for column in zip(*rows, strict=True)))
    assert all(row[4] <= evaluations for rows in found.values() for row in rows)


def test_what_is_reached() -> None:
    """The first row that is low enough counts."""
    trace = [(2.0, 1, 5.0), (4.0, 2, 3.0), (6.0, 3, 3.0)]
    assert [reached(trace, cost) for cost in (5.0, 3.0, 1.0)] == [(2.0, 1), (4.0, 2), (math.inf, math.inf)]
