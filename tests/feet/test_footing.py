"""Feet on slopes, stairs and in the air above them."""

from __future__ import annotations

import math

import pytest
import torch

from hopdiff.editing.leg_joints import find_legs
from hopdiff.editing.root_path import root_path, with_root_path
from hopdiff.editing.targets import Constraint, edit_path
from hopdiff.feet.contacts import Contacts, contact_points, find_contacts
from hopdiff.feet.planting import Planted, clean_feet
from hopdiff.geometry.clip import Clip
from hopdiff.grounds import build_ground
from hopdiff.terrain.ground import Ground
from tests.people import clip_of

CLIPS = ("walk", "walk_straight_cmu_16_15", "walk_straight_snu_30hz")


def rising(clip: Clip, kind: str, before: float = 0.8, **more: float) -> Ground:
    """A ground that rises where a clip goes, some metres after its start."""
    path = root_path(clip)
    way = path.place[-1] - path.place[0]
    start = path.place[0] + before * way / way.norm()
    heading = math.degrees(math.atan2(float(way[0]), float(way[1])))
    return build_ground({"kind": kind, "start": start.tolist(), "heading": heading, **more})


def walked(clip: Clip, ground: Ground, share: float) -> tuple[Contacts, Planted]:
    """A clip led along a share of its way on a ground."""
    contacts, path = find_contacts(clip, find_legs(clip.skeleton)), root_path(clip)
    end = path.place[0] + share * (path.place[-1] - path.place[0])
    bound = Constraint(clip.frames - 1, (float(end[0]), float(end[1])), keep=True)
    after = edit_path(path, [bound], clip.frame_time).path
    return contacts, clean_feet(clip, with_root_path(clip, path, after), contacts, ground)


def heights(clip: Clip, contacts: Contacts, planted: Planted, ground: Ground) -> torch.Tensor:
    """How much higher than in the source standing points are over the ground [m]."""
    points, own = contact_points(planted.clip, contacts), contact_points(clip, contacts)
    stands = contacts.touching & planted.touching[:, [leg for leg, _ in contacts.points]]
    over = points[..., 1] - ground.height(points[..., [0, 2]])
    return (over - own[..., 1])[stands]


@pytest.mark.parametrize("angle", [-10.0, 10.0, 20.0])
@pytest.mark.parametrize("name", CLIPS)
def test_feet_stand_on_a_slope(name: str, angle: float) -> None:
    clip = clip_of(name)
    ground = rising(clip, "slope", angle=angle, length=None)
    contacts, planted = walked(clip, ground, 0.7)
    off = heights(clip, contacts, planted, ground)
    assert float(off.quantile(0.95)) < (0.012 if abs(angle) < 15 else 0.025)
    assert float(off.min()) > -0.015
    rose = float(planted.clip.root_position[-1, 1] - clip.root_position[-1, 1])
    place = planted.clip.root_position[-1:, [0, 2]].double()
    assert rose == pytest.approx(float(ground.height(place)), abs=0.12)
    # The first pose is on level ground, and stays.
    assert (planted.clip.rotations[0] - clip.rotations[0]).abs().max() < 1e-6


@pytest.mark.parametrize("rise", [-0.17, 0.17])
@pytest.mark.parametrize("name", CLIPS)
def test_stairs_are_stepped_on_treads_and_not_through_their_edges(name: str, rise: float) -> None:
    clip = clip_of(name)
    ground = rising(clip, "stairs", rise=rise, run=0.29, steps=12)
    contacts, planted = walked(clip, ground, 0.45)
    points = contact_points(planted.clip, contacts)
    over = points[..., 1] - ground.height(points[..., [0, 2]])
    own = contact_points(clip, contacts)[..., 1] - contacts.heights()
    # No point of a foot is deeper in the stairs than it is in the floor of the clip, standing or not.
    floor = contacts.floor
    assert float((over - floor - own.clamp_max(0.0)).min()) > -0.03
    # A contact is on one tread with the point that it is on first.
    stands = contacts.touching & planted.touching[:, [leg for leg, _ in contacts.points]]
    levels = ground.height(points[..., [0, 2]])
    for k in range(len(contacts.legs)):
        for first, last in contacts.plants(k):
            point = next(i for i, (leg, _) in enumerate(contacts.points) if leg == k)
            found = levels[first : last + 1, point][stands[first : last + 1, point]]
            assert len(found.unique()) <= 1
    climbed = float(planted.clip.root_position[-1, 1] - clip.root_position[-1, 1])
    assert abs(climbed) > 2 * 0.17
    assert math.copysign(1.0, climbed) == math.copysign(1.0, rise)


def test_level_ground_changes_nothing() -> None:
    clip = clip_of("walk")
    contacts = find_contacts(clip, find_legs(clip.skeleton))
    plain, on_flat = clean_feet(clip, clip, contacts), clean_feet(clip, clip, contacts, build_ground({"kind": "flat"}))
    assert torch.equal(plain.clip.rotations, on_flat.clip.rotations)
    level = build_ground({"kind": "slope", "angle": 0.0, "heading": 0.0, "start": [0, 0], "length": None})
    on_level = clean_feet(clip, clip, contacts, level)
    assert (on_level.clip.rotations - clip.rotations).abs().max() < 1e-6


def test_a_foot_that_is_in_the_air_at_both_ends_stands_in_between_as_high_as_the_ground() -> None:
    clip = clip_of("run")
    whole = find_contacts(clip, find_legs(clip.skeleton))
    first, last = whole.plants(0)[1]
    part = clip.part(slice(first - 6, last + 7))
    ground = rising(part, "slope", before=0.0, angle=10.0, length=None)
    contacts, planted = walked(part, ground, 1.0)
    assert not contacts.stands(0)[[0, -1]].any()
    assert planted.touching[:, 0].any()
    assert heights(part, contacts, planted, ground).abs().max() < 0.012
