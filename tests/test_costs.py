"""The terms of the objective in cases whose answer is known."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from torch import Tensor

from hopdiff import costs, limits
from hopdiff.costs import Calibration, StyleSettings
from hopdiff.models.thesis import ThesisModel
from hopdiff.models.trajectory import JOINT_CHANNELS, Trajectory
from hopdiff.numerics import GRAVITY, chebyshev_nodes
from hopdiff.problem import RunProblem
from hopdiff.types import Status
from tests.builders import cost_settings, make_character, make_problem, valid_genes


def column(*values: float) -> Tensor:
    return torch.tensor(values, dtype=torch.float64)


@cache
def problem() -> RunProblem:
    return make_problem("speed=5", "beta=0.2")


@cache
def ordinary() -> Trajectory:
    with torch.no_grad():
        return problem().trajectory(problem().ordinary_genes.unsqueeze(0))


def with_rates(before: list[float], after: list[float]) -> Trajectory:
    return ordinary()._replace(rates_before=column(*before).unsqueeze(0), rates_after=column(*after).unsqueeze(0))


def test_eval_in_closed_form() -> None:
    # Equation (14): perfect, worst, and half way.
    assert float(costs.evaluation(column(0.0), column(0.25), 0.2)) == pytest.approx(0.0, abs=1e-15)
    assert float(costs.evaluation(column(1e12), column(1e12), 0.2)) == pytest.approx(1.0)
    assert float(costs.evaluation(column(1.0), column(0.25), 0.2)) == pytest.approx(0.25)
    assert float(costs.evaluation(column(0.0), column(2.0), 0.5)) == pytest.approx(0.25)
    assert float(costs.evaluation(column(3.0), column(2.0), 0.5)) == pytest.approx(1.0 - 0.5 / 4 - 0.5 / 2)


@given(st.floats(0.0, 100.0), st.floats(0.0, 50.0), st.floats(0.0, 0.95))
def test_eval_stays_in_its_range_and_grows_with_gamma(gamma: float, energy: float, beta: float) -> None:
    value = float(costs.evaluation(column(gamma), column(energy), beta))
    assert 0.0 <= value < 1.0
    assert value <= float(costs.evaluation(column(gamma + 1.0), column(energy), beta))


def test_energy_target_of_the_thesis() -> None:
    assert costs.energy_target(0.2) == pytest.approx(0.25)
    assert costs.energy_target(0.7) == pytest.approx(2.333, abs=1e-3)
    assert costs.energy_target(0.0) == 0.0


@pytest.mark.parametrize("beta", [0.2, 0.5, 0.8])
def test_energy_mismatch_is_the_squared_relative_miss(beta: float) -> None:
    target = costs.energy_target(beta)
    assert float(costs.energy_mismatch(column(target), beta)) == 0.0
    assert float(costs.energy_mismatch(column(1.1 * target), beta)) == pytest.approx(0.01)
    assert float(costs.energy_mismatch(column(0.9 * target), beta)) == pytest.approx(0.01)


def test_a_calm_run_is_pulled_less_but_still_pulled() -> None:
    calm = float(costs.energy_mismatch(column(0.1), 0.0))
    assert 0.0 < calm < float(costs.energy_mismatch(column(0.25 + 0.1), 0.2))


def test_equal_rates_are_connected_in_both_forms() -> None:
    same = with_rates([5.0, -3.0, 0.0, 8.0], [5.0, -3.0, 0.0, 8.0])
    assert float(costs.connectivity(same, "smooth", 1.0)) == 0.0
    assert float(costs.connectivity(same, "ratio", 1.0)) == 0.0


def test_smooth_connectivity_by_hand() -> None:
    found = costs.connectivity(with_rates([2.0, 0.0, 1.0, 0.0], [1.0, 3.0, -1.0, 0.0]), "smooth", 0.5)
    wanted = 1.0 / (4 + 1 + 0.25) + 9.0 / (9 + 0.25) + 4.0 / (1 + 1 + 0.25)
    assert float(found) == pytest.approx(wanted)


def test_ratio_connectivity_is_the_printed_one_for_rates_far_from_zero() -> None:
    found = float(costs.connectivity(with_rates([10.0, -20.0, 8.0, 6.0], [20.0, -10.0, 8.0, 9.0]), "ratio", 1e-6))
    assert found == pytest.approx((2 - 1) ** 2 + (2 - 1) ** 2 + 0.0 + (1.5 - 1) ** 2, rel=1e-9)


def test_ratio_connectivity_has_no_pole() -> None:
    found = float(costs.connectivity(with_rates([0.0] * 4, [10.0, 0.0, 0.0, 0.0]), "ratio", 1.0))
    assert found == pytest.approx(100.0)


@given(st.lists(st.floats(-50, 50), min_size=4, max_size=4), st.lists(st.floats(-50, 50), min_size=4, max_size=4))
def test_smooth_connectivity_is_bounded_and_knows_no_direction(a: list[float], b: list[float]) -> None:
    there, back = (float(costs.connectivity(with_rates(*pair), "smooth", 1.0)) for pair in ((a, b), (b, a)))
    assert 0.0 <= there <= 8.0
    assert there == pytest.approx(back)


def test_energy_rate_of_one_joint_at_constant_acceleration() -> None:
    body = make_character()
    one = torch.zeros_like(ordinary().accelerations)
    one[..., 0] = 30.0
    still = ordinary()._replace(accelerations=one, balance_error=torch.zeros_like(ordinary().balance_error))
    time = float(still.contact_time + still.flight_time)
    inertia = float(body.inertias[body.skeleton.index("left_hip"), 0])
    work = inertia * 900.0 * time * math.sqrt(body.leg_length / GRAVITY)
    wanted = work / (body.mass * GRAVITY * 5.0 * time)
    assert float(costs.energy_rate_raw(still, body)) == pytest.approx(wanted, rel=1e-5)


def test_energy_rate_of_a_constant_lean() -> None:
    body = make_character()
    error = torch.zeros_like(ordinary().balance_error)
    error[..., 0], error[..., 1] = 0.03, 0.04
    off = ordinary()._replace(accelerations=torch.zeros_like(ordinary().accelerations), balance_error=error)
    # |delta| = 5 cm, times sqrt(g / l), over the speed: mass and step time cancel.
    wanted = 0.05 * math.sqrt(GRAVITY / body.leg_length) / 5.0
    assert float(costs.energy_rate_raw(off, body)) == pytest.approx(wanted, rel=1e-6)


def test_energy_rate_does_not_depend_on_body_mass() -> None:
    heavy = make_problem("speed=5", "beta=0.2", "character.mass=140")
    assert heavy.ordinary.energy_unit == pytest.approx(problem().ordinary.energy_unit, rel=1e-9)


def test_energy_rate_of_similar_bodies_at_the_same_froude_speed_is_the_same() -> None:
    small = make_problem(f"speed={5.0 * math.sqrt(0.5)}", "beta=0.2", f"character.height={1.75 * 0.5}")
    # Only connectivity and the gains, which have units of their own, see the size.
    share = small.ordinary.energy_unit / problem().ordinary.energy_unit
    assert share == pytest.approx(1.0, abs=0.1)


def test_frame_interval_does_not_scale_the_energy() -> None:
    """As printed, halving h would double it."""
    genes, speed = problem().table.decode(problem().ordinary_genes.unsqueeze(0)), column(5.0)
    rates = []
    for h in (4e-3, 2e-3, 1e-3):
        with torch.no_grad():
            trajectory = ThesisModel(problem().character, h).trajectory(genes, speed)
        rates.append(float(costs.energy_rate_raw(trajectory, problem().character)))
    assert max(rates) < 1.3 * min(rates)


def test_leg_force_carries_the_body_on_average() -> None:
    """Mean vertical force over stance = weight times (1 + flight / contact), so over the step it is the weight."""
    p = problem()
    genes = valid_genes(p, 20)
    with torch.no_grad():
        t = p.trajectory(genes)
        cycle = p.model.gait(p.table.decode(genes), torch.full((20,), 5.0).double()).steps.cycle  # type: ignore[attr-defined]
    n = p.model.nodes  # type: ignore[attr-defined]
    x = chebyshev_nodes(n, torch.float64, torch.device("cpu")).expand(20, -1)
    forward, height = cycle.stance_forward(x), cycle.stance_height(x)
    upward = t.leg_force[:, :n] * height / torch.hypot(forward, height)
    mean = (upward * t.weights[:, :n]).sum(-1)
    torch.testing.assert_close(mean / t.contact_time, 1.0 + t.flight_time / t.contact_time, rtol=1e-5, atol=0.0)
    # The mean square of anything with mean one is at least one.
    assert (costs.leg_effort(t) > 0.0).all()


def test_leg_effort_by_hand() -> None:
    standing = torch.zeros_like(ordinary().leg_force)
    half = standing.shape[-1] // 2
    standing[:, :half] = 2.5
    t = ordinary()._replace(leg_force=standing)
    duty = float(t.contact_time / (t.contact_time + t.flight_time))
    assert float(costs.leg_effort(t)) == pytest.approx(6.25 * duty - 1.0, rel=1e-6)


def test_arm_swing_is_a_root_mean_square_about_the_mean() -> None:
    angles = torch.zeros_like(ordinary().angles)
    names = [name for name, _, _ in JOINT_CHANNELS]
    angles[..., names.index("left_shoulder")] = 0.2
    angles[..., names.index("right_shoulder")] = -0.4
    assert float(costs.arm_swing(ordinary()._replace(angles=angles))) == pytest.approx(0.3, abs=1e-6)


def test_bounce_is_the_travel_of_the_centre_of_mass() -> None:
    height = ordinary().com_height.clone()
    height[:] = torch.linspace(0.95, 1.02, height.shape[-1], dtype=torch.float64)
    assert float(costs.com_bounce(ordinary()._replace(com_height=height))) == pytest.approx(0.07)


def test_the_ordinary_run_has_its_own_style() -> None:
    usual: Calibration = problem().ordinary
    assert float(costs.style_mismatch(ordinary(), usual, cost_settings().style, 0.2)) == pytest.approx(0.0, abs=1e-12)
    slower = ordinary()._replace(contact_time=ordinary().contact_time * math.e)
    assert float(costs.style_mismatch(slower, usual, cost_settings().style, 0.2)) >= 1.0


def test_style_follows_the_energy_target_by_its_power_law() -> None:
    style = cost_settings().style
    growth = math.log(costs.energy_target(0.7) / 0.25)
    exponents = (style.contact_time, style.flight_time, style.bounce, style.arm_swing)
    wanted = sum((e * growth) ** 2 for e in exponents)
    assert float(costs.style_mismatch(ordinary(), problem().ordinary, style, 0.7)) == pytest.approx(wanted, rel=1e-9)


LIMITS = cost_settings().limits
ARMS = column(*("shoulder" in name for name, _, _ in JOINT_CHANNELS))


@pytest.mark.parametrize(
    ("status", "change"),
    [
        (Status.LEG_OVERREACH, {"reach": column(1.05)}),
        (Status.LEG_FORCE, {"leg_force": ordinary().leg_force * 4.0}),
        (Status.FOOT_UNDERGROUND, {"foot_height": ordinary().foot_height - 0.05}),
        (Status.BALANCE_UNSTABLE, {"sway_stiffness": column(-1.0)}),
        (Status.NO_FLIGHT, {"flight_time": column(-0.1)}),
        (Status.JOINT_LIMIT, {"angles": ordinary().angles + 4.0 * ARMS}),
        (Status.NOT_FINITE, {"reach": column(math.nan)}),
        (Status.STANCE_UNSOLVED, {"solved": torch.tensor([False])}),
    ],
)
def test_every_broken_constraint_has_its_status(status: Status, change: dict[str, Tensor]) -> None:
    def judge(t: Trajectory) -> int:
        return int(limits.status_of(limits.excesses(t, make_character(), LIMITS), t.solved))

    assert judge(ordinary()) == Status.OK
    assert judge(ordinary()._replace(**change)) == status
    assert status.sentence.endswith(".")


def test_a_folded_stance_leg_collapses() -> None:
    angles = ordinary().angles.clone()
    knee = [name for name, _, _ in JOINT_CHANNELS].index("left_knee")
    angles[..., knee] = torch.where(ordinary().leg_force > 0, math.radians(120.0), angles[..., knee])
    t = ordinary()._replace(angles=angles)
    assert limits.excesses(t, make_character(), LIMITS)[Status.LEG_COLLAPSED] > 0


def test_penalty_starts_inside_the_constraint_and_is_smooth() -> None:
    def price(excess: float) -> float:
        return float(limits.penalty({Status.LEG_FORCE: column(excess)}, LIMITS))

    assert price(-LIMITS.margin - 1e-6) == 0.0
    assert price(0.0) == pytest.approx(LIMITS.penalty * LIMITS.margin**2)
    assert price(1.0) == pytest.approx(LIMITS.penalty * (1.0 + LIMITS.margin) ** 2)
    tiny = 1e-6
    assert price(-LIMITS.margin + tiny) / tiny < 1e-4


def styled(beta: float, style: StyleSettings) -> Trajectory:
    """The ordinary run with every quantity of the style where the power law wants it."""
    t, ratio = ordinary(), costs.energy_target(beta) / 0.25
    height = t.com_height.mean() + (t.com_height - t.com_height.mean()) * ratio**style.bounce
    used = (t.weights / t.duration.unsqueeze(-1)).unsqueeze(-1)
    arms = [k for k, (name, _, _) in enumerate(JOINT_CHANNELS) if "shoulder" in name]
    angles = t.angles.clone()
    mean = (angles[..., arms] * used).sum((1, 2)) / 2.0
    angles[..., arms] = mean + (angles[..., arms] - mean) * ratio**style.arm_swing
    return t._replace(
        contact_time=t.contact_time * ratio**style.contact_time,
        flight_time=t.flight_time * ratio**style.flight_time,
        com_height=height,
        angles=angles,
    )


@pytest.mark.parametrize("beta", [0.15, 0.2, 0.6])
def test_a_run_that_follows_the_power_law_has_the_style(beta: float) -> None:
    style = replace(cost_settings().style, contact_time=-0.3, flight_time=0.5, bounce=0.7, arm_swing=-0.4)
    right = float(costs.style_mismatch(styled(beta, style), problem().ordinary, style, beta))
    assert right == pytest.approx(0.0, abs=1e-12)
    for name in ("contact_time", "flight_time"):
        off = styled(beta, style)
        off = off._replace(**{name: getattr(off, name) * math.exp(0.2)})
        assert float(costs.style_mismatch(off, problem().ordinary, style, beta)) == pytest.approx(0.04, rel=1e-6)


def test_style_stays_where_it_is_below_half_of_the_ordinary_target() -> None:
    # beta 1/9 asks for 1/8, half of the 1/4 of beta 0.2.
    style, usual = cost_settings().style, problem().ordinary
    calm = [float(costs.style_mismatch(ordinary(), usual, style, beta)) for beta in (0.0, 0.05, 1.0 / 9.0, 0.15)]
    assert calm[0] == calm[1] == pytest.approx(calm[2], rel=1e-9)
    assert calm[3] < 0.5 * calm[2]


@pytest.mark.parametrize(("beta", "demand"), [(0.0, 0.1), (1.0 / 9.0, 0.25), (1.0 / 6.0, 0.64), (0.2, 1.0)])
def test_below_the_ordinary_run_demand_falls_with_the_square_of_the_target(beta: float, demand: float) -> None:
    miss = 0.3 * 0.25  # in units of the ordinary target, however small the target itself
    found = float(costs.energy_mismatch(column(costs.energy_target(beta) + miss), beta))
    assert found == pytest.approx(demand * 0.09, rel=1e-9)


def test_energy_rate_of_many_joints_is_a_sum_over_joints_and_time() -> None:
    body, t = make_character(), ordinary()
    accelerations = torch.zeros_like(t.accelerations)
    accelerations[..., 3], accelerations[..., 8] = 7.0, torch.linspace(0.0, 9.0, accelerations.shape[1]).double()
    work = costs.joint_effort(t._replace(accelerations=accelerations), body)[0]
    knee, waist = body.skeleton.index("right_knee"), body.skeleton.index("waist")
    assert float(work[3]) == pytest.approx(float(body.inertias[knee, 0] * 49.0 * t.duration), rel=1e-9)
    by_hand = float(body.inertias[waist, 0]) * float((accelerations[0, :, 8] ** 2 * t.weights[0]).sum())
    assert float(work[8]) == pytest.approx(by_hand, rel=1e-9)
    assert float(work.sum()) == pytest.approx(float(work[3] + work[8]))


def test_posture_is_the_squared_miss_of_the_mean_lean() -> None:
    angles = torch.zeros_like(ordinary().angles)
    lean = [name for name, _, _ in JOINT_CHANNELS].index("trunk_lean")
    half = angles.shape[1] // 2
    angles[:, :half, lean], angles[:, half:, lean] = 0.1, 0.4
    duty = float(ordinary().contact_time / costs.step_time(ordinary()))
    found = float(costs.posture_mismatch(ordinary()._replace(angles=angles), 0.05))
    assert found == pytest.approx((0.1 * duty + 0.4 * (1.0 - duty) - 0.05) ** 2, rel=1e-6)


def test_moments_that_are_not_used_say_nothing() -> None:
    t = ordinary()
    spoiled = t._replace(
        weights=torch.cat((t.weights, torch.zeros_like(t.weights[:, :1])), dim=-1),
        angles=torch.cat((t.angles, torch.full_like(t.angles[:, :1], 9.0)), dim=1),
        leg_force=torch.cat((t.leg_force, torch.full_like(t.leg_force[:, :1], 99.0)), dim=-1),
        com_height=torch.cat((t.com_height, torch.full_like(t.com_height[:, :1], 99.0)), dim=-1),
    )
    assert float(costs.com_bounce(spoiled)) == float(costs.com_bounce(t))
    plain, other = (limits.excesses(x, make_character(), LIMITS) for x in (t, spoiled))
    for status, value in plain.items():
        assert float(other[status]) == float(value), status


UNITS = {
    Status.LEG_OVERREACH: {"reach": column(LIMITS.reach + 0.05)},
    Status.LEG_FORCE: {"leg_force": torch.full_like(ordinary().leg_force, LIMITS.leg_force_bw + 2.0)},
    Status.BALANCE_UNSTABLE: {"sway_stiffness": column(LIMITS.sway_stiffness - 0.1)},
    Status.NO_FLIGHT: {"flight_time": column(LIMITS.flight_time_s - 0.02)},
    Status.FOOT_UNDERGROUND: {
        "foot_height": torch.full_like(
            ordinary().foot_height, -1e-3 * LIMITS.foot_below_ground_mm - 0.05 * make_character().leg_length
        )
    },
}


@pytest.mark.parametrize("status", list(UNITS))
def test_an_excess_of_one_is_gross(status: Status) -> None:
    found = limits.excesses(ordinary()._replace(**UNITS[status]), make_character(), LIMITS)
    assert float(found[status]) == pytest.approx(1.0, rel=1e-6)


def test_one_foot_below_the_ground_is_enough() -> None:
    for side in (0, 1):
        feet = ordinary().foot_height.abs()
        feet[0, 5, side] = -0.03
        found = limits.excesses(ordinary()._replace(foot_height=feet), make_character(), LIMITS)
        wanted = (0.03 - 0.0005) / (0.05 * make_character().leg_length)
        assert float(found[Status.FOOT_UNDERGROUND]) == pytest.approx(wanted, rel=1e-9)


def test_a_knee_that_folds_in_the_air_does_not_collapse() -> None:
    knee = [name for name, _, _ in JOINT_CHANNELS].index("left_knee")
    bend = math.radians(LIMITS.knee_stance_deg)
    for standing, wanted in ((True, 1.0), (False, -2.0 * bend)):
        angles = torch.zeros_like(ordinary().angles)
        angles[..., knee] = torch.where((ordinary().leg_force > 0) == standing, bend + 0.5, 0.0)
        found = limits.excesses(ordinary()._replace(angles=angles), make_character(), LIMITS)
        assert float(found[Status.LEG_COLLAPSED]) == pytest.approx(wanted, rel=1e-6)


BENT = [
    *((f"{side}_{joint}", joint) for side in ("left", "right") for joint in ("knee", "shoulder", "elbow")),
    *(("left_thigh", "hip"), ("right_thigh", "hip"), ("trunk_lean", "waist"), ("neck_flex", "neck")),
]


@pytest.mark.parametrize(("name", "kind"), BENT)
def test_every_joint_is_held_in_its_own_range(name: str, kind: str) -> None:
    body, names = make_character(), [name for name, _, _ in JOINT_CHANNELS]
    middle = torch.zeros_like(ordinary().angles)
    for channel, joint in BENT:
        middle[..., names.index(channel)] = sum(body.limits[joint]) / 2.0
    low, high = body.limits[kind]
    for tilt in (0.0, 0.1):
        # The pelvis tips forward under the trunk: hips fold by as much more, the waist by as much less.
        more = {"hip": tilt, "waist": -tilt}.get(kind, 0.0)
        for beyond in (high - more + 0.3, low - more - 0.3):
            angles = middle.clone()
            angles[0, 7, names.index(name)] = beyond
            t = ordinary()._replace(angles=angles, pelvis_tilt=column(tilt))
            found = limits.excesses(t, body, LIMITS)[Status.JOINT_LIMIT]
            assert float(found) == pytest.approx(0.3 / 0.5, rel=1e-9)


def test_the_worst_constraint_names_the_failure() -> None:
    excess = {Status.LEG_FORCE: column(0.1, 0.3, -0.1), Status.NO_FLIGHT: column(0.2, 0.1, 0.0)}
    solved = torch.tensor([True, True, True])
    assert limits.status_of(excess, solved).tolist() == [Status.NO_FLIGHT, Status.LEG_FORCE, Status.OK]


def test_penalties_add_up_over_constraints() -> None:
    excess = {Status.LEG_FORCE: column(0.3), Status.NO_FLIGHT: column(0.5), Status.LEG_OVERREACH: column(-1.0)}
    own = replace(cost_settings().limits, penalty=3.0, margin=0.1)
    assert float(limits.penalty(excess, own)) == pytest.approx(3.0 * (0.4**2 + 0.6**2))


def test_connectivity_of_a_limp_is_the_mean_of_its_two_take_offs() -> None:
    before, after = [2.0, 0.0, 1.0, 0.0], [1.0, 3.0, -1.0, 0.5]
    one = [float(costs.connectivity(with_rates(*pair), "smooth", 0.5)) for pair in ((before, after), (after, after))]
    both = float(costs.connectivity(with_rates(before + after, after + after), "smooth", 0.5))
    assert one[1] == 0.0
    assert both == pytest.approx(0.5 * one[0])
