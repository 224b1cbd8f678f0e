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
    heel, ball = layout.heel, layout.ball
    width = ROUND * float(ball[2] - heel[2])
    c, s = pitch.cos(), pitch.sin()
    down, along = -float(heel[1]), (float(heel[2]), float(ball[2]))
    first, second = down * c - along[0] * s, down * c - along[1] * s
    share = torch.sigmoid((second - first) / width)
    height = first + width * functional.softplus((second - first) / width)
    reach = along[0] + (along[1] - along[0]) * share
    return Sole(height, reach * c + down * s)


def pitch_course(
    phase: Tensor, touchdown: Tensor, takeoff: Tensor, settle: Tensor, slap: Tensor, rise: Tensor
) -> Tensor:
    """Pitch (P, M) of a standing foot at phases (P, M) of its contact [rad].

    From `touchdown` (P,) it comes down flat as exp(-settle s - slap s^2), and rises on its ball to `takeoff` (P,) as
    s^rise: people's feet do about that (see experiments/realism).
    """
    settle, slap, rise = settle.unsqueeze(-1), slap.unsqueeze(-1), rise.unsqueeze(-1)
    fall = torch.exp(-(settle + slap * phase) * phase)
    return touchdown.unsqueeze(-1) * fall + takeoff.unsqueeze(-1) * phase.clamp_min(1e-12) ** rise
