"""Numbers in the air made smooth: against a dense solution, and what must stay."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch

from hopdiff.feet.easing import calmed, jerk, smoothest

FRAME = 1.0 / 120.0


def test_smoothest_is_the_least_of_the_two_sums_of_squares() -> None:
    chance = torch.Generator().manual_seed(3)
    wanted = torch.randn(17, 2, dtype=torch.float64, generator=chance)
    weight = 0.1 + torch.rand(17, dtype=torch.float64, generator=chance)
    fixed = torch.zeros(17, dtype=torch.bool)
    fixed[[0, 1, 7, 16]] = True
    found = smoothest(wanted, fixed, 2.5, weight).numpy()
    assert np.array_equal(found[fixed], wanted[fixed].numpy())
    free = ~fixed.numpy()
    rows = np.concatenate((2.5**3 * np.diff(np.eye(17), 3, axis=0), np.diag(np.sqrt(weight.numpy()))))
    sides = np.concatenate((np.zeros((14, 2)), np.sqrt(weight.numpy())[:, None] * wanted.numpy()))
    best = np.linalg.lstsq(rows[:, free], sides - rows[:, ~free] @ found[~free], rcond=None)[0]
    assert np.abs(found[free] - best).max() < 1e-9


@pytest.mark.parametrize("count", [1, 2, 3, 4, 5])
def test_few_numbers_have_no_jerk_or_a_finite_one(count: int) -> None:
    values = torch.arange(count, dtype=torch.float64)[:, None] ** 2
    assert torch.isfinite(jerk(values, FRAME)).all()
    free = torch.zeros(count, dtype=torch.bool)
    none = torch.zeros(count, dtype=torch.float64)
    found = calmed(values, torch.zeros_like(values), free, none, torch.tensor([1.0, 1.0]).double(), FRAME)
    assert torch.isfinite(found).all()


def test_jerk_is_the_third_derivative() -> None:
    times = FRAME * torch.arange(60, dtype=torch.float64)
    found = jerk((7.0 * times**3)[:, None], FRAME)
    assert (found[:, 0] - 42.0).abs().max() < 1e-5
    assert found[30, 1] == pytest.approx(42.0, abs=1e-5)


def corner() -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    """A swing with a corner in what was added to it, 25 frames of it free; the same without; and which are fixed."""
    times = FRAME * torch.arange(80, dtype=torch.float64)
    base = torch.sin(2.0 * math.pi * times)[:, None]
    added = 0.3 * (times - times[40]).clamp_min(0.0)[:, None]
    fixed = torch.ones(80, dtype=torch.bool)
    fixed[28:53] = False
    return base + added, base, fixed


def test_a_corner_is_made_even_where_that_is_free_and_nowhere_else() -> None:
    values, base, fixed = corner()
    most = 1.5 * jerk(base, FRAME).amax(0)
    found = calmed(values, base, fixed, torch.zeros(80, dtype=torch.float64), most, FRAME)
    assert torch.equal(found[fixed], values[fixed])
    assert (jerk(values, FRAME)[40] > 4.0 * most).any()
    assert (jerk(found, FRAME)[~fixed] < 1.01 * most).all()
    assert (found - values).abs().max() < 0.01


def test_what_has_no_more_jerk_than_it_may_stays_to_the_last_digit() -> None:
    values, base, fixed = corner()
    found = calmed(values, base, fixed, torch.zeros(80, dtype=torch.float64), 10.0 * jerk(values, FRAME).amax(0), FRAME)
    assert torch.equal(found, values)


def test_it_does_not_get_below_a_floor() -> None:
    values, base, fixed = corner()
    # A corner downwards: evened alone it would cut below it.
    values, base = -values, -base
    still = torch.zeros(80, dtype=torch.float64)
    most = 1.5 * jerk(base, FRAME).amax(0)
    without = calmed(values, base, fixed, still, most, FRAME)
    assert float((values - without).max()) > 1e-3
    found = calmed(values, base, fixed, still, most, FRAME, values)
    assert float((values - found).max()) <= 0.0
    assert (jerk(found, FRAME)[~fixed] < jerk(values, FRAME)[40].max()).all()
