"""The loop: what it counts, when it ends, what it hands back."""

import math

import pytest
import torch

from hopdiff.search.base import Asked, Eval
from hopdiff.search.ga import GA
from hopdiff.search.gradient import Gradient
from hopdiff.search.loop import Budget, run_search
from hopdiff.search.random import Random
from hopdiff.types import HopdiffError, Status
from tests.search import problems


def seeded(seed=0):
    return torch.Generator().manual_seed(seed)


class Breaking(problems.Function):
    """Ctrl-C arrives while the batch number `at` is priced."""

    at = 3
    batches = 0

    def evaluate(self, genes, with_grad):
        self.batches += 1
        if self.batches > self.at:
            raise KeyboardInterrupt
        return super().evaluate(genes, with_grad)


def test_ctrl_c_keeps_the_best_so_far():
    problem = Breaking(problems.sphere().f, 20)
    result = run_search(problem, Random(), Budget(1000), seeded())
    whole = run_search(problems.sphere(), Random(), Budget(300), seeded())
    assert result.interrupted
    assert not whole.interrupted
    assert result.evaluations == 300
    assert torch.equal(result.best_genes, whole.best_genes)


def test_ctrl_c_in_the_callback_keeps_the_best_too():
    def tired(row, result):
        raise KeyboardInterrupt

    result = run_search(problems.sphere(), Random(), Budget(1000), seeded(), on_step=tired)
    assert result.interrupted
    assert len(result.history) == 1


def test_ctrl_c_before_anything_valid_passes_through():
    problem = Breaking(problems.sphere().f, 20, valid=lambda x: x[:, 0] > 2)
    with pytest.raises(KeyboardInterrupt):
        run_search(problem, Random(), Budget(1000), seeded())


def test_stop_ends_after_the_step():
    answers = iter([False, False, True])
    result = run_search(problems.sphere(), Random(), Budget(1000), seeded(), stop=lambda: next(answers))
    assert result.interrupted
    assert len(result.history) == 3


def test_target_ends_the_search():
    result = run_search(problems.sphere(), Gradient(), Budget(10_000, target=1e-3), seeded())
    assert result.best_cost <= 1e-3
    assert result.spent < 1000
    assert result.history[-2].best > 1e-3


def test_last_batch_is_cut():
    result = run_search(problems.sphere(), Random(population=40), Budget(100), seeded())
    assert [row.evaluations for row in result.history] == [40, 80, 100]


def test_gradients_are_charged_for():
    result = run_search(problems.sphere(), Gradient(starts=4, screen=10), Budget(50, gradient_price=2.0), seeded())
    assert [(row.evaluations, row.gradient_evaluations, row.spent) for row in result.history[:2]] == [
        (10, 0, 10.0),
        (14, 4, 22.0),
    ]
    assert result.gradient_price == 2.0


def test_callback_sees_every_row_and_the_state_of_things():
    seen = []
    problem = problems.half_invalid()
    result = run_search(problem, GA(), Budget(1000), seeded(), on_step=lambda row, so_far: seen.append((row, so_far)))
    assert [row for row, _ in seen] == result.history
    assert [so_far.best_cost for _, so_far in seen] == [row.best for row in result.history]
    assert [row.step for row in result.history] == list(range(len(result.history)))
    seconds = [row.seconds for row in result.history]
    assert seconds == sorted(seconds)


def test_row_holds_the_median_the_invalid_share_and_the_best_terms():
    """Of points 0, .1, .., .9 those below .35 are impossible."""

    class Ladder(Random):
        def ask(self, state, generator):
            return torch.arange(10, dtype=torch.float64)[:, None] / 10, False

    problem = problems.Function(lambda x: x[:, 0] ** 2, 1, valid=lambda x: x[:, 0] > 0.35)
    result = run_search(problem, Ladder(), Budget(20), seeded())
    row = result.history[0]
    assert row.best == pytest.approx(0.16)
    assert row.median == pytest.approx(0.36)  # the lower of the two in the middle of six
    assert row.invalid == pytest.approx(0.4)
    assert (row.gamma, row.energy) == pytest.approx((0.16, 0.4))
    assert result.best_terms == pytest.approx({"gamma": 0.16, "energy": 0.4})
    assert result.best_status is Status.OK
    assert result.statuses == {Status.OK: 12, Status.LEG_FORCE: 8}
    assert result.invalid_fraction == pytest.approx(0.4)


def test_a_step_without_valid_candidates_has_no_median():
    class Late(problems.Function):
        def evaluate(self, genes, with_grad):
            result = super().evaluate(genes, with_grad)
            return result if self.evaluated > 100 else result._replace(cost=torch.full_like(result.cost, math.inf))

    rows = []
    problem = Late(problems.sphere().f, 20)
    run_search(problem, Random(), Budget(200), seeded(), on_step=lambda row, so_far: rows.append((row, so_far)))
    first, so_far = rows[0]
    assert math.isnan(first.median)
    assert math.isnan(first.gamma)
    assert first.best == so_far.best_cost == math.inf
    assert so_far.best_genes.isnan().all()
    assert rows[1][0].best < math.inf


@pytest.mark.parametrize("poison", [math.nan, -math.inf, math.inf])
def test_what_is_not_a_finite_number_is_never_best_nor_told(poison):
    told = []

    class Listening(Random):
        def tell(self, state, genes, result, generator):
            told.append(result)
            return state

    class Poisoned(problems.Function):
        def evaluate(self, genes, with_grad):
            cost, _, merit, terms, status, _ = super().evaluate(genes, with_grad)
            cost, merit = cost.clone(), merit.clone()
            cost[::2] = merit[::2] = poison
            return Eval(cost, torch.full_like(genes, math.nan), merit, terms, status)

    result = run_search(Poisoned(problems.sphere().f, 20), Listening(), Budget(300), seeded())
    assert 0 < result.best_cost < math.inf
    assert result.invalid_fraction == 0.5
    assert result.statuses == {Status.OK: 150, Status.NOT_FINITE: 150}
    for evaluation in told:
        assert torch.equal(evaluation.cost.isinf(), torch.arange(100) % 2 == 0)
        assert (evaluation.cost > 0).all()
        assert (evaluation.merit > 0).all()
        assert evaluation.grad is not None
        assert evaluation.grad.isfinite().all()


def test_failure_counts_and_names_the_commonest_reason():
    class Hopeless(problems.Function):
        def evaluate(self, genes, with_grad):
            result = super().evaluate(genes, with_grad)
            status = torch.full_like(result.status, Status.NO_FLIGHT)
            status[:10] = Status.LEG_COLLAPSED
            return result._replace(cost=torch.full_like(result.cost, math.inf), status=status)

    with pytest.raises(HopdiffError, match=r"None of the 250 candidates .*too little lift for a flight phase\.$"):
        run_search(Hopeless(problems.sphere().f, 20), Random(), Budget(250), seeded())


@pytest.mark.parametrize(("name", "value"), [("evaluations", 0), ("gradient_price", -1), ("gradient_price", math.nan)])
def test_wrong_budgets_are_named(name, value):
    with pytest.raises(HopdiffError, match=rf"^budget\.{name} must be"):
        Budget(**{name: value})


@pytest.mark.parametrize("search", [object(), Random, "ga"], ids=["no search", "a class", "a name"])
def test_what_is_no_search_is_told(search):
    with pytest.raises(HopdiffError, match="a search is an object with name, init, ask and tell"):
        run_search(problems.Function(problems.sphere().f, 3), search, Budget(10), seeded())


@pytest.mark.parametrize(
    "asked", [None, [0.5], (torch.zeros(4, 2), True), (torch.zeros(3), True), ([[0.5] * 3], False)], ids=str
)
def test_what_is_no_batch_of_points_is_told(asked):
    class Strange(Random):
        def ask(self, state, generator):
            return asked

    with pytest.raises(HopdiffError, match=r"must be a tensor of shape \(P, 3\) and whether its gradient is wanted"):
        run_search(problems.Function(problems.sphere().f, 3), Strange(), Budget(10), seeded())


def test_a_search_that_asks_for_nothing_is_told():
    class Silent(Random):
        def ask(self, state, generator):
            return torch.zeros(0, 3, dtype=torch.float64), False

    with pytest.raises(HopdiffError, match=r"The search asked for no candidate\."):
        run_search(problems.Function(problems.sphere().f, 3), Silent(), Budget(10), seeded())


class Tired(Random):
    """Over after three steps."""

    def init(self, problem, generator):
        return super().init(problem, generator), 0

    def ask(self, state, generator):
        return super().ask(state[0], generator)

    def tell(self, state, genes, result, generator):
        return state[0], state[1] + 1

    def finished(self, state):
        return state[1] == 3


@pytest.mark.parametrize(
    ("search", "budget", "stop", "why"),
    [
        (Tired(), Budget(1000), None, "converged"),
        (Tired(), Budget(250), None, "budget"),
        (Tired(), Budget(1000, target=1e9), None, "target"),
        (Tired(), Budget(1000), lambda: True, "user"),
    ],
)
def test_it_says_why_it_ended(search, budget, stop, why):
    so_far = []
    result = run_search(problems.sphere(), search, budget, seeded(), lambda row, found: so_far.append(found), stop)
    assert result.stopped == why
    assert result.interrupted == (why == "user")
    assert {found.stopped for found in so_far} == {""}
    assert len(result.history) == {"converged": 3, "budget": 3, "target": 1, "user": 1}[why]
    assert result.evaluations == {"converged": 300, "budget": 250, "target": 100, "user": 100}[why]


def test_residuals_are_asked_for_and_counted_as_values():
    class Looking(Random):
        def ask(self, state, generator):
            return Asked(state.uniform(10, generator), with_residuals=True)

        def tell(self, state, genes, result, generator):
            assert torch.equal(result.residuals.square().sum(-1), result.merit)
            return state

    problem = problems.squares(3)
    result = run_search(problem, Looking(), Budget(35), seeded())
    assert (result.evaluations, result.gradient_evaluations) == (35, 0)
    with pytest.raises(HopdiffError, match=r"residuals of the cost, which this problem does not tell\."):
        run_search(problems.sphere(), Looking(), Budget(35), seeded())
