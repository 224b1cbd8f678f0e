"""Many starts: screening, descents, replacement."""

import math

import pytest
import torch

from hopdiff.search.adam import Adam
from hopdiff.search.base import Eval
from hopdiff.search.gradient import Gradient
from hopdiff.search.loop import Budget, run_search
from tests.search import problems


def seeded(seed=0):
    return torch.Generator().manual_seed(seed)


@pytest.mark.parametrize("make", [problems.rosenbrock, problems.ellipsoid, problems.corner, problems.kinked])
def test_converges_within_the_usual_budget(make):
    assert run_search(make(), Gradient(), Budget(), seeded()).best_cost < 1e-8


def test_the_best_of_the_screening_become_starts():
    settings, generator = Gradient(starts=3, screen=10), seeded()
    state = settings.init(problems.sphere(2), generator)
    genes, with_grad = settings.ask(state, generator)
    assert genes.shape == (10, 2)
    assert not with_grad
    cost = torch.arange(10.0, dtype=torch.float64)
    cost[:2] = math.inf
    merit = torch.arange(10.0, dtype=torch.float64)
    merit[9] = cost[9] = math.inf
    state = settings.tell(state, genes, Eval(cost, None, merit, {}, torch.zeros(10).long()), generator)
    starts, with_grad = settings.ask(state, generator)
    assert with_grad
    assert torch.equal(starts, genes[2:5])
    # valid ones first, then invalid ones by merit; the one without merit never
    assert torch.equal(state.waiting, genes[[5, 6, 7, 8, 0, 1]])


def test_starts_from_invalid_points_when_there_is_nothing_better():
    """Less than one point in a million is valid, but the merit leads there."""
    centre = problems.optimum(10)
    problem = problems.sphere(10)
    problem.valid = lambda x: (x - centre).abs().amax(1) < 0.1
    result = run_search(problem, Gradient(), Budget(2000), seeded())
    assert result.best_cost < 1e-6
    assert result.history[0].invalid == 1.0


def test_finished_descents_make_room():
    problem = problems.sphere(4)
    problem.keep = True
    run_search(problem, Gradient(starts=4, screen=8), Budget(600), seeded())
    screenings = [batch for batch in problem.seen if len(batch) == 8]
    assert len(screenings) >= 3
    assert all(len(batch) in (4, 8) for batch in problem.seen[:-1])
    assert not torch.equal(screenings[0], screenings[1])


def test_adam_walks_down_and_stops_after_its_steps():
    problem = problems.sphere(5)
    rows = Adam.begin(torch.rand(3, 5, generator=seeded(), dtype=torch.float64), rate=0.05, steps=100)
    for step in range(100):
        assert not rows.done.any(), step
        result = problem.evaluate(rows.trial(), True)
        rows = rows.advance(rows.trial(), result.merit, result.grad)
    assert rows.done.all()
    assert rows.value.max() < 1e-3


def test_adam_turns_back_where_there_is_no_value():
    x = torch.full((1, 2), 0.5, dtype=torch.float64)
    rows = Adam.begin(x, rate=0.1, steps=50).advance(x, x.new_ones(1), torch.ones_like(x))
    first = rows.trial()
    rows = rows.advance(first, x.new_full((1,), math.inf), torch.zeros_like(x))
    torch.testing.assert_close(rows.trial() - x, (first - x) / 2)
