"""The adapter to the library's CMA-ES."""

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
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


def test_populations_of_runs_that_grow_and_of_small_ones_take_turns():
    problem = problems.rastrigin(5)
    problem.keep = True
    settings = CMAES(population=6, patience=20)
    run_search(problem, settings, Budget(4000), torch.Generator().manual_seed(0))
    sizes = [len(batch) for batch in problem.seen[:-1]]
    assert set(sizes) >= {6, 12, 24}
    assert any(later < earlier for earlier, later in pairwise(sizes))
    problem.seen.clear()
    run_search(problem, replace(settings, small=False), Budget(4000), torch.Generator().manual_seed(0))
    sizes = [len(batch) for batch in problem.seen[:-1]]
    assert sizes == sorted(sizes)


def test_a_small_run_follows_where_the_growing_ones_have_spent_more():
    """The small one has a population between the usual one and half of the largest."""
    settings, generator = CMAES(population=8, patience=1), torch.Generator().manual_seed(0)
    state = settings.init(problems.sphere(3), generator)
    kinds, spent = [], [0, 0]
    for _ in range(60):
        genes, _ = settings.ask(state, generator)
        spent[state.small] += len(genes)
        before, state = state, settings.tell(state, genes, answer(torch.zeros(len(genes)).double()), generator)
        assert tuple(spent) == state.spent
        if state.optimizer is not before.optimizer:
            kinds.append(state.small)
            assert state.small == (spent[1] < spent[0])
            size = state.optimizer.popsize
            assert 8 <= size <= max(8, state.large // 2) if state.small else size == state.large == 2 * before.large
    assert {True, False} <= set(kinds)


def test_runs_in_vain_end_the_search():
    settings = CMAES(population=4, patience=2, restarts=3)
    result = run_search(problems.squares(2), settings, Budget(), torch.Generator().manual_seed(0))
    assert result.stopped == "converged"
    assert result.spent < 5000


def test_values_of_the_impossible_lie_above_the_worst_one_and_its_size_apart():
    inf = math.inf
    for worst in (3.0, -3.0):
        cost = torch.tensor([inf, -4.0, inf, worst], dtype=torch.float64)
        value = ranked_values(cost, torch.tensor([2.0, -4.0, 1.0, worst], dtype=torch.float64))
        assert value.tolist() == [worst + 2 * 4.0, -4.0, worst + 4.0, worst]


def answer(cost):
    return Eval(cost, None, cost, {}, torch.zeros(len(cost), dtype=torch.int64))


def test_a_run_is_given_up_after_its_patience_and_grows():
    settings = CMAES(population=6, patience=2, growth=1.5, tolerance=0.01, small=False)
    generator = torch.Generator().manual_seed(0)
    state = settings.init(problems.sphere(3), generator)
    assert state.optimizer.popsize == 6
    story = []
    # A fall of less than one per cent is none.
    for best in (10.0, 9.95, 9.0, 8.95, 8.94):
        genes, with_grad = settings.ask(state, generator)
        assert not with_grad
        state = settings.tell(state, genes, answer(best + torch.arange(6.0, dtype=torch.float64)), generator)
        story.append((state.optimizer.popsize, state.best, state.idle))
    assert story == [(6, 10.0, 0), (6, 10.0, 1), (6, 9.0, 0), (6, 9.0, 1), (9, math.inf, 0)]


def test_the_first_run_starts_at_the_start_or_in_the_middle_and_later_ones_anywhere():
    for start in (None, 0.3):
        problem = problems.sphere(2)
        if start is not None:
            problem.start = torch.full((2,), start, dtype=torch.float64)
        settings = CMAES(population=200, sigma=0.05, patience=1, small=False, growth=1.1)
        generator = torch.Generator().manual_seed(0)
        state = settings.init(problem, generator)
        means = []
        for _ in range(4):
            genes, _ = settings.ask(state, generator)
            means.append(genes.mean(0))
            flat = torch.zeros(len(genes), dtype=torch.float64)
            if len(means) == 1:
                assert float(genes.std()) == pytest.approx(0.05, rel=0.1)
            size = state.optimizer.popsize
            while state.optimizer.popsize == size:
                state = settings.tell(state, settings.ask(state, generator)[0], answer(flat), generator)
        middle = torch.full((2,), start or 0.5, dtype=torch.float64)
        torch.testing.assert_close(means[0], middle, rtol=0.0, atol=0.02)
        assert all(float((mean - middle).abs().max()) > 0.04 for mean in means[1:])


def test_the_first_step_is_the_spread_of_a_problem_that_tells_one():
    problem = problems.sphere(2)
    problem.start, problem.spread = torch.full((2,), 0.5, dtype=torch.float64), 0.03
    for settings, sigma in ((CMAES(), 0.03), (CMAES(sigma=0.1), 0.1)):
        assert settings.init(problem, torch.Generator().manual_seed(0)).optimizer.sigma == sigma
    assert CMAES().init(problems.sphere(2), torch.Generator().manual_seed(0)).optimizer.sigma == 0.2


def test_numpys_own_random_numbers_stay_the_callers():
    drawn = []
    for seed in (0, 1):
        np.random.seed(7)  # noqa: NPY002
        run_search(problems.rastrigin(3), CMAES(patience=5), Budget(600), torch.Generator().manual_seed(seed))
        drawn.append(float(np.random.rand()))  # noqa: NPY002
    np.random.seed(7)  # noqa: NPY002
    assert drawn == [float(np.random.rand())] * 2  # noqa: NPY002
