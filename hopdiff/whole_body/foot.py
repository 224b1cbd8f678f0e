"""A foot that rolls over its sole without slipping: heel, ball, and a smooth passage between them.

For a convex sole the height of the ankle above the ground is a function h of the foot's pitch alone (its support
function), the contact point lies -dh/dpitch ahead of the ankle, and rolling moves the ankle by -h d(pitch).
"""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor
from torch.nn import functional

from hopdiff.whole_body.layout import Layout

ROUND = 0.03  # of the distance from heel to ball: how round the sole is between its two edges


class Sole(NamedTuple):
    """height: of the ankle above the ground. ahead: of the contact point before the ankle. (...) [m]."""

    height: Tensor
    ahead: Tensor


def sole(layout: Layout, pitch: Tensor) -> Sole:
    """Where ankle and contact point of a standing foot are, for its pitch (...), toes up [rad]."""
    down, heel, ball = layout.sole
    width = ROUND * (ball - heel)
    c, s = pitch.cos(), pitch.sin()
    # How much lower the ball's edge is than the heel's, in widths.
    lower = s * ((heel - ball) / width)
    low = c * down
    height = low - heel * s + width * functional.softplus(lower)
    reach = heel + (ball - heel) * torch.sigmoid(lower)
    return Sole(height, reach * c + s * down)


def pitch_shapes(phase: Tensor, settle: Tensor, slap: Tensor, rise: Tensor) -> tuple[Tensor, Tensor]:
    """What `pitch_course` adds up, (P, M) each: how the foot comes down flat, and how it rises on its ball."""
    settle, slap, rise = settle.unsqueeze(-1), slap.unsqueeze(-1), rise.unsqueeze(-1)
    return torch.exp(-(settle + slap * phase) * phase), phase.clamp_min(1e-12) ** rise


def pitch_course(
    phase: Tensor, touchdown: Tensor, takeoff: Tensor, settle: Tensor, slap: Tensor, rise: Tensor
) -> Tensor:
    """Pitch (P, M) of a standing foot at phases (P, M) of its contact [rad].

    From `touchdown` (P,) it comes down flat as exp(-settle s - slap s^2), and rises on its ball to `takeoff` (P,) as
    s^rise: people's feet do about that (see experiments/realism).
    """
    fall, climb = pitch_shapes(phase, settle, slap, rise)
    return touchdown.unsqueeze(-1) * fall + takeoff.unsqueeze(-1) * climb
