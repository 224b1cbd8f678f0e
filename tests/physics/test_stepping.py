"""The thesis' stepping against the smooth solution of the same equations."""

from __future__ import annotations

import math

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from torch import Tensor

from hopdiff.numerics import GRAVITY
from hopdiff.physics.hopper import Cycle, solve_cycle
from hopdiff.physics.stepping import Hops, flight_blend, step_balance, step_hopper


def column(*values: float) -> Tensor:
    return torch.tensor(values, dtype=torch.float64)


def running() -> Cycle:
    """Hops at 3, 5 and 8 m/s."""
    return solve_cycle(
        column(0.9, 0.88, 0.88), column(0.38, 0.46, 0.5), column(3.0, 5.0, 8.0), flight_time=column(0.09, 0.12, 0.14)
    )


def step(cycle: Cycle, h: float, hops: int = 1, frames: int = 100_000) -> Hops:
    return step_hopper(
        cycle.leg_length,
        cycle.touchdown_angle,
        cycle.speed,
        cycle.stiffness,
        cycle.touchdown_rate,
        h,
        hops,
        frames,
    )


def stance_error(cycle: Cycle, h: float) -> Tensor:
    """Largest height error over the stance frames (P,) [m]."""
    hops = step(cycle, h)
    standing = hops.alive & ~hops.in_flight
    times = torch.arange(hops.height.shape[-1], dtype=torch.float64) * h
    phase = (times / cycle.contact_time.unsqueeze(-1)).clamp(max=1.0)
    return ((hops.height - cycle.stance_height(phase)).abs() * standing).amax(-1)


def test_stance_converges_to_the_smooth_one_with_the_order_of_the_integrator() -> None:
    cycle = running()
    errors = torch.stack([stance_error(cycle, h) for h in (4e-3, 2e-3, 1e-3, 5e-4)])
    order = torch.log2(errors[:-1] / errors[1:])
    assert float((order[1:] - 2.0).abs().max()) < 0.15
    assert float(errors[-1].max()) < 2e-5


def test_contact_time_is_right_to_one_frame() -> None:
    cycle = running()
    for h in (5e-3, 1e-3, 2e-4):
        hops = step(cycle, h)
        contact = (hops.alive & ~hops.in_flight).sum(-1) * h
        assert float((contact - cycle.contact_time).abs().max()) <= 1.5 * h


def test_flight_converges_too() -> None:
    cycle = running()
    errors = []
    for h in (2e-3, 5e-4, 1.25e-4):
        hops = step(cycle, h)
        errors.append(float((hops.flight.amax(-1) - cycle.flight_time).abs().max()))
    # Take-off falls on a frame, so that flight is right to first order only.
    assert errors[0] < 6 * 2e-3
    assert errors[2] < errors[0] / 8.0


def test_figure_3_4_of_the_thesis_is_a_cycle() -> None:
    cycle = solve_cycle(column(2.0), column(math.pi / 4), column(10.0), stiffness=column(60.0))
    hops = step(cycle, 0.005, hops=3)
    heights = hops.height[0, hops.alive[0]]
    first = [float(hops.height[0, hops.alive[0] & (hops.hop[0] == k)].max()) for k in range(3)]
    assert first == pytest.approx([first[0]] * 3, rel=0.05)
    assert float(heights.min()) > 0.5
    stance = (hops.alive & ~hops.in_flight & (hops.hop == 0)).sum() * 0.005
    assert float(stance) == pytest.approx(0.283, abs=0.006)
    assert float(hops.flight[0, hops.hop[0] == 0].max()) == pytest.approx(0.576, abs=0.03)


def test_feet_are_planted_and_hip_keeps_its_pace() -> None:
    hops = step(running(), 2e-3, hops=3)
    speed = column(3.0, 5.0, 8.0)
    for p in range(3):
        alive = hops.alive[p]
        travel = hops.forward[p, alive].diff()
        torch.testing.assert_close(travel, torch.full_like(travel, float(speed[p]) * 2e-3))
        for k in range(3):
            assert hops.foot[p, alive & (hops.hop[p] == k)].unique().numel() == 1
        assert (hops.foot[p, alive].diff() >= 0).all()


def test_flight_frames_lie_on_one_parabola() -> None:
    hops = step(running(), 2e-3)
    for p in range(3):
        heights = hops.height[p, hops.in_flight[p] & hops.alive[p]]
        torch.testing.assert_close(
            heights.diff().diff(), torch.full_like(heights[2:], -GRAVITY * 4e-6), atol=1e-12, rtol=0
        )


def test_a_hopper_that_falls_stops_and_its_neighbour_does_not() -> None:
    cycle = running()
    limp = cycle._replace(stiffness=cycle.stiffness * column(1.0, 0.01, 1.0))
    hops, whole = step(limp, 2e-3), step(cycle, 2e-3)
    assert int(hops.hop[1].max()) == 0
    assert not bool(hops.alive[1, -1])
    assert torch.isfinite(hops.height).all()
    for p in (0, 2):
        n = int(whole.alive[p].sum())
        assert torch.equal(hops.height[p, :n], whole.height[p, :n])


def test_frames_are_limited() -> None:
    assert step(running(), 1e-3, hops=50, frames=20).height.shape == (3, 20)


@given(st.floats(0.51, 0.999))
def test_blend_runs_from_0_to_1_with_its_extremum_at_alpha(alpha: float) -> None:
    shares = torch.linspace(0.0, 1.0, 1001, dtype=torch.float64).unsqueeze(0)
    blend = flight_blend(shares, column(alpha))[0]
    assert float(blend[0]) == 0.0
    assert float(blend[-1]) == pytest.approx(1.0, abs=1e-9)
    peak = float(flight_blend(column(alpha).unsqueeze(0), column(alpha)))
    assert peak == pytest.approx(alpha**2 / (2.0 * alpha - 1.0), rel=1e-9)
    assert float(blend.max()) <= peak + 1e-9


@pytest.mark.parametrize("h", [0.01, 0.001])
def test_balance_settles_at_the_rate_of_the_continuous_law(h: float) -> None:
    """Equation (10) keeps dZ/dt = delta / v once its own part, which lives for a few frames, has died away."""
    speed, error = column(5.0), column(0.03)
    angles = [column(0.0)] * 3
    for _ in range(60):
        angles.append(step_balance((angles[-1], angles[-2], angles[-3]), error, h, speed))
    rate = (angles[-1] - angles[-2]) / h
    assert float(rate) == pytest.approx(0.03 / 5.0, rel=1e-6)


def test_balance_forgets_its_own_shake_within_frames() -> None:
    """The roots (1 +- i) / 2: halved in square every frame, whatever the frame interval is."""
    angles = [column(0.0), column(0.0), column(0.1)]
    for _ in range(40):
        angles.append(step_balance((angles[-1], angles[-2], angles[-3]), column(0.0), 0.01, column(5.0)))
    shake = (torch.cat(angles[2:]).diff()).abs()
    envelope = 0.5 ** (torch.arange(len(shake)) / 2.0)
    assert (shake <= 0.2 * envelope + 1e-15).all()


def test_phases_run_from_0_to_1() -> None:
    """A stance overshoots its end by up to a frame: the phase stays at 1 there, however long the frame."""
    hops = step(running(), 0.02, hops=2)
    for p in range(3):
        phase, standing = hops.phase[p, hops.alive[p]], ~hops.in_flight[p, hops.alive[p]]
        assert float(phase[0]) == 0.0
        assert float(phase.min()) >= 0.0
        assert float(phase[standing].max()) <= 1.0
        assert float(phase[standing].max()) > 0.85


def test_a_landing_carries_the_rate_of_the_flight_to_second_order() -> None:
    """The first frame after it: h v - g h^2 / 2 lower, while the spring is as long as at rest."""
    h = 0.01
    hops = step(running(), h, hops=2)
    for p in range(3):
        flying = torch.nonzero(hops.in_flight[p] & (hops.hop[p] == 0)).flatten()
        first, landed = int(flying[0]), int(flying[-1]) + 1
        height = hops.height[p]
        rate = float(height[first + 1] - height[first]) / h + 0.5 * GRAVITY * h
        fallen = -math.sqrt(rate**2 + 2.0 * GRAVITY * float(height[first] - height[landed]))
        assert float(height[landed + 1] - height[landed]) == pytest.approx(h * fallen - 0.5 * GRAVITY * h**2, abs=1e-6)
