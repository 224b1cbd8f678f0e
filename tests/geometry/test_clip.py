from __future__ import annotations

import dataclasses

import pytest
import torch

from hopdiff.geometry.clip import Clip
from hopdiff.geometry.rotation import axis_rotation
from hopdiff.geometry.skeleton import Skeleton

STICK = Skeleton(
    ("root", "tip"),
    (-1, 0),
    torch.tensor([[0.0, 1.0, 0.0], [0.0, 0.0, 0.5]], dtype=torch.float64),
    {"tip": torch.tensor([0.0, 0.0, 0.25], dtype=torch.float64)},
)


def bouncing(frames: int = 21) -> Clip:
    """Two bounces and one sway while travelling (0.3, 0, 4) in all."""
    t = torch.linspace(0, 1, frames, dtype=torch.float64)
    sway = torch.sin(2 * torch.pi * t)
    root = torch.stack((0.3 * t + 0.02 * sway, 1 + 0.05 * torch.cos(4 * torch.pi * t), 4 * t), dim=1)
    turns = axis_rotation("Y", torch.stack((sway, -sway), dim=1))
    return Clip(STICK, root, turns, 0.03)


def test_duration_counts_intervals():
    clip = bouncing(21)
    assert clip.frames == 21
    assert clip.duration == pytest.approx(0.6)
    assert bouncing(1).duration == 0.0


def test_positions_and_ends():
    clip = bouncing()
    sway = torch.sin(2 * torch.pi * torch.linspace(0, 1, 21, dtype=torch.float64))
    forward = torch.stack((torch.sin(sway), torch.zeros_like(sway), torch.cos(sway)), dim=1)
    tip = clip.root_position + 0.5 * forward
    torch.testing.assert_close(clip.joint_positions()[:, 1], tip)
    along = torch.tensor([0.0, 0.0, 0.25], dtype=torch.float64)  # the tip turns back what the root turned
    torch.testing.assert_close(clip.end_positions()["tip"], tip + along)


def test_in_place_takes_the_steady_travel_only():
    clip = bouncing()
    still = clip.in_place()
    t = torch.linspace(0, 1, 21, dtype=torch.float64)
    torch.testing.assert_close(still.root_position[:, 0], 0.02 * torch.sin(2 * torch.pi * t))
    torch.testing.assert_close(still.root_position[:, 1], clip.root_position[:, 1])
    torch.testing.assert_close(still.root_position[:, 2], torch.zeros_like(t), atol=1e-12, rtol=0)
    torch.testing.assert_close(still.in_place().root_position, still.root_position)
    assert still.rotations is clip.rotations


def test_in_place_leaves_the_original_and_single_frames_alone():
    clip = bouncing()
    before = clip.root_position.clone()
    clip.in_place()
    assert torch.equal(clip.root_position, before)
    assert torch.equal(bouncing(1).in_place().root_position, bouncing(1).root_position)


def test_clips_are_immutable():
    with pytest.raises(dataclasses.FrozenInstanceError):
        bouncing().frame_time = 1.0


def test_joints_that_move_against_their_parents():
    clip = bouncing()
    stretch = torch.linspace(0.5, 0.9, clip.frames, dtype=torch.float64)
    offsets = torch.zeros(clip.frames, 2, 3, dtype=torch.float64)
    offsets[:, 1, 2] = stretch
    telescope = dataclasses.replace(clip, offsets=offsets)
    length = torch.linalg.vector_norm(telescope.joint_positions()[:, 1] - clip.root_position, dim=-1)
    torch.testing.assert_close(length, stretch)
    apart = telescope.end_positions()["tip"] - telescope.joint_positions()[:, 1]
    torch.testing.assert_close(apart, clip.end_positions()["tip"] - clip.joint_positions()[:, 1])
    still = dataclasses.replace(clip, offsets=STICK.offsets.expand(clip.frames, 2, 3))
    torch.testing.assert_close(still.joint_positions(), clip.joint_positions())
