"""From angles to frames and places of all segments.

A frame is stored by its axes: F[..., k, i, :] is component i of axis k (left, up, forward of the segment), so that a
vector (a, b, c) of the segment is a F[0] + b F[1] + c F[2] in the world.
"""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor

from hopdiff.whole_body.layout import CHEST, PARENTS, Layout


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


def attitude_frames(pitch: Tensor, roll: Tensor, yaw: Tensor) -> Tensor:
    """Frames (..., 3, 3, M) of the rotation yaw, then roll, then pitch, about up, forward and left; angles (..., M)."""
    angles = torch.stack((pitch, roll, yaw))
    (cx, cz, cy), (sx, sz, sy) = angles.cos().unbind(0), angles.sin().unbind(0)
    zx, zy = sz * cx, sz * sx
    left = torch.stack((cy * cz, sz, -sy * cz), dim=-2)
    up = torch.stack((sy * sx - cy * zx, cz * cx, sy * zx + cy * sx), dim=-2)
    ahead = torch.stack((cy * zy + sy * cx, -cz * sx, cy * cx - sy * zy), dim=-2)
    return torch.stack((left, up, ahead), dim=-3)


def limb_frames(turn: Tensor, flexion: Tensor) -> Tensor:
    """Frames (..., 3, 3, M) of a turn about forward, then a flexion (forward, about left); angles (..., M)."""
    angles = torch.stack((turn, flexion))
    (cz, cx), (sz, sx) = angles.cos().unbind(0), angles.sin().unbind(0)
    none = torch.zeros_like(turn)
    left = torch.stack((cz, sz, none), dim=-2)
    up = torch.stack((-sz * cx, cz * cx, -sx), dim=-2)
    ahead = torch.stack((-sz * sx, cz * sx, cx), dim=-2)
    return torch.stack((left, up, ahead), dim=-3)


def trunk_frames(angles: Angles) -> Tensor:
    """(P, 4, 3, 3, M) of pelvis, waist, chest and head."""
    stacked = torch.stack((angles.pelvis, angles.waist, angles.chest, angles.head), dim=1)
    return attitude_frames(stacked[:, :, 0], stacked[:, :, 1], stacked[:, :, 2])


def all_frames(angles: Angles, trunk: Tensor) -> Tensor:
    """(P, S, 3, 3, M) of all segments; trunk: what `trunk_frames` gave."""
    turn = torch.cat((angles.tilt, angles.tilt, torch.zeros_like(angles.tilt)), dim=1)
    legs = limb_frames(turn, torch.cat((angles.thigh, angles.thigh - angles.knee, angles.foot), dim=1))
    return torch.cat((trunk, legs, _arm_frames(angles, trunk[:, CHEST])), dim=1)


def _arm_frames(angles: Angles, chest: Tensor) -> Tensor:
    """(P, 4, 3, 3, M) of both upper arms and both forearms."""
    sides = angles.shoulder.new_tensor((1.0, -1.0))[:, None]
    outward = (sides * angles.abduction[:, None, None]).expand_as(angles.shoulder)
    own = limb_frames(outward, angles.shoulder)
    turned = -sides * angles.inward[:, None, None]
    c, s = turned.cos().unsqueeze(2), turned.sin().unsqueeze(2)
    left, up, ahead = own.unbind(2)
    upper = torch.stack((c * left - s * ahead, up, s * left + c * ahead), dim=2)
    c, s = angles.elbow.cos().unsqueeze(2), angles.elbow.sin().unsqueeze(2)
    left, up, ahead = upper.unbind(2)
    lower = torch.stack((left, c * up - s * ahead, s * up + c * ahead), dim=2)
    return torch.einsum("pjim,pskjm->pskim", chest, torch.cat((upper, lower), dim=1))


def joint_places(layout: Layout, root: Tensor, frames: Tensor) -> Tensor:
    """(P, S, 3, M) of the joints that the segments turn about [m]; root: (P, 3, M) middle between the hips [m]."""
    holders = frames[:, [max(parent, 0) for parent in PARENTS]]
    arms = torch.einsum("pskim,sk->psim", holders, layout.offsets)
    return root.unsqueeze(1) + torch.einsum("sj,pjim->psim", layout.above, arms)


def segment_centres(layout: Layout, joints: Tensor, frames: Tensor) -> Tensor:
    """(P, S, 3, M) centres of mass of the segments [m]."""
    return joints + torch.einsum("pskim,sk->psim", frames, layout.centres)
