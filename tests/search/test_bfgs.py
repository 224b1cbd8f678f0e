"""Quasi-Newton descent in the box."""

import math

import pytest
import torch
from scipy.optimize import minimize

from hopdiff.search.bfgs import ARMIJO, BACKTRACKS, Bfgs
from hopdiff.search.descent import joined, taken
from hopdiff.search.model_step import POWELL
from tests.search import problems


def descend(problem, x, steps, **settings):
    rows = Bfgs.begin(x, **{"reach": 1.0, "tolerance": 0.0, "patience": 5, **settings})
    for _ in range(steps):
        trial = rows.trial()
        result = problem.evaluate(trial, True)
        rows = rows.advance(trial, result.merit, result.grad)
    return rows


def starts(problem, rows=4, seed=0):
    generator = torch.Generator().manual_seed(seed)
    return torch.rand(rows, problem.dimension, generator=generator, dtype=torch.float64)


@pytest.mark.parametrize(
    ("make", "steps"),
    [
        (problems.sphere, 30),
        (problems.corner, 30),
        (problems.ellipsoid, 200),
        (problems.rosenbrock, 200),
        (problems.kinked, 120),
    ],
)
def test_every_start_converges(make, steps):
    problem = make()
    assert descend(problem, starts(problem), steps).value.min() <= 1e-10
    assert descend(problem, starts(problem), steps).value.median() <= 1e-8


@pytest.mark.parametrize("dimension", [6, 20])
def test_agrees_with_another_solver_on_a_minimum_held_by_bounds(dimension):
    problem = problems.bound_ellipsoid(dimension)
    rows = descend(problem, starts(problem), 200)

    def f(x):
        result = problem.evaluate(torch.from_numpy(x)[None], True)
        return float(result.merit), result.grad[0].numpy()

    other = minimize(
        f, [0.5] * dimension, jac=True, bounds=[(0, 1)] * dimension, method="L-BFGS-B", options={"maxfun": 10**5}
    )
    assert int(((rows.x == 0) | (rows.x == 1)).sum(1).min()) > 0
    assert rows.value.tolist() == pytest.approx([other.fun] * 4, rel=1e-6)


def test_a_quadratic_takes_few_trials():
    """Dense updates learn a quadratic of G genes in about G steps."""
    problem = problems.ellipsoid(10, 100.0)
    assert descend(problem, starts(problem), 45).value.max() < 1e-6


def test_accepted_values_only_fall_and_trials_stay_in_the_box():
    problem = problems.rastrigin()
    rows = Bfgs.begin(starts(problem, 16), reach=1.0, tolerance=0.0, patience=5)
    last = rows.value
    for _ in range(60):
        trial = rows.trial()
        assert trial.min() >= 0
        assert trial.max() <= 1
        result = problem.evaluate(trial, True)
        rows = rows.advance(trial, result.merit, result.grad)
        assert (rows.value <= last).all()
        assert (torch.linalg.eigvalsh(rows.hessian) > 0).all()
        last = rows.value


def test_a_row_goes_its_way_whatever_its_neighbours_do():
    problem = problems.kinked(8)
    x = starts(problem, 6)
    together = descend(problem, x, 40)
    alone = descend(problem, x[2:3], 40)
    torch.testing.assert_close(together.x[2:3], alone.x, rtol=1e-6, atol=1e-8)


def test_backs_off_from_where_there_is_no_value():
    inner = problems.sphere(5).f
    problem = problems.Function(lambda x: inner(x) + torch.where(x[:, 0] > 0.45, math.inf, 0.0), 5)
    x = starts(problem)
    x[:, 0] = 0.4
    rows = descend(problem, x, 80)
    assert rows.value.isfinite().all()
    assert (rows.x[:, 0] <= 0.45).all()
    assert (rows.value < inner(x)).all()


def test_a_start_without_value_is_done_at_once():
    x = torch.full((2, 3), 0.5, dtype=torch.float64)
    rows = Bfgs.begin(x, 1.0, 0.0, 5)
    value = torch.tensor([math.inf, 1.0], dtype=torch.float64)
    rows = rows.advance(rows.trial(), value, torch.ones_like(x))
    assert rows.done.tolist() == [True, False]


def test_done_at_a_minimum_and_not_before():
    problem = problems.corner(6)
    rows = Bfgs.begin(starts(problem), 1.0, 0.0, 5)
    for _ in range(60):
        trial = rows.trial()
        result = problem.evaluate(trial, True)
        rows = rows.advance(trial, result.merit, result.grad)
        assert (rows.value[rows.done] < 1e-12).all()
    assert rows.done.all()


def test_patience_ends_a_slow_descent():
    problem = problems.rosenbrock(10)
    hasty = descend(problem, starts(problem), 60, tolerance=0.9, patience=2)
    assert hasty.done.all()
    assert hasty.value.min() > 1e-8


def test_wrong_gradients_end_instead_of_going_on_for_ever():
    x = torch.full((1, 4), 0.5, dtype=torch.float64)
    rows = Bfgs.begin(x, 1.0, 0.0, 5)
    rows = rows.advance(x, x.new_ones(1), torch.ones_like(x))
    trials = 0
    while not rows.done and trials < 100:
        rows = rows.advance(rows.trial(), x.new_full((1,), 2.0), torch.ones_like(x))
        trials += 1
    assert trials == BACKTRACKS + 1
    assert torch.equal(rows.x, x)


def test_float32_gets_as_far_as_its_digits():
    problem = problems.ellipsoid(10, 100.0)
    rows = descend(problem, starts(problem).float(), 80)
    assert rows.x.dtype == rows.value.dtype == torch.float32
    assert rows.value.max() < 1e-4


def test_rows_can_be_taken_out_and_put_together():
    rows = Bfgs.begin(torch.rand(5, 3, dtype=torch.float64), 1.0, 0.0, 5)
    again = joined(taken(rows, torch.tensor([0, 3])), taken(rows, torch.tensor([1, 2, 4])))
    assert torch.equal(again.x, rows.x[[0, 3, 1, 2, 4]])
    assert again.patience == 5
    assert joined(rows, rows._replace(patience=9)).patience == 5


def bowl(genes=4, seed=0):
    """A quadratic: its matrix, positive definite, and its centre in the middle of the box."""
    root = torch.randn(genes, genes, generator=torch.Generator().manual_seed(seed), dtype=torch.float64)
    return root @ root.T + torch.eye(genes, dtype=torch.float64), torch.full((genes,), 0.5, dtype=torch.float64)


def test_the_first_step_goes_down_the_gradient_as_far_as_reach_says():
    x = torch.full((1, 4), 0.5, dtype=torch.float64)
    gradient = torch.tensor([[0.3, -0.1, 0.2, 0.4]], dtype=torch.float64)
    rows = Bfgs.begin(x, 0.2, 0.0, 5).advance(x, x.new_ones(1), gradient)
    step = rows.trial() - x
    torch.testing.assert_close(step / step.norm(), -gradient / gradient.norm())
    assert float(step.square().mean().sqrt()) == pytest.approx(0.2)
    assert torch.equal(rows.gradient, gradient)
    assert (int(rows.age), int(rows.misses), int(rows.idle), bool(rows.done)) == (0, 0, 0, False)


@pytest.mark.parametrize("curvature", [1.0, 0.01, -1.0])
def test_an_update_is_the_damped_one_of_powell(curvature):
    """After one step: Nocedal and Wright, Numerical Optimization (2006), procedure 18.2."""
    matrix, _ = bowl()
    matrix = curvature * matrix
    x = torch.full((1, 4), 0.5, dtype=torch.float64)
    gradient = torch.tensor([[0.3, -0.1, 0.2, 0.4]], dtype=torch.float64)
    rows = Bfgs.begin(x, 0.02, 0.0, 5).advance(x, x.new_ones(1), gradient)
    before = rows.hessian[0]
    trial = rows.trial()
    s = (trial - x)[0]
    y = matrix @ s
    rows = rows.advance(trial, x.new_zeros(1), gradient + y)
    expected = s @ before @ s
    theta = 1.0 if s @ y >= 0.2 * expected else 0.8 * expected / (expected - s @ y)
    assert (theta == 1.0) == (curvature == 1.0)
    r = theta * y + (1.0 - theta) * before @ s
    known = before @ s
    wanted = before - torch.outer(known, known) / expected + torch.outer(r, r) / (s @ r)
    torch.testing.assert_close(rows.hessian[0], wanted, rtol=1e-9, atol=1e-9)
    # The new model knows the step: H s = r.
    torch.testing.assert_close(rows.hessian[0] @ s, r, rtol=1e-9, atol=1e-9)
    assert POWELL == 0.2
    assert int(rows.age) == 1


@pytest.mark.parametrize(
    ("value", "factor"), [(1.5, 0.25), (math.inf, 0.25), (1.05, 0.25 / 0.55), (0.99999, 0.5), (9.0, 0.1)]
)
def test_a_step_that_does_not_fall_is_shortened_to_the_bottom_of_a_parabola(value, factor):
    x = torch.full((1, 2), 0.5, dtype=torch.float64)
    gradient = torch.tensor([[1.0, 0.0]], dtype=torch.float64)
    rows = Bfgs.begin(x, 0.5 / math.sqrt(2.0), 0.0, 5).advance(x, x.new_ones(1), gradient)
    first = rows.trial()
    # Slope -1/2 along the whole step; the parabola through 1 and `value` has its bottom at 1/4 / (rise + 1/2).
    assert float((first - x)[0, 0]) == pytest.approx(-0.5)
    rows = rows.advance(first, x.new_full((1,), value), torch.zeros_like(x))
    assert float(rows.step) == pytest.approx(factor)
    assert int(rows.misses) == 1
    assert torch.equal(rows.x, x)
    assert float(rows.value) == 1.0
    torch.testing.assert_close(rows.trial(), x + factor * (first - x))


@pytest.mark.parametrize(("share", "taken"), [(0.9, False), (1.1, True)])
def test_a_step_must_bring_its_share_of_the_promised_fall(share, taken):
    x = torch.full((1, 2), 0.5, dtype=torch.float64)
    rows = Bfgs.begin(x, 0.5 / math.sqrt(2.0), 0.0, 5).advance(x, x.new_ones(1), torch.eye(2, dtype=torch.float64)[:1])
    trial = rows.trial()
    rows = rows.advance(trial, x.new_full((1,), 1.0 - share * ARMIJO * 0.5), torch.eye(2, dtype=torch.float64)[:1])
    assert torch.equal(rows.x, trial) == taken


def test_a_step_ends_in_the_lowest_point_of_the_model_within_the_box():
    """Against another solver, with centres of the model in and far out of the box."""
    random = torch.rand(12, 4, generator=torch.Generator().manual_seed(3), dtype=torch.float64)
    for seed, start in enumerate(random):
        matrix, _ = bowl(seed=seed)
        centre = 3.0 * torch.rand(4, generator=torch.Generator().manual_seed(50 + seed), dtype=torch.float64) - 1.0

        def f(x, matrix=matrix, centre=centre):
            away = torch.from_numpy(x) - centre
            return float(0.5 * away @ matrix @ away), (matrix @ away).numpy()

        x = start[None]
        value, gradient = f(start.numpy())
        rows = Bfgs.begin(x, 1.0, 0.0, 5).advance(x, x.new_full((1,), value), torch.from_numpy(gradient)[None])
        # One more accepted step, so that the direction is taken anew from the true curvature.
        trial = rows.trial()
        value, gradient = f(trial[0].numpy())
        if not value < float(rows.value):
            continue
        rows = rows._replace(hessian=matrix[None])
        known = rows.advance(trial, x.new_full((1,), value), torch.from_numpy(gradient)[None])
        best = minimize(f, [0.5] * 4, jac=True, bounds=[(0, 1)] * 4, method="L-BFGS-B", options={"ftol": 1e-15})
        # The update of a model that is right already changes nothing.
        torch.testing.assert_close(known.hessian[0], matrix, rtol=1e-8, atol=1e-8)
        torch.testing.assert_close(known.trial()[0], torch.from_numpy(best.x), rtol=0.0, atol=1e-5)


def test_idle_steps_are_counted_in_a_row():
    x = torch.full((1, 2), 0.5, dtype=torch.float64)
    rows = Bfgs.begin(x, 1e-5, 0.1, 3)
    counts = []
    # Falls of 5, 50, 5, 5, 5 per cent, at gradients that always lead on.
    for value in (100.0, 95.0, 47.0, 45.0, 43.0, 41.0):
        rows = rows.advance(rows.trial(), x.new_full((1,), value), torch.full_like(x, 1.0))
        counts.append((int(rows.idle), bool(rows.done)))
    assert counts == [(0, False), (1, False), (0, False), (1, False), (2, False), (3, True)]
