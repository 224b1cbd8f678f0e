"""Walks that tests of motion graphs start from: a stick figure that swings its legs along a way that bends."""

from __future__ import annotations

import math
from collections.abc import Sequence

import torch
from torch import Tensor

from hopdiff.geometry.clip import Clip
from hopdiff.geometry.rotation import axis_rotation
from hopdiff.geometry.skeleton import Skeleton

FRAME = 1.0 / 30.0
NAMES = ("hips", "left_leg", "left_foot", "right_leg", "right_foot", "head")
OFFSETS = [[0.0, 0.0, 0.0], [0.1, 0.0, 0.0], [0.0, -0.9, 0.0], [-0.1, 0.0, 0.0], [0.0, -0.9, 0.0], [0.0, 0.7, 0.0]]


def skeleton(leg: float = 0.9) -> Skeleton:
    offsets = torch.tensor(OFFSETS, dtype=torch.float64)
    offsets[[2, 4], 1] = -leg
    return Skeleton(NAMES, (-1, 0, 1, 0, 3, 0), offsets)


def walker(
    turns: Sequence[tuple[float, float]] = ((10.0, 0.0),),
    speed: float = 1.2,
    period: float = 1.0,
    frame_time: float = FRAME,
    start: tuple[float, float, float] = (0.0, 0.0, 0.0),
    leg: float = 0.9,
) -> Clip:
    """turns: seconds and degrees a second, one after the other. period: of a stride [s]. start: x, z [m], yaw [rad]."""
    rates = torch.cat([torch.full((round(time / frame_time),), math.radians(rate)) for time, rate in turns]).double()
    # Bends begin and end softly.
    rates = torch.nn.functional.avg_pool1d(rates[None], 9, 1, 4, count_include_pad=False)[0]
    count = len(rates)
    time = frame_time * torch.arange(count, dtype=torch.float64)
    yaw = start[2] + frame_time * (rates.cumsum(0) - rates)
    moved = speed * frame_time * torch.stack((torch.sin(yaw), torch.cos(yaw)), dim=-1)
    place = torch.tensor(start[:2], dtype=torch.float64) + moved.cumsum(0) - moved
    phase = 2.0 * math.pi * time / period
    swing = 0.45 * torch.sin(phase) * min(1.0, speed)
    rotations = torch.eye(3, dtype=torch.float64).repeat(count, len(NAMES), 1, 1)
    rotations[:, 0] = axis_rotation("Y", yaw + 0.05 * torch.sin(phase))
    rotations[:, 1], rotations[:, 3] = axis_rotation("X", swing), axis_rotation("X", -swing)
    height = 0.95 + 0.02 * torch.cos(2.0 * phase)
    root = torch.stack((place[:, 0], height, place[:, 1]), dim=-1)
    return Clip(skeleton(leg), root, rotations, frame_time)


def wanderer() -> Clip:
    """40 s of walking straight on and to both sides."""
    bends = [(3.0, 0.0), (1.5, 60.0), (2.0, 0.0), (1.5, -60.0), (1.0, 0.0), (2.0, 90.0), (1.5, 0.0), (2.0, -90.0)]
    # No stride is a whole number of frames, so that no two frames are quite the same.
    return walker([*bends, (2.0, 30.0), (2.0, -30.0), *bends, (4.0, 0.0)], period=0.9713)


def moved(clip: Clip, x: float, z: float, turn: float) -> Clip:
    """A clip turned about y [rad], then moved over the ground [m]."""
    turned = axis_rotation("Y", torch.tensor(turn, dtype=torch.float64))
    rotations = clip.rotations.clone()
    rotations[:, 0] = turned @ rotations[:, 0]
    root = clip.root_position @ turned.T + torch.tensor([x, 0.0, z], dtype=torch.float64)
    return Clip(clip.skeleton, root, rotations, clip.frame_time)


def angles_between(first: Tensor, second: Tensor) -> Tensor:
    """(...) of rotations (..., 3, 3) [rad]; exact for small ones."""
    between = first.transpose(-1, -2) @ second
    return 2.0 * torch.asin(
        ((between - torch.eye(3).to(between)).flatten(-2).norm(dim=-1) / math.sqrt(8.0)).clamp(max=1)
    )
