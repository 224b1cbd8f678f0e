"""Euler angles along a motion: which of the angles that mean one rotation follow smoothly, or follow older ones."""

from __future__ import annotations

import math

import torch
from torch import Tensor

from hopdiff.geometry.rotation import matrix_to_euler, unwrap


def continuous_euler(rotations: Tensor, order: str, at_pole: Tensor | None = None) -> Tensor:
    """Euler angles that follow a motion without flips.

    rotations: (T, ..., 3, 3). order: one to three letters, neighbours different. at_pole: (T, ...) [rad], first angle
    to take at a pole of the middle one; None holds the value of the frame before. Returns (T, ..., n) [rad], each
    frame the nearest to its predecessor of all angles that mean the same rotation: besides full turns, three angles
    have a second form (`second_form`). A knee that bends past a right angle about the middle axis needs it.
    """
    if len(order) < 3:
        return unwrap(matrix_to_euler(rotations, order))
    if at_pole is None:
        at_pole = _held(rotations, order)
    near = matrix_to_euler(rotations, order, at_pole)
    far = second_form(near, order)
    # Whether a frame changes form with respect to its predecessor does not depend on which form that one has.
    changes = _turn_distance(far[1:], near[:-1]) < _turn_distance(near[1:], near[:-1])
    first = torch.zeros_like(near[:1, ..., 0], dtype=torch.bool)
    use_far = torch.cat((first, torch.cumsum(changes, dim=0) % 2 == 1))
    return unwrap(torch.where(use_far[..., None], far, near))


def second_form(angles: Tensor, order: str) -> Tensor:
    """The other three angles in one turn that mean the same rotation, for orders of three letters.

    angles: (..., 3) [rad]. (a, b, c) is (a + pi, pi - b, c + pi) about three different axes and (a + pi, -b, c + pi)
    where the outer axes are the same.
    """
    a, b, c = angles.unbind(-1)
    middle = -b if order[0] == order[2] else math.pi - b
    return torch.stack((a + math.pi, middle, c + math.pi), dim=-1)


def joined_euler(rotations: Tensor, order: str, old: Tensor, kept: Tensor) -> Tensor:
    """Euler angles of an edited motion that join the angles of frames that were not edited.

    rotations: (T, 3, 3). order: one to three letters, neighbours different. old: (T, n) [rad], angles before the
    edit. kept: (T,) bool, frames whose rotation is the old one: they get the old angles. The others go on smoothly
    from the kept frame before them (if there is none, towards the first one; without any, from what is nearest to
    the old angles of frame 0). Returns (T, n) [rad].
    """
    angles = continuous_euler(rotations, order, old[:, 0] if bool(kept.any()) else None)
    time = torch.arange(len(kept), device=kept.device)
    before = torch.cummax(torch.where(kept, time, -1), dim=0).values
    anchor = torch.where(before >= 0, before, kept.int().argmax())
    goal = old[anchor]
    if len(order) == 3:
        other = second_form(angles, order)
        use = _turn_distance(other[anchor], goal) < _turn_distance(angles[anchor], goal)
        angles = torch.where(use[:, None], other, angles)
    turn = 2 * math.pi
    joined = angles + turn * torch.round((goal - angles[anchor]) / turn)
    return torch.where(kept[:, None], old, joined)


def _held(rotations: Tensor, order: str) -> Tensor:
    """First angle of each frame, or at a pole that of the last frame before that was not at one."""
    # A pole answers with whatever it is given.
    ask = torch.full_like(rotations[..., 0, 0], torch.nan)
    first = matrix_to_euler(rotations, order, ask)[..., 0]
    time = torch.arange(len(first), device=first.device).reshape(-1, *[1] * (first.ndim - 1)).expand(first.shape)
    sure = ~first.isnan()
    before = torch.cummax(torch.where(sure, time, -1), dim=0).values
    start = sure.int().argmax(dim=0, keepdim=True).expand(before.shape)
    return first.gather(0, torch.where(before >= 0, before, start)).nan_to_num()


def _turn_distance(a: Tensor, b: Tensor) -> Tensor:
    """Sum over the angles of the distance between two sets of them, full turns left out."""
    turn = 2 * math.pi
    return (torch.remainder(a - b + math.pi, turn) - math.pi).abs().sum(dim=-1)
