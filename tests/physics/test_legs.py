"""Legs: geometry of a pose, and curves through the air without a jump in angle or rate."""

from __future__ import annotations

import math
from collections.abc import Callable

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from scipy.interpolate import CubicSpline
from torch import Tensor

from hopdiff.numerics import smooth_max
from hopdiff.physics.leg_motion import knee_offset_slopes, leg_motion
from hopdiff.physics.legs import (
    FLIGHT_ROOM,
    STRAIGHTEST_KNEE,
    TRAIL_ROOM,
    LegMotion,
    LegPose,
    Swing,
    SwingGenes,
    flight_alpha,
    knee_offset,
    leg_pose,
    leg_reach,
    make_swing,
)

THIGH, SHANK = 0.42, 0.5


def column(*values: float) -> Tensor:
    return torch.tensor(values, dtype=torch.float64)


def swings(count: int = 50, haste: float = 1.0) -> Swing:
    """Swings of a human-sized leg at many speeds, with the rates of a planted foot under a hip that travels.

    haste: factor of the rates at take-off and touchdown.
    """
    random = torch.rand(9, count, generator=torch.Generator().manual_seed(2), dtype=torch.float64)

    def between(row: int, low: float, high: float) -> Tensor:
        return low + (high - low) * random[row]

    speed, angle, contact, flight = between(0, 3, 8), between(1, 0.3, 0.5), between(2, 0.12, 0.2), between(3, 0.08, 0.2)
    reach = 0.97 * (THIGH + SHANK)
    knee = torch.acos((torch.tensor(reach) ** 2 - THIGH**2 - SHANK**2) / (2 * THIGH * SHANK)).double().expand(count)
    still = torch.zeros(count, dtype=torch.float64)
    turn = -haste * speed * torch.cos(angle) / reach
    fold = haste * speed * torch.sin(angle) / (0.5 * SHANK)
    return make_swing(
        contact,
        flight,
        start=LegPose(-angle, knee, still - 0.05),
        start_rate=LegPose(turn, -fold, still + 0.1),
        end=LegPose(angle, knee, still - 0.03),
        end_rate=LegPose(turn, fold, still - 0.2),
        genes=SwingGenes(
            between(4, 0.15, 0.5),
            between(5, -1.0, -0.6),
            between(6, 0.8, 1.5),
            between(7, 1.7, 2.2),
            between(8, 0.04, 0.1),
        ),
        hip_height=still + 0.85,
        thigh=THIGH,
        shank=SHANK,
    )


def at(curve: Callable[[Tensor], LegMotion], x: float, duration: Tensor) -> tuple[Tensor, Tensor]:
    """Pose (3, P) and its rate [rad/s] at a share x of a phase."""
    share = torch.full_like(duration, x).requires_grad_(True)
    pose = curve(share).pose
    rates = [torch.autograd.grad(value.sum(), share, retain_graph=True)[0] / duration for value in pose]
    return torch.stack([value.detach()[:, 0] for value in pose]), torch.stack([rate[:, 0] for rate in rates])


@given(st.floats(-0.2, 0.2), st.floats(-0.6, 0.6), st.floats(0.3, 0.6))
def test_a_pose_puts_the_foot_where_it_was_asked(left: float, forward: float, down: float) -> None:
    pose, reach = leg_pose(column(left), column(-down), column(forward), THIGH, SHANK)
    distance = math.hypot(left, forward, down)
    assert float(reach) == pytest.approx(distance / (THIGH + SHANK), abs=1e-12)
    assert float(leg_reach(pose.knee, THIGH, SHANK)) == pytest.approx(distance, abs=1e-8)
    # Walk down the leg: thigh and shank in the plane, then the plane tilted.
    thigh = float(pose.angle + knee_offset(pose.knee, THIGH, SHANK))
    shank = thigh - float(pose.knee)
    ahead = THIGH * math.sin(thigh) + SHANK * math.sin(shank)
    below = THIGH * math.cos(thigh) + SHANK * math.cos(shank)
    tilt = float(pose.tilt)
    assert (below * math.sin(tilt), below * math.cos(tilt), ahead) == pytest.approx((left, down, forward), abs=1e-8)
    assert 0.0 <= float(pose.knee) < math.pi


def test_a_foot_out_of_reach_straightens_the_knee_and_says_so() -> None:
    pose, reach = leg_pose(column(0.0), column(-1.0), column(0.0), THIGH, SHANK)
    assert float(pose.knee) == pytest.approx(0.0, abs=1e-4)
    assert float(reach) > 1.0


@given(st.floats(-0.2, 0.2), st.floats(-0.6, 0.6), st.floats(0.3, 0.6))
def test_a_leg_moves_as_its_foot_asks(left: float, forward: float, down: float) -> None:
    """Rates and accelerations against those of autograd, along a parabola of the foot."""
    time = torch.zeros(1, dtype=torch.float64, requires_grad=True)
    start, rate, bend = (
        torch.tensor(row, dtype=torch.float64).unsqueeze(-1)
        for row in ((left, -down, forward), (0.4, 0.7, -3.0), (2.0, -9.0, 5.0))
    )
    pose, _ = leg_pose(*(start + rate * time + 0.5 * bend * time**2).unbind(0), THIGH, SHANK)
    found = leg_motion(start, rate, bend, THIGH, SHANK)
    for value, known, first, second in zip(pose, *found, strict=True):
        (once,) = torch.autograd.grad(value, time, create_graph=True)
        (twice,) = torch.autograd.grad(once, time, retain_graph=True)
        torch.testing.assert_close(known, value.detach())
        torch.testing.assert_close(first, once.detach(), rtol=1e-8, atol=1e-9)
        torch.testing.assert_close(second, twice.detach(), rtol=1e-7, atol=1e-7)


def test_a_leg_that_is_set_straight_has_a_knee_that_stands_still() -> None:
    foot = torch.tensor([0.0, -1.0, 0.0], dtype=torch.float64)
    found = leg_motion(foot, torch.ones_like(foot), torch.ones_like(foot), THIGH, SHANK)
    assert float(found.rate.knee) == 0.0
    assert float(found.acceleration.knee) == 0.0


def test_slopes_of_the_knee_offset() -> None:
    knee = torch.linspace(0.1, 2.5, 9, dtype=torch.float64, requires_grad=True)
    (once,) = torch.autograd.grad(knee_offset(knee, THIGH, SHANK).sum(), knee, create_graph=True)
    (twice,) = torch.autograd.grad(once.sum(), knee)
    slope, bend = knee_offset_slopes(knee.detach(), THIGH, SHANK)
    torch.testing.assert_close(slope, once.detach())
    torch.testing.assert_close(bend, twice)


@pytest.mark.parametrize("x", [0.0, 0.2, 0.5, 0.7, 1.0])
def test_the_air_tells_how_fast_it_goes_and_how_it_bends(x: float) -> None:
    swing = swings()
    for curve, duration in (
        (swing.first_flight, swing.flight),
        (swing.swing, swing.contact),
        (swing.last_flight, swing.flight),
    ):
        share = torch.full_like(duration, x).requires_grad_(True)
        pose, rate, acceleration = curve(share)
        for value, first, second in zip(pose, rate, acceleration, strict=True):
            (once,) = torch.autograd.grad(value.sum(), share, create_graph=True)
            torch.testing.assert_close(first, once / duration, rtol=1e-9, atol=1e-9)
            (twice,) = torch.autograd.grad(first.sum(), share, retain_graph=True)
            torch.testing.assert_close(second, twice / duration, rtol=1e-7, atol=5e-4)


def test_the_air_takes_over_from_stance_and_hands_back_to_it() -> None:
    """Both ends carry the pose and the rates of the stance, so that the foot is at rest on the ground there."""
    swing = swings()
    for curve, x, pose, rate in (
        (swing.first_flight, 0.0, swing.start, swing.start_rate),
        (swing.last_flight, 1.0, swing.end, swing.end_rate),
    ):
        found, found_rate = at(curve, x, swing.flight)
        torch.testing.assert_close(found, torch.stack([v[:, 0] for v in pose]), atol=1e-10, rtol=0.0)
        torch.testing.assert_close(found_rate, torch.stack([v[:, 0] for v in rate]), atol=1e-8, rtol=0.0)


def test_no_jump_in_angle_or_rate_between_the_phases() -> None:
    swing = swings()
    for before, after in (
        (at(swing.first_flight, 1.0, swing.flight), at(swing.swing, 0.0, swing.contact)),
        (at(swing.swing, 0.5 - 1e-12, swing.contact), at(swing.swing, 0.5, swing.contact)),
        (at(swing.swing, 1.0, swing.contact), at(swing.last_flight, 0.0, swing.flight)),
    ):
        torch.testing.assert_close(before[0], after[0], atol=1e-9, rtol=0.0)
        torch.testing.assert_close(before[1], after[1], atol=1e-6, rtol=0.0)


def test_the_genes_are_where_they_say() -> None:
    swing = swings()
    angle, knee = at(swing.swing, 0.0, swing.contact)[0][:2]
    torch.testing.assert_close(angle, swing.angle_start[:, 0])
    torch.testing.assert_close(knee, swing.knees[1][:, 0])
    torch.testing.assert_close(at(swing.swing, 0.5, swing.contact)[0][1], swing.knees[2][:, 0])


def test_clearance_is_kept_at_the_other_legs_takeoff() -> None:
    swing = swings()
    angle, knee, _ = at(swing.last_flight, 0.0, swing.flight)[0]
    clearance = 0.85 - leg_reach(knee, THIGH, SHANK) * torch.cos(angle)
    assert ((clearance > 0.04 - 1e-9) & (clearance < 0.1 + 1e-9)).all()


def test_the_knee_does_not_lock_where_the_leg_lets_go_of_the_ground() -> None:
    swing = swings(200)
    x = torch.linspace(0.0, 1.0, 400, dtype=torch.float64).expand(200, -1)
    for curve in (swing.first_flight, swing.last_flight):
        assert float(curve(x).pose.knee.min()) > (1.0 - FLIGHT_ROOM) * STRAIGHTEST_KNEE


def test_the_leg_swings_past_its_touchdown_angle_and_peaks_at_alpha() -> None:
    swing = swings()
    shares = torch.linspace(0.0, 1.0, 4001, dtype=torch.float64).expand(len(swing.flight), -1)
    angle = swing.last_flight(shares).pose.angle
    peak = shares[0, angle.argmax(-1)]
    torch.testing.assert_close(peak, swing.alpha[:, 0], atol=3e-4, rtol=0.0)
    # Equation (6): the way past the end, as a share of the way from start to end.
    alpha = swing.alpha[:, 0]
    overshoot = (angle.amax(-1) - angle[:, 0]) / (angle[:, -1] - angle[:, 0])
    torch.testing.assert_close(overshoot, alpha**2 / (2.0 * alpha - 1.0), rtol=1e-5, atol=0.0)


def test_alpha_comes_from_the_rate_at_touchdown() -> None:
    reach, rate, duration = column(0.3), column(-6.0), column(0.15)
    alpha = float(flight_alpha(reach, rate, duration))
    # B_c'(T) T = (2 - 2 alpha) / (1 - 2 alpha), times the reach over T.
    assert 0.3 / 0.15 * (2.0 - 2.0 * alpha) / (1.0 - 2.0 * alpha) == pytest.approx(-6.0)


@pytest.mark.parametrize("haste", [1.0, 4.0, 10.0])
def test_what_the_stance_leaves_swings_out_no_farther_than_its_room(haste: float) -> None:
    """The curve with the rate of take-off, and that of touchdown, against the same without it."""
    swing = swings(60, haste)
    still = torch.zeros_like(swing.flight)
    x = torch.linspace(0.0, 1.0, 800, dtype=torch.float64).expand(60, -1)
    bare = swing._replace(start_rate=LegPose(still, still, still), end_rate=swing.end_rate._replace(knee=still))
    trail = (swing.first_flight(x).pose.angle - bare.first_flight(x).pose.angle).abs().amax(-1)
    follow = (swing.first_flight(x).pose.knee - bare.first_flight(x).pose.knee).abs().amax(-1)
    reach = (swing.last_flight(x).pose.knee - bare.last_flight(x).pose.knee).abs().amax(-1)
    rooms = (
        torch.full_like(trail, TRAIL_ROOM),
        FLIGHT_ROOM * (swing.start.knee - STRAIGHTEST_KNEE)[:, 0],
        FLIGHT_ROOM * (swing.end.knee - STRAIGHTEST_KNEE)[:, 0],
    )
    rates = (swing.start_rate.angle, swing.start_rate.knee, swing.end_rate.knee)
    for found, room, rate in zip((trail, follow, reach), rooms, rates, strict=True):
        # Extremum of |r| T x (1 - x)^m, whose m is the least that keeps to the room, 2.5 or more but for rounding off.
        push = (rate * swing.flight).abs()[:, 0]
        power = smooth_max(push / (torch.e * room) - 0.5, 2.5, 0.5)
        torch.testing.assert_close(found, push * power**power / (power + 1.0) ** (power + 1.0), rtol=1e-3, atol=0.0)
        assert bool((found < 1.04 * room).all())
        if haste == 10.0:
            assert bool((found > 0.8 * room).any())


def test_the_knee_runs_on_a_clamped_spline() -> None:
    """But for what the stance leaves and asks for: SciPy's spline through the same knots."""
    swing = swings(5)
    still = torch.zeros_like(swing.flight)
    bare = swing._replace(start_rate=LegPose(still, still, still), end_rate=swing.end_rate._replace(knee=still))
    x = torch.linspace(0.0, 1.0, 9, dtype=torch.float64).expand(5, -1)
    for p in range(5):
        flight, contact = float(swing.flight[p]), float(swing.contact[p])
        knots = torch.tensor([0.0, flight, flight + 0.5 * contact, flight + contact, 2.0 * flight + contact])
        spline = CubicSpline(knots.double().numpy(), [float(k[p]) for k in swing.knees], bc_type="clamped")
        for curve, start, length in (
            (bare.first_flight, 0.0, flight),
            (bare.swing, flight, contact),
            (bare.last_flight, flight + contact, flight),
        ):
            wanted = torch.from_numpy(spline((start + x[p] * length).numpy()))
            torch.testing.assert_close(curve(x).pose.knee[p], wanted, rtol=0.0, atol=1e-6)


def test_the_leg_angle_keeps_its_curvature_when_the_other_foot_lands() -> None:
    swing, e = swings(), 1e-4
    # What the take-off leaves has faded by then, but its curvature fades slowly.
    still = torch.zeros_like(swing.flight)
    swing = swing._replace(start_rate=LegPose(still, still, still))
    near = torch.tensor([1.0 - 2.0 * e, 1.0 - e, 1.0], dtype=torch.float64).expand(len(swing.flight), -1)
    before = swing.first_flight(near).pose.angle.diff().diff()[:, 0] / (e * swing.flight[:, 0]) ** 2
    far = torch.tensor([0.0, e, 2.0 * e], dtype=torch.float64).expand(len(swing.flight), -1)
    after = swing.swing(far).pose.angle.diff().diff()[:, 0] / (e * swing.contact[:, 0]) ** 2
    assert float((after - before).abs().max()) < 0.005 * float(before.abs().max())


def test_the_leg_tilts_evenly_through_the_whole_swing() -> None:
    """One cubic over both flights and the contact between them."""
    swing = swings()
    whole = 2.0 * swing.flight + swing.contact
    ends = (swing.start.tilt, swing.end.tilt, swing.start_rate.tilt * whole, swing.end_rate.tilt * whole)
    for curve, x, time in (
        (swing.first_flight, 0.7, 0.7 * swing.flight),
        (swing.swing, 0.4, swing.flight + 0.4 * swing.contact),
        (swing.last_flight, 0.2, 1.2 * swing.flight + swing.contact),
    ):
        s = time / whole
        wanted = (
            (1.0 + 2.0 * s) * (1.0 - s) ** 2 * ends[0]
            + s**2 * (3.0 - 2.0 * s) * ends[1]
            + s * (1.0 - s) ** 2 * ends[2]
            + s**2 * (s - 1.0) * ends[3]
        )
        torch.testing.assert_close(curve(torch.full_like(s, x)).pose.tilt, wanted)
