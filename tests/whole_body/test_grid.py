"""Calculus on phases of different durations, against polynomials whose derivatives and integrals are known."""

from __future__ import annotations

import math

import pytest
import torch
from numpy.polynomial import Polynomial
from torch import Tensor

from hopdiff.whole_body.grid import Grid

DTYPE = torch.float64
NODES = (6, 5, 9)
DURATIONS = torch.tensor([[0.3, 0.12, 0.5], [0.05, 0.9, 0.21]], dtype=DTYPE)
CURVE = Polynomial([0.4, -1.3, 2.0, 0.7, -0.6])  # as high as the phase of five nodes can hold


def grid() -> Grid:
    return Grid(NODES, DURATIONS)


def at(curve: Polynomial, times: Tensor) -> Tensor:
    return torch.from_numpy(curve(times.numpy()))


def channels(curve: Polynomial, times: Tensor) -> Tensor:
    """(P, 2, 3, T): the curve times 1 to 6."""
    factors = torch.arange(1.0, 7.0, dtype=DTYPE).reshape(2, 3)
    return at(curve, times)[:, None, None] * factors[:, :, None]


def test_times_run_through_the_phases() -> None:
    g = grid()
    assert g.size == 20
    torch.testing.assert_close(g.total, torch.tensor([0.92, 1.16], dtype=DTYPE))
    for phase in range(3):
        here = g.times[:, g.slice(phase)]
        torch.testing.assert_close(here[:, 0], DURATIONS[:, :phase].sum(1))
        torch.testing.assert_close(here[:, -1], DURATIONS[:, : phase + 1].sum(1))
        assert bool((here.diff(dim=-1) > 0).all())
        torch.testing.assert_close(g.spans[:, g.slice(phase)], DURATIONS[:, phase, None].expand_as(here))


def test_derivative_and_running_integral_are_exact_on_polynomials() -> None:
    g = grid()
    values = channels(CURVE, g.times)
    torch.testing.assert_close(g.derivative(values), channels(CURVE.deriv(), g.times), atol=1e-11, rtol=0.0)
    torch.testing.assert_close(g.integral(values), channels(CURVE.integ(), g.times), atol=1e-13, rtol=0.0)


def test_total_and_mean_are_exact_on_polynomials() -> None:
    g = grid()
    values = channels(CURVE, g.times)
    whole = channels(CURVE.integ(), g.total.unsqueeze(-1))[..., 0]
    torch.testing.assert_close(g.total_of(values), whole, atol=1e-13, rtol=0.0)
    torch.testing.assert_close(g.mean_of(values), whole / g.total[:, None, None], atol=1e-13, rtol=0.0)
    torch.testing.assert_close((at(CURVE, g.times) * g.weights).sum(-1), whole[:, 0, 0], atol=1e-13, rtol=0.0)


def test_each_phase_has_its_own_polynomial() -> None:
    """A curve with corners: rates at the end of a phase are those of its own side."""
    g = grid()
    slopes = torch.tensor([2.0, -3.0, 0.5], dtype=DTYPE)
    own = torch.repeat_interleave(slopes, torch.tensor(NODES)).expand_as(g.times)
    values = g.integral(own)
    torch.testing.assert_close(values[:, g.slice(0).stop - 1], values[:, g.slice(1).start])
    torch.testing.assert_close(values[:, -1], (DURATIONS * slopes).sum(-1))
    torch.testing.assert_close(g.derivative(values), own, atol=1e-11, rtol=0.0)


def test_samples_lie_on_the_curve_and_end_where_it_ends() -> None:
    g = grid()
    ends = torch.cumsum(DURATIONS, dim=1)
    inside = torch.rand(2, 40, generator=torch.Generator().manual_seed(1), dtype=DTYPE) * g.total.unsqueeze(-1)
    for times in (inside, ends, torch.zeros(2, 1, dtype=DTYPE), g.times):
        found = g.sample(channels(CURVE, g.times).flatten(1, 2), times)
        torch.testing.assert_close(found, channels(CURVE, times).flatten(1, 2), atol=1e-11, rtol=0.0)
    beyond = g.sample(at(CURVE, g.times).unsqueeze(1), torch.tensor([[-1.0, 9.0]] * 2, dtype=DTYPE))
    torch.testing.assert_close(beyond[:, 0], at(CURVE, torch.stack((0.0 * g.total, g.total), dim=-1)))


def test_a_jump_is_seen_after_the_end_of_its_phase() -> None:
    g = grid()
    steps = torch.repeat_interleave(torch.tensor([1.0, 2.0, 3.0], dtype=DTYPE), torch.tensor(NODES))
    end = DURATIONS[:, :1]
    times = torch.cat((end - 1e-9, end, end + 1e-9), dim=-1)
    found = g.sample(steps.expand(2, 1, -1), times)[:, 0]
    torch.testing.assert_close(found, torch.tensor([[1.0, 1.0, 2.0]] * 2, dtype=DTYPE))


@pytest.mark.parametrize("which", [0, 1])
def test_candidates_do_not_mix(which: int) -> None:
    both, alone = grid(), Grid(NODES, DURATIONS[which : which + 1])
    values = torch.rand(2, 3, both.size, generator=torch.Generator().manual_seed(2), dtype=DTYPE)
    own = values[which : which + 1]
    for name in ("derivative", "integral", "total_of", "mean_of"):
        torch.testing.assert_close(getattr(both, name)(values)[which], getattr(alone, name)(own)[0])
    times = torch.rand(2, 7, generator=torch.Generator().manual_seed(3), dtype=DTYPE)
    torch.testing.assert_close(
        both.sample(values, times)[which], alone.sample(own, times[which : which + 1])[0], atol=1e-13, rtol=0.0
    )


def wave(grid: Grid, order: float) -> Tensor:
    """(1, 2, M) a wave over the time of a grid, and the same a little higher."""
    phase = 2.0 * math.pi * order * grid.times / grid.total
    return torch.stack((torch.sin(phase + 0.3), torch.sin(phase + 0.3) + 0.4), dim=1)


@pytest.mark.parametrize("width", [1e-6, 1e-2, 0.5])
def test_the_two_parts_of_a_curve_are_integrated_past_its_kinks(width: float) -> None:
    """Against a million even moments, for kinks much sharper than the nodes are dense, and for round ones."""
    grid = Grid((33, 19), torch.tensor([[0.3, 0.2]], dtype=DTYPE))
    found = torch.stack(grid.fine.signed(grid.finer(wave(grid, 2.0)), width))[:, 0]
    times = torch.linspace(0.0, 0.5, 1_000_001, dtype=DTYPE)
    angle = 2.0 * math.pi * 2.0 * times / 0.5 + 0.3
    curves = torch.stack((torch.sin(angle), torch.sin(angle) + 0.4))
    parts = [0.5 * (sign * curves + torch.sqrt(curves**2 + width**2) - width) for sign in (1.0, -1.0)]
    wanted = torch.stack([torch.trapezoid(part, times) for part in parts])
    torch.testing.assert_close(found, wanted, rtol=3e-4, atol=3e-6)
    # A sum over the same nodes is far worse where the kinks are sharp.
    if width < 1e-3:
        plain = (grid.fine.weights * grid.finer(wave(grid, 2.0)).clamp_min(0.0)).sum(-1)[0]
        assert float((plain - wanted[0]).abs().max()) > 3.0 * float((found - wanted).abs().max())


def test_kinks_cost_the_third_power_of_the_distance_between_nodes() -> None:
    errors = []
    for nodes in ((25, 25), (49, 49)):
        grid = Grid(nodes, torch.tensor([[0.25, 0.25]], dtype=DTYPE))
        (positive, _) = grid.fine.signed(grid.finer(wave(grid, 1.7)), 1e-9)
        times = torch.linspace(0.0, 0.5, 2_000_001, dtype=DTYPE)
        angle = 2.0 * math.pi * 1.7 * times / 0.5 + 0.3
        curves = torch.stack((torch.sin(angle), torch.sin(angle) + 0.4)).clamp_min(0.0)
        errors.append(float((positive[0] - torch.trapezoid(curves, times)).abs().max()))
    assert errors[1] < errors[0] / 4.0


def test_parts_have_gradients_without_jumps() -> None:
    """Also of a curve that is nothing at all, and of one that just touches nothing."""
    grid = Grid((17, 9), torch.tensor([[0.3, 0.2]], dtype=DTYPE))
    rest = torch.zeros(1, 1, grid.fine.size, dtype=DTYPE)

    def gradient(shift: float) -> Tensor:
        values = (rest + shift).requires_grad_()
        (found,) = torch.autograd.grad(grid.fine.signed(values, 0.1)[0].sum(), values)
        return found

    middle = gradient(0.0)
    assert bool(middle.isfinite().all())
    torch.testing.assert_close(gradient(1e-6), middle, rtol=0.0, atol=1e-6)
    torch.testing.assert_close(middle.sum(), 0.5 * grid.total[0], rtol=1e-6, atol=0.0)
