"""Frames at both ends of a clip that stay as they are while the feet between them are put right."""

from __future__ import annotations

import math

import pytest
import torch

from hopdiff.editing.leg_joints import find_legs
from hopdiff.editing.root_path import RootPath, root_path, with_root_path
from hopdiff.editing.targets import Constraint, edit_path
from hopdiff.feet.contacts import find_contacts, slide_numbers
from hopdiff.feet.planting import clean_feet
from hopdiff.feet.quality import standing_numbers
from hopdiff.geometry.clip import Clip
from tests.people import clip_of


def edited_between(clip: Clip, head: int, tail: int, turn: float) -> Clip:
    """The frames up to head as they are, those from tail on turned and moved as one, an edit in between."""
    path = root_path(clip)
    middle = RootPath(path.place[head : tail + 1], path.yaw[head : tail + 1])
    x, z = middle.place[-1].tolist()
    yaw = float(middle.yaw[-1]) + turn
    new = edit_path(middle, [Constraint(tail - head, (x + 0.2, z - 0.1), yaw)], clip.frame_time).path
    by = new.yaw[-1] - path.yaw[tail]
    c, s = torch.cos(by), torch.sin(by)
    away = path.place[tail + 1 :] - path.place[tail]
    rest = new.place[-1] + torch.stack((c * away[:, 0] + s * away[:, 1], c * away[:, 1] - s * away[:, 0]), dim=-1)
    place = torch.cat((path.place[:head], new.place, rest))
    return with_root_path(clip, path, RootPath(place, torch.cat((path.yaw[:head], new.yaw, path.yaw[tail + 1 :] + by))))


@pytest.mark.parametrize("name", ["walk", "run", "walk_straight_snu_30hz", "walk_turn_left90_cmu_16_17"])
@pytest.mark.parametrize("turn", [0.0, 0.25 * math.pi])
def test_kept_frames_stay_and_nothing_jumps_next_to_them(name: str, turn: float) -> None:
    clip = clip_of(name)
    contacts = find_contacts(clip, find_legs(clip.skeleton))
    for head, tail in ((clip.frames // 4, 3 * clip.frames // 4), (clip.frames // 5, 2 * clip.frames // 3)):
        moved = edited_between(clip, head, tail, turn)
        planted = clean_feet(clip, moved, contacts, kept=(head, tail))
        clean = planted.clip
        for here in (slice(0, head + 1), slice(tail, None)):
            assert torch.equal(clean.root_position[here], moved.root_position[here])
            assert torch.equal(clean.rotations[here], moved.rotations[here])
        places, old = clean.joint_positions(), clip.joint_positions()
        seams = torch.tensor([head - 1, head, tail - 2, tail - 1])
        jolt, own = (one.diff(n=2, dim=0).norm(dim=-1) for one in (places, old))
        assert float(jolt[seams].max()) < 1.2 * float(own.max())
        before, after = slide_numbers(clip, contacts), standing_numbers(planted, contacts)
        assert after["slide_speed"] < before["slide_speed"] + 0.02
        assert after["drift"] < before["drift"] + 0.01


def test_a_contact_that_reaches_into_kept_frames_stands_where_these_say() -> None:
    clip = clip_of("walk")
    contacts = find_contacts(clip, find_legs(clip.skeleton))
    first, last = next(span for span in contacts.plants(0) if span[0] > 8)
    head, tail = (first + last) // 2, clip.frames - 1
    moved = edited_between(clip, head, tail, 0.5 * math.pi)
    clean = clean_feet(clip, moved, contacts, kept=(head, tail))
    ankle = contacts.legs[0].ankle
    assert ankle is not None
    stood = slice(head, last + 1)
    assert bool(clean.touching[stood, 0].all())
    off = (clean.clip.joint_positions() - clip.joint_positions())[stood, ankle, ::2].norm(dim=-1)
    led = (moved.joint_positions() - clip.joint_positions())[stood, ankle, ::2].norm(dim=-1)
    assert float(off.max()) < 0.01 < float(led.max())


@pytest.mark.parametrize("mask", [slice(0, 20), slice(20, None)])
def test_slides_are_held_only_in_the_frames_that_are_said(mask: slice) -> None:
    clip = clip_of("walk")
    contacts = find_contacts(clip, find_legs(clip.skeleton))
    held = torch.zeros(clip.frames, dtype=torch.bool)
    held[mask] = True
    clean = clean_feet(clip, clip, contacts, still=held).clip
    everywhere = clean_feet(clip, clip, contacts, still=True).clip
    change, most = ((one.rotations - clip.rotations).flatten(1).norm(dim=-1) for one in (clean, everywhere))
    inside, outside = float(change[mask].max()), float(change[~held].min())
    assert inside > 0.5 * float(most[mask].max()) > 0.0
    assert outside < 1e-9
