"""Numbers that fail when a motion is spoiled, and what a user is told then."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch

from hopdiff.editing.leg_joints import find_legs
from hopdiff.feet.contacts import Contacts, find_contacts
from hopdiff.feet.planting import Planted
from hopdiff.feet.quality import BARS, Quality, quality_of
from hopdiff.geometry.clip import Clip
from hopdiff.geometry.rotation import axis_rotation
from tests.people import clip_of


def walk() -> tuple[Clip, Contacts]:
    clip = clip_of("walk")
    return clip, find_contacts(clip, find_legs(clip.skeleton))


def judged(clip: Clip, spoiled: Clip, contacts: Contacts, given_up: int = 0, lowered: float = 0.0) -> Quality:
    touching = torch.stack([contacts.stands(k) for k in range(2)], dim=-1)
    left_out = torch.zeros_like(touching)
    frames = touching[:, 0].nonzero().flatten()[:given_up]
    left_out[frames, 0] = True
    sunk = torch.full((clip.frames,), lowered, dtype=torch.float64)
    return quality_of(clip, Planted(spoiled, touching & ~left_out, left_out, sunk), contacts)


def test_a_clip_passes_against_itself() -> None:
    clip, contacts = walk()
    found = judged(clip, clip, contacts)
    assert found.sentences == []
    assert set(found.numbers) == set(BARS)
    assert found.numbers["joint_speed_ratio"] == found.numbers["joint_acceleration_ratio"] == 1.0
    assert max(value for name, value in found.numbers.items() if "ratio" not in name) < 1e-9


def turned(clip: Clip, joint: str, frames: slice, axis: str, angle: float) -> Clip:
    rotations = clip.rotations.clone()
    index = clip.skeleton.index(joint)
    rotations[frames, index] = rotations[frames, index] @ axis_rotation(axis, torch.tensor(angle)).to(rotations)
    return replace(clip, rotations=rotations)


def lifted(clip: Clip, by: float) -> Clip:
    return replace(clip, root_position=clip.root_position + torch.tensor([0.0, by, 0.0]))


@pytest.mark.parametrize(
    ("name", "spoil", "said"),
    [
        ("first_pose_error", lambda c: turned(c, "LeftArm", slice(0, 1), "Z", 0.1), "the first pose is"),
        ("last_pose_error", lambda c: turned(c, "LeftForeArm", slice(-1, None), "Y", 0.3), "the last pose is"),
        ("foot_float", lambda c: lifted(c, 0.02), "floats 2.0 cm"),
        ("foot_sink", lambda c: lifted(c, -0.03), "sinks 3.0 cm"),
        ("joint_speed_ratio", lambda c: turned(c, "RightUpLeg", slice(20, 21), "X", 1.0), "as fast as anything"),
        ("joint_acceleration_ratio", lambda c: turned(c, "LeftArm", slice(20, 21), "Z", 1.0), "jerked"),
        ("hyperextension_deg", lambda c: turned(c, "LeftLeg", slice(0, None), "X", -1.2), "farther back"),
    ],
)
def test_each_number_tells_of_what_it_is_for(name: str, spoil, said: str) -> None:  # type: ignore[no-untyped-def]
    clip, contacts = walk()
    found = judged(clip, spoil(clip), contacts)
    assert found.numbers[name] > BARS[name]
    assert any(said in sentence for sentence in found.sentences)


def test_a_body_that_comes_down_and_steps_that_are_given_up_are_told_of() -> None:
    clip, contacts = walk()
    found = judged(clip, clip, contacts, given_up=60, lowered=0.12)
    assert found.numbers["root_drop"] == pytest.approx(0.12)
    assert any("comes down by 12 cm" in sentence for sentence in found.sentences)
    assert found.numbers["given_up"] > 0.05
    assert any("had to step or leave the ground" in sentence for sentence in found.sentences)
