"""Clips before and after a walk, made of people."""

from __future__ import annotations

import math
from dataclasses import replace

import torch

from hopdiff.feet.prints import GroundMove
from hopdiff.geometry.clip import Clip
from hopdiff.geometry.rotation import from_vector
from hopdiff.joins.seams import placed
from tests.people import WALK, person


def laid(clip: Clip, degrees: float, x: float, z: float) -> Clip:
    """A clip somewhere else in the scene."""
    turn = torch.tensor(math.radians(degrees), dtype=torch.float64)
    return placed(clip, GroundMove(turn, torch.tensor([x, z], dtype=torch.float64)))


def rise(seconds: float = 1.0) -> Clip:
    """Someone who comes up from a crouch, all joints bent, and still is not quite up when the clip ends."""
    clip = person(WALK, [(seconds, None)])
    share = torch.linspace(1.0, 0.3, clip.frames, dtype=torch.float64)
    rotations, root = clip.rotations.clone(), clip.root_position.clone()
    bend = {"UpLeg": -0.7, "Leg": 1.4, "Foot": -0.7, "Spine": 0.5, "Arm": 0.6, "Neck": -0.3}
    for joint, name in enumerate(clip.skeleton.names):
        angle = bend.get(name.removeprefix("Left").removeprefix("Right"), 0.0)
        axis = torch.tensor([1.0, 0.0, 0.0], dtype=torch.float64)
        rotations[:, joint] = rotations[:, joint] @ from_vector(share[:, None] * angle * axis)
    bent = replace(clip, rotations=rotations)
    foot = clip.skeleton.index("LeftFoot")
    root -= (bent.joint_positions() - clip.joint_positions())[:, foot]
    return replace(bent, root_position=root)


def lie(seconds: float = 1.0) -> Clip:
    """The same, down again."""
    clip = rise(seconds)
    return replace(clip, root_position=clip.root_position.flip(0), rotations=clip.rotations.flip(0))


def walk(seconds: float = 4.0) -> Clip:
    return person(WALK, [(seconds, 0.0)])
