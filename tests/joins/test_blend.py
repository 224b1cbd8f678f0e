"""Poses at seams: exact there, the walk's own after a while, and no jerk in between."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
import torch

from hopdiff.editing.leg_joints import find_legs
from hopdiff.geometry.clip import Clip
from hopdiff.geometry.rotation import axis_rotation
from hopdiff.joins.blend import LONGEST, SHORTEST, blend_time, blended, reversed_clip
from tests.joins.neighbours import rise, walk
from tests.people import body


def turning(rate: float, start: float, frames: int = 61) -> Clip:
    """A body that stands, whose left arm turns at a rate [rad/s]."""
    skeleton = body()
    rotations = torch.eye(3, dtype=torch.float64).repeat(frames, len(skeleton.names), 1, 1)
    angles = start + rate * torch.arange(frames, dtype=torch.float64) / 30.0
    rotations[:, skeleton.index("LeftArm")] = axis_rotation("Z", angles)
    root = torch.tensor([0.0, 1.0, 0.0], dtype=torch.float64).expand(frames, 3)
    return Clip(skeleton, root, rotations, 1.0 / 30.0)


def angle(clip: Clip) -> torch.Tensor:
    turn = clip.rotations[:, clip.skeleton.index("LeftArm")]
    return torch.atan2(turn[:, 1, 0], turn[:, 0, 0])


@pytest.mark.parametrize(("rate", "before"), [(0.0, 0.0), (0.0, 0.6), (0.5, -0.4), (-0.3, 0.2)])
def test_an_angle_goes_over_by_the_polynomial_that_keeps_place_and_speed(rate: float, before: float) -> None:
    """The closed form: x0 (1 - 10 s^3 + 15 s^4 - 6 s^5), s from 0 to 1 in the time of the blend, and
    v0 T (t - 6 t^3 + 8 t^4 - 3 t^5), t from 0 to 1 in T = .4 s."""
    seconds, quick, own = 1.0, 0.4, 0.2
    ahead, sooner = turning(own, 0.1), turning(rate, 0.1 + before)
    made = angle(blended(ahead, sooner, seconds))
    s, t = ((torch.arange(61, dtype=torch.float64) / 30.0 / time).clamp_max(1.0) for time in (seconds, quick))
    x0 = float(angle(sooner)[-1]) - 0.1
    expected = x0 * (1 - 10 * s**3 + 15 * s**4 - 6 * s**5)
    expected = expected + (rate - own) * quick * (t - 6 * t**3 + 8 * t**4 - 3 * t**5)
    assert (made - angle(ahead) - expected).abs().max() < 1e-9


@pytest.mark.parametrize("legs", [True, False])
def test_the_walk_begins_in_the_last_pose_and_is_itself_again(legs: bool) -> None:
    ahead, before = walk(), rise()
    made = blended(ahead, before, 0.8, find_legs(ahead.skeleton) if legs else ())
    assert torch.equal(made.root_position[0], before.root_position[-1])
    assert torch.equal(made.rotations[0], before.rotations[-1])
    assert (made.rotations[25:] - ahead.rotations[25:]).abs().max() < 1e-9
    assert (made.root_position[25:] - ahead.root_position[25:]).abs().max() < 1e-12
    whole = torch.cat((before.joint_positions(), made.joint_positions()[1:]))
    own = max(float(one.joint_positions().diff(n=2, dim=0).norm(dim=-1).max()) for one in (ahead, before))
    seam = before.frames - 1
    assert float(whole.diff(n=2, dim=0)[seam - 2 : seam + 25].norm(dim=-1).max()) < 1.2 * own


def test_feet_do_not_sink_on_their_way_over() -> None:
    ahead, before = walk(), rise()
    made = blended(ahead, before, 0.8, find_legs(ahead.skeleton))
    for name in ("LeftFoot", "RightFoot", "LeftToeBase", "RightToeBase"):
        at = ahead.skeleton.index(name)
        low = min(float(one.joint_positions()[:, at, 1].min()) for one in (ahead, before))
        assert float(made.joint_positions()[:, at, 1].min()) > low - 2e-3


def test_the_time_of_a_blend_goes_with_what_is_to_be_made_good() -> None:
    ahead = walk()
    last = ahead.part(slice(0, 5))
    assert blend_time(ahead, reversed_clip(reversed_clip(last)).part(slice(0, 1)), 0) >= SHORTEST
    times = []
    for lift in (0.0, 0.3, 0.8):
        higher = replace(last, root_position=last.root_position[:1].expand(5, 3) + torch.tensor([0.0, lift, 0.0]))
        times.append(blend_time(ahead, replace(higher, rotations=last.rotations[:1].expand_as(last.rotations)), 0))
    assert SHORTEST <= times[0] <= times[1] < times[2] <= LONGEST


def test_reversing_twice_is_nothing() -> None:
    clip = walk(2.0)
    again = reversed_clip(reversed_clip(clip))
    assert torch.equal(again.rotations, clip.rotations)
    assert torch.equal(reversed_clip(clip).root_position[0], clip.root_position[-1])
    assert math.isclose(reversed_clip(clip).duration, clip.duration)
