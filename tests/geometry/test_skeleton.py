from __future__ import annotations

import math

import torch

from hopdiff.geometry.rotation import axis_rotation, euler_to_matrix
from hopdiff.geometry.skeleton import Skeleton

ARM = Skeleton(
    names=("shoulder", "elbow", "twin"),
    parents=(-1, 0, 0),
    offsets=torch.tensor([[9.0, 9.0, 9.0], [0.0, -0.3, 0.0], [0.1, 0.0, 0.0]], dtype=torch.float64),
    end_sites={"elbow": torch.tensor([0.0, -0.25, 0.0], dtype=torch.float64)},
)


def test_names_and_children():
    assert ARM.index("twin") == 2
    assert ARM.children(0) == [1, 2]
    assert ARM.children(1) == []


def test_a_two_link_arm_follows_its_closed_form():
    swing = torch.linspace(-1, 2, 7, dtype=torch.float64)
    bend = torch.linspace(0, 2.5, 7, dtype=torch.float64)
    root = torch.randn(7, 3, generator=torch.Generator().manual_seed(0), dtype=torch.float64)
    still = torch.eye(3, dtype=torch.float64).expand(7, 3, 3)
    rotations = torch.stack((axis_rotation("X", swing), axis_rotation("X", bend), still), dim=1)
    positions, orientations = ARM.forward(root, rotations)
    ends = ARM.end_positions(positions, orientations)
    zero = torch.zeros_like(swing)
    elbow = root + 0.3 * torch.stack((zero, -torch.cos(swing), -torch.sin(swing)), dim=-1)
    hand = elbow + 0.25 * torch.stack((zero, -torch.cos(swing + bend), -torch.sin(swing + bend)), dim=-1)
    torch.testing.assert_close(positions[:, 0], root)
    torch.testing.assert_close(positions[:, 1], elbow)
    torch.testing.assert_close(ends["elbow"], hand)
    torch.testing.assert_close(orientations[:, 1], axis_rotation("X", swing + bend))


def test_bone_lengths_never_change_and_batches_do_not_mix():
    angles = 6 * torch.rand(5, 4, 3, 3, generator=torch.Generator().manual_seed(1), dtype=torch.float64)
    rotations = euler_to_matrix(angles, "XYZ")
    root = torch.zeros(5, 4, 3, dtype=torch.float64)
    positions, _ = ARM.forward(root, rotations)
    lengths = torch.linalg.vector_norm(positions[..., 1:, :] - positions[..., :1, :], dim=-1)
    torch.testing.assert_close(lengths, torch.tensor([0.3, 0.1], dtype=torch.float64).expand(5, 4, 2))
    alone, _ = ARM.forward(root[2, 1], rotations[2, 1])
    torch.testing.assert_close(positions[2, 1], alone)


def test_turning_the_root_turns_everything_about_it():
    half_turn = axis_rotation("Y", torch.tensor(math.pi, dtype=torch.float64))
    rotations = torch.eye(3, dtype=torch.float64).repeat(3, 1, 1)
    rotations[0] = half_turn
    positions, _ = ARM.forward(torch.tensor([1.0, 2.0, 3.0], dtype=torch.float64), rotations)
    torch.testing.assert_close(positions[2], torch.tensor([0.9, 2.0, 3.0], dtype=torch.float64))
    torch.testing.assert_close(positions[1], torch.tensor([1.0, 1.7, 3.0], dtype=torch.float64))
