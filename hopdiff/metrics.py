"""The numbers of a finished run."""

from __future__ import annotations

import math

import torch
from torch import Tensor

from hopdiff import costs, limits
from hopdiff.models.gait import stride_motion
from hopdiff.models.trajectory import Trajectory
from hopdiff.motion import Motion
from hopdiff.problem import RunProblem
from hopdiff.types import Status

MEASURING_FPS = 240.0  # dense enough that maxima between frames do not matter


def run_metrics(problem: RunProblem, genes: Tensor) -> dict[str, float]:
    """What one candidate (G,) of the unit box measures, in SI units unless a name ends in _deg or _bw.

    Of a limp, times of a step are means of both; contact_time_left and contact_time_right tell the legs apart.
    trunk_side_deg: mean lean of the trunk, to the left positive. knee_touchdown_deg: of the left leg; the other knee
    angles are the larger of both legs.
    """
    evaluation = problem.evaluate(genes.unsqueeze(0), with_grad=False)
    with torch.no_grad():
        trajectory = problem.trajectory(genes.unsqueeze(0))
    gait = problem.gait(genes.unsqueeze(0))
    motion = stride_motion(gait, MEASURING_FPS)
    left, right = gait.contact_times[0].tolist()
    terms = {name: float(value) for name, value in evaluation.terms.items()}
    step_time = float(costs.step_time(trajectory))
    guard = problem.settings.gamma_guard
    return {
        "speed": problem.speed,
        "beta": problem.beta,
        "froude": problem.froude,
        "leg_length": problem.character.leg_length,
        "cost": float(evaluation.cost),
        "eval": terms["eval"],
        "gamma": terms["gamma"],
        "gamma_smooth": float(costs.connectivity(trajectory, "smooth", guard)),
        "gamma_ratio": float(costs.connectivity(trajectory, "ratio", guard)),
        "energy_rate": terms["energy"],
        "energy_rate_raw": terms["energy_raw"],
        "energy_unit": problem.ordinary.energy_unit,
        "energy_target": costs.energy_target(problem.beta),
        **{f"cost_{term.name}": terms[term.name] for term in problem.terms if term.name != "eval"},
        "contact_time": float(trajectory.contact_time),
        "contact_time_left": left,
        "contact_time_right": right,
        "flight_time": float(trajectory.flight_time),
        "flight_share": float(trajectory.flight_time) / step_time,
        "step_frequency": 1.0 / step_time,
        "step_length": float(costs.step_length(trajectory)),
        "step_width": float(problem.table.decode(genes.unsqueeze(0))["step_width"]),
        "stride_time": 2.0 * step_time,
        "duty_factor": float(trajectory.contact_time) / (2.0 * step_time),
        **motion_metrics(motion),
        "arm_swing_deg": math.degrees(float(costs.arm_swing(trajectory))),
        "stance_leg_reach": float(trajectory.reach),
        "joint_limit_excess_deg": _joint_excess(problem, trajectory),
    }


def motion_metrics(motion: Motion) -> dict[str, float]:
    """What can be read off the finished frames alone."""
    knees = torch.stack((motion.angles["left_knee"], motion.angles["right_knee"]), dim=-1)
    height = motion.com[:-1, 1]
    return {
        "com_oscillation": float(height.max() - height.min()),
        "com_side_range": float(motion.com[:, 0].max() - motion.com[:, 0].min()),
        "peak_leg_force_bw": float(motion.leg_force.max()),
        "knee_touchdown_deg": math.degrees(float(knees[0, 0])),
        "knee_stance_max_deg": math.degrees(float(knees[motion.contact].max())),
        "knee_swing_max_deg": math.degrees(float(knees[~motion.contact].max())),
        "trunk_lean_deg": math.degrees(float(motion.angles["trunk"][:-1].mean())),
        "trunk_lean_range_deg": _range_deg(motion.angles["trunk"]),
        "trunk_side_deg": -math.degrees(float(motion.angles["trunk_side"][:-1].mean())),
        "trunk_side_range_deg": _range_deg(motion.angles["trunk_side"]),
        "stance_foot_drift": stance_foot_drift(motion),
        "min_foot_clearance": float(motion.feet[..., 1].min()),
        "loop_error": loop_error(motion),
    }


def _range_deg(angles: Tensor) -> float:
    return math.degrees(float(angles.max() - angles.min()))


def stance_foot_drift(motion: Motion) -> float:
    """Farthest that a standing foot gets from where it touched down [m]."""
    drift = 0.0
    for phase in motion.phases:
        if phase.kind == "stance":
            side = ("left", "right").index(phase.side)
            inside = (motion.times >= phase.start - 1e-9) & (motion.times <= phase.end + 1e-9)
            feet = motion.feet[inside, side]
            if len(feet):
                drift = max(drift, float((feet - feet[0]).norm(dim=-1).max()))
    return drift


def loop_error(motion: Motion) -> float:
    """Largest difference between first and last frame, travel aside: joint angles [rad] and root position [m]."""
    clip = motion.clip
    between = clip.rotations[0].transpose(-1, -2) @ clip.rotations[-1]
    # |R - R^T| / sqrt(8) is the sine of the angle, exact where the trace formula loses its digits.
    sine = (between - between.transpose(-1, -2)).flatten(1).norm(dim=-1) / math.sqrt(8.0)
    root = clip.root_position[-1] - clip.root_position[0]
    return max(float(torch.asin(sine.clamp(max=1.0)).max()), float(root[:2].abs().max()))


def _joint_excess(problem: RunProblem, trajectory: Trajectory) -> float:
    excess = limits.excesses(trajectory, problem.character, problem.settings.limits)
    return math.degrees(max(float(excess[Status.JOINT_LIMIT]) * limits.JOINT_LIMIT_SCALE, 0.0))
