"""Clips that go on where they began: found, and laid end to end."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from hopdiff.editing.root_path import root_path
from hopdiff.geometry.clip import Clip
from hopdiff.geometry.rotation import axis_rotation

ALIKE = math.radians(3.0)  # by which any joint may differ
LEVEL = 0.01  # m by which the height of the root may differ


def is_loop(clip: Clip) -> bool:
    """Whether the last frame is the first of a repetition: the same pose, after a way over the ground."""
    if clip.frames < 3 or clip.offsets is not None:
        return False
    turn = root_path(clip).yaw
    first, last = clip.rotations[0].double(), clip.rotations[-1].double()
    back = axis_rotation("Y", turn[0] - turn[-1])
    last = torch.cat(((back @ last[0]).unsqueeze(0), last[1:]))
    between = first.transpose(-1, -2) @ last
    sine = (between - between.transpose(-1, -2)).flatten(1).norm(dim=-1) / math.sqrt(8.0)
    upright = between.diagonal(dim1=-2, dim2=-1).sum(-1) > 1.0
    level = abs(float(clip.root_position[-1, 1] - clip.root_position[0, 1])) < LEVEL
    return level and bool((sine < math.sin(ALIKE)).all() and upright.all())


@dataclass(frozen=True)
class Repetition:
    """Where one repetition of a loop is: turn (3, 3) about y, start and here (3,) where it began and begins [m]."""

    turn: Tensor
    start: Tensor
    here: Tensor

    def points(self, places: Tensor) -> Tensor:
        """Points (..., 3) of the first repetition, in this one [m]."""
        return (places - self.start) @ self.turn.T + self.here


def repetitions(clip: Clip, count: int) -> list[Repetition]:
    """The places of a loop that is laid end to end, each repetition turned and moved to where the last one ended."""
    path = root_path(clip)
    turn, way = path.yaw[-1] - path.yaw[0], path.place[-1] - path.place[0]
    place, yaw = path.place[0], torch.zeros_like(turn)
    start = clip.root_position.new_tensor((float(path.place[0, 0]), 0.0, float(path.place[0, 1])))
    found = []
    for _ in range(count):
        here = clip.root_position.new_tensor((float(place[0]), 0.0, float(place[1])))
        found.append(Repetition(axis_rotation("Y", yaw).to(clip.rotations), start, here))
        c, s = torch.cos(yaw), torch.sin(yaw)
        place = place + torch.stack((c * way[0] + s * way[1], c * way[1] - s * way[0]))
        yaw = yaw + turn
    return found


def repeated(clip: Clip, count: int) -> Clip:
    """A loop laid end to end; the frame that two repetitions share comes once."""
    roots, rotations = [clip.root_position[:1]], [clip.rotations[:1]]
    for one in repetitions(clip, count):
        roots.append(one.points(clip.root_position[1:]))
        rotations.append(torch.cat(((one.turn @ clip.rotations[1:, 0]).unsqueeze(1), clip.rotations[1:, 1:]), dim=1))
    return replace(clip, root_position=torch.cat(roots), rotations=torch.cat(rotations))
