from __future__ import annotations

import math

import pytest
import torch
from torch import Tensor

from hopdiff.geometry.clip import Clip
from hopdiff.geometry.rotation import axis_rotation
from hopdiff.geometry.skeleton import Skeleton
from hopdiff.motion import Motion, Phase

HEIGHT = 1.76
STANCE_MIDDLE = 0.15  # share of the stride at which the left leg stands straight down


def make_skeleton() -> Skeleton:
    rows = {
        "pelvis": (-1, (0.0, 0.531, 0.0)),
        "waist": (0, (0.0, 0.085, 0.0)),
        "neck": (1, (0.0, 0.235, 0.0)),
        "left_shoulder": (1, (0.112, 0.2, 0.0)),
        "right_shoulder": (1, (-0.112, 0.2, 0.0)),
        "left_elbow": (3, (0.0, -0.16, 0.0)),
        "right_elbow": (4, (0.0, -0.16, 0.0)),
        "left_hip": (0, (0.05, 0.0, 0.0)),
        "right_hip": (0, (-0.05, 0.0, 0.0)),
        "left_knee": (7, (0.0, -0.243, 0.0)),
        "right_knee": (8, (0.0, -0.243, 0.0)),
    }
    ends = {"neck": 0.149, "left_elbow": -0.2, "right_elbow": -0.2, "left_knee": -0.288, "right_knee": -0.288}
    return Skeleton(
        names=tuple(rows),
        parents=tuple(parent for parent, _ in rows.values()),
        offsets=HEIGHT * torch.tensor([offset for _, offset in rows.values()], dtype=torch.float64),
        end_sites={name: HEIGHT * torch.tensor([0.0, y, 0.0], dtype=torch.float64) for name, y in ends.items()},
    )


def make_motion(speed: float = 4.0, stride: float = 0.68, frames: int = 42, duty: float = 0.33) -> Motion:
    """A made-up run of sines: no physics, but the shape of one stride."""
    t = torch.linspace(0, 1, frames, dtype=torch.float64)
    wave = 2 * math.pi * (t - STANCE_MIDDLE)
    reach = math.radians(18 + 6 * speed)
    angles: dict[str, Tensor] = {"trunk": torch.full_like(t, math.radians(6)) + 0.03 * torch.sin(2 * wave)}
    for side, turn in (("left", 0.0), ("right", math.pi)):
        # Forward of the body before stance, behind it after: falling through zero in the middle of stance.
        angles[f"{side}_hip"] = 0.08 - reach * torch.sin(wave + turn)
        swing = (1 - torch.cos(wave + turn - 0.7)) / 2
        angles[f"{side}_knee"] = 0.25 + (0.9 + 0.13 * speed) * swing**3
        angles[f"{side}_shoulder"] = -0.15 + 0.12 * speed * torch.sin(wave + turn)
        angles[f"{side}_elbow"] = 1.6 + 0.25 * torch.sin(wave + turn)
    rotations = torch.eye(3, dtype=torch.float64).repeat(frames, 11, 1, 1)
    skeleton = make_skeleton()
    sign = {"trunk": 1, "hip": -1, "knee": 1, "shoulder": -1, "elbow": -1}
    for name, angle in angles.items():
        joint = skeleton.index("waist" if name == "trunk" else name)
        rotations[:, joint] = axis_rotation("X", sign[name.split("_")[-1]] * angle)
    rise = 0.03 * torch.cos(2 * wave)
    root = torch.stack((0.01 * torch.sin(wave), 0.885 - rise, speed * stride * t), dim=1)
    clip = Clip(skeleton, root, rotations, stride / (frames - 1))
    ends = clip.end_positions()
    feet = torch.stack((ends["left_knee"], ends["right_knee"]), dim=1)
    contact = torch.stack((t < duty, (t >= 0.5) & (t < 0.5 + duty)), dim=1)
    times = t * stride
    shares = (("stance", "left", 0.0, duty), ("flight", "left", duty, 0.5))
    shares += (("stance", "right", 0.5, 0.5 + duty), ("flight", "right", 0.5 + duty, 1.0))
    return Motion(
        clip=clip,
        times=times,
        contact=contact,
        feet=feet,
        com=root + torch.tensor([0.0, 0.1, 0.02], dtype=torch.float64),
        com_target=torch.stack((0.02 * torch.sin(wave), torch.zeros_like(t), speed * times), dim=1),
        leg_force=contact * 2.4,
        angles=angles,
        phases=tuple(Phase(kind, side, a * stride, b * stride) for kind, side, a, b in shares),
    )


@pytest.fixture
def motion() -> Motion:
    return make_motion()
