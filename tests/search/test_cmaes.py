"""The adapter to the library's CMA-ES."""

import math

import pytest
import torch

from hopdiff.search.base import Eval
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


def test_values_of_the_impossible_lie_above_the_worst_one_and_its_size_apart():
    inf = math.inf
    for worst in (3.0, -3.0):
        cost = torch.tensor([inf, -4.0, inf, worst], dtype=torch.float64)
        value = ranked_values(cost, torch.tensor([2.0, -4.0, 1.0, worst], dtype=torch.float64))
        assert value.tolist() == [worst + 2 * 4.0, -4.0, worst + 4.0, worst]


def answer(cost):
    return Eval(cost, None, cost, {}, torch.zeros(len(cost), dtype=torch.int64))


def test_a_run_is_given_up_after_its_patience_and_grows():
    settings, generator = CMAES(population=6, patience=2, growth=1.5, tolerance=0.01), torch.Generator().manual_seed(0)
    state = settings.init(problems.sphere(3), generator)
    assert state.optimizer.population_size == 6
    story = []
    # A fall of less than one per cent is none.
    for best in (10.0, 9.95, 9.0, 8.95, 8.94):
        genes, with_grad = settings.ask(state, generator)
        assert not with_grad
        state = settings.tell(state, genes, answer(best + torch.arange(6.0, dtype=torch.float64)), generator)
        story.append((state.optimizer.population_size, state.best, state.idle))
    assert story == [(6, 10.0, 0), (6, 10.0, 1), (6, 9.0, 0), (6, 9.0, 1), (9, math.inf, 0)]


def test_the_first_run_starts_in_the_middle_and_a_later_one_anywhere():
    settings, generator = CMAES(population=200, sigma=0.05, patience=1), torch.Generator().manual_seed(0)
    state = settings.init(problems.sphere(2), generator)
    means = []
    for _ in range(4):
        genes, _ = settings.ask(state, generator)
        means.append(genes.mean(0))
        flat = torch.zeros(len(genes), dtype=torch.float64)
        if len(means) == 1:
            assert float(genes.std()) == pytest.approx(0.05, rel=0.1)
        state = settings.tell(state, genes, answer(flat), generator)
        state = settings.tell(state, settings.ask(state, generator)[0], answer(flat), generator)
    torch.testing.assert_close(means[0], torch.full((2,), 0.5, dtype=torch.float64), rtol=0.0, atol=0.02)
    assert all(float((mean - 0.5).abs().max()) > 0.05 for mean in means[1:])
