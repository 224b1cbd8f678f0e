"""Straight runs led along curves, for pictures only: feet stand still, but no leg cares about its length."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import torch
from torch import Tensor

from hopdiff.geometry.rotation import axis_rotation
from hopdiff.motion import Motion

FINE = 0.01  # m


def repeated(motion: Motion, strides: int) -> Motion:
    """One stride after the other, as one motion."""
    period, frames = float(motion.times[-1]), len(motion.times) - 1
    travel = motion.clip.root_position[-1] - motion.clip.root_position[0]
    travel = travel * torch.tensor([0.0, 0.0, 1.0])

    def chain(track: Tensor, step: Tensor | float = 0.0) -> Tensor:
        return torch.cat([*(track[:-1] + k * step for k in range(strides)), track[-1:] + (strides - 1) * step])

    contact = torch.cat([*[motion.contact[:-1]] * strides, motion.contact[-1:]])
    assert len(contact) == strides * frames + 1
    clip = replace(
        motion.clip,
        root_position=chain(motion.clip.root_position, travel),
        rotations=chain(motion.clip.rotations),
    )
    phases = tuple(
        replace(phase, start=phase.start + k * period, end=phase.end + k * period)
        for k in range(strides)
        for phase in motion.phases
    )
    return replace(
        motion,
        clip=clip,
        times=chain(motion.times, period),
        contact=contact,
        feet=chain(motion.feet, travel),
        com=chain(motion.com, travel),
        com_target=chain(motion.com_target, travel),
        leg_force=chain(motion.leg_force),
        angles={name: chain(curve) for name, curve in motion.angles.items()},
        phases=phases,
    )


def bent(motion: Motion, turn: float, waves: float = 0.0, lean: float = 0.15) -> Motion:
    """A straight motion along a curve: turned by `turn` [rad] evenly in all (a circle for 2 pi), or with `waves`
    whole waves of that heading to both sides (1: an S). lean: into the turn, where it is sharpest [rad]."""
    length = float(motion.clip.root_position[-1, 2])
    way = np.arange(-2.0, length + 2.0, FINE)
    share = way / length
    heading = turn * np.sin(2 * math.pi * waves * share) if waves else turn * share
    start = np.searchsorted(way, 0.0)
    x, z = (np.cumsum(f(heading)) * FINE for f in (np.sin, np.cos))
    x, z = x - x[start], z - z[start]
    bend = np.gradient(heading, way)
    bend = lean * bend / np.abs(bend).max()

    def at(curve: np.ndarray, along: Tensor) -> Tensor:
        return torch.as_tensor(np.interp(along.numpy(), way, curve))

    def led(points: Tensor) -> Tensor:
        angle = at(heading, points[..., 2])
        across = points[..., 0]
        return torch.stack(
            (
                at(x, points[..., 2]) + across * torch.cos(angle),
                points[..., 1],
                at(z, points[..., 2]) - across * torch.sin(angle),
            ),
            dim=-1,
        )

    along = motion.clip.root_position[:, 2]
    turned = axis_rotation("Y", at(heading, along)) @ axis_rotation("Z", -at(bend, along))
    rotations = motion.clip.rotations.clone()
    rotations[:, 0] = turned @ rotations[:, 0]
    clip = replace(motion.clip, root_position=led(motion.clip.root_position), rotations=rotations)
    return replace(motion, clip=clip, feet=led(motion.feet), com=led(motion.com), com_target=led(motion.com_target))
