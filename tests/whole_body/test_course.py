"""Whole-body runs along curves: on feet that roll without sliding, leaning into the turn, back where they began."""

from __future__ import annotations

import math
from functools import cache
from itertools import pairwise

import numpy as np
import pytest
import torch

from hopdiff.effort.metrics import standing_feet
from hopdiff.geometry.curve import PlaneCurve, curve_through
from hopdiff.models.course import turning_lean
from hopdiff.motion import Motion
from hopdiff.whole_body.course import Course
from hopdiff.whole_body.finish import stride_motion
from hopdiff.whole_body.gait import BodyGait
from tests.whole_body.bodies import SPEEDS, solved

LEAN = math.radians(30.0)
STRIDES = 10


def gait_of(name: str) -> BodyGait:
    found = solved(name)
    return BodyGait.of(found.movement, found.body)


def circle(length: float) -> PlaneCurve:
    """A closed circle to the left of a length [m]."""
    radius = length / (2.0 * math.pi)
    angle = np.linspace(0.0, 2.0 * math.pi, 49)
    return curve_through(radius * np.stack((1.0 - np.cos(angle), np.sin(angle)), axis=-1), closed=True)


@cache
def lap(name: str) -> Motion:
    """Ten strides round a circle of 3.5 to 4 m radius."""
    gait = gait_of(name)
    duration = STRIDES * float(gait.stride_time[0])
    curve = circle(SPEEDS[name] * duration)
    return Course(gait, curve, STRIDES, duration, turning_lean(curve, STRIDES, duration, LEAN)).motion(240.0)


def test_a_straight_line_is_the_straight_run() -> None:
    gait = gait_of("run")
    period = float(gait.stride_time[0])
    line = curve_through(np.array([[0.0, 0.0], [0.0, SPEEDS["run"] * period]]), closed=False)
    led = Course(gait, line, 1, period, torch.zeros_like).motion(120.0)
    straight = stride_motion(gait, 120.0)
    assert led.clip.frames == straight.clip.frames
    gap = led.clip.joint_positions() - straight.clip.joint_positions()
    assert float(gap.norm(dim=-1).amax()) < 1e-6
    assert torch.allclose(led.com, straight.com, atol=1e-6)
    assert led.force is not None
    assert straight.force is not None
    assert torch.allclose(led.force, straight.force, atol=1e-9)


@pytest.mark.parametrize("name", ["run", "limp"])
def test_feet_roll_without_sliding_and_stay_above_the_ground(name: str) -> None:
    motion = lap(name)
    assert standing_feet(motion)["foot_slip"] < 1e-4
    # Where the straight run is clear of the ground, so is this one, but for how softly feet are lifted.
    straight = lowest(stride_motion(gait_of(name), 240.0))
    assert lowest(motion) > min(straight, 0.0) - 1e-3


def lowest(motion: Motion) -> float:
    """The lowest that a heel or ball gets [m]."""
    skeleton = motion.clip.skeleton
    places, frames = motion.clip.forward()
    found = []
    for side in ("left", "right"):
        toe, ankle = skeleton.index(f"{side}_toe"), skeleton.index(f"{side}_ankle")
        heel = skeleton.offsets[toe] * torch.tensor([1.0, 1.0, -0.04 / 0.072], dtype=torch.float64)
        heels = places[:, ankle] + frames[:, ankle] @ heel
        found.append(float(torch.minimum(heels[:, 1], places[:, toe, 1]).min()))
    return min(found)


@pytest.mark.parametrize("name", ["run", "limp"])
def test_bones_keep_their_lengths_and_legs_reach_their_ankles(name: str) -> None:
    motion = lap(name)
    skeleton = motion.clip.skeleton
    assert motion.cop is not None
    places, frames = motion.clip.forward()
    for k, side in enumerate(("left", "right")):
        ankle, toe = skeleton.index(f"{side}_ankle"), skeleton.index(f"{side}_toe")
        standing = motion.contact[:, k]
        # The sole's point of contact, from the foot's own frame, is on the ground below the pressure.
        local = (frames[:, ankle].transpose(-1, -2) @ (motion.cop[:, k] - places[:, ankle]).unsqueeze(-1)).squeeze(-1)
        sole = skeleton.offsets[toe][1]
        assert float((local[standing, 1] - sole).abs().max()) < 0.08  # the foot pitches about its edges
        assert float(motion.cop[standing, k, 1].abs().max()) < 1e-12


def test_a_closed_path_loops_and_leans_inwards() -> None:
    motion = lap("run")
    places = motion.clip.joint_positions()
    assert float((places[-1] - places[0]).norm(dim=-1).max()) < 2e-3  # what a spline leaves of the circle
    radius = SPEEDS["run"] * STRIDES * float(gait_of("run").stride_time[0]) / (2.0 * math.pi)
    wanted = math.atan(SPEEDS["run"] ** 2 / (9.81 * radius))
    assert motion.force is not None
    # The ground force of a whole lap points inwards as far as the body leans.
    total = motion.force.sum(1)
    centre = torch.tensor([radius, 0.0, 0.0], dtype=torch.float64)
    inwards = (centre - motion.com) * torch.tensor([1.0, 0.0, 1.0], dtype=torch.float64)
    inwards = inwards / inwards.norm(dim=-1, keepdim=True)
    share = float((total[:-1] * inwards[:-1]).sum(-1).mean() / total[:-1, 1].mean())
    assert share == pytest.approx(math.tan(wanted), rel=0.05)


def test_nothing_jumps() -> None:
    motion = lap("run")
    places = motion.clip.joint_positions()
    step = (places[1:] - places[:-1]) / motion.clip.frame_time
    jump = (step[1:] - step[:-1]).norm(dim=-1)
    straight = stride_motion(gait_of("run"), 240.0)
    own = straight.clip.joint_positions()
    usual = ((own[2:] - 2.0 * own[1:-1] + own[:-2]) / straight.clip.frame_time).norm(dim=-1)
    assert float(jump.max()) < 2.0 * float(usual.max())


def test_phases_of_another_duration_are_stretched_with_it() -> None:
    gait = gait_of("run")
    own = 2.0 * float(gait.stride_time[0])
    line = curve_through(np.array([[0.0, 0.0], [0.0, 1.1 * SPEEDS["run"] * own]]), closed=False)
    for duration in (own, 1.1 * own):
        motion = Course(gait, line, 2, duration, torch.zeros_like).motion(120.0)
        assert motion.phases[0].start == 0.0
        assert motion.phases[-1].end == pytest.approx(duration)
        for before, after in pairwise(motion.phases):
            assert before.end == pytest.approx(after.start)
