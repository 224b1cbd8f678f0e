"""Feet of another body put on the ground where they stand: still, level as they are, and never below it.

A foot is a few points of its sole. While it stands, the lowest of them are on the ground and do not move; the foot
rolls over them as it is turned. Between contacts it goes over to its own way, and legs follow by inverse kinematics.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from hopdiff.editing.leg_joints import Leg
from hopdiff.editing.loop import repeated, repetitions
from hopdiff.export.target import Target
from hopdiff.feet.contacts import spans
from hopdiff.feet.prints import FootPrint, GroundMove, weights
from hopdiff.feet.reach import STRETCHED
from hopdiff.feet.track import LegTrack, leg_tracks
from hopdiff.feet.way import FootWay, lowering
from hopdiff.geometry.clip import Clip
from hopdiff.geometry.quaternion import slerp
from hopdiff.geometry.rotation import axis_rotation, unwrap

MOST_LOWERED = 0.3  # m by which a body is lowered whose legs are too short: proportions may differ
TOUCH = 0.003  # m above the lowest point of a sole up to which others stand, too
LEVELS = 13  # ways to hold a foot that are tried, from its own to level
AROUND = 2.0  # s of a loop's neighbours that its contacts are seen with


@dataclass(frozen=True, eq=False)
class Sole:
    """Points of the sole of a leg in the rest pose, from the ankle, or from the end of the shank [m].

    foot: (K, 3), turned with the shank where there is no ankle. ball: (3,) where the foot stands. toe: (3,) of the toe
    joint, None if the leg has none, and tips: (M, 3) from there.
    """

    leg: Leg
    foot: Tensor
    ball: Tensor
    toe: Tensor | None = None
    tips: Tensor | None = None

    @classmethod
    def of(cls, target: Target, leg: Leg) -> Sole:
        depth, here = target.depth(leg), torch.zeros(3, dtype=torch.float64)
        skin = target.sole(leg)
        if leg.ankle is None:
            return cls(leg, here.unsqueeze(0) if skin is None else skin.foot, here)

        def on_ground(place: Tensor) -> Tensor:
            return torch.stack((place[0], place.new_tensor(-depth), place[2]))

        toe = None if leg.toe is None else target.places[leg.toe] - target.places[leg.ankle]
        if skin is not None:
            ball = toe if toe is not None else (skin.tip - 0.3 * (skin.tip + skin.heel)) * skin.ahead
            return cls(leg, skin.foot, on_ground(ball), toe, skin.toe)
        heel = on_ground(here)
        if leg.toe is None or toe is None:
            end = target.end_of(leg.ankle)
            foot = [heel] if end is None else [heel, on_ground(end)]
            return cls(leg, torch.stack(foot), foot[-1])
        end = target.end_of(leg.toe)
        tips = None if end is None else (on_ground(toe + end) - toe).unsqueeze(0)
        return cls(leg, torch.stack((heel, on_ground(toe))), on_ground(toe), toe, tips)

    def points(self, frames: Tensor) -> Tensor:
        """(T, K, 3) from the ankle, of joints turned as (T, J, 3, 3)."""
        ankle = self.leg.ankle
        found = _turned(frames[:, self.leg.knee if ankle is None else ankle], self.foot)
        if ankle is not None and self.toe is not None and self.tips is not None and self.leg.toe is not None:
            toe = _turned(frames[:, ankle], self.toe.unsqueeze(0))
            found = torch.cat((found, toe + _turned(frames[:, self.leg.toe], self.tips)), dim=1)
        return found

    def standing(self, frames: Tensor) -> Tensor:
        """(T, 3) from the ankle where the foot stands."""
        joint = self.leg.knee if self.leg.ankle is None else self.leg.ankle
        return _turned(frames[:, joint], self.ball.unsqueeze(0))[:, 0]


def _turned(frames: Tensor, points: Tensor) -> Tensor:
    """(T, K, 3) points (K, 3) of frames (T, 3, 3)."""
    return points @ frames.transpose(-1, -2)


def foot_points(clip: Clip, soles: Sequence[Sole]) -> Tensor:
    """(T, 2, 3) where feet stand: the ball, or the sole below the ankle, or the end of the shank [m]."""
    frames = clip.forward()[1]
    found = []
    for sole, track in zip(soles, leg_tracks(clip, [sole.leg for sole in soles]), strict=True):
        found.append(track.ankle + sole.standing(frames))
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
    # What is below a shank without a foot turns with it as the leg is posed: once more from there.
    stumps = any(sole.leg.ankle is None and len(sole.foot) > 1 for sole in soles)
    for _ in range(2 if stumps else 1):
        clip = _planted_once(clip, soles, contact)
    return clip


def _planted_once(clip: Clip, soles: Sequence[Sole], contact: Tensor) -> Clip:
    tracks = leg_tracks(clip, [sole.leg for sole in soles])
    frames = clip.forward()[1]
    ways = [
        _way(track, frames, sole, contact[:, k], clip.frame_time)
        for k, (track, sole) in enumerate(zip(tracks, soles, strict=True))
    ]
    lowered = lowering(ways, MOST_LOWERED)
    root, rotations = clip.root_position.clone(), clip.rotations.clone()
    root[:, 1] -= lowered
    for way in ways:
        way.pose(rotations, torch.eye(3, dtype=torch.float64), lowered)
    posed = replace(clip, root_position=root, rotations=rotations)
    for k, sole in enumerate(soles):
        posed = _cleared(posed, sole, contact[:, k])
    return posed


def _cleared(clip: Clip, sole: Sole, stands: Tensor) -> Clip:
    """A clip whose foot, where it is in the air and its leg is too short to fold further, is as level as it must be to
    stay above y = 0."""
    positions, frames = clip.forward()
    ankle = sole.leg.ankle
    if ankle is None or not bool(stands.any()):
        return clip
    foot, height = frames[:, ankle], positions[:, ankle, 1]
    level = axis_rotation("Y", torch.atan2(foot[:, 0, 2] - foot[:, 2, 0], foot[:, 0, 0] + foot[:, 2, 2]))
    shares = torch.linspace(0.0, 1.0, LEVELS, dtype=torch.float64)
    lows = []
    for share in shares:
        turn = slerp(foot, level, share.expand(len(foot))) @ foot.transpose(-1, -2)
        lows.append(height + (turn[:, None] @ sole.points(frames).unsqueeze(-1))[..., 1, 0].amin(dim=1))
    low = torch.stack(lows)
    # The first share at which it is clear, between two of those that were tried; all of it where none is.
    clear = (low >= 0.0).double().argmax(dim=0)
    clear = torch.where((low >= 0.0).any(dim=0), clear, torch.full_like(clear, LEVELS - 1))
    before = (clear - 1).clamp_min(0)
    at = torch.arange(len(foot))
    under, over = low[before, at], low[clear, at]
    part = torch.where(clear > 0, (-under / (over - under).clamp_min(1e-9)).clamp(0.0, 1.0), torch.zeros_like(over))
    share = torch.where(stands, torch.zeros_like(part), (before.double() + part) / (LEVELS - 1))
    if not bool((share > 0.0).any()):
        return clip
    rotations = clip.rotations.clone()
    above = frames[:, clip.skeleton.parents[ankle]]
    rotations[:, ankle] = above.transpose(-1, -2) @ slerp(foot, level, share)
    return replace(clip, rotations=rotations)


def _way(track: LegTrack, frames: Tensor, sole: Sole, stands: Tensor, frame_time: float) -> FootWay:
    """The way of a foot whose frames (T, J, 3, 3) are the clip's, held while it stands (T,)."""
    ankle = track.ankle
    times = torch.arange(len(ankle))
    still = GroundMove(torch.zeros((), dtype=torch.float64), torch.zeros(2, dtype=torch.float64))
    prints = [FootPrint(first, last, still, False) for first, last in spans(stands)]
    shares = torch.zeros(len(prints), len(ankle), dtype=torch.float64)
    for number, (here, share) in enumerate(weights(prints, len(ankle), frame_time)):
        shares[number, here] = share
    inside = [times.clamp(one.first, one.last) for one in prints]
    turn, change = torch.zeros(len(ankle), dtype=torch.float64), torch.zeros_like(ankle)
    if sole.leg.ankle is not None:
        # A foot that stands does not turn about the vertical.
        foot = frames[:, sole.leg.ankle]
        yaw = unwrap(torch.atan2(foot[:, 0, 2] - foot[:, 2, 0], foot[:, 0, 0] + foot[:, 2, 2]))
        for one, share, at in zip(prints, shares, inside, strict=True):
            turn = turn + share * (yaw[one.frames].mean() - yaw)[at]
    frame = axis_rotation("Y", turn)
    points = (frame[:, None] @ sole.points(frames).unsqueeze(-1)).squeeze(-1)
    for one, share, at in zip(prints, shares, inside, strict=True):
        here = one.frames
        rolled = _rolled(points[here])
        rolled[:, [0, 2]] += (ankle[here] - rolled).mean(dim=0)[[0, 2]]
        change = change + share[:, None] * (rolled - ankle[here])[at - one.first]
    target = ankle + change
    floor = -points[..., 1].amin(dim=1)
    target[:, 1] = torch.maximum(target[:, 1], floor)
    # Heels roll as the source's do: none is raised for the sake of reach before the body comes down.
    return FootWay(
        track,
        track.hip,
        target,
        frame,
        stands,
        shares.sum(dim=0),
        torch.ones_like(turn),
        frame_time,
        STRETCHED,
        floor=floor,
    )


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
