"""Levenberg-Marquardt descent in the box."""

import math

import pytest
import torch

from hopdiff.search.bfgs import Bfgs
from hopdiff.search.lm import LEAST_DAMPING, MISSES, OFTEN, Lm, Looks
from tests.search import problems


def descend(problem, x, batches, tolerance=0.0, patience=5):
    rows = Lm.begin(x, tolerance, patience)
    for _ in range(batches):
        rows = step(problem, rows)
    return rows


def step(problem, rows):
    """Another look of the rows that want one, or else a trial of all."""
    index = rows.stale.nonzero()[:, 0]
    if len(index):
        return rows.informed(index, problem.residuals(rows.probes(index)))
    trial = rows.trial()
    result = problem.evaluate(trial, True)
    return rows.advance(trial, result.merit, result.grad)


def starts(problem, rows=4, seed=0):
    generator = torch.Generator().manual_seed(seed)
    return torch.rand(rows, problem.dimension, generator=generator, dtype=torch.float64)


@pytest.mark.parametrize(
    ("make", "batches"), [(problems.squares, 12), (problems.rosenbrock_squares, 120), (problems.bound_squares, 30)]
)
def test_every_start_converges(make, batches):
    problem = make()
    rows = descend(problem, starts(problem), batches)
    least = float(rows.value.min())
    assert rows.value.tolist() == pytest.approx([least] * 4, rel=1e-6, abs=1e-10)
    if make is problems.bound_squares:
        assert int(((rows.x == 0) | (rows.x == 1)).sum(1).min()) > 0
        other = Bfgs.begin(starts(problem), 1.0, 0.0, 5)
        for _ in range(200):
            result = problem.evaluate(other.trial(), True)
            other = other.advance(other.trial(), result.merit, result.grad)
        assert least == pytest.approx(float(other.value.min()), rel=1e-9)
    else:
        assert least < 1e-10


def test_one_look_tells_all_of_a_sum_of_linear_squares():
    """The model is the matrix of the sum, whatever the start and however the nudges had to turn at a bound."""
    problem = problems.bound_squares(6, 100.0)
    x = torch.cat((starts(problem, 2), torch.ones(1, 6, dtype=torch.float64)))
    rows = step(problem, Lm.begin(x, 0.0, 5))
    assert rows.stale.tolist() == [True] * 3
    rows = step(problem, rows)
    axes = problems.rotation(6)
    wanted = 2.0 * (axes * torch.logspace(0, 2, 6, dtype=torch.float64)) @ axes.T
    torch.testing.assert_close(rows.model, wanted.expand(3, -1, -1), rtol=1e-6, atol=1e-6)
    assert rows.age.tolist() == [0] * 3
    assert not rows.stale.any()


def test_probes_stay_in_the_box_and_nudge_a_gene_each():
    x = torch.tensor([[0.2, 1.0, 0.0], [0.5, 0.5, 0.99999]], dtype=torch.float64)
    rows = Lm.begin(x, 0.0, 5)
    probes = rows.probes(torch.tensor([1])).view(4, 3)
    assert torch.equal(probes[0], x[1])
    probes = rows.probes(torch.tensor([0, 1])).view(2, 4, 3)
    assert probes.min() >= 0
    assert probes.max() <= 1
    assert torch.equal((probes[:, 1:] != x[:, None]), torch.eye(3).bool().expand(2, 3, 3))


def test_a_gene_whose_nudge_has_no_value_tells_nothing():
    problem = problems.squares(3)
    x = torch.full((1, 3), 0.5, dtype=torch.float64)
    rows = step(problem, Lm.begin(x, 0.0, 5))
    index = torch.tensor([0])
    result = problem.residuals(rows.probes(index))
    merit = result.merit.clone()
    merit[2] = math.inf
    rows = rows.informed(index, result._replace(merit=merit))
    torch.testing.assert_close(rows.model[0].diagonal(), torch.tensor([2.0, 0.0, 2.0], dtype=torch.float64))
    assert rows.direction.isfinite().all()


def test_accepted_values_only_fall_and_trials_stay_in_the_box():
    problem = problems.rosenbrock_squares(6)
    rows = Lm.begin(starts(problem, 16), 0.0, 5)
    last = rows.value
    for _ in range(60):
        assert rows.trial().min() >= 0
        assert rows.trial().max() <= 1
        rows = step(problem, rows)
        assert (rows.value <= last).all()
        last = rows.value


def test_a_row_goes_its_way_whatever_its_neighbours_do():
    """Trials wait for looks of others, so that only the number of steps tells them apart."""
    problem = problems.rosenbrock_squares(6)
    x = starts(problem, 5)

    def path(rows, row):
        """The values of a row after each of its trials."""
        found = []
        while len(found) < 15:
            trying = not rows.stale.any()
            rows = step(problem, rows)
            if trying:
                found.append(float(rows.value[row]))
        return found

    together, alone = path(Lm.begin(x, 0.0, 99), 2), path(Lm.begin(x[2:3], 0.0, 99), 0)
    assert together == pytest.approx(alone, rel=1e-6)


def test_a_start_without_value_is_done_at_once():
    x = torch.full((2, 3), 0.5, dtype=torch.float64)
    rows = Lm.begin(x, 0.0, 5).advance(x, torch.tensor([math.inf, 1.0], dtype=torch.float64), torch.ones_like(x))
    assert rows.done.tolist() == [True, False]
    assert rows.stale.tolist() == [False, True]


def test_done_at_a_minimum():
    problem = problems.bound_squares(6)
    rows = descend(problem, starts(problem), 60)
    assert rows.done.all()


def test_patience_ends_a_slow_descent():
    problem = problems.rosenbrock_squares(10)
    hasty = descend(problem, starts(problem), 60, tolerance=0.9, patience=2)
    assert hasty.done.all()
    assert hasty.value.min() > 1e-8


def test_wrong_gradients_end_instead_of_going_on_for_ever():
    problem = problems.squares(4)
    x = torch.full((1, 4), 0.5, dtype=torch.float64)
    rows = step(problem, Lm.begin(x, 0.0, 5).advance(x, x.new_ones(1), torch.ones_like(x)))
    trials = 0
    while not rows.done and trials < 100:
        rows = rows.advance(rows.trial(), x.new_full((1,), 2.0), torch.ones_like(x))
        trials += 1
    assert trials <= MISSES + 1
    assert torch.equal(rows.x, x)


@pytest.mark.parametrize(("kept", "factor"), [(0.9, 0.2), (0.7, 0.6), (0.3, 1.0), (0.1, 3.0), (-0.1, 4.0)], ids=str)
def test_the_damping_follows_how_much_of_the_promise_was_kept(kept, factor):
    problem = problems.squares(3)
    x = torch.full((1, 3), 0.4, dtype=torch.float64)
    rows = step(problem, step(problem, Lm.begin(x, 0.0, 5)))
    moved = rows.trial() - x
    promised = -(moved * rows.gradient).sum() - (moved.square()).sum()
    value = rows.value - kept * promised
    after = rows.advance(rows.trial(), value, rows.gradient)
    assert float(after.damping / rows.damping) == pytest.approx(factor)
    assert bool(after.stale) == (0 < kept < 0.5)
    if kept < 0:
        again = after.advance(after.trial(), value, rows.gradient)
        assert float(again.damping / after.damping) == pytest.approx(8.0)


def test_a_look_serves_a_few_steps_and_a_failed_trial_calls_for_the_next():
    problem = problems.rosenbrock_squares(4)
    rows = Lm.begin(starts(problem, 1), 0.0, 99)
    story = []
    for _ in range(60):
        looked = bool(rows.stale)
        before, rows = rows, step(problem, rows)
        if not looked and before.age > 0:
            failed = torch.equal(rows.x, before.x)
            assert rows.done or bool(rows.stale) >= failed
            story.append(int(before.age))
    assert max(story) == OFTEN.steps - 1


def looks_of(looks, problem, x, batches):
    """What led to every look but the first: steps since the last one, and failed trials in a row."""
    rows, found = Lm.begin(x, 0.0, 99, looks), []
    for _ in range(batches):
        if bool(rows.stale) and rows.age > 0:
            found.append((int(rows.age), int(rows.misses)))
        rows = step(problem, rows)
    return rows, found


def test_seldom_looks_come_after_many_steps_or_several_failed_trials():
    problem = problems.rosenbrock_squares(8)
    x = starts(problem, 1)
    rows, found = looks_of(Looks(12, 0.0, 3), problem, x, 90)
    assert rows.value < 1e-10
    assert all(age == 12 or misses >= 3 for age, misses in found)
    assert {age == 12 for age, _ in found} == {True, False}
    assert len(found) < len(looks_of(OFTEN, problem, x, 90)[1])


def test_a_row_that_cannot_move_looks_before_it_gives_up():
    """A model that is old may point out of the box for no reason."""
    problem = problems.squares(3)
    rows = Lm.begin(starts(problem, 1), 0.0, 99, Looks(20, 0.0, 3))
    rows = step(problem, step(problem, rows))._replace(age=torch.tensor([4]), direction=torch.zeros(1, 3).double())
    trial = rows.trial()
    result = problem.evaluate(trial, True)
    after = rows.advance(trial, result.merit, result.grad)
    assert after.stale.tolist() == [True]
    assert after.done.tolist() == [False]
    fresh = rows._replace(age=torch.tensor([0])).advance(trial, result.merit, result.grad)
    assert fresh.done.tolist() == [True]


def test_a_row_that_the_model_promises_nothing_keeps_a_little_damping():
    problem = problems.squares(3)
    x = problems.optimum(3)[None]
    rows = step(problem, step(problem, Lm.begin(x, 0.0, 5)))
    assert rows.done.all()
    assert rows.damping > LEAST_DAMPING
