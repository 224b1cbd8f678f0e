"""The numbers of a run against what can be worked out from its frames."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
import torch

from hopdiff import costs
from hopdiff.geometry.rotation import axis_rotation
from hopdiff.metrics import loop_error, motion_metrics, run_metrics, stance_foot_drift
from hopdiff.models.trajectory import JOINT_CHANNELS
from hopdiff.motion import Motion
from tests.builders import make_problem, valid_genes

NEEDED = (
    *("speed", "beta", "cost", "gamma", "energy_rate", "energy_rate_raw", "energy_unit", "energy_target"),
    *("contact_time", "flight_time", "step_frequency", "step_length", "duty_factor", "com_oscillation"),
    *("peak_leg_force_bw", "knee_touchdown_deg", "knee_stance_max_deg", "knee_swing_max_deg", "trunk_lean_deg"),
    *("stance_foot_drift", "min_foot_clearance", "loop_error"),
)


@pytest.fixture(scope="module")
def stride() -> tuple[dict[str, float], Motion]:
    problem = make_problem("speed=5", "beta=0.5")
    genes = valid_genes(problem, 1, seed=11)[0]
    return run_metrics(problem, genes), problem.motion(genes, 240.0)


@pytest.mark.parametrize("model", ["smooth", "thesis"])
def test_all_that_is_promised_is_there_and_finite(model: str) -> None:
    problem = make_problem("speed=5", "beta=0.5", f"model={model}")
    measured = run_metrics(problem, problem.ordinary_genes)
    for name in NEEDED:
        assert math.isfinite(measured[name]), name


def test_times_and_lengths_hang_together(stride: tuple[dict[str, float], Motion]) -> None:
    m, motion = stride
    step = m["contact_time"] + m["flight_time"]
    assert motion.clip.duration == pytest.approx(2.0 * step, abs=1e-9)
    assert m["stride_time"] == pytest.approx(2.0 * step)
    assert m["step_frequency"] == pytest.approx(1.0 / step)
    assert m["step_length"] == pytest.approx(5.0 * step)
    assert m["duty_factor"] == pytest.approx(m["contact_time"] / (2.0 * step))
    assert m["flight_share"] == pytest.approx(m["flight_time"] / step)
    travelled = motion.clip.root_position[-1, 2] - motion.clip.root_position[0, 2]
    assert float(travelled) / motion.clip.duration == pytest.approx(m["speed"], abs=1e-12)
    assert m["energy_rate"] == pytest.approx(m["energy_rate_raw"] / m["energy_unit"])
    assert m["energy_target"] == pytest.approx(1.0)


def test_contact_time_is_what_the_feet_show(stride: tuple[dict[str, float], Motion]) -> None:
    m, motion = stride
    ground = motion.clip.end_positions()["left_knee"][:, 1].abs() < 1e-6
    assert float(ground.sum()) * motion.clip.frame_time == pytest.approx(m["contact_time"], abs=2.5 / 240.0)


def test_bounce_from_the_masses_of_the_segments(stride: tuple[dict[str, float], Motion]) -> None:
    m, motion = stride
    body = make_problem("speed=5", "beta=0.5").character
    positions, orientations = body.skeleton.forward(motion.clip.root_position, motion.clip.rotations)
    centre = torch.zeros(motion.clip.frames, 3, dtype=torch.float64)
    for k in range(len(body.skeleton.names)):
        place = positions[:, k] + torch.einsum("tij,j->ti", orientations[:, k], body.coms[k])
        centre += body.masses[k] / body.mass * place
    assert m["com_oscillation"] == pytest.approx(float(centre[:, 1].max() - centre[:, 1].min()), abs=1e-9)


def test_knee_angles_from_the_joints_of_the_frames(stride: tuple[dict[str, float], Motion]) -> None:
    m, motion = stride
    points = motion.clip.joint_positions()
    index = motion.clip.skeleton.index
    thigh = points[:, index("left_knee")] - points[:, index("left_hip")]
    shank = motion.clip.end_positions()["left_knee"] - points[:, index("left_knee")]
    cosine = (thigh * shank).sum(-1) / (thigh.norm(dim=-1) * shank.norm(dim=-1))
    knee = torch.rad2deg(torch.acos(cosine.clamp(-1.0, 1.0)))
    standing = motion.contact[:, 0]
    assert m["knee_touchdown_deg"] == pytest.approx(float(knee[0]), abs=1e-4)
    assert m["knee_stance_max_deg"] == pytest.approx(float(knee[standing].max()), abs=1e-4)
    assert m["knee_swing_max_deg"] == pytest.approx(float(knee[~standing].max()), abs=1e-4)


def test_trunk_lean_from_the_frames(stride: tuple[dict[str, float], Motion]) -> None:
    m, motion = stride
    _, orientations = motion.clip.skeleton.forward(motion.clip.root_position, motion.clip.rotations)
    up = orientations[:-1, motion.clip.skeleton.index("waist"), :, 1]
    # Forward tilt of the trunk's own up axis; yaw and side bend change it little.
    lean = torch.rad2deg(torch.atan2(up[:, 2], up[:, 1])).mean()
    assert m["trunk_lean_deg"] == pytest.approx(float(lean), abs=1.0)


def test_peak_force_lies_between_mean_and_limit(stride: tuple[dict[str, float], Motion]) -> None:
    m, _ = stride
    mean = 1.0 + m["flight_time"] / m["contact_time"]
    assert mean < m["peak_leg_force_bw"] < 2.5 * mean


def test_a_slipping_foot_is_seen(stride: tuple[dict[str, float], Motion]) -> None:
    _, motion = stride
    feet = motion.feet.clone()
    middle = int(motion.contact[:, 0].sum()) // 2
    feet[middle, 0, 0] += 0.013
    assert stance_foot_drift(motion) < 1e-6
    assert stance_foot_drift(replace(motion, feet=feet)) == pytest.approx(0.013, abs=1e-6)


@pytest.mark.parametrize("frame", [0, 1, -1])
def test_a_foot_that_slips_in_one_frame_is_seen_in_that_frame(
    stride: tuple[dict[str, float], Motion], frame: int
) -> None:
    """Against where it touched down: the first frame of its stance, up to the last, which may be that of take-off."""
    _, motion = stride
    inside = torch.nonzero(motion.contact[:, 0]).flatten()
    last = int(inside[inside < int(torch.nonzero(~motion.contact[:, 0])[0])][-1])
    first = next(phase for phase in motion.phases if phase.kind == "stance" and phase.side == "left")
    phases = tuple(
        replace(phase, end=float(motion.times[last])) if phase is first else phase for phase in motion.phases
    )
    feet = motion.feet.clone()
    feet[(0, 1, last)[frame], 0, 0] += 0.01
    feet[2, 0, 0] -= 0.01
    wanted = 0.02 if frame == 0 else 0.01
    assert stance_foot_drift(replace(motion, feet=feet, phases=phases)) == pytest.approx(wanted, abs=1e-6)
    feet[2, 0, 0] += 0.01
    assert stance_foot_drift(replace(motion, feet=feet, phases=phases)) == pytest.approx(0.01, abs=1e-6)


def test_a_sunken_foot_is_seen(stride: tuple[dict[str, float], Motion]) -> None:
    _, motion = stride
    feet = motion.feet.clone()
    feet[3, 1, 1] = -0.02
    assert motion_metrics(replace(motion, feet=feet))["min_foot_clearance"] == pytest.approx(-0.02)


@pytest.mark.parametrize("angle", [1e-6, 1e-3, 0.5])
def test_a_loop_that_does_not_close_is_measured_in_radians(
    stride: tuple[dict[str, float], Motion], angle: float
) -> None:
    _, motion = stride
    rotations = motion.clip.rotations.clone()
    rotations[-1, 3] = rotations[0, 3] @ axis_rotation("X", torch.tensor(angle, dtype=torch.float64))
    broken = replace(motion, clip=replace(motion.clip, rotations=rotations))
    assert loop_error(motion) < 1e-7
    assert loop_error(broken) == pytest.approx(angle, rel=1e-3, abs=1e-8)


def test_a_loop_that_drops_is_measured_in_metres(stride: tuple[dict[str, float], Motion]) -> None:
    _, motion = stride
    root = motion.clip.root_position.clone()
    root[-1, 1] -= 0.004
    broken = replace(motion, clip=replace(motion.clip, root_position=root))
    assert loop_error(broken) == pytest.approx(0.004, abs=1e-6)


@pytest.mark.parametrize("leg", ["left", "right"])
def test_the_legs_of_a_limp_are_told_apart(leg: str) -> None:
    problem = make_problem("speed=3.5", "beta=0.3", "limp.amount=0.3", f"limp.leg={leg}")
    m = run_metrics(problem, problem.ordinary_genes)
    sound = "right" if leg == "left" else "left"
    assert m[f"contact_time_{leg}"] == pytest.approx(0.7 * m[f"contact_time_{sound}"], rel=1e-6)
    assert m["contact_time"] == pytest.approx(0.5 * (m["contact_time_left"] + m["contact_time_right"]), rel=1e-9)
    # The body leans over the sound leg, left positive.
    assert math.copysign(1.0, m["trunk_side_deg"]) == (-1.0 if leg == "left" else 1.0)


def test_terms_and_both_forms_of_gamma_are_told() -> None:
    problem = make_problem("speed=5", "beta=0.5")
    genes = valid_genes(problem, 1, seed=11)
    m, trajectory = run_metrics(problem, genes[0]), problem.trajectory(genes)
    result = problem.evaluate(genes, with_grad=False)
    assert m["cost"] == float(result.cost)
    for name in ("energy_match", "leg_force", "style", "posture", "ordinary"):
        assert m[f"cost_{name}"] == float(result.terms[name])
    for form in ("smooth", "ratio"):
        gamma = costs.connectivity(trajectory, form, problem.settings.gamma_guard)
        assert m[f"gamma_{form}"] == pytest.approx(float(gamma))
    assert m["gamma"] == m["gamma_smooth"] != m["gamma_ratio"]
    assert m["step_width"] == pytest.approx(float(problem.table.decode(genes)["step_width"]))
    assert m["stance_leg_reach"] == float(trajectory.reach)
    assert m["arm_swing_deg"] == pytest.approx(math.degrees(float(costs.arm_swing(trajectory))))
    assert m["joint_limit_excess_deg"] == 0.0


def test_a_joint_beyond_its_range_is_told_in_degrees() -> None:
    problem = make_problem("speed=5", "beta=0.5", "character.joint_limits_deg.elbow=[0,40]")
    genes = problem.ordinary_genes
    column = [name for name, _, _ in JOINT_CHANNELS].index("left_elbow")
    angles = problem.trajectory(genes[None]).angles
    bent = math.degrees(float(angles[..., [column, column + 1]].max()))
    assert bent > 41.0
    assert run_metrics(problem, genes)["joint_limit_excess_deg"] == pytest.approx(bent - 40.0, rel=1e-6)


def test_ranges_and_means_of_the_frames(stride: tuple[dict[str, float], Motion]) -> None:
    _, motion = stride
    frames = len(motion.times)
    swing = torch.linspace(-0.2, 0.3, frames, dtype=torch.float64)
    com = torch.stack((2.0 * swing, swing, swing), dim=-1)
    angles = motion.angles | {"trunk": swing, "trunk_side": -0.5 * swing}
    force = torch.zeros_like(motion.leg_force)
    force[4, 1] = 3.25
    m = motion_metrics(replace(motion, com=com, angles=angles, leg_force=force))
    assert m["com_side_range"] == pytest.approx(1.0)
    # The last frame is the first of the next stride and counts only where a range is closed by it.
    assert m["com_oscillation"] == pytest.approx(0.5 * (frames - 2) / (frames - 1))
    assert m["trunk_lean_range_deg"] == pytest.approx(math.degrees(0.5))
    assert m["trunk_side_range_deg"] == pytest.approx(math.degrees(0.25))
    mean = float(swing[:-1].mean())
    assert m["trunk_lean_deg"] == pytest.approx(math.degrees(mean))
    assert m["trunk_side_deg"] == pytest.approx(math.degrees(0.5 * mean))
    assert m["peak_leg_force_bw"] == 3.25


def test_a_loop_that_walks_off_sideways_is_measured_too(stride: tuple[dict[str, float], Motion]) -> None:
    _, motion = stride
    root = motion.clip.root_position.clone()
    root[-1, 0] += 0.007
    root[-1, 2] += 5.0
    assert loop_error(replace(motion, clip=replace(motion.clip, root_position=root))) == pytest.approx(0.007, abs=1e-6)
