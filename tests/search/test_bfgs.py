"""Quasi-Newton descent in the box."""

import math

import pytest
import torch
from scipy.optimize import minimize

from hopdiff.search.bfgs import Bfgs
from hopdiff.search.descent import joined, taken
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
    assert 10 < trials < 100
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
