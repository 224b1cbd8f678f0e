"""A population whose best descend."""

import pytest
import torch

from hopdiff.search.hybrid import Hybrid, spread
from hopdiff.search.loop import Budget, run_search
from hopdiff.types import HopdiffError
from tests.search import problems
from tests.search.driving import told


def seeded(seed=0):
    return torch.Generator().manual_seed(seed)


def steps_of(settings, problem, asks):
    """What is asked, and the state before and after each answer."""
    generator = seeded()
    state = settings.init(problem, generator)
    for _ in range(asks):
        genes, with_grad = settings.ask(state, generator)
        result = problem.evaluate(genes, with_grad)
        before, state = state, told(settings, state, genes, result, generator)
        yield genes, with_grad, before, state


def test_generations_and_steps_take_turns():
    settings = Hybrid(population=30, elites=4, climbers=3, steps=2, generations=50)
    turns = [with_grad for _, with_grad, _, _ in steps_of(settings, problems.rastrigin(), 9)]
    assert turns == [False, True, True] * 3


def test_lamarck_writes_genes_back_and_baldwin_only_their_cost():
    for write_back in (True, False):
        problem = problems.ellipsoid(8)
        settings = Hybrid(population=30, climbers=2, steps=3, generations=50, write_back=write_back)
        *_, (_, _, _, before), (_, _, _, _), (_, _, _, _), (_, _, _, after) = steps_of(settings, problem, 4)
        gained = after.people.cost[0] < before.people.cost[0]
        assert gained
        true = problem.evaluate(after.people.genes, False).cost
        assert torch.allclose(true, after.people.cost) == write_back
        known = (after.people.genes[:1] == before.people.genes).all(1).any()
        assert bool(known) != write_back


def test_climbers_keep_their_curvature_while_they_stay_best():
    settings = Hybrid(population=30, climbers=2, steps=2, generations=50)
    ages = [state.climbers.pack.descent.age.max() for *_, state in steps_of(settings, problems.rosenbrock(), 24)]
    assert max(ages) > 3


def test_ends_in_descents_and_then_starts_again():
    settings = Hybrid(population=30, climbers=2, steps=1, generations=2, refine=3)
    generations = [state.people.generation for *_, state in steps_of(settings, problems.corner(6), 80)]
    assert max(generations) == 2
    restart = generations.index(0, generations.index(2))
    assert 1 in generations[restart:]
    *_, (_, _, _, last) = steps_of(settings, problems.corner(6), 80)
    assert len(last.settled) >= 1


def test_converges():
    for make in (problems.ellipsoid, problems.rosenbrock, problems.kinked):
        assert run_search(make(), Hybrid(), Budget(), seeded()).best_cost < 1e-8


def test_spread_picks_the_first_of_each_neighbourhood():
    genes = torch.tensor([[0.1, 0.1], [0.11, 0.1], [0.5, 0.5], [0.9, 0.9], [0.52, 0.5]], dtype=torch.float64)

    def chosen(others, count, apart):
        distance = torch.cdist(genes, torch.cat((genes, others)))
        return spread(distance.tolist(), count, apart * 2**0.5)

    nobody = genes[:0]
    assert chosen(nobody, 3, 0.05) == [0, 2, 3]
    assert chosen(nobody, 2, 0.05) == [0, 2]
    assert chosen(genes[3:4] + 0.01, 5, 0.05) == [0, 2]
    assert chosen(nobody, 5, 0.0) == [0, 1, 2, 3, 4]
    assert spread([], 5, 0.1) == []


def test_it_is_over_when_descents_find_nothing_better():
    for problem in (problems.squares(6), problems.sphere(6)):
        result = run_search(problem, Hybrid(restarts=3), Budget(), seeded())
        assert result.stopped == "converged"
        assert result.best_cost < 1e-6


@pytest.mark.parametrize("write_back", [True, False], ids=["lamarck", "baldwin"])
def test_residuals_serve_the_climbers(write_back):
    problem = problems.rosenbrock_squares()
    result = run_search(problem, Hybrid(write_back=write_back), Budget(), seeded())
    assert result.best_cost < 1e-8
    assert result.spent < 3000


def test_adam_is_no_climber():
    with pytest.raises(HopdiffError, match=r"^search\.method must be one of lm, bfgs, not 'adam'\.$"):
        Hybrid(method="adam")
