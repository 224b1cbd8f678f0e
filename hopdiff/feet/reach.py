"""What a leg does about a foot print that it cannot reach: raise the heel, lower the body, or leave the ground."""

from __future__ import annotations

import torch
from torch import Tensor
from torch.nn import functional

from hopdiff.feet.track import LegTrack, smooth_step

REACH = 0.99  # of the leg's length: as far as a foot is put, unless the source goes farther
SOFT = 0.93  # of the leg's length: from here on a leg stretches less and less
EDGE = 0.97  # the same as it lands or leaves
STRETCHED = 0.985  # the same for a leg that stands
FOLDED, FOLD = 0.5, 0.15  # of the leg's length: from here on it folds less and less, and by how much at most
HEEL = 0.8  # rad by which a heel is raised beyond the source's, at most
EASY = 0.4  # of that before the body comes down
BEHIND = (-0.05, 0.15)  # m that the hip is ahead of the ball of the foot: from where on, and from where on freely


def longest(track: LegTrack) -> Tensor:
    """(T,) as far as a leg reaches [m]."""
    return torch.maximum(track.span, torch.full_like(track.span, REACH)).clamp_max(1.0) * track.length


def softened(track: LegTrack, distance: Tensor, soft: Tensor | float = SOFT) -> Tensor:
    """(T,) distances from hip to ankle [m] as a leg stretches towards them: as they are up to a share of its length
    and to what the source does, then less and less up to the longest."""
    length = track.length
    low = torch.maximum(track.span, torch.as_tensor(soft, dtype=length.dtype)) * length
    high = torch.maximum(longest(track), low + 1e-4 * length)
    return eased(distance, low, high - low)


def unfolded(track: LegTrack, distance: Tensor) -> Tensor:
    """(T,) distances from hip to ankle [m] to which a leg folds: as they are down to a share of its length and to what
    the source does, then less and less."""
    low, room = torch.minimum(track.span, torch.full_like(track.span, FOLDED)) * track.length, FOLD * track.length
    return -eased(-distance, -low, room)


def eased(distance: Tensor, low: Tensor, room: Tensor) -> Tensor:
    """(T,) distances [m] as they are up to low, then less and less, never by room or more beyond it."""
    more = (distance - low).clamp_min(0.0)
    found: Tensor = torch.minimum(distance, low) + room * (1.0 - torch.exp(-more / room))
    return found


def heel_angle(hip: Tensor, ankle: Tensor, ball: Tensor, axis: Tensor, reach: Tensor) -> Tensor:
    """(...,) angles about an axis (..., 3) to its left by which a foot must be turned on its ball, heel up, for its
    ankle (..., 3) to be as far from the hip as reach (...,), or as near to that as can be [rad].

    The scalar product of hip and turned ankle, both from the ball, is A cos + B sin + C of the angle.
    """
    towards, arm = hip - ball, ankle - ball
    fixed = (towards * axis).sum(-1) * (arm * axis).sum(-1)
    a = (towards * arm).sum(-1) - fixed
    b = (towards * torch.linalg.cross(axis.expand_as(arm), arm)).sum(-1)
    wanted = 0.5 * ((towards**2).sum(-1) + (arm**2).sum(-1) - reach**2) - fixed
    share = (wanted / torch.sqrt(a**2 + b**2).clamp_min(1e-9)).clamp(-1.0, 1.0)
    angle: Tensor = torch.atan2(b, a) - torch.acos(share)
    return angle


def heel_up(hip: Tensor, ankle: Tensor, ball: Tensor, axis: Tensor, reach: Tensor, most: Tensor) -> Tensor:
    """(...,) the same, never heel down and at most by most (...,) [rad]."""
    return torch.minimum(heel_angle(hip, ankle, ball, axis, reach).clamp_min(0.0), most)


def turned_up(ankle: Tensor, ball: Tensor, axis: Tensor, angle: Tensor) -> Tensor:
    """(..., 3) ankles turned about the ball by angles (...,), heel up [m]."""
    arm = ankle - ball
    c, s = torch.cos(angle)[..., None], torch.sin(angle)[..., None]
    along = (arm * axis).sum(-1, keepdim=True)
    found: Tensor = ball + c * arm + s * torch.linalg.cross(axis.expand_as(arm), arm) + (1.0 - c) * along * axis
    return found


def most_heel(hip: Tensor, ball: Tensor, axis: Tensor) -> Tensor:
    """(...,) by how much a heel may be raised [rad]: not while the hip is still behind the foot."""
    x, _, z = axis.unbind(-1)
    ahead = functional.normalize(torch.stack((-z, x), dim=-1), dim=-1)
    before = ((hip - ball)[..., [0, 2]] * ahead).sum(-1)
    share = (before - BEHIND[0]) / (BEHIND[1] - BEHIND[0])
    found: Tensor = HEEL * smooth_step(share)
    return found


def lacking(
    hip: Tensor, ankle: Tensor, ball: Tensor | None, axis: Tensor, reach: Tensor, heel: Tensor
) -> tuple[Tensor, Tensor]:
    """(...,) how far the hip (..., 3) must come down for the ankle to be within reach (...,), heel raised as far as it
    may, and by how much it is out of reach [m]. heel: (...,) share of the angle by which it may be raised."""
    if ball is not None:
        most = heel * most_heel(hip, ball, axis)
        ankle = turned_up(ankle, ball, axis, heel_up(hip, ankle, ball, axis, reach, most))
    gap = ankle - hip
    level = gap[..., 0] ** 2 + gap[..., 2] ** 2
    down = (-gap[..., 1] - (reach**2 - level).clamp_min(0.0).sqrt()).clamp_min(0.0)
    return down, (gap.norm(dim=-1) - reach).clamp_min(0.0)
