"""The numbers of a finished run against the run itself."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache

import pytest
import torch

from hopdiff.effort.metrics import body_metrics, body_motion_metrics, joint_gap
from hopdiff.effort.terms import energy_ratio
from hopdiff.motion import Motion
from hopdiff.whole_body.finish import stride_motion
from tests.effort.runs import ORDINARY, priced, unit_genes
from tests.whole_body.bodies import body_problem

BRISK = ("speed=3.5", "beta=0.6", "costs.least.external_work=0.11", "costs.least.contact_time=0.22")


@cache
def measured(*settings: str) -> dict[str, float]:
    problem = body_problem(*settings)
    return body_metrics(problem, unit_genes(problem)[0])


def test_times_and_lengths() -> None:
    found, run = measured(*ORDINARY), priced()
    contact, flight = run.movement.grid.durations[0].tolist()
    step = contact + flight
    for name, wanted in {
        "contact_time": contact,
        "contact_time_left": contact,
        "contact_time_right": contact,
        "flight_time": flight,
        "flight_share": flight / step,
        "stride_time": 2.0 * step,
        "step_frequency": 1.0 / step,
        "step_length": 3.5 * step,
        "duty_factor": contact / (2.0 * step),
        "step_width": float(run.movement.genes["step_width"]),
        "speed": 3.5,
        "beta": 0.2,
        "leg_length": 0.531 * 1.75,
        "froude": 3.5 / math.sqrt(9.81 * 0.531 * 1.75),
    }.items():
        assert found[name] == pytest.approx(wanted, rel=1e-9), name


def test_shapes_and_forces() -> None:
    found, run = measured(*ORDINARY), priced()
    angles, carried = run.body.angles, run.body.carried
    knee = torch.rad2deg(angles.knee[0])
    stance = run.movement.grid.slice(0)
    height = carried.com[0, 1]
    for name, wanted, slack in (
        ("knee_touchdown_deg", float(knee[0, 0]), 1e-3),
        ("knee_stance_max_deg", float(knee[0, stance].max()), 0.3),
        ("knee_swing_max_deg", float(knee.max()), 0.3),
        ("knee_takeoff_deg", float(knee[0, stance.stop - 1]), 2.0),
        ("com_oscillation", float(height.max() - height.min()), 1e-3),
        # A half sine that carries the body over the whole step.
        ("peak_force_bw", 0.5 * math.pi / float(run.movement.genes["contact_share"]), 1e-3),
        ("least_force_bw", 0.0, 1e-6),
        ("trunk_lean_deg", math.degrees(float(run.movement.genes["trunk_lean"])), 0.05),
        ("trunk_lean_range_deg", math.degrees(float(angles.chest[0, 0].max() - angles.chest[0, 0].min())), 0.1),
        ("arm_swing_deg", math.degrees(math.hypot(20.0, 0.0) / math.sqrt(2.0) * math.pi / 180.0), 0.01),
        ("stance_leg_reach", 0.988, 1e-6),
        ("pelvis_roll_range_deg", 4.0, 0.05),
        ("pelvis_yaw_range_deg", 6.0, 0.05),
    ):
        assert found[name] == pytest.approx(wanted, abs=slack), name
    assert abs(found["trunk_side_deg"]) < 1e-6
    largest = run.dynamics.torque[0].abs().amax(-1) * 70.0
    assert found["torque_knee_flexion_nm"] == pytest.approx(float(largest[5:7, 0].max()))
    assert found["torque_elbow_flexion_nm"] == pytest.approx(float(largest[11:13, 0].max()))
    assert found["torque_hip_sideways_nm"] == pytest.approx(float(largest[3:5, 2].max()))


def test_the_movement_obeys_physics_and_stands_on_its_feet() -> None:
    found = measured(*ORDINARY)
    assert found["stance_residual_bw"] < 1e-3
    assert found["momentum_drift"] < 1e-4
    assert found["moment_residual_nm"] < 2.0
    assert found["foot_slip"] < 1e-4
    assert found["cop_excess"] < 1e-6
    assert found["min_foot_clearance"] > -1e-6
    assert found["loop_error"] < 1e-6


def test_the_friction_that_is_needed_is_the_largest_while_a_foot_bears_weight() -> None:
    problem = body_problem(*ORDINARY)
    motion = stride_motion(problem.gait(unit_genes(problem)), 240.0)
    assert motion.force is not None
    ratios = [
        float(f[0] ** 2 + f[2] ** 2) ** 0.5 / float(f[1]) for frame in motion.force for f in frame if float(f[1]) > 0.5
    ]
    assert measured(*ORDINARY)["friction_needed"] >= max(ratios) - 0.01
    assert max(ratios) > 0.1


def test_nothing_pushes_in_the_air() -> None:
    assert measured(*ORDINARY)["flight_residual_bw"] < 1e-6


def moved_motion(axis: int, way: float) -> Motion:
    """The run with a root that drifts by so much along an axis in its stride."""
    problem = body_problem(*ORDINARY)
    motion = stride_motion(problem.gait(unit_genes(problem)), 240.0)
    drift = torch.zeros_like(motion.clip.root_position)
    drift[:, axis] = torch.linspace(0.0, way, len(drift), dtype=drift.dtype)
    return replace(motion, clip=replace(motion.clip, root_position=motion.clip.root_position + drift))


def test_a_body_that_sinks_is_seen() -> None:
    assert joint_gap(moved_motion(1, 0.0)) < 1e-6
    sunk = body_motion_metrics(moved_motion(1, -0.02))
    assert sunk["min_foot_clearance"] < -0.005
    assert sunk["loop_error"] == pytest.approx(0.02, rel=1e-3)


@pytest.mark.parametrize("axis", [0, 2])
def test_feet_that_slide_are_seen(axis: int) -> None:
    """Two centimetres a stride, of which a foot stands a third."""
    motion = moved_motion(axis, 0.02)
    share = float(motion.contact[:, 0].double().mean())
    assert body_motion_metrics(motion)["foot_slip"] == pytest.approx(0.02 * share, rel=0.1)


def test_energy_is_told_in_that_of_the_least_run() -> None:
    ordinary, brisk = measured(*ORDINARY), measured(*BRISK)
    assert ordinary["energy_rate"] == ordinary["energy_target"] == pytest.approx(0.25)
    assert ordinary["energy_unit"] == ordinary["external_work"]
    assert brisk["energy_target"] == pytest.approx(1.5)
    assert brisk["energy_unit"] == 0.11
    assert brisk["external_work"] == pytest.approx(ordinary["external_work"])
    scale = body_problem(*BRISK).settings.scale
    assert brisk["energy_rate"] == pytest.approx(0.25 * (brisk["external_work"] / 0.11) ** (1.0 / scale))
    asked, weight = energy_ratio(0.6, scale) * 0.11, body_problem(*BRISK).settings.energy
    assert brisk["cost_energy_match"] == pytest.approx(weight * (brisk["external_work"] / asked - 1.0) ** 2)
    assert ordinary["cost_of_transport"] == pytest.approx(
        ordinary["cost_positive_work"] + ordinary["cost_negative_work"]
    )
