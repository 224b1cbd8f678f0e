"""Many starts: screening, descents, replacement."""

import math

import pytest
import torch

from hopdiff.search.adam import Adam
from hopdiff.search.base import Eval
from hopdiff.search.bfgs import Bfgs
from hopdiff.search.descent import PROVEN, Curves
from hopdiff.search.gradient import RESTARTS, SCREEN, STARTS, Gradient
from hopdiff.search.lm import Lm
from hopdiff.search.loop import Budget, run_search
from hopdiff.types import HopdiffError
from tests.search import problems
from tests.search.driving import told


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
    state = told(settings, state, genes, Eval(cost, None, merit, {}, torch.zeros(10).long()), generator)
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


def test_ended_descents_make_room_until_enough_were_in_vain():
    """All end in the one minimum: after the first four, which one of them found, five more are as many as it takes."""
    problem = problems.sphere(4)
    problem.keep = True
    result = run_search(problem, Gradient(starts=4, screen=6, restarts=8), Budget(), seeded())
    assert result.stopped == "converged"
    screenings = [batch for batch in problem.seen if len(batch) == 6]
    assert len(screenings) == 2
    assert not torch.equal(screenings[0], screenings[1])
    assert max(len(batch) for batch in problem.seen) == 6
    assert {len(batch) for batch in problem.seen} <= {1, 2, 3, 4, 6}


@pytest.mark.parametrize(("starts", "restarts"), [(1, 0), (3, 0), (1, 2), (2, 5)])
def test_how_many_descents_there_are(starts, restarts):
    """Each begins at a point that was screened."""
    problem = problems.sphere(3)
    problem.keep = True
    run_search(problem, Gradient(starts=starts, screen=20, restarts=restarts), Budget(), seeded())
    screened = problem.seen[0]
    tried = torch.cat(problem.seen[1:])
    begun = int((screened[:, None] == tried[None]).all(-1).any(1).sum())
    assert begun == max(starts, restarts + 1)


def test_a_descent_that_falls_behind_is_given_up():
    """Of two valleys the deeper one is found by the best start, and the other is left before its end."""
    curves = Curves().begun(2)
    for step in range(1, 12):
        fast, slow = 1.0 + 10.0 * 0.3**step, 2.0 + 10.0 * 0.3**step
        curves = curves.seen([fast, slow][: len(curves.values)], [False] * 2, [True] * 2, 1e-3)
        if len(curves.values) == 1:
            break
    assert step == PROVEN
    assert curves.kept == (0,)
    assert (curves.best, curves.vain) == (slow, 0)


def test_a_descent_that_may_still_win_goes_on():
    """A slow one that falls evenly overtakes a fast one, which is then the one behind."""
    curves = Curves().begun(2)
    for step in range(1, 8):
        curves = curves.seen([1.0 + 10.0 * 0.3**step, 4.0 - 0.45 * step], [False] * 2, [True] * 2, 1e-3)
        assert curves.kept == ((0, 1) if step < 7 else (1,))
    assert curves.best == 1.0 + 10.0 * 0.3**7


def test_the_best_that_ended_is_better_by_more_than_the_gain():
    curves = Curves().begun(1)
    for value, best, vain in ((2.0, 2.0, 0), (1.999, 1.999, 1), (1.99, 1.99, 0), (3.0, 1.99, 1), (2.5, 1.99, 2)):
        curves = curves.seen([value], [True], [True], 1e-3)
        assert (curves.best, curves.vain, curves.kept) == (best, vain, ())
        curves = curves.begun(1)


def test_what_is_impossible_holds_nobody_back_and_is_never_the_best():
    curves = Curves().begun(2)
    for _ in range(12):
        curves = curves.seen([1.0, 2.0], [False, False], [False, True], 1e-3)
    assert curves.kept == (0, 1)
    curves = curves.seen([1.0, 2.0], [True, False], [False, True], 1e-3)
    assert (curves.best, curves.vain, curves.kept) == (None, 1, (1,))
    curves = curves.seen([2.0], [True], [True], 1e-3)
    assert (curves.best, curves.vain) == (2.0, 0)


def test_it_goes_on_until_something_possible_was_found():
    """The merit leads to where no candidate is possible; only a hundredth of the box is, elsewhere."""
    problem = problems.sphere(2)
    problem.valid = lambda x: (x < 0.1).all(-1)
    result = run_search(problem, Gradient(method="bfgs", starts=2, screen=8, restarts=1), Budget(4000), seeded())
    assert (result.best_genes < 0.1).all()
    assert result.stopped == "budget"


def test_residuals_choose_levenberg_and_marquardt():
    generator = seeded()
    for problem, method, kind in (
        (problems.squares(3), None, Lm),
        (problems.squares(3), "lm", Lm),
        (problems.squares(3), "bfgs", Bfgs),
        (problems.sphere(3), None, Bfgs),
        (problems.sphere(3), "adam", Adam),
    ):
        assert isinstance(Gradient(method=method).init(problem, generator).pack.descent, kind)
    with pytest.raises(HopdiffError, match=r"^search\.method=lm needs the residuals of the cost"):
        Gradient(method="lm").init(problems.sphere(3), generator)


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
        torch.testing.assert_close(trial, twin.detach(), rtol=0.0, atol=1e-12)
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
    assert (state.starts, state.screen, state.restarts) == (STARTS, SCREEN, RESTARTS) == (4, 64, 8)
    problem.starts, problem.screen, problem.restarts = 2, 9, 0
    state = Gradient().init(problem, seeded())
    assert (state.starts, state.screen, state.restarts) == (2, 9, 0)
    # another method than the one that suits it
    state = Gradient(method="adam").init(problem, seeded())
    assert (state.starts, state.screen, state.restarts) == (STARTS, SCREEN, RESTARTS)
    state = Gradient(starts=5, screen=11, restarts=7).init(problem, seeded())
    assert (state.starts, state.screen, state.restarts) == (5, 11, 7)


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
