"""Many starts: screening, descents, replacement."""

import math

import pytest
import torch

from hopdiff.search.adam import Adam
from hopdiff.search.base import Eval
from hopdiff.search.gradient import SCREEN, STARTS, Gradient
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


def test_adam_is_that_of_torch_with_a_rate_that_falls_along_half_a_cosine():
    steps, rate = 40, 0.02
    target = torch.rand(3, 5, generator=seeded(1), dtype=torch.float64)
    x = torch.rand(3, 5, generator=seeded(2), dtype=torch.float64)
    rows = Adam.begin(x, rate, steps)
    twin = x.clone().requires_grad_()
    other = torch.optim.Adam([twin], lr=rate, betas=(0.9, 0.99), eps=1e-300)
    for step in range(steps):
        trial = rows.trial()
        # Its corrections for the first steps are worked out in single precision.
        torch.testing.assert_close(trial, twin.detach(), rtol=0.0, atol=1e-6)
        value = (trial - target).pow(4).sum(-1)
        rows = rows.advance(trial, value, 4.0 * (trial - target).pow(3))
        assert torch.equal(rows.value, value)
        assert torch.equal(rows.last, trial)
        other.param_groups[0]["lr"] = rate * 0.5 * (1.0 + math.cos(math.pi * (step + 1) / steps))
        twin.grad = 4.0 * (twin.detach() - target).pow(3)
        other.step()
        assert rows.done.tolist() == [step + 1 == steps] * 3


def test_adam_gives_up_where_it_only_ever_turns_back():
    x = torch.full((2, 2), 0.5, dtype=torch.float64)
    rows = Adam.begin(x, rate=0.1, steps=50).advance(x, x.new_ones(2), torch.ones_like(x))
    nowhere = torch.tensor([math.inf, 1.0], dtype=torch.float64)
    for halvings in range(1, 11):
        rows = rows.advance(rows.trial(), nowhere, torch.ones_like(x))
        assert float(rows.scale[0]) == 0.5**halvings
        assert rows.age.tolist() == [1, halvings + 1]
        # 2^-10 is the first factor below a thousandth.
        assert rows.done.tolist() == [halvings == 10, False]
    assert torch.equal(rows.last[0], x[0])
    assert float(rows.value[0]) == 1.0


def test_a_problem_says_how_many_starts_suit_it():
    problem = problems.sphere(3)
    state = Gradient().init(problem, seeded())
    assert (state.starts, state.screen) == (STARTS, SCREEN) == (16, 128)
    problem.starts, problem.screen = 4, 9
    state = Gradient().init(problem, seeded())
    assert (state.starts, state.screen) == (4, 9)
    state = Gradient(starts=5, screen=11).init(problem, seeded())
    assert (state.starts, state.screen) == (5, 11)


def test_a_search_begins_about_the_start_of_a_problem_that_says_how_far():
    problem = problems.sphere(3)
    problem.start, problem.spread = torch.tensor([0.5, 0.02, 0.7], dtype=torch.float64), 0.05
    state = Gradient(starts=1, screen=20_000).init(problem, seeded())
    genes, _ = Gradient(starts=1, screen=20_000).ask(state, seeded())
    assert genes.min() == 0.0
    assert float(genes[:, 1].median()) == pytest.approx(0.02, abs=2e-3)
    for gene, place in ((0, 0.5), (2, 0.7)):
        assert float(genes[:, gene].mean()) == pytest.approx(place, abs=2e-3)
        assert float(genes[:, gene].std()) == pytest.approx(0.05, rel=0.03)
    del problem.spread
    genes, _ = Gradient(starts=1, screen=5000).ask(Gradient(starts=1, screen=5000).init(problem, seeded()), seeded())
    assert float(genes.std()) == pytest.approx(12**-0.5, rel=0.02)
