"""Individuals that breed, the best of which descend."""

import pytest
import torch

from hopdiff.search.descent import PROVEN
from hopdiff.search.hybrid import Hybrid
from hopdiff.search.loop import Budget, run_search
from hopdiff.types import HopdiffError
from tests.search import problems
from tests.search.driving import told

BOTH = pytest.mark.parametrize("write_back", [True, False], ids=["lamarck", "baldwin"])


def seeded(seed=0):
    return torch.Generator().manual_seed(seed)


def steps_of(settings, problem, asks):
    """What is asked, and the state before and after each answer, until the search is over."""
    generator = seeded()
    state = settings.init(problem, generator)
    for _ in range(asks):
        if settings.finished(state):
            return
        genes, with_grad, *_ = settings.ask(state, generator)
        result = problem.evaluate(genes, with_grad)
        before, state = state, told(settings, state, genes, result, generator)
        yield genes, with_grad, before, state


def test_the_best_of_the_first_individuals_descends_at_once():
    problem = problems.ellipsoid(8)
    (first, with_grad, _, state), (second, then, _, _) = steps_of(Hybrid(population=12), problem, 2)
    assert (len(first), with_grad, len(second), then) == (12, False, 1, True)
    assert torch.equal(second[0], first[problem.evaluate(first, False).cost.argmin()])
    assert len(state.brood.genes) == 11


def test_a_problem_may_ask_for_fewer_individuals():
    sizes = []
    for screen in (None, 18, 64):
        problem = problems.sphere(4)
        if screen:
            problem.screen = screen
        sizes.append(len(next(steps_of(Hybrid(), problem, 1))[0]))
    assert sizes == [40, 18, 40]


def test_descents_that_pay_get_most_of_the_evaluations():
    turns = [with_grad for _, with_grad, _, _ in steps_of(Hybrid(share=0.05), problems.rosenbrock(), 120)]
    generations = turns[1:].count(False)
    assert 0 < generations < 10


def test_generations_that_pay_get_up_to_half():
    """Where gradients lead nowhere, children are what brings something."""
    noise = problems.Function(lambda x: (x - 0.3).abs().sum(-1).detach() + 0.0 * x.sum(-1), 6)
    settings = Hybrid(restarts=60, climbers=2, patience=20)
    turns = [with_grad for _, with_grad, _, _ in steps_of(settings, noise, 80)]
    assert turns.count(False) > 20


def test_a_larger_share_breeds_more():
    counts = []
    for share in (0.0, 0.1, 0.5):
        turns = [with_grad for _, with_grad, _, _ in steps_of(Hybrid(share=share), problems.rosenbrock(), 60)]
        counts.append(turns[1:].count(False))
    assert counts[0] < counts[1] < counts[2]


@BOTH
def test_lamarck_writes_genes_back_and_baldwin_only_their_cost(write_back):
    problem = problems.ellipsoid(8)
    settings = Hybrid(write_back=write_back, restarts=9)
    first = None
    for genes, _, before, state in steps_of(settings, problem, 300):
        first = genes if first is None else first
        if len(state.climbers.able) < len(before.climbers.able):
            break
    best = state.brood.genes[0]
    assert state.brood.cost[0] < 1e-3 * problem.evaluate(first, False).cost.min()
    true = problem.evaluate(best[None], False).cost[0]
    assert bool(torch.isclose(true, state.brood.cost[0], atol=1e-12)) == write_back
    assert bool((best == first).all(-1).any()) != write_back


@BOTH
def test_who_descends_breeds_with_what_it_has_reached(write_back):
    settings = Hybrid(write_back=write_back)
    *_, (_, _, _, state) = steps_of(settings, problems.ellipsoid(8), 12)
    parents = settings._parents(state).genes
    climber = state.climbers
    assert torch.equal(parents[0], (climber.pack.descent.x if write_back else climber.origin)[0])
    assert len(parents) == len(state.brood.genes) + 1


def test_descents_begin_apart_from_all_that_has_been_searched():
    settings = Hybrid(apart=0.1, restarts=12)
    begun = 0
    for _, _, before, state in steps_of(settings, problems.rastrigin(6), 400):
        if len(state.climbers.able) > len(before.climbers.able):
            begun += 1
            distance = torch.cdist(state.climbers.origin[-1:], before.settled.x)
            assert (distance >= 0.1 * 6**0.5).all()
    assert begun > 3


def test_a_descent_to_where_one_has_ended_is_given_up():
    """It had not been under way for long enough to be judged by how it falls."""
    trials, ends = [], []
    settings = Hybrid(population=20, apart=0.15, restarts=4)
    for _, with_grad, before, state in steps_of(settings, problems.ellipsoid(4, 300.0), 200):
        if with_grad:
            trials.append(len(before.climbers.pack.curves.values[0]) + 1)
            if not state.climbers.able:
                ends.append(trials[-1])
    assert state.over
    assert ends[0] > PROVEN > max(ends[1:])
    assert state.settled.merit[0] < 1e-8 < state.settled.merit[1:].min()
    distance = torch.cdist(state.settled.x, state.settled.x)
    assert all(distance[at, :at].min() < 0.15 * 2.0 for at in range(1, len(ends)))


def test_random_newcomers_come_where_all_individuals_have_been_searched():
    problem, settings = problems.sphere(6), Hybrid(apart=1.0, restarts=3)
    *steps, (_, _, _, last) = steps_of(settings, problem, 200)
    newcomers = [genes for genes, with_grad, before, _ in steps if before.barren and not with_grad]
    assert len(newcomers) > 2
    assert all(genes.shape == (settings.children, 6) and genes.std() > 0.2 for genes in newcomers)
    assert settings.finished(last)
    assert run_search(problem, settings, Budget(), seeded()).best_cost < 1e-8


def test_a_child_better_than_all_descends_too():
    """A step down that only a child can take, and a descent that takes long."""

    def f(x):
        return torch.where(x[:, 0] > 0.6, 0.0, 9.0) + (x - 0.3).square().sum(-1).pow(0.25)

    problem = problems.Function(f, 4)
    problem.start, problem.spread = torch.full((4,), 0.4, dtype=torch.float64), 0.02
    grown = [
        (before, state)
        for _, _, before, state in steps_of(Hybrid(share=0.5, mutation=0.5, sigma=0.3, tolerance=0.0), problem, 60)
        if len(state.climbers.able) > len(before.climbers.able) > 0
    ]
    assert grown
    for before, state in grown:
        assert state.best < before.best
        assert problem.evaluate(state.climbers.origin[-1:], False).cost == state.best


def test_converges():
    for make in (problems.ellipsoid, problems.rosenbrock, problems.kinked):
        assert run_search(make(), Hybrid(), Budget(), seeded()).best_cost < 1e-8


def test_it_is_over_when_descents_find_nothing_better():
    spent = []
    for restarts in (0, 3):
        for problem in (problems.squares(6), problems.sphere(6)):
            result = run_search(problem, Hybrid(restarts=restarts), Budget(), seeded())
            assert result.stopped == "converged"
            assert result.best_cost < 1e-6
            spent.append(result.spent)
    assert max(spent[:2]) < min(spent[2:])


def test_it_goes_on_as_long_as_nothing_possible_is_found():
    with pytest.raises(HopdiffError, match="None of the 400 candidates"):
        run_search(problems.all_invalid(), Hybrid(), Budget(400, gradient_price=0.0), seeded())


@BOTH
def test_residuals_serve_the_climbers(write_back):
    problem = problems.rosenbrock_squares()
    result = run_search(problem, Hybrid(write_back=write_back), Budget(), seeded())
    assert result.best_cost < 1e-8
    assert result.spent < 1500


def test_seldom_looks_save_evaluations():
    def looked(renew):
        result = run_search(problems.rosenbrock_squares(), Hybrid(renew=renew, restarts=0), Budget(), seeded())
        assert result.best_cost < 1e-8
        return result.evaluations - result.gradient_evaluations

    assert looked(20) < looked(2)


def test_adam_is_no_climber():
    with pytest.raises(HopdiffError, match=r"^search\.method must be one of lm, bfgs, not 'adam'\.$"):
        Hybrid(method="adam")
