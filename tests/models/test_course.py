"""Runs along curves: on pinned feet, without a jump, leaning into the turn, back where they began on a closed one."""

from __future__ import annotations

import math
from functools import cache

import numpy as np
import pytest
import torch
from torch import Tensor

from hopdiff.geometry.curve import PlaneCurve, curve_through
from hopdiff.metrics import loop_error, stance_foot_drift
from hopdiff.models.course import run_along, turning_lean
from hopdiff.models.gait import Gait, stride_time
from hopdiff.motion import Motion
from tests.builders import make_problem, valid_genes

LEAN = math.radians(30.0)
KINDS = [("smooth", 0.0), ("smooth", 0.4), ("thesis", 0.0)]


def circle(length: float, turn: float = 2.0 * math.pi) -> PlaneCurve:
    """An arc to the left of a length [m] that turns by an angle; the whole circle is closed."""
    radius = length / turn
    angle = np.linspace(0.0, turn, 49)
    points = radius * np.stack((1.0 - np.cos(angle), np.sin(angle)), axis=-1)
    return curve_through(points, closed=turn == 2.0 * math.pi)


def gait_of(model: str, amount: float, seed: int = 4) -> Gait:
    problem = make_problem("speed=4", "beta=0.3", f"model={model}", f"limp.amount={amount}")
    return problem.gait(valid_genes(problem, 1, seed=seed))


@cache
def lap(model: str, amount: float) -> Motion:
    """Twenty strides round a circle of about 7 m radius."""
    gait = gait_of(model, amount)
    duration = 20 * float(stride_time(gait)[0])
    return run_along(gait, circle(4.0 * duration), 20, duration, 60.0, LEAN)


@pytest.mark.parametrize(("model", "amount"), KINDS)
def test_standing_feet_stay_where_they_are_and_swinging_ones_above_the_ground(model: str, amount: float) -> None:
    motion = lap(model, amount)
    assert stance_foot_drift(motion) < 1e-9
    assert float(motion.feet[..., 1].min()) > -1e-9
    for side in (0, 1):
        assert float(motion.feet[motion.contact[:, side], side, 1].abs().max()) < 1e-9


@pytest.mark.parametrize(("model", "amount"), KINDS[:2])
def test_a_closed_path_loops(model: str, amount: float) -> None:
    motion = lap(model, amount)
    root = motion.clip.root_position
    assert loop_error(motion) < 1e-8
    assert float((root[-1] - root[0]).abs().max()) < 1e-3  # what a spline through 48 points leaves of the circle


@pytest.mark.parametrize(("model", "amount"), KINDS)
def test_the_body_heads_along_the_tangent_and_leans_into_the_turn(model: str, amount: float) -> None:
    motion = lap(model, amount)
    clip = motion.clip
    radius = 4.0 * clip.duration / (2.0 * math.pi)
    heading = 2.0 * math.pi * motion.times / clip.duration
    # The trunk swings about heading and lean; over whole strides only these are left.
    trunk = clip.rotations[:, 0] @ clip.rotations[:, clip.skeleton.index("waist")]
    left = torch.stack((torch.cos(heading), torch.zeros_like(heading), -torch.sin(heading)), dim=-1)
    ahead = torch.stack((torch.sin(heading), torch.zeros_like(heading), torch.cos(heading)), dim=-1)
    up, forward = trunk[..., 1], trunk[..., 2]
    turned = torch.atan2((forward * left).sum(-1), (forward * ahead).sum(-1))[:-1]
    leant = torch.atan2((up * left).sum(-1), up[:, 1])[:-1]
    own = 0.0 if amount == 0 else 0.06  # a limper leans by himself
    assert float(turned.mean()) == pytest.approx(0.0, abs=0.03)
    assert float(leant.mean()) == pytest.approx(math.atan(16.0 / (9.81 * radius)), abs=0.02 + own)


def smoothest(values: Tensor, step: float) -> float:
    """Largest second difference [1/s^2]."""
    return float(torch.diff(values, n=2, dim=0).abs().max()) / step**2


def test_a_turn_adds_no_jerk_to_the_joints() -> None:
    problem = make_problem("speed=4", "beta=0.3")
    gait = problem.gait(problem.ordinary_genes.unsqueeze(0))
    duration = 6 * float(stride_time(gait)[0])
    straight, bent = (
        run_along(gait, curve, 6, duration, 240.0, LEAN)
        for curve in (curve_through([[0, 0], [0, 4.0 * duration]]), circle(4.0 * duration, turn=1.5))
    )
    for name, values in bent.angles.items():
        step = bent.clip.frame_time
        assert smoothest(values, step) < 1.1 * smoothest(straight.angles[name], step) + 10.0


def test_a_straight_path_is_the_straight_run() -> None:
    problem = make_problem("speed=4", "beta=0.3")
    genes = valid_genes(problem, 1, seed=4)
    gait = problem.gait(genes)
    duration = float(stride_time(gait)[0])
    wanted = problem.motion(genes[0], 60.0).clip
    found = run_along(gait, curve_through([[0, 0], [0, 4.0 * duration]]), 1, duration, 60.0, LEAN).clip
    torch.testing.assert_close(found.joint_positions(), wanted.joint_positions(), atol=1e-7, rtol=0.0)


def test_another_duration_is_stretched_in_time_only() -> None:
    gait = gait_of("smooth", 0.0)
    duration = 4 * float(stride_time(gait)[0])
    curve = circle(4.0 * duration, turn=1.0)
    motion = run_along(gait, curve, 4, 1.02 * duration, 60.0, LEAN)
    assert motion.clip.duration == pytest.approx(1.02 * duration)
    assert motion.phases[-1].end == pytest.approx(1.02 * duration)
    assert stance_foot_drift(motion) < 1e-9


def test_lean_is_limited_and_fades_in() -> None:
    curve = circle(20.0, turn=3.0)
    arc = torch.linspace(0.0, 20.0, 400, dtype=torch.float64)
    lean = turning_lean(curve, 10, 20.0 / 9.0, math.radians(15.0))(arc)
    assert float(lean.max()) == pytest.approx(math.radians(15.0), rel=1e-3)
    assert float(lean.min()) > 0.0
    assert float(lean[0]) < 0.6 * float(lean.max())


def test_a_leg_at_its_longest_lets_the_body_sink() -> None:
    """A run whose leg is all but straight still reaches footholds beside its straight places."""
    problem = make_problem("speed=4", "beta=0.3", "genes.fixed.leg_extension=0.99", "genes.fixed.step_width=0.12")
    gait = problem.gait(problem.ordinary_genes.unsqueeze(0))
    duration = 4 * float(stride_time(gait)[0])
    straight, bent = (
        run_along(gait, curve, 4, duration, 60.0, LEAN)
        for curve in (curve_through([[0, 0], [0, 4.0 * duration]]), circle(4.0 * duration, turn=2.5))
    )
    assert stance_foot_drift(bent) < 1e-9
    # Upright above its lean, HIP is lower than in the straight run.
    lean = turning_lean(circle(4.0 * duration, turn=2.5), 4, duration, LEAN)
    middle = len(bent.times) // 2
    arc = 4.0 * bent.times[middle : middle + 1]
    upright = float(bent.clip.root_position[middle, 1] / torch.cos(lean(arc)))
    assert 0.0005 < float(straight.clip.root_position[middle, 1]) - upright < 0.03
