"""The hopper alone over many hops: geometry of the legs, continuity, and the numbers of the thesis' figures."""

from __future__ import annotations

import math

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch import Tensor

from hopdiff.numerics import GRAVITY
from hopdiff.physics.hopping import Hopper, Hopping, Legs, first_hop, hop_along, periodic_rate

FIGURE_3_4 = Hopper(leg_length=2.0, touchdown_angle=math.pi / 4, speed=10.0, stiffness=3000.0, mass=50.0)
FIGURE_3_5 = FIGURE_3_4._replace(speed=5.0)
FIGURE_3_7 = Hopper(leg_length=1.5, touchdown_angle=math.pi / 6, speed=5.0, stiffness=9000.0, mass=50.0)
ONE = Legs(1, 0.9, 1.3, -0.4, 0.35, 1.6, 2.2, 1.4)
TWO = ONE._replace(number=2)
CASES = pytest.mark.parametrize(
    ("hopper", "legs", "step"),
    [(FIGURE_3_4, ONE, 0.005), (FIGURE_3_5, ONE, 0.01), (FIGURE_3_7, TWO, 0.01)],
    ids=["3.4", "3.5", "3.7"],
)


def hop(hopper: Hopper, legs: Legs, step: float, hops: int = 2, rate: float | None = None) -> Hopping:
    start = (periodic_rate(hopper) or 0.0) if rate is None else rate
    done = hop_along(hopper, legs, start, step, hops, max_frames=20_000)
    assert done is not None
    return done


def distance(a: Tensor, b: Tensor) -> Tensor:
    return torch.linalg.vector_norm(a - b, dim=-1)


def angles(done: Hopping) -> tuple[Tensor, Tensor]:
    """theta_c and theta_l (F, L) from the points."""
    along = done.feet - done.hip.unsqueeze(1)
    upper = done.knees - done.hip.unsqueeze(1)
    turn = torch.atan2(along[..., 0], -along[..., 1])
    return turn, torch.atan2(upper[..., 0], -upper[..., 1]) - turn


@CASES
def test_links_keep_their_length_and_the_knee_is_in_front(hopper: Hopper, legs: Legs, step: float) -> None:
    done = hop(hopper, legs, step)
    half = torch.full_like(done.knees[..., 0], 0.5 * hopper.leg_length)
    torch.testing.assert_close(distance(done.knees, done.hip.unsqueeze(1)), half, atol=1e-9, rtol=0)
    torch.testing.assert_close(distance(done.feet, done.knees), half, atol=1e-9, rtol=0)
    _, fold = angles(done)
    assert float(fold.min()) > -1e-9
    assert float(fold.max()) > 0.4, "a leg folds somewhere"


@CASES
def test_a_standing_foot_is_pinned_to_the_ground(hopper: Hopper, legs: Legs, step: float) -> None:
    done = hop(hopper, legs, step)
    for k in range(3):
        frames = ((done.hop == k) & ~done.in_flight).nonzero()[:, 0]
        feet = done.feet[frames, k % legs.number]
        assert float(feet[:, 1].abs().max()) < 1e-9
        assert float(feet[:, 0].max() - feet[:, 0].min()) < 1e-9


@CASES
def test_nothing_jumps_at_take_off_and_touchdown(hopper: Hopper, legs: Legs, step: float) -> None:
    done = hop(hopper, legs, step)
    changes = (done.in_flight[1:] != done.in_flight[:-1]).nonzero()[:, 0]
    assert len(changes) == 4
    turn, fold = angles(done)
    # A folded leg of fixed links stretches with an infinite rate of theta_l: its length is what is steady there.
    length = hopper.leg_length * torch.cos(fold)
    for curve in (turn, length):
        moves = curve.diff(dim=0).abs()
        for i in changes.tolist():
            near = torch.cat((moves[max(i - 3, 0) : i], moves[i + 1 : i + 4])).amax(0)
            assert (moves[i] <= 1.5 * near + 0.01).all(), f"frame {i}"


@CASES
def test_halving_the_step_halves_the_largest_move_of_a_foot(hopper: Hopper, legs: Legs, step: float) -> None:
    """What is continuous moves less in a shorter frame; a jump would stay."""
    coarse, fine = (float(distance(done.feet[1:], done.feet[:-1]).max()) for done in _twice(hopper, legs, step))
    assert fine < 0.65 * coarse


def _twice(hopper: Hopper, legs: Legs, step: float) -> tuple[Hopping, Hopping]:
    return hop(hopper, legs, step, hops=1), hop(hopper, legs, 0.5 * step, hops=1)


@CASES
def test_the_leg_meets_the_ground_at_the_touchdown_angle(hopper: Hopper, legs: Legs, step: float) -> None:
    done = hop(hopper, legs, step)
    turn, fold = angles(done)
    landings = [0, *((done.hop[1:] > done.hop[:-1]).nonzero()[:, 0] + 1).tolist()]
    assert len(landings) == 3
    for k, i in enumerate(landings):
        assert float(turn[i, k % legs.number]) == pytest.approx(hopper.touchdown_angle, abs=1e-9)
        assert float(fold[i, k % legs.number]) == pytest.approx(0.0, abs=1e-4)


def test_legs_swap_their_roles_from_hop_to_hop() -> None:
    done = hop(FIGURE_3_7, TWO, 0.01, hops=3)
    assert [int(done.carrier[done.hop == k].unique()) for k in range(4)] == [0, 1, 0, 1]
    turn, fold = angles(done)
    for k in range(4):
        i = int((done.hop == k).nonzero()[0])
        active = (k + 1) % 2
        assert float(turn[i, active]) == pytest.approx(TWO.angle_start, abs=1e-9)
        assert float(fold[i, active]) == pytest.approx(0.5 * TWO.knee_start, abs=1e-9)


def test_the_active_leg_reaches_its_middle_and_its_end() -> None:
    done = hop(FIGURE_3_7, TWO, 0.002, hops=1)
    turn, fold = angles(done)
    takeoff = int(done.in_flight.nonzero()[0])
    assert float(turn[takeoff, 1]) == pytest.approx(TWO.angle_end, abs=1e-9)
    assert float(fold[takeoff, 1]) == pytest.approx(0.5 * TWO.knee_end, abs=1e-9)
    assert float(fold[: takeoff + 1, 1].max()) == pytest.approx(0.5 * TWO.knee_middle, abs=1e-3)


def test_flight_blends_as_equations_5_and_6_say() -> None:
    done = hop(FIGURE_3_7, TWO, 0.01, hops=1)
    turn, fold = angles(done)
    frames = done.in_flight.nonzero()[:, 0]
    share = (done.times[frames] - done.times[frames[0]]) / done.flight_times[0]
    blend = (share**2 - 2.0 * TWO.alpha * share) / (1.0 - 2.0 * TWO.alpha)
    for leg, end_turn, end_fold in ((0, TWO.angle_start, 0.5 * TWO.knee_start), (1, FIGURE_3_7.touchdown_angle, 0.0)):
        start_turn, start_fold = turn[frames[0], leg], fold[frames[0], leg]
        torch.testing.assert_close(turn[frames, leg], start_turn + (end_turn - start_turn) * blend)
        expected = start_fold + (end_fold - start_fold) * share
        torch.testing.assert_close(fold[frames, leg], expected, atol=1e-4, rtol=0)


def test_figure_3_4_is_a_cycle_and_stepping_agrees_within_a_frame() -> None:
    rate = periodic_rate(FIGURE_3_4)
    assert rate is not None
    exact = first_hop(FIGURE_3_4, rate)
    assert exact.contact == pytest.approx(0.2828, abs=5e-5)
    assert exact.flight == pytest.approx(0.5755, abs=5e-5)
    # At touchdown as fast as at take-off: what the flight takes away it must have begun with.
    assert exact.flight == pytest.approx(-2.0 * rate / GRAVITY, rel=1e-5)
    done = hop(FIGURE_3_4, ONE, 0.005, hops=5)
    assert done.contact_times == pytest.approx([exact.contact] * 5, abs=0.005)
    assert done.flight_times == pytest.approx([exact.flight] * 5, abs=0.005)


@pytest.mark.parametrize("hopper", [FIGURE_3_5, FIGURE_3_7], ids=["3.5", "3.7"])
def test_figures_3_5_and_3_7_have_no_cycle(hopper: Hopper) -> None:
    """However fast they fall at touchdown, they fall faster at the next: no hop repeats, nor do two or more."""
    assert periodic_rate(hopper) is None
    rates = [-0.1 * i for i in range(121)]
    landings = {rate: first_hop(hopper, rate).landing_rate for rate in rates}
    bounces = {rate: after for rate, after in landings.items() if math.isfinite(after)}
    assert len(bounces) > 50
    assert all(after < rate - 1.0 for rate, after in bounces.items())


def test_landing_rate_is_that_of_stepping() -> None:
    exact = first_hop(FIGURE_3_7, -1.0)
    done = hop(FIGURE_3_7, TWO, 1e-3, hops=1, rate=-1.0)
    drop = done.apex_heights[0] - FIGURE_3_7.touchdown_height
    assert exact.landing_rate == pytest.approx(-math.sqrt(2.0 * GRAVITY * drop), rel=5e-3)


def test_the_bounce_grows_until_the_leg_gives_way() -> None:
    done = hop(FIGURE_3_5, ONE, 0.01, hops=3)
    assert (done.hops_done, done.fell) == (2, True)
    assert done.apex_heights[1] > 2.0 * done.apex_heights[0]
    assert len(done.contact_times) == len(done.flight_times) == len(done.apex_heights) == 2
    assert int(done.hop.max()) == 2
    assert torch.isfinite(done.feet).all()
    whole = hop(FIGURE_3_5, ONE, 0.01, hops=2)
    assert (whole.hops_done, whole.fell) == (2, False)
    n = len(whole.times)
    torch.testing.assert_close(whole.hip, done.hip[:n])


def test_first_hop_is_what_fine_stepping_tends_to() -> None:
    exact = first_hop(FIGURE_3_7, -1.0)
    errors = []
    for step in (4e-3, 5e-4):
        done = hop(FIGURE_3_7, TWO, step, hops=1, rate=-1.0)
        errors.append(abs(done.flight_times[0] - exact.flight))
        assert done.contact_times[0] == pytest.approx(exact.contact, abs=step)
    assert errors[1] < 0.25 * errors[0]


def test_a_leg_too_soft_falls_in_its_first_hop() -> None:
    soft = FIGURE_3_4._replace(stiffness=100.0)
    assert math.isnan(first_hop(soft, 0.0).flight)
    done = hop(soft, ONE, 0.005, rate=0.0)
    assert (done.hops_done, done.fell, done.flight_times) == (0, True, [])


def test_a_fall_within_the_first_frame_is_a_fall() -> None:
    done = hop(FIGURE_3_7, TWO, 0.02, rate=-100.0)
    assert (len(done.times), done.hops_done, done.fell) == (1, 0, True)


def test_too_many_frames_are_refused() -> None:
    assert hop_along(FIGURE_3_4, ONE, -2.8, 0.005, 3, max_frames=200) is None
    assert hop_along(FIGURE_3_4, ONE, -2.8, 0.005, 3, max_frames=600) is not None


@settings(max_examples=25, deadline=None)
@given(length=st.floats(0.5, 2.0), angle=st.floats(0.2, 0.8), speed=st.floats(2.0, 10.0), swings=st.floats(0.8, 5.0))
def test_a_periodic_rate_repeats(length: float, angle: float, speed: float, swings: float) -> None:
    """Whatever is called periodic lands as it started, with a leg that is stretched exactly at the mirror image."""
    contact = 2.0 * length * math.sin(angle) / speed
    hopper = Hopper(length, angle, speed, stiffness=(swings / contact) ** 2, mass=1.0)
    if (rate := periodic_rate(hopper)) is not None:
        exact = first_hop(hopper, rate)
        assert exact.contact == pytest.approx(contact, rel=1e-4)
        assert exact.flight == pytest.approx(-2.0 * rate / GRAVITY, rel=1e-3)
        assert exact.landing_rate == pytest.approx(rate, rel=1e-3)
