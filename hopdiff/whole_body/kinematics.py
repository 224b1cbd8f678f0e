"""From angles to frames and places of all segments.

A frame is stored by its axes: F[..., k, i, :] is component i of axis k (left, up, forward of the segment), so that a
vector (a, b, c) of the segment is a F[0] + b F[1] + c F[2] in the world.
"""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor

from hopdiff.numerics import constant
from hopdiff.whole_body.layout import CHEST, Layout


class Angles(NamedTuple):
    """pelvis, waist, chest, head: (P, 3, M) pitch (forward), roll (to the right) and yaw (to the left) in the world.

    thigh, knee, foot, tilt: (P, 2, M) of the left and the right leg: attitude of the thigh ahead of the vertical,
    flexion, pitch of the foot (toes up), and turn of the leg about the forward axis (foot to the left).
    shoulder, elbow: (P, 2, M) flexion. abduction, inward: (P,) of both arms alike. All [rad].
    """

    pelvis: Tensor
    waist: Tensor
    chest: Tensor
    head: Tensor
    thigh: Tensor
    knee: Tensor
    foot: Tensor
    tilt: Tensor
    shoulder: Tensor
    elbow: Tensor
    abduction: Tensor
    inward: Tensor


def attitude_frames(angles: Tensor) -> Tensor:
    """Frames (..., 3, 3, M) of the rotation yaw, then roll, then pitch, about up, forward and left.

    angles: (..., 3, M) pitch, roll and yaw.
    """
    (cx, cz, cy), (sx, sz, sy) = angles.cos().unbind(-2), angles.sin().unbind(-2)
    zx, zy = sz * cx, sz * sx
    axes = (cy * cz, sz, -sy * cz, sy * sx - cy * zx, cz * cx, sy * zx + cy * sx, cy * zy + sy * cx, -cz * sx)
    found: Tensor = torch.stack((*axes, cy * cx - sy * zy), dim=-2).unflatten(-2, (3, 3))
    return found


def limb_frames(turn: Tensor, flexion: Tensor) -> Tensor:
    """Frames (..., 3, 3, M) of a turn about forward, then a flexion (forward, about left); angles (..., M)."""
    cz, sz = turn.cos(), turn.sin()
    cx, sx = flexion.cos(), flexion.sin()
    axes = (cz, sz, torch.zeros_like(cx), -sz * cx, cz * cx, -sx, -sz * sx, cz * sx, cx)
    found: Tensor = torch.stack(axes, dim=-2).unflatten(-2, (3, 3))
    return found


def trunk_frames(angles: Angles) -> Tensor:
    """(P, 4, 3, 3, M) of pelvis, waist, chest and head."""
    return attitude_frames(torch.stack((angles.pelvis, angles.waist, angles.chest, angles.head), dim=1))


def all_frames(angles: Angles, trunk: Tensor, arms: Tensor | None = None) -> Tensor:
    """(P, S, 3, 3, M) of all segments; trunk, arms: what `trunk_frames` and `arm_frames` gave."""
    arms = arm_frames(angles) if arms is None else arms
    flexion = torch.stack((angles.thigh, angles.thigh - angles.knee, angles.foot), dim=1)
    # Feet stand level from side to side, whichever way the leg leans.
    turn = torch.stack((angles.tilt, angles.tilt, torch.zeros_like(angles.tilt)), dim=1)
    legs = limb_frames(turn, flexion).flatten(1, 2)
    # From the chest's frame to the world.
    carried = (arms.unsqueeze(-2) * trunk[:, None, None, CHEST]).sum(3)
    return torch.cat((trunk, legs, carried), dim=1)


def arm_frames(angles: Angles) -> Tensor:
    """(P, 4, 3, 3, M) of both upper arms and both forearms in the frame of the chest."""
    sides = constant((1.0, -1.0), angles.shoulder.dtype, angles.shoulder.device)[:, None]
    outward = (sides * angles.abduction[:, None, None]).expand_as(angles.shoulder)
    own = limb_frames(outward, angles.shoulder)
    turned = -sides * angles.inward[:, None, None]
    c, s = turned.cos().unsqueeze(2), turned.sin().unsqueeze(2)
    left, up, ahead = own.unbind(2)
    upper = torch.stack((c * left - s * ahead, up, s * left + c * ahead), dim=2)
    c, s = angles.elbow.cos().unsqueeze(2), angles.elbow.sin().unsqueeze(2)
    left, up, ahead = upper.unbind(2)
    lower = torch.stack((left, c * up - s * ahead, s * up + c * ahead), dim=2)
    return torch.cat((upper, lower), dim=1)


def placed(matrix: Tensor, root: Tensor, frames: Tensor) -> Tensor:
    """(P, N, 3, M) points [m] that hang on the body: `Layout.hanging` or `weighing` (N, 3 S), the root (P, 3, M) middle
    between the hips [m], and the frames (P, S, 3, 3, M)."""
    hung = matrix @ frames.reshape(frames.shape[0], matrix.shape[1], -1)
    found: Tensor = root.unsqueeze(1) + hung.unflatten(2, (3, -1))
    return found


def joint_places(layout: Layout, root: Tensor, frames: Tensor) -> Tensor:
    """(P, S, 3, M) of the joints that the segments turn about [m]; root: (P, 3, M) middle between the hips [m]."""
    return placed(layout.hanging, root, frames)


def segment_centres(layout: Layout, root: Tensor, frames: Tensor) -> Tensor:
    """(P, S, 3, M) centres of mass of the segments [m]."""
    return placed(layout.weighing, root, frames)
