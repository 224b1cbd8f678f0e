"""Legs without the rest of the body, and bent anew."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
import torch
from torch import Tensor

from hopdiff.editing.leg_joints import find_legs
from hopdiff.feet.reach import FOLD, FOLDED, unfolded
from hopdiff.feet.track import LegTrack, bent, leg_tracks
from hopdiff.geometry.clip import Clip
from hopdiff.geometry.rotation import axis_rotation
from tests.people import clip_of

CLIPS = ("walk", "walk without toes", "run", "walk_straight_cmu_16_15", "walk_straight_snu_30hz")
EYE = torch.eye(3, dtype=torch.float64)


def tracks_of(clip: Clip) -> list[LegTrack]:
    return leg_tracks(clip, find_legs(clip.skeleton))


def moved(clip: Clip, track: LegTrack, ankle: Tensor) -> Clip:
    """The clip with one leg led to other places, its foot as it was."""
    rotations = clip.rotations.double().clone()
    bent(track, rotations, EYE, track.hip, ankle, track.foot, track.toe)
    return replace(clip, rotations=rotations)


@pytest.mark.parametrize("name", CLIPS)
def test_legs_are_where_the_whole_body_has_them(name: str) -> None:
    clip = clip_of(name)
    places, frames = (one.double() for one in clip.forward())
    for track in tracks_of(clip):
        leg = track.leg
        torch.testing.assert_close(track.hip, places[:, leg.hip])
        torch.testing.assert_close(track.knee, places[:, leg.knee])
        torch.testing.assert_close(track.lower, frames[:, leg.knee])
        if leg.ankle is not None:
            torch.testing.assert_close(track.ankle, places[:, leg.ankle])
        if leg.toe is not None:
            torch.testing.assert_close(track.ball, places[:, leg.toe])
            torch.testing.assert_close(track.toe, frames[:, leg.toe])


@pytest.mark.parametrize("name", CLIPS)
def test_a_leg_asked_to_stay_stays(name: str) -> None:
    clip = clip_of(name)
    for track in tracks_of(clip):
        assert (moved(clip, track, track.ankle).rotations - clip.rotations).abs().max() < 1e-6


@pytest.mark.parametrize("name", CLIPS)
def test_an_ankle_within_reach_is_reached_and_bones_keep_their_lengths(name: str) -> None:
    clip = clip_of(name)
    for track in tracks_of(clip):
        # Nearer to the hip and aside; a straight leg may miss by what it takes to bend without a jerk.
        line = track.ankle - track.hip
        goal = track.hip + 0.9 * line + torch.tensor([0.03, 0.0, 0.02], dtype=torch.float64)
        after = moved(clip, track, goal)
        found = next(one for one in tracks_of(after) if one.leg == track.leg)
        assert (found.ankle - goal).norm(dim=-1).max() < 3e-3
        torch.testing.assert_close(found.length, track.length)
        if track.foot is not None and found.foot is not None:
            assert (found.foot - track.foot).abs().max() < 1e-6


def test_an_ankle_out_of_reach_is_aimed_at() -> None:
    clip = clip_of("walk")
    track = tracks_of(clip)[0]
    far = track.hip + 3.0 * (track.ankle - track.hip)
    found = tracks_of(moved(clip, track, far))[0]
    assert found.span.min() > 1.0 - 1e-6
    across = torch.nn.functional.normalize(far - track.hip, dim=-1)
    assert ((found.ankle - found.hip) / found.length[:, None] - across).norm(dim=-1).max() < 1e-3


def straight_leg(noise: float) -> tuple[Clip, LegTrack]:
    """A walk whose left leg is all but straight, the knee a little before or behind the line in turns."""
    clip = clip_of("walk")
    track = tracks_of(clip)[0]
    rotations = clip.rotations.double().clone()
    frames = torch.arange(clip.frames, dtype=torch.float64)
    bend = noise * torch.sin(1.7 * frames)
    rotations[:, track.leg.knee] = axis_rotation("X", 0.4 * torch.ones_like(bend))
    half = clip.frames // 2
    rotations[half:, track.leg.knee] = axis_rotation("X", bend[half:])
    shaken = replace(clip, rotations=rotations)
    return shaken, tracks_of(shaken)[0]


@pytest.mark.parametrize("noise", [math.radians(0.5), math.radians(2.0)])
def test_a_knee_does_not_pop_where_a_leg_is_so_straight_that_its_bend_is_noise(noise: float) -> None:
    clip, track = straight_leg(noise)
    half = clip.frames // 2
    goal = track.hip + 0.97 * (track.ankle - track.hip)
    found = tracks_of(moved(clip, track, goal))[0]
    way = (found.knee - found.hip) / found.length[:, None]
    own = (track.knee - track.hip) / track.length[:, None]
    jumps = (way.diff(dim=0).norm(dim=-1) - own.diff(dim=0).norm(dim=-1))[half:]
    assert float(jumps.max()) < 0.02
    # Bent forward, as the leg is bent in the other half of the clip.
    forward = track.upper[:, :, 2]
    line = torch.nn.functional.normalize(found.ankle - found.hip, dim=-1)
    out = (found.knee - found.hip) - ((found.knee - found.hip) * line).sum(-1, keepdim=True) * line
    assert float((out * forward).sum(-1)[half:].min()) > 0.0


@pytest.mark.parametrize("name", CLIPS)
def test_a_knee_is_bent_by_the_angle_between_its_bones(name: str) -> None:
    for track in tracks_of(clip_of(name)):
        thigh, shank = track.knee - track.hip, track.ankle - track.knee
        angle = torch.atan2(torch.linalg.cross(thigh, shank).norm(dim=-1), (thigh * shank).sum(-1))
        far = (track.ankle - track.hip).norm(dim=-1)
        torch.testing.assert_close(track.flexion(far), angle, atol=2e-6, rtol=0.0)
        torch.testing.assert_close(track.distance(angle), far)


def test_a_leg_folds_no_further_than_a_heel_gets_to_the_body() -> None:
    (track, _) = tracks_of(clip_of("walk"))
    for share in (1.0, 0.7, FOLDED, 0.4, 0.2, 0.0):
        wish = share * track.length
        found = unfolded(track, wish)
        if share >= FOLDED:
            torch.testing.assert_close(found, wish)
        assert (found >= wish - 1e-12).all()
        # Unless the clip itself folds it further.
        assert (found >= (torch.minimum(track.span, torch.tensor(FOLDED)) - FOLD) * track.length).all()
