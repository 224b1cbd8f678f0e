"""The hopper against the thesis' own numbers, closed forms, an independent integrator and finite differences."""

from __future__ import annotations

import math

import pytest
import torch
from scipy.integrate import solve_ivp
from torch import Tensor

from hopdiff.numerics import GRAVITY, chebyshev_nodes, integration_matrix
from hopdiff.physics.hopper import STANCE_NODES, flight_time, solve_cycle


def column(*values: float) -> Tensor:
    return torch.tensor(values, dtype=torch.float64)


def human(count: int, seed: int = 0) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """Leg lengths, touchdown angles, speeds and flight times of human size."""
    random = torch.rand(4, count, generator=torch.Generator().manual_seed(seed), dtype=torch.float64)
    speed = 2.0 + 8.0 * random[0]
    angle = torch.deg2rad(18.0 + 12.0 * random[1])
    length = 0.8 + 0.15 * random[2]
    contact = 2.0 * length * torch.sin(angle) / speed
    return length, angle, speed, contact * (0.3 + 1.2 * random[3])


def test_figure_3_4_of_the_thesis() -> None:
    cycle = solve_cycle(column(2.0), column(math.pi / 4), column(10.0), stiffness=column(3000.0 / 50.0))
    assert bool(cycle.converged)
    assert float(cycle.contact_time) == pytest.approx(0.283, abs=5e-4)
    assert float(cycle.flight_time) == pytest.approx(0.576, abs=5e-4)


def test_stiffness_and_flight_time_give_the_same_cycle() -> None:
    length, angle, speed, flight = human(200)
    forward = solve_cycle(length, angle, speed, flight_time=flight)
    back = solve_cycle(length, angle, speed, stiffness=forward.stiffness)
    assert bool(forward.converged.all())
    assert bool(back.converged.all())
    # A spring can hop in two ways: what was found is always one of them, and nearly always the one asked for.
    again = solve_cycle(length, angle, speed, flight_time=back.flight_time)
    torch.testing.assert_close(again.stiffness, forward.stiffness, rtol=1e-8, atol=0.0)
    same = (back.flight_time - flight).abs() < 1e-8 * flight
    assert float(same.double().mean()) >= 0.9
    torch.testing.assert_close(back.half_stance[same], forward.half_stance[same], rtol=1e-8, atol=0.0)


def test_an_independent_integrator_finds_the_same_stance() -> None:
    length, angle, speed, flight = human(5, seed=3)
    cycle = solve_cycle(length, angle, speed, flight_time=flight)
    for i in range(5):
        rest, k, v = float(length[i]), float(cycle.stiffness[i]), float(speed[i])

        def motion(
            t: float, y: list[float], rest: float = rest, k: float = k, v: float = v, a: float = float(angle[i])
        ):
            d = math.hypot(v * t - rest * math.sin(a), y[0])
            return [y[1], k * (rest - d) * y[0] / d - GRAVITY]

        start = [rest * math.cos(float(angle[i])), float(cycle.touchdown_rate[i])]
        contact = float(cycle.contact_time[i])
        found = solve_ivp(motion, (0.0, contact), start, rtol=1e-11, atol=1e-12, dense_output=True)
        phase = torch.linspace(0.0, 1.0, 21, dtype=torch.float64).expand(5, -1)
        heights = found.sol(contact * phase[i].numpy())
        torch.testing.assert_close(cycle.stance_height(phase)[i], torch.tensor(heights[0]), atol=1e-8, rtol=0.0)
        assert heights[1][-1] == pytest.approx(-start[1], abs=1e-7)


def test_the_spring_carries_the_body_on_average() -> None:
    """Over a stance the mean vertical force is the weight times (1 + flight / contact)."""
    length, angle, speed, flight = human(50)
    cycle = solve_cycle(length, angle, speed, flight_time=flight)
    phase = torch.linspace(0.0, 1.0, 2001, dtype=torch.float64).expand(50, -1)
    forward, height = cycle.stance_forward(phase), cycle.stance_height(phase)
    vertical = cycle.leg_force_bw(forward, height) * height / torch.hypot(forward, height)
    mean = torch.trapezoid(vertical, dx=1.0 / 2000.0)
    torch.testing.assert_close(mean, 1.0 + flight / cycle.contact_time, rtol=1e-5, atol=0.0)


def test_flight_is_ballistic_and_ends_at_touchdown_height() -> None:
    length, angle, speed, flight = human(20)
    cycle = solve_cycle(length, angle, speed, flight_time=flight)
    start = length * torch.cos(angle)
    torch.testing.assert_close(flight_time(start, -cycle.touchdown_rate, start), flight)
    heights = cycle.flight_height(column(0.0, 0.5, 1.0).expand(20, -1))
    torch.testing.assert_close(heights[:, 0], start)
    torch.testing.assert_close(heights[:, 2], start)
    torch.testing.assert_close(heights[:, 1] - start, GRAVITY * flight**2 / 8.0)


def test_a_height_that_is_never_reached_has_no_flight_time() -> None:
    assert torch.isnan(flight_time(column(1.0), column(0.1), column(2.0))).all()


def test_times_follow_their_arguments() -> None:
    """Gradients of the flight time and stiffness through the solution, against central differences."""
    length, angle, speed, flight = human(10)
    stiffness = solve_cycle(length, angle, speed, flight_time=flight).stiffness

    def times(*arguments: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        by_stiffness = solve_cycle(*arguments[:3], stiffness=arguments[3])
        by_flight = solve_cycle(*arguments[:3], flight_time=arguments[4])
        return by_stiffness.flight_time, by_stiffness.contact_time, by_flight.half_stance

    arguments = [x.clone().requires_grad_() for x in (length, angle, speed, stiffness, flight)]
    assert torch.autograd.gradcheck(times, arguments, eps=1e-6, atol=1e-5, rtol=1e-5)


def test_neighbours_do_not_matter() -> None:
    length, angle, speed, flight = human(8)
    together = solve_cycle(length, angle, speed, flight_time=flight)
    spoiled = [x.clone() for x in (length, angle, speed, flight)]
    spoiled[0][0], spoiled[3][1], spoiled[1][2] = math.nan, -5.0, 1.57
    beside = solve_cycle(*spoiled[:3], flight_time=spoiled[3])
    assert not bool(beside.converged[:2].any())
    for i in range(3, 8):
        alone = solve_cycle(*(x[i : i + 1] for x in (length, angle, speed)), flight_time=flight[i : i + 1])
        for other in (together, beside):
            torch.testing.assert_close(other.half_stance[i], alone.half_stance[0], rtol=0.0, atol=1e-12)


def test_one_of_the_two_must_be_given() -> None:
    with pytest.raises(ValueError, match="either"):
        solve_cycle(column(1.0), column(0.4), column(3.0))


def test_stance_is_symmetric_in_time() -> None:
    length, angle, speed, flight = human(16)
    cycle = solve_cycle(length, angle, speed, flight_time=flight)
    phase = torch.linspace(0.0, 1.0, 21, dtype=torch.float64).expand(16, -1)
    stance = cycle.stance_height(phase)
    torch.testing.assert_close(stance, stance.flip(-1), atol=1e-12, rtol=0.0)
    torch.testing.assert_close(stance[:, 0], length * torch.cos(angle), atol=1e-10, rtol=0.0)


def test_work_of_the_leg_is_the_change_of_vertical_energy() -> None:
    length, angle, speed, flight = human(16)
    cycle = solve_cycle(length, angle, speed, flight_time=flight)
    n = 24
    here = torch.device("cpu")
    half = (0.5 * chebyshev_nodes(n, torch.float64, here)).expand(16, -1)
    forward, height = cycle.stance_forward(half), cycle.stance_height(half)
    lift = GRAVITY * cycle.leg_force_bw(forward, height) * height / torch.hypot(forward, height)
    until = 0.5 * integration_matrix(n, torch.float64, here).T * cycle.contact_time[:, None, None]
    start = cycle.touchdown_rate.unsqueeze(-1)
    rate = start + ((lift - GRAVITY).unsqueeze(1) @ until)[:, 0]
    assert float(rate[:, -1].abs().max()) < 1e-7  # no vertical speed at mid-stance
    work = ((lift * rate).unsqueeze(1) @ until)[:, 0]
    energy = 0.5 * (rate**2 - start**2) + GRAVITY * (height - height[:, :1])
    torch.testing.assert_close(work, energy, atol=1e-7, rtol=0.0)


def test_more_nodes_find_the_same_hop(monkeypatch: pytest.MonkeyPatch) -> None:
    length, angle, speed, flight = human(32)
    coarse = solve_cycle(length, angle, speed, flight_time=flight)
    monkeypatch.setattr("hopdiff.physics.hopper.STANCE_NODES", 2 * STANCE_NODES)
    fine = solve_cycle(length, angle, speed, flight_time=flight)
    phase = torch.linspace(0.0, 1.0, 50, dtype=torch.float64).expand(32, -1)
    error = (coarse.stance_height(phase) - fine.stance_height(phase)).abs() / length.unsqueeze(-1)
    assert float(error.max()) < 1e-8


def test_a_hop_that_cannot_be_is_marked_and_stays_finite() -> None:
    length, angle, speed, _ = human(4)
    hopeless = solve_cycle(length, angle, speed, stiffness=torch.full_like(length, 1e-3))
    assert not bool(hopeless.converged.any())
    assert all(bool(torch.isfinite(value).all()) for value in hopeless[:-1])
