"""Clips that go on where they began: found, and laid end to end."""

from __future__ import annotations

import math
from dataclasses import replace

import torch

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


def repeated(clip: Clip, count: int) -> Clip:
    """A loop laid end to end, each repetition turned and moved to where the one before it ended; the frame they share
    comes once."""
    path = root_path(clip)
    turn, way = path.yaw[-1] - path.yaw[0], path.place[-1] - path.place[0]
    roots, rotations = [clip.root_position[:1]], [clip.rotations[:1]]
    place, yaw = path.place[0], torch.zeros_like(turn)
    for _ in range(count):
        turned = axis_rotation("Y", yaw).to(clip.rotations)
        start = clip.root_position.new_tensor((float(path.place[0, 0]), 0.0, float(path.place[0, 1])))
        here = clip.root_position.new_tensor((float(place[0]), 0.0, float(place[1])))
        roots.append((clip.root_position[1:] - start) @ turned.T + here)
        rotations.append(torch.cat(((turned @ clip.rotations[1:, 0]).unsqueeze(1), clip.rotations[1:, 1:]), dim=1))
        c, s = torch.cos(yaw), torch.sin(yaw)
        place = place + torch.stack((c * way[0] + s * way[1], c * way[1] - s * way[0]))
        yaw = yaw + turn
    return replace(clip, root_position=torch.cat(roots), rotations=torch.cat(rotations))
