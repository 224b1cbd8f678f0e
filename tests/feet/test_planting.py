"""Contacts found, and feet that stand as still after an edit as before it."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache

import pytest
import torch

from hopdiff.editing.leg_joints import find_legs
from hopdiff.editing.loop import repeated
from hopdiff.editing.root_path import RootPath, root_path, with_root_path
from hopdiff.editing.targets import Constraint, edit_path
from hopdiff.feet.contacts import Contacts, contact_points, find_contacts, leg_length, slide_numbers, spans
from hopdiff.feet.planting import LOWEST, clean_feet
from hopdiff.feet.reach import REACH
from hopdiff.geometry.clip import Clip
from tests.editing.walks import stride, stride_motion
from tests.people import RUN, WALK, Gait, clip_of

CAPTURED = ("walk_straight_cmu_07_01", "walk_straight_cmu_16_15", "walk_straight_snu_30hz", "run_cmu_16_35")
MADE = ("walk", "walk without toes", "walk sideways", "run")
CLIPS = ("own", *MADE, *CAPTURED)
TURNS = (("aside", None), ("same place", 90.0), ("aside", 90.0), ("back", 180.0))


@cache
def own_run() -> Clip:
    return repeated(stride(), 6)


@cache
def sliding_run() -> Clip:
    """The same on a floor that carries it to the left at 0.2 m/s, and its feet with it."""
    clip = own_run()
    root = clip.root_position.clone()
    root[:, 0] += 0.2 * clip.frame_time * torch.arange(clip.frames)
    return replace(clip, root_position=root)


def source(name: str) -> Clip:
    return own_run() if name == "own" else clip_of(name)


def contacts_of(clip: Clip) -> Contacts:
    return find_contacts(clip, find_legs(clip.skeleton))


def wish(path: RootPath, where: str, turn: float | None) -> Constraint:
    way = path.place[-1] - path.place[0]
    left = torch.stack((way[1], -way[0]))
    place = {"aside": path.place[-1] + 0.2 * left, "same place": path.place[-1], "back": path.place[0] + 0.5 * left}[
        where
    ]
    yaw = None if turn is None else float(path.yaw[-1]) + math.radians(turn)
    return Constraint(path.frames - 1, (float(place[0]), float(place[1])), yaw, keep=turn is None)


def edited(clip: Clip, where: str, turn: float | None) -> Clip:
    path = root_path(clip)
    return with_root_path(clip, path, edit_path(path, [wish(path, where, turn)], clip.frame_time).path)


def difference(a: Clip, b: Clip) -> float:
    return max(float((a.rotations - b.rotations).abs().max()), float((a.root_position - b.root_position).abs().max()))


def fastest(clip: Clip) -> float:
    """Largest angular speed of any joint [rad/s]."""
    between = clip.rotations[:-1].transpose(-1, -2) @ clip.rotations[1:]
    cosine = 0.5 * (between.diagonal(dim1=-2, dim2=-1).sum(-1) - 1.0)
    return float(torch.acos(cosine.clamp(-1.0, 1.0)).max()) / clip.frame_time


def test_contacts_of_a_run_of_our_own_are_its_stances() -> None:
    clip, contacts = own_run(), contacts_of(own_run())
    assert contacts.names == ("left foot", "right foot")
    numbers = slide_numbers(clip, contacts)
    assert numbers["slide_speed"] < 0.05
    assert numbers["drift"] < 0.02
    motion = stride_motion()
    intervals = len(motion.times) - 1
    stances = torch.cat([motion.contact[:-1]] * 6 + [motion.contact[-1:]])
    assert len(stances) == 6 * intervals + 1
    agree = contacts.touching == stances
    assert float(agree.double().mean()) > 0.93


@pytest.mark.parametrize(
    ("name", "plants", "share"),
    [
        ("walk", [6, 7], 0.95),
        ("run", [4, 3], 0.6),
        ("walk_straight_cmu_16_15", [4, 4], 0.95),
        ("run_cmu_16_35", [2, 2], 0.3),
    ],
)
def test_contacts_are_the_steps(name: str, plants: list[int], share: float) -> None:
    contacts = contacts_of(clip_of(name))
    assert contacts.names == ("left heel", "left toe", "right heel", "right toe")
    assert [len(contacts.plants(leg)) for leg in (0, 1)] == plants
    assert float(contacts.touching.any(dim=-1).double().mean()) >= share


@pytest.mark.parametrize(("name", "gait"), [("walk", WALK), ("run", RUN)])
def test_contacts_last_as_long_as_feet_are_made_to_stand(name: str, gait: Gait) -> None:
    contacts = contacts_of(clip_of(name))
    frames = gait.duty * gait.stride * 120.0
    for leg in (0, 1):
        for first, last in contacts.plants(leg)[1:-1]:
            assert last - first + 1 == pytest.approx(frames, abs=3)


@pytest.mark.parametrize("name", ["walk", "walk_straight_cmu_16_15"])
def test_the_frame_rate_does_not_change_the_contacts(name: str) -> None:
    fast = clip_of(name)
    slow = replace(
        fast, root_position=fast.root_position[::4], rotations=fast.rotations[::4], frame_time=4.0 * fast.frame_time
    )
    both = contacts_of(fast).touching[::4] == contacts_of(slow).touching
    assert float(both.double().mean()) > 0.93


def test_spans_are_runs_of_true() -> None:
    flags = torch.tensor([True, True, False, True, False, False, True])
    assert list(spans(flags)) == [(0, 1), (3, 3), (6, 6)]
    assert list(spans(torch.zeros(4, dtype=torch.bool))) == []


@pytest.mark.parametrize("name", CLIPS)
def test_without_an_edit_nothing_is_cleaned(name: str) -> None:
    clip = source(name)
    contacts = contacts_of(clip)
    assert difference(clean_feet(clip, clip, contacts).clip, clip) < 1e-6


@pytest.mark.parametrize(("where", "turn"), TURNS)
@pytest.mark.parametrize("name", CLIPS)
def test_feet_stand_as_still_as_in_the_source(name: str, where: str, turn: float | None) -> None:
    clip = source(name)
    contacts = contacts_of(clip)
    moved = edited(clip, where, turn)
    ends = (0, clip.frames - 1)
    clean = clean_feet(clip, moved, contacts).clip
    own, before, after = (slide_numbers(c, contacts) for c in (clip, moved, clean))
    assert before["slide_speed"] > own["slide_speed"] + 0.005
    assert after["slide_speed"] < own["slide_speed"] + 0.02
    assert after["drift"] < own["drift"] + 0.01
    assert after["foot_depth"] < max(0.005, own["foot_depth"] + 1e-3)
    assert fastest(clean) < 1.5 * fastest(clip)
    for frame in ends:
        assert (clean.rotations[frame] - moved.rotations[frame]).abs().max() < 1e-6
        assert (clean.root_position[frame] - moved.root_position[frame]).abs().max() < 1e-9
    # Only legs move, and the root up and down.
    legs = {joint for leg in contacts.legs for joint in (leg.hip, leg.knee, leg.ankle, leg.toe) if joint is not None}
    others = [joint for joint in range(len(clip.skeleton.names)) if joint not in legs]
    assert torch.equal(clean.rotations[:, others], moved.rotations[:, others])
    assert torch.equal(clean.root_position[:, [0, 2]], moved.root_position[:, [0, 2]])


@pytest.mark.parametrize("name", CLIPS)
def test_cleaning_again_changes_nothing(name: str) -> None:
    clip = source(name)
    contacts = contacts_of(clip)
    moved = edited(clip, "aside", 90.0)
    once = clean_feet(clip, moved, contacts).clip
    assert difference(clean_feet(clip, once, contacts).clip, once) < 2e-6


@pytest.mark.parametrize(
    ("name", "quicker"),
    [("own", 1.1), ("walk", 1.2), ("run", 1.15), ("walk_straight_cmu_07_01", 1.1), ("run_cmu_16_35", 1.1)],
)
def test_a_bound_frame_next_to_a_contact_does_not_make_the_foot_jump(name: str, quicker: float) -> None:
    clip = source(name)
    contacts, path = contacts_of(clip), root_path(clip)
    last = clip.frames - 1
    end = (float(path.place[-1, 0]) + 0.6, float(path.place[-1, 1]))
    beside = [
        frame
        for leg in (0, 1)
        for begun, ended in contacts.plants(leg)
        for frame in (begun - 1, ended + 1)
        if 0.25 * clip.frames < frame < 0.7 * clip.frames
    ]
    assert beside
    for frame in beside:
        place = path.place[frame] + torch.tensor([0.15, 0.1], dtype=torch.float64)
        bound = Constraint(frame, (float(place[0]), float(place[1])), keep=True)
        solved = edit_path(path, [bound, Constraint(last, end, keep=True)], clip.frame_time)
        moved = with_root_path(clip, path, solved.path)
        clean = clean_feet(clip, moved, contacts).clip
        assert torch.equal(clean.root_position[:, [0, 2]], moved.root_position[:, [0, 2]])
        assert fastest(clean) < quicker * fastest(clip)
        assert slide_numbers(clean, contacts)["drift"] < slide_numbers(clip, contacts)["drift"] + 0.015


@pytest.mark.parametrize("name", ["own", "walk_straight_snu_30hz"])
def test_a_leg_that_is_too_short_lowers_the_root_for_a_while(name: str) -> None:
    clip = source(name)
    contacts = contacts_of(clip)
    path = root_path(clip)
    far = path.place[0] + 1.4 * (path.place[-1] - path.place[0])
    bound = Constraint(clip.frames - 1, (float(far[0]), float(far[1])), keep=True)
    moved = with_root_path(clip, path, edit_path(path, [bound], clip.frame_time).path)
    clean = clean_feet(clip, moved, contacts).clip
    lowered = (moved.root_position - clean.root_position)[:, 1]
    assert 0.01 < float(lowered.max()) <= LOWEST
    assert float(lowered.min()) > -1e-9
    assert float(lowered.diff().abs().max()) / clip.frame_time < 1.0


@pytest.mark.parametrize("name", [*MADE[:2], *CAPTURED[1:3]])
def test_feet_that_slide_in_the_source_can_be_held_too(name: str) -> None:
    clip = source(name)
    contacts = contacts_of(clip)
    ends = (0, clip.frames - 1)
    still = clean_feet(clip, clip, contacts, still=True).clip
    before, after = slide_numbers(clip, contacts), slide_numbers(still, contacts)
    assert after["slide_speed"] < 0.75 * before["slide_speed"]
    assert fastest(still) < 1.5 * fastest(clip)
    for frame in ends:
        assert (still.rotations[frame] - clip.rotations[frame]).abs().max() < 1e-6


def test_a_foot_does_in_a_contact_what_it_did_turned_by_the_mean_and_where_it_was_led() -> None:
    """One turn and shift for all frames of a contact: the means of what the edit does to its frames."""
    clip = sliding_run()
    contacts = contacts_of(clip)
    moved = edited(clip, "same place", 90.0)
    clean = clean_feet(clip, moved, contacts).clip
    turn = root_path(moved).yaw - root_path(clip).yaw
    ground = [torch.complex(p[..., 2], p[..., 0]) for p in (contact_points(c, contacts) for c in (clip, moved, clean))]
    source, led, found = ground
    turned = 0.0
    for leg in (0, 1):
        # Those at the ends of the clip stand where these say.
        for first, last in contacts.plants(leg)[1:-1]:
            here = slice(first, last + 1)
            own = source[here, leg] - source[here, leg].mean()
            mean = turn[here].mean()
            wanted = led[here, leg].mean() + torch.polar(torch.ones_like(mean), mean) * own
            assert float((found[here, leg] - wanted).abs().max()) < 1e-5
            turned = max(turned, float((turn[first] - mean).abs() * own.abs().max()))
    # What the first frame's turn would put elsewhere.
    assert turned > 1e-4


@pytest.mark.parametrize("end", [0, -1])
def test_the_ends_of_a_clip_say_where_their_feet_stand(end: int) -> None:
    whole = sliding_run()
    plants = contacts_of(whole).plants(0)
    first, last = plants[1 if end == 0 else -2]
    middle = (first + last) // 2
    here = slice(middle, None) if end == 0 else slice(None, middle + 1)
    clip = replace(whole, root_position=whole.root_position[here], rotations=whole.rotations[here])
    contacts = contacts_of(clip)
    moved = edited(clip, "same place", 90.0)
    clean = clean_feet(clip, moved, contacts).clip
    assert (clean.rotations[end] - moved.rotations[end]).abs().max() < 1e-6
    before, led, found = (
        torch.complex(p[:, 0, 2], p[:, 0, 0]) for p in (contact_points(c, contacts) for c in (clip, moved, clean))
    )
    turn = (root_path(moved).yaw - root_path(clip).yaw)[end]
    first, last = contacts.plants(0)[end]
    stands = slice(first, last + 1)
    wanted = led[end] + torch.polar(torch.ones_like(turn), turn) * (before[stands] - before[end])
    assert last - first > 5
    assert float((found[stands] - wanted).abs().max()) < 1e-5


def test_feet_that_a_moving_floor_carries_are_held_if_that_is_asked() -> None:
    clip = sliding_run()
    contacts = contacts_of(clip)
    still = clean_feet(clip, clip, contacts, still=True).clip
    before, after = slide_numbers(clip, contacts), slide_numbers(still, contacts)
    assert before["slide_speed"] == pytest.approx(0.2, abs=0.02)
    assert after["slide_speed"] < 0.02
    assert after["drift"] < 0.005
    # In each contact a foot stands where it was on average.
    own, held = (contact_points(c, contacts)[..., [0, 2]] for c in (clip, still))
    for leg in (0, 1):
        for first, last in contacts.plants(leg)[1:-1]:
            here = slice(first, last + 1)
            assert (own[here, leg].mean(dim=0) - held[here, leg].mean(dim=0)).norm() < 1e-4
    assert difference(clean_feet(clip, clip, contacts).clip, clip) < 1e-6


def test_a_root_sinks_only_as_far_as_its_legs_are_too_short() -> None:
    """Feet 60 cm apart sideways from where the hips are led: the root sinks around the contacts, and slowly."""
    clip = own_run()
    contacts = contacts_of(clip)
    path = root_path(clip)
    count = clip.frames
    wave = 0.25 * torch.sin(torch.linspace(0.0, 40.0, count, dtype=torch.float64))
    moved = with_root_path(clip, path, RootPath(path.place + torch.stack((wave, 0.0 * wave), dim=-1), path.yaw))
    clean = clean_feet(clip, moved, contacts).clip
    lowered = (clip.root_position - clean.root_position)[:, 1]
    assert float(lowered.min()) > -1e-9
    assert 0.005 < float(lowered.max()) < 0.2
    assert float(lowered.diff().abs().max()) / clip.frame_time < 1.5
    assert torch.equal(clean.root_position[:, [0, 2]], moved.root_position[:, [0, 2]])
    # Standing feet are where they should be, and no leg is longer than it is.
    assert slide_numbers(clean, contacts)["drift"] < slide_numbers(clip, contacts)["drift"] + 5e-3
    positions = clean.joint_positions()
    for k, leg in enumerate(contacts.legs):
        reach = (contact_points(clean, contacts)[:, k] - positions[:, leg.hip]).norm(dim=-1)
        own = (contact_points(clip, contacts)[:, k] - clip.joint_positions()[:, leg.hip]).norm(dim=-1)
        assert float((reach - torch.maximum(own, torch.tensor(REACH * leg_length(clip, leg)))).max()) < 4e-3
    # Nothing sinks that need not.
    flat = with_root_path(clip, path, RootPath(path.place + torch.tensor([3.0, 1.0]), path.yaw))
    assert torch.equal(clean_feet(clip, flat, contacts).clip.root_position, flat.root_position)


def standing_still(seconds: float) -> Clip:
    """Somebody who stands for a while in the middle of a walk."""
    clip = clip_of("walk")
    middle = clip.frames // 2
    count = round(seconds / clip.frame_time)
    order = torch.cat((torch.full((count,), middle), torch.full((1,), middle)))
    return replace(clip, root_position=clip.root_position[order], rotations=clip.rotations[order])


def test_who_stands_and_has_to_go_elsewhere_makes_steps() -> None:
    clip = standing_still(4.0)
    contacts = contacts_of(clip)
    path = root_path(clip)
    shift = torch.linspace(0.0, 1.5, clip.frames, dtype=torch.float64)
    moved = with_root_path(clip, path, RootPath(path.place + torch.stack((shift, 0.0 * shift), dim=-1), path.yaw))
    planted = clean_feet(clip, moved, contacts)
    steps = [len(list(spans(planted.touching[:, k]))) for k in (0, 1)]
    stood = [len(contacts.plants(k)) for k in (0, 1)]
    feet = [k for k in (0, 1) if stood[k]]
    assert feet
    assert all(steps[k] > stood[k] for k in feet)
    # Never both feet at once, and each of them lifted and set down again, not slid.
    if len(feet) == 2:
        assert bool(planted.touching.any(dim=-1).all())
    points = contact_points(planted.clip, contacts)
    for p, (leg, _) in enumerate(contacts.points):
        for first, last in spans(planted.touching[:, leg] & contacts.touching[:, p]):
            if first > 0 and last < clip.frames - 1:
                drift = (points[first : last + 1, p] - points[first, p])[:, [0, 2]].norm(dim=-1)
                assert float(drift.max()) < 0.01


def test_what_cannot_be_reached_is_given_up_and_the_body_does_not_fall() -> None:
    clip = clip_of("walk")
    contacts, path = contacts_of(clip), root_path(clip)
    far = path.place[0] + 1.8 * (path.place[-1] - path.place[0])
    bound = Constraint(clip.frames - 1, (float(far[0]), float(far[1])), keep=True)
    moved = with_root_path(clip, path, edit_path(path, [bound], clip.frame_time).path)
    planted = clean_feet(clip, moved, contacts)
    assert bool(planted.given_up.any())
    assert float(planted.lowered.max()) <= LOWEST
    assert fastest(planted.clip) < 5.0 * fastest(clip)
