"""Feet of another body put on the ground where they stand: still, level as they are, and never below it.

A foot is a few points of its sole. While it stands, the lowest of them are on the ground and do not move; the foot
rolls over them as it is turned. Between contacts it goes over to its own way, and legs follow by inverse kinematics.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import torch
from scipy.ndimage import maximum_filter1d, uniform_filter1d
from torch import Tensor

from hopdiff.editing.contacts import spans
from hopdiff.editing.feet import RAMP, REACH, SETTLING, reached
from hopdiff.editing.leg_joints import Leg
from hopdiff.editing.loop import repeated, repetitions
from hopdiff.export.target import Target
from hopdiff.geometry.clip import Clip
from hopdiff.geometry.rotation import axis_rotation, unwrap

TOUCH = 0.003  # m above the lowest point of a sole up to which others stand, too
AROUND = 2.0  # s of a loop's neighbours that its contacts are seen with


@dataclass(frozen=True, eq=False)
class Sole:
    """Points of the sole of a leg in the rest pose, from the ankle, or from the end of the shank [m].

    heel, ball, tip: (3,); tip is from the toe joint, and toe (3,) is where that is; None if the leg has none.
    """

    leg: Leg
    heel: Tensor
    ball: Tensor | None = None
    toe: Tensor | None = None
    tip: Tensor | None = None

    @classmethod
    def of(cls, target: Target, leg: Leg) -> Sole:
        depth = target.depth(leg)
        if leg.ankle is None:
            return cls(leg, torch.zeros(3, dtype=torch.float64))

        def on_ground(place: Tensor) -> Tensor:
            return torch.stack((place[0], place.new_tensor(-depth), place[2]))

        heel = on_ground(torch.zeros(3, dtype=torch.float64))
        if leg.toe is None:
            end = target.end_of(leg.ankle)
            return cls(leg, heel, None if end is None else on_ground(end))
        toe = target.places[leg.toe] - target.places[leg.ankle]
        end = target.end_of(leg.toe)
        return cls(leg, heel, on_ground(toe), toe, None if end is None else on_ground(toe + end) - toe)

    def points(self, frames: Tensor) -> Tensor:
        """(T, K, 3) from the ankle, of joints turned as (T, J, 3, 3); the second is where the foot stands, if any."""
        if self.leg.ankle is None:
            return torch.zeros(len(frames), 1, 3, dtype=torch.float64)
        foot = frames[:, self.leg.ankle]
        found = [foot @ point for point in (self.heel, self.ball) if point is not None]
        if self.toe is not None and self.tip is not None and self.leg.toe is not None:
            found.append(foot @ self.toe + frames[:, self.leg.toe] @ self.tip)
        return torch.stack(found, dim=1)


def foot_points(clip: Clip, soles: Sequence[Sole]) -> Tensor:
    """(T, 2, 3) where feet stand: the ball, or the sole below the ankle, or the end of the shank [m]."""
    positions, frames = clip.forward()
    found = []
    for sole in soles:
        points = sole.points(frames)
        found.append(_ankle(clip, sole.leg, positions, frames) + points[:, min(1, points.shape[1] - 1)])
    return torch.stack(found, dim=1)


def planted(clip: Clip, soles: Sequence[Sole], contact: Tensor, loop: bool) -> Clip:
    """A clip on the ground y = 0 whose feet stand while contact (T, 2) says so.

    clip: its joints' frames aligned with the axes in the rest pose. loop: whether it goes on where it began; then its
    end fits its beginning afterwards, too. A foot that a loop never lifts is left as it is.
    """
    if not loop or clip.duration <= 0.0:
        return _planted(clip, soles, contact)
    period, half = clip.frames - 1, math.ceil(AROUND / clip.duration)
    count = 2 * half + 1
    flags = contact & ~contact.all(dim=0)
    flags = torch.cat((flags[:1], *[flags[1:]] * count))
    long = _planted(repeated(clip, count), soles, flags)
    here, one = slice(half * period, (half + 1) * period + 1), repetitions(clip, count)[half]
    rotations = long.rotations[here].clone()
    rotations[:, 0] = one.turn.transpose(-1, -2) @ rotations[:, 0]
    return replace(
        long, root_position=(long.root_position[here] - one.here) @ one.turn + one.start, rotations=rotations
    )


def _planted(clip: Clip, soles: Sequence[Sole], contact: Tensor) -> Clip:
    positions, frames = clip.forward()
    ankles, targets, turns = [], [], []
    for k, sole in enumerate(soles):
        ankle = _ankle(clip, sole.leg, positions, frames)
        target, turn = _held(ankle, frames, sole, list(spans(contact[:, k])), clip.frame_time)
        ankles.append(ankle)
        targets.append(target)
        turns.append(turn)
    root = clip.root_position.clone()
    root[:, 1] -= _sink(positions, soles, ankles, targets, clip.frame_time)
    lowered, rotations = replace(clip, root_position=root), clip.rotations
    for sole, target, turn in zip(soles, targets, turns, strict=True):
        rotations = reached(lowered, clip, rotations, sole.leg, target, turn)
    return replace(lowered, rotations=rotations)


def _ankle(clip: Clip, leg: Leg, positions: Tensor, frames: Tensor) -> Tensor:
    """(T, 3) ankle, or end of the shank [m]."""
    if leg.ankle is not None:
        return positions[:, leg.ankle]
    return positions[:, leg.knee] + frames[:, leg.knee] @ clip.skeleton.end_sites[clip.skeleton.names[leg.knee]]


def _held(
    ankle: Tensor, frames: Tensor, sole: Sole, plants: list[tuple[int, int]], frame_time: float
) -> tuple[Tensor, Tensor]:
    """Where the ankle (T, 3) of a leg shall be [m], and the turn about y of its foot (T,) [rad]."""
    times = torch.arange(len(ankle))
    weights = [_weight(plants, number, len(ankle), frame_time) for number in range(len(plants))]
    inside = [times.clamp(first, last) for first, last in plants]
    turn, change = torch.zeros(len(ankle), dtype=torch.float64), torch.zeros_like(ankle)
    if sole.leg.ankle is not None:
        # A foot that stands does not turn about the vertical.
        foot = frames[:, sole.leg.ankle]
        yaw = unwrap(torch.atan2(foot[:, 0, 2] - foot[:, 2, 0], foot[:, 0, 0] + foot[:, 2, 2]))
        for (first, last), weight, at in zip(plants, weights, inside, strict=True):
            turn = turn + weight * (yaw[first : last + 1].mean() - yaw)[at]
    points = (axis_rotation("Y", turn)[:, None] @ sole.points(frames).unsqueeze(-1)).squeeze(-1)
    for (first, last), weight, at in zip(plants, weights, inside, strict=True):
        here = slice(first, last + 1)
        rolled = _rolled(points[here])
        rolled[:, [0, 2]] += (ankle[here] - rolled).mean(dim=0)[[0, 2]]
        change = change + weight[:, None] * (rolled - ankle[here])[at - first]
    target = ankle + change
    target[:, 1] = torch.maximum(target[:, 1], -points[..., 1].amin(dim=1))
    return target, turn


def _rolled(points: Tensor) -> Tensor:
    """(T, 3) way of the ankle of a foot whose lowest points lie on y = 0 without sliding [m].

    points: (T, K, 3) of the sole, from the ankle.
    """
    height = points[..., 1] - points[..., 1].amin(dim=1, keepdim=True)
    touching = height < TOUCH
    both = touching[1:] & touching[:-1]
    both = torch.where(both.any(dim=1, keepdim=True), both, touching[1:] | touching[:-1]).double()
    steps = -(points.diff(dim=0) * both.unsqueeze(-1)).sum(dim=1) / both.sum(dim=1, keepdim=True)
    way = torch.cat((torch.zeros_like(points[:1, 0]), steps.cumsum(dim=0)))
    return torch.stack((way[:, 0], -points[..., 1].amin(dim=1), way[:, 2]), dim=-1)


def _weight(plants: list[tuple[int, int]], number: int, frames: int, frame_time: float) -> Tensor:
    """(T,) 1 in a contact, 0 after a ramp on either side; those that share a swing sum to 1 at most."""
    first, last = plants[number]
    sooner = plants[number - 1][1] if number else -frames
    later = plants[number + 1][0] if number + 1 < len(plants) else 2 * frames
    before, after = (min(RAMP / frame_time, float(gap)) for gap in (first - sooner, later - last))
    times = torch.arange(frames, dtype=torch.float64)
    x = torch.minimum(1.0 - (first - times) / before, 1.0 - (times - last) / after).clamp(0.0, 1.0)
    return x**2 * (3.0 - 2.0 * x)


def _sink(
    positions: Tensor, soles: Sequence[Sole], ankles: Sequence[Tensor], targets: Sequence[Tensor], frame_time: float
) -> Tensor:
    """(T,) how far the body must go down for all feet to be within reach, changing slowly [m]."""
    need = torch.zeros(len(positions), dtype=torch.float64)
    for sole, ankle, target in zip(soles, ankles, targets, strict=True):
        hip, knee = positions[:, sole.leg.hip], positions[:, sole.leg.knee]
        length = (knee - hip).norm(dim=-1) + (ankle - knee).norm(dim=-1)
        longest = torch.maximum(REACH * length, (ankle - hip).norm(dim=-1))
        gap = target - hip
        room = (longest**2 - gap[:, 0] ** 2 - gap[:, 2] ** 2).clamp_min(0.0).sqrt()
        need = torch.maximum(need, -gap[:, 1] - room)
    if float(need.max()) <= 1e-9:
        return torch.zeros_like(need)
    wide = 2 * max(1, round(0.5 * SETTLING / frame_time)) + 1
    # Twice the mean over half the window each: no corners.
    smooth = maximum_filter1d(need.numpy(), wide, mode="nearest")
    narrow = wide // 2 // 2 * 2 + 1
    for _ in range(2):
        smooth = uniform_filter1d(smooth, narrow, mode="nearest")
    return torch.from_numpy(smooth)
