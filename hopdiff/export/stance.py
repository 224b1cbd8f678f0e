"""Feet that the model's legs do not have: planted on the ball while they stand, hanging in the swing.

While a leg stands the ball of its foot stays on one place, the heel is as high as lets the knee keep its bend, and the
ankle is where that puts it; thigh and shank reach for it. In the swing the leg is the model's again.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from scipy.ndimage import maximum_filter1d, uniform_filter1d
from torch import Tensor
from torch.nn import functional

from hopdiff.editing.leg_joints import Leg
from hopdiff.export.take import Take
from hopdiff.feet.contacts import spans
from hopdiff.feet.reach import heel_angle
from hopdiff.feet.track import bent, leg_tracks
from hopdiff.geometry.rotation import axis_rotation
from hopdiff.geometry.skeleton import Skeleton

POINTED = 0.35  # rad by which toes point down from the shank's right angle in mid-swing
LIFT = 0.06  # s in which toes are lifted that would scrape
EASE = 0.35  # of a swing in which a foot leaves how it stood, and comes to how it will stand
SOFT = 0.04  # rad about which a heel that would sink stays on the ground, so that it does so without a corner


@dataclass(frozen=True, eq=False)
class _Foot:
    """toe: its joint, at the ball. ball, tip: (3,) from the ankle of a level foot to its ball and the tips of its toes
    [m]."""

    leg: Leg
    toe: int
    ball: Tensor
    tip: Tensor


def with_feet(take: Take) -> Tensor:
    """Rotations (T, J, 3, 3) of a take on 22 joints whose ankles are straight and whose contacts are known, with legs
    and feet posed."""
    rotations = take.clip.rotations
    for k, side in enumerate(("left", "right")):
        rotations = _posed(take, rotations, k, _foot(take.clip.skeleton, side))
    return rotations


def _foot(skeleton: Skeleton, side: str) -> _Foot:
    hip, knee, ankle, toe = (skeleton.index(f"{side}_{part}") for part in ("hip", "knee", "ankle", "toe"))
    ball = skeleton.offsets[toe]
    return _Foot(Leg(side, hip, knee, ankle, toe), toe, ball, ball + skeleton.end_sites[f"{side}_toe"])


def _posed(take: Take, rotations: Tensor, k: int, foot: _Foot) -> Tensor:
    assert take.contact is not None
    assert take.feet is not None
    contact, leg = take.contact[:, k], foot.leg
    places, frames = take.clip.forward()
    hip, ankle, shank = places[:, leg.hip], places[:, leg.ankle], frames[:, leg.knee]
    heading = _level(shank)
    pitch, aim = torch.zeros(len(contact), dtype=torch.float64), ankle.clone()
    for first, last in spans(contact):
        here = slice(first, last + 1)
        heading[here] = _level(heading[here].mean(dim=0, keepdim=True))
        # The model stands on the point below the ankle of a level foot.
        point = take.feet[here, k].mean(dim=0) * torch.tensor([1.0, 0.0, 1.0])
        level = heading[first]
        ball = point + level @ (foot.ball * torch.tensor([1.0, 0.0, 1.0]))
        pitch[here] = _heel(hip[here], (hip[here] - ankle[here]).norm(dim=-1), ball, level, foot.ball)
        stood = level @ axis_rotation("X", pitch[here])
        aim[here] = ball - stood @ foot.ball
    swing = _swing(contact)
    aim = ankle + _carried(aim - ankle, contact, swing)
    pitch = _carried(pitch, contact, swing)
    # In mid-swing the foot hangs from the shank that the reach leaves; toes are lifted where they would scrape.
    rotations, track = rotations.clone(), leg_tracks(take.clip, (leg,))[0]
    bent(track, rotations, torch.eye(3, dtype=torch.float64), track.hip, aim, track.foot, track.toe)
    posed = take.clip.skeleton.forward(take.clip.root_position, rotations)
    ankle, shank = posed[0][:, leg.ankle], posed[1][:, leg.knee]
    hanging = torch.atan2(-shank[:, 1, 2], shank[:, 1, 1]) + POINTED
    pitch = pitch + swing * (hanging - pitch)
    pitch = pitch - _lift(pitch, ankle[:, 1], foot, swing, take.clip.frame_time)
    turned = rotations.clone()
    turned[:, leg.ankle] = shank.transpose(-1, -2) @ heading @ axis_rotation("X", pitch)
    # Toes stay on the ground while the heel comes up.
    turned[:, foot.toe] = axis_rotation("X", -(1.0 - swing) * pitch.clamp_min(0.0))
    return turned


def _level(frame: Tensor) -> Tensor:
    """(T, 3, 3) the frames (T, 3, 3) set upright, with the heading of their left axes."""
    across = functional.normalize(frame[:, :, 0] * torch.tensor([1.0, 0.0, 1.0], dtype=frame.dtype), dim=-1)
    up = torch.tensor([0.0, 1.0, 0.0], dtype=frame.dtype).expand_as(across)
    return torch.stack((across, up, torch.linalg.cross(across, up)), dim=-1)


def _heel(hip: Tensor, reach: Tensor, ball: Tensor, level: Tensor, offset: Tensor) -> Tensor:
    """(T,) pitch of a foot on its ball (3,), heel up, that puts its ankle as far from the hip (T, 3) as it was, reach
    (T,) [rad]; 0 at least, without a corner. level: (3, 3) frame of the level foot, offset: (3,) from its ankle to its
    ball."""
    pitch = heel_angle(hip, ball - level @ offset, ball, level[:, 0], reach)
    return 0.5 * (pitch + torch.sqrt(pitch**2 + SOFT**2))


def _carried(values: Tensor, contact: Tensor, swing: Tensor) -> Tensor:
    """What is known in the stances (T, ...), carried on into the swings, where it fades as they begin and end."""
    found = list(spans(contact))
    result = values.clone()
    fade = (1.0 - swing).reshape(-1, *[1] * (values.ndim - 1))
    for k in range(-1, len(found)):
        before = found[k][1] if k >= 0 else None
        after = found[k + 1][0] if k + 1 < len(found) else None
        start, stop = 0 if before is None else before + 1, len(values) if after is None else after
        if start >= stop:
            continue
        middle = (start + stop) // 2 if before is not None and after is not None else start if before is None else stop
        if before is not None:
            result[start:middle] = fade[start:middle] * values[before]
        if after is not None:
            result[middle:stop] = fade[middle:stop] * values[after]
    return result if found else torch.zeros_like(values)


def _lift(pitch: Tensor, height: Tensor, foot: _Foot, swing: Tensor, frame_time: float) -> Tensor:
    """(T,) by how much toes are lifted in the swing so that they stay above the ground; height: of the ankle [m]."""
    reach, down = float(foot.tip.norm()), torch.atan2(foot.tip[2], -foot.tip[1])
    steepest = down - torch.acos((height / reach).clamp(-1.0, 1.0))
    steepest = torch.where(height < reach, steepest, torch.pi)
    excess = torch.where(swing > 0.0, (pitch - steepest).clamp_min(0.0), 0.0)
    wide = 2 * round(LIFT / frame_time) + 1
    smooth = uniform_filter1d(maximum_filter1d(excess.numpy(), wide, mode="nearest"), wide, mode="nearest")
    return torch.maximum(excess, torch.from_numpy(smooth) * (4.0 * swing).clamp_max(1.0))


def _swing(contact: Tensor) -> Tensor:
    """(T,) 0 while a foot stands, 1 in the middle of its swing, without corners between."""
    frames = len(contact)
    stands = contact.nonzero().flatten()
    if not len(stands):
        return torch.ones(frames, dtype=torch.float64)
    times = torch.arange(frames)
    after = torch.searchsorted(stands, times)
    before = torch.searchsorted(stands, times, right=True) - 1
    far = float(frames)
    since = torch.where(before >= 0, (times - stands[before.clamp_min(0)]).double(), far)
    until = torch.where(after < len(stands), (stands[after.clamp_max(len(stands) - 1)] - times).double(), far)
    share = (torch.minimum(since, until) / (EASE * (since + until).clamp_min(1.0))).clamp(0.0, 1.0)
    return share**2 * (3.0 - 2.0 * share)
