"""The adapter to the library's CMA-ES."""

import math

import pytest
import torch

from hopdiff.search.cmaes import CMAES, ranked_values
from hopdiff.search.loop import Budget, run_search
from tests.search import problems


def test_invalid_ones_rank_last_by_merit_with_finite_values():
    inf = math.inf
    cost = torch.tensor([2.0, inf, -5.0, inf, inf, 3.0], dtype=torch.float64)
    merit = torch.tensor([2.0, 9.0, -5.0, 1.0, inf, 3.0], dtype=torch.float64)
    value = ranked_values(cost, merit)
    assert value.isfinite().all()
    assert value.argsort().tolist() == [2, 0, 5, 3, 1, 4]
    assert value[cost.isfinite()].tolist() == [2.0, -5.0, 3.0]


@pytest.mark.parametrize("merit", [[3.0, 1.0, 2.0], [math.inf] * 3])
def test_values_are_finite_when_nothing_is_valid(merit):
    merit = torch.tensor(merit, dtype=torch.float64)
    value = ranked_values(torch.full((3,), math.inf, dtype=torch.float64), merit)
    assert value.isfinite().all()
    assert len(value.unique()) == 3


def test_converges_on_an_ellipsoid():
    result = run_search(problems.ellipsoid(10, 100.0), CMAES(), Budget(), torch.Generator().manual_seed(0))
    assert result.best_cost < 1e-8


def test_population_grows_at_a_restart():
    problem = problems.rastrigin(5)
    problem.keep = True
    run_search(problem, CMAES(population=6, patience=20), Budget(4000), torch.Generator().manual_seed(0))
    sizes = [len(batch) for batch in problem.seen[:-1]]
    assert sizes == sorted(sizes)
    assert set(sizes) >= {6, 12, 24}
