"""A walk that begins in one pose and ends in another: what it lacks there is added, and taken away over time.

Inertialisation (Bollo 2018): the difference between the pose that is wanted and the walk's, and how fast it changes,
go to zero by a polynomial, while the walk itself goes on underneath. So nothing stops or starts with a jerk at a seam.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import torch
from scipy.spatial.transform import Rotation
from torch import Tensor

from hopdiff.editing.leg_joints import Leg
from hopdiff.feet.reach import REACH, SOFT, eased
from hopdiff.feet.track import LegTrack, bent, leg_tracks
from hopdiff.geometry.clip import Clip

GLANCE = 1.0 / 30.0  # s over which speeds are taken
EASE = 0.6  # of the walk's largest acceleration that a blend may add
SHORTEST, LONGEST = 0.4, 1.2  # s in which a difference is taken away
SWIFT = 25.0  # rad/s above which a difference of turns is a leap from one axis to another
CARRIED = 0.4  # s in which a difference of speeds is taken away at most
QUICKEST = 0.25  # s that a foot has for it at least
SHARE = 0.5  # of the walk at most


def blend_time(walk: Clip, other: Clip, at: int) -> float:
    """Seconds that the first frame (at 0) or the last one (at -1) of a walk needs to come from a clip's last or first
    frame, for no joint to be accelerated more than joints are in the walk."""
    first, before = (walk, other) if at == 0 else (reversed_clip(walk), reversed_clip(other))
    here = first.joint_positions().double(), before.joint_positions().double()
    return min(_needed(*here, walk.frame_time, SHORTEST), SHARE * max(walk.duration, walk.frame_time))


def _needed(walk: Tensor, before: Tensor, frame_time: float, least: float) -> float:
    """Seconds that places (T, K, 3) need to come from those before (T', K, 3) on [m]."""
    n = _glance(walk, before, frame_time)
    far = (walk[0] - before[-1]).norm(dim=-1)
    faster = ((walk[n] - walk[0]) - (before[-1] - before[max(-1 - n, -len(before))])).norm(dim=-1) / (n * frame_time)
    m = max(1, min(round(GLANCE / frame_time), (len(walk) - 1) // 2))
    jolts = (walk[2 * m :] - 2.0 * walk[m:-m] + walk[: -2 * m]).norm(dim=-1) / (m * frame_time) ** 2
    most = EASE * float(jolts.max())
    if most <= 0.0:
        return LONGEST
    # The polynomials of `_Fade` bend by 5.8 of what they take away over T^2, and by 3.9 of its speed over T, or
    # more where that is longer than CARRIED.
    speed = 3.9 * faster
    seconds = (speed + (speed**2 + 4.0 * most * 5.8 * far).sqrt()) / (2.0 * most)
    return min(max(least, float(seconds.max())), LONGEST)


def _glance(walk: Tensor, before: Tensor, frame_time: float) -> int:
    """Frames over which speeds are taken, as those from frame to frame are noise in quick captures."""
    return max(1, min(round(GLANCE / frame_time), len(walk) - 1, len(before) - 1))


def blended(
    walk: Clip,
    before: Clip,
    seconds: float,
    legs: Sequence[Leg] = (),
    stands: Tensor | None = None,
    stood: Tensor | None = None,
) -> Clip:
    """The walk from the last pose of another clip on, of which it is the walk again after some seconds.

    Joints and root by their angles; legs so that ankles and feet go over in the world, never lower than where they
    stand, and are there when they land. stands: (T, L) bool, when feet of the walk do; stood: (L,) those that do in the
    last frame before. For the end of a walk see `reversed_clip`.
    """
    fade = _Fade(walk, seconds)
    root = fade.places(walk.root_position, before.root_position)
    rotations = fade.turns(walk.rotations, before.rotations)
    offsets = walk.offsets
    if offsets is not None:
        offsets = fade.places(offsets, before.offsets if before.offsets is not None else offsets[:1])
    made = replace(walk, root_position=root, rotations=rotations, offsets=offsets)
    own, was, now = (leg_tracks(clip, legs) for clip in (walk, before, made))
    for at in range(len(legs)):
        swing = seconds
        if stands is not None and stood is not None:
            quick = _needed(own[at].ankle[:, None], was[at].ankle[:, None], walk.frame_time, QUICKEST)
            swing = min(seconds, _swing(stands[:, at], bool(stood[at]), quick, walk.frame_time))
        _step_over(_Fade(walk, swing), own[at], was[at], now[at], rotations, fade.frames)
    # To the last digit, as angles and inverse kinematics are not.
    root[0], rotations[0] = before.root_position[-1].to(root), before.rotations[-1].to(rotations)
    return replace(made, root_position=root, rotations=rotations)


def _swing(stands: Tensor, stood: bool, quickest: float, frame_time: float) -> float:
    """Seconds in which a foot must be where the walk has it: until it lands, if it does not stand all the time."""
    if bool(stands[0]):
        return math.inf if stood else quickest
    landing = stands.nonzero().flatten()
    return max(quickest, int(landing[0]) * frame_time) if len(landing) else math.inf


def reversed_clip(clip: Clip) -> Clip:
    """The clip from its last frame to its first."""
    offsets = None if clip.offsets is None else clip.offsets.flip(0)
    return replace(clip, root_position=clip.root_position.flip(0), rotations=clip.rotations.flip(0), offsets=offsets)


class _Fade:
    """How differences at the first frame of a walk go to zero."""

    def __init__(self, walk: Clip, seconds: float) -> None:
        self.frame_time = walk.frame_time
        count = min(walk.frames - 1, max(1, round(seconds / walk.frame_time)))
        # What a speed adds grows with the time in which it is taken away.
        quick = min(count, max(1, round(CARRIED / walk.frame_time)))
        frames = torch.arange(walk.frames, dtype=torch.float64)
        s, t = (frames / count).clamp_max(1.0), (frames / quick).clamp_max(1.0)
        # From 1 and from 0 with slope 1 to rest; without curvature at both ends.
        self.of_place = 1.0 - s**3 * (10.0 - 15.0 * s + 6.0 * s**2)
        self.of_speed = quick * (t - t**3 * (6.0 - 8.0 * t + 3.0 * t**2))
        self.frames = slice(0, count + 1)

    def _faded(self, now: Tensor, change: Tensor) -> Tensor:
        """(T, ...) of a difference at frame 0 and its change in a frame."""
        shape = (-1, *[1] * now.dim())
        return self.of_place.reshape(shape) * now + self.of_speed.reshape(shape) * change

    def places(self, walk: Tensor, before: Tensor) -> Tensor:
        """Places (T, ...) of the walk from those before (T', ...) on."""
        own, was = walk.double(), before.double()
        n = _glance(own, was, self.frame_time)
        now, sooner = was[-1] - own[0], was[max(-1 - n, -len(was))] - (2.0 * own[0] - own[n])
        return (own + self._faded(now, (now - sooner) / n)).to(walk)

    def turns(self, walk: Tensor, before: Tensor) -> Tensor:
        """Rotations (T, ..., 3, 3) of the walk from those before (T', ..., 3, 3) on."""
        own, was = walk.double(), before.double()
        n = _glance(own, was, self.frame_time)
        back = own[0] @ own[n].transpose(-1, -2) @ own[0]
        now = _vector(was[-1] @ own[0].transpose(-1, -2))
        change = (now - _vector(was[max(-1 - n, -len(was))] @ back.transpose(-1, -2))) / n
        # A turn of half a circle has two axes: one that changes sides has no speed.
        swift = change.norm(dim=-1, keepdim=True) > SWIFT * self.frame_time
        change = torch.where(swift, torch.zeros_like(change), change)
        return (_matrix(self._faded(now, change)) @ own).to(walk)


def _step_over(fade: _Fade, own: LegTrack, was: LegTrack, now: LegTrack, rotations: Tensor, frames: slice) -> None:
    """Write some frames of a leg into rotations (T, J, 3, 3), whose foot goes from where it was to that of the walk."""
    ankle = fade.places(own.ankle, was.ankle)
    foot = None if own.foot is None or was.foot is None else fade.turns(own.foot, was.foot)
    sunk = torch.minimum(was.ankle[-1, 1], own.ankle[:, 1].min()) - ankle[:, 1]
    if own.ball is not None and was.ball is not None and own.foot is not None and foot is not None:
        arm = own.foot.transpose(-1, -2) @ (own.ball - own.ankle).unsqueeze(-1)
        ball = ankle[:, 1] + (foot @ arm)[:, 1, 0]
        sunk = torch.maximum(sunk, torch.minimum(was.ball[-1, 1], own.ball[:, 1].min()) - ball)
    x, y, z = ankle.unbind(-1)
    ankle = torch.stack((x, y + sunk.clamp_min(0.0), z), dim=-1)
    # A leg is drawn in rather than stretched out, and no straighter than its angles have it: its knee would jump.
    gap = ankle - now.hip
    distance = gap.norm(dim=-1)
    low = torch.maximum(own.span, now.span).clamp_min(SOFT) * now.length
    drawn = eased(distance, low, (REACH * now.length - low).clamp_min(1e-4))
    drawn = torch.minimum(drawn, now.span.clamp_min(SOFT) * now.length)
    ankle = now.hip + gap * (drawn / distance.clamp_min(1e-9))[:, None]
    still = torch.eye(3, dtype=torch.float64).expand(len(ankle), 3, 3)
    some = rotations.clone()
    bent(now, some, still, now.hip, ankle, foot, None)
    rotations[frames] = some[frames]


def _vector(rotations: Tensor) -> Tensor:
    """Rotation vectors (..., 3) of matrices (..., 3, 3) [rad]."""
    found = Rotation.from_matrix(rotations.detach().cpu().numpy().reshape(-1, 3, 3)).as_rotvec()
    return torch.from_numpy(found).reshape(rotations.shape[:-1])


def _matrix(vectors: Tensor) -> Tensor:
    """Matrices (..., 3, 3) of rotation vectors (..., 3) [rad]."""
    found = Rotation.from_rotvec(vectors.numpy().reshape(-1, 3)).as_matrix()
    return torch.from_numpy(found).reshape(*vectors.shape, 3)
