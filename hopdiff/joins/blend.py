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
from hopdiff.feet.reach import softened
from hopdiff.feet.track import LegTrack, bent, leg_tracks
from hopdiff.geometry.clip import Clip

SHORTEST, LONGEST = 0.4, 1.2  # s in which a difference is taken away
SHARE = 0.5  # of the walk at most


def blend_time(walk: Clip, other: Clip, at: int) -> float:
    """Seconds that the first frame (at 0) or the last one (at -1) of a walk needs to come from a clip's last or first
    frame: with the root of how far joints are apart, so that they are all accelerated alike."""
    far = (walk.joint_positions()[at] - other.joint_positions()[-1 - at]).norm(dim=-1).max()
    return min(max(SHORTEST, math.sqrt(float(far))), LONGEST, SHARE * max(walk.duration, walk.frame_time))


def blended(walk: Clip, before: Clip, seconds: float, legs: Sequence[Leg] = ()) -> Clip:
    """The walk from the last pose of another clip on, of which it is the walk again after some seconds.

    Joints and root by their angles; legs so that ankles and feet go over in the world, never lower than where they
    stand. For the end of a walk see `reversed_clip`.
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
        _step_over(fade, own[at], was[at], now[at], rotations)
    # To the last digit, as angles and inverse kinematics are not.
    root[0], rotations[0] = before.root_position[-1].to(root), before.rotations[-1].to(rotations)
    return replace(made, root_position=root, rotations=rotations)


def reversed_clip(clip: Clip) -> Clip:
    """The clip from its last frame to its first."""
    offsets = None if clip.offsets is None else clip.offsets.flip(0)
    return replace(clip, root_position=clip.root_position.flip(0), rotations=clip.rotations.flip(0), offsets=offsets)


class _Fade:
    """How differences at the first frame of a walk go to zero."""

    def __init__(self, walk: Clip, seconds: float) -> None:
        self.frame_time = walk.frame_time
        count = min(walk.frames - 1, max(1, round(seconds / walk.frame_time)))
        s = torch.arange(walk.frames, dtype=torch.float64) / count
        s = s.clamp_max(1.0)
        # From 1 and from 0 with slope 1 to rest; without curvature at both ends.
        self.of_place = 1.0 - s**3 * (10.0 - 15.0 * s + 6.0 * s**2)
        self.of_speed = count * (s - s**3 * (6.0 - 8.0 * s + 3.0 * s**2))
        self.frames = slice(0, count + 1)

    def _faded(self, now: Tensor, sooner: Tensor) -> Tensor:
        """(T, ...) of a difference at frame 0 and one frame sooner."""
        shape = (-1, *[1] * now.dim())
        return self.of_place.reshape(shape) * now + self.of_speed.reshape(shape) * (now - sooner)

    def places(self, walk: Tensor, before: Tensor) -> Tensor:
        """Places (T, ...) of the walk from those before (T', ...) on."""
        own, was = walk.double(), before.double()
        now, sooner = was[-1] - own[0], was[max(-2, -len(was))] - (2.0 * own[0] - own[1])
        return (own + self._faded(now, sooner)).to(walk)

    def turns(self, walk: Tensor, before: Tensor) -> Tensor:
        """Rotations (T, ..., 3, 3) of the walk from those before (T', ..., 3, 3) on."""
        own, was = walk.double(), before.double()
        back = own[0] @ own[1].transpose(-1, -2) @ own[0]
        now = _vector(was[-1] @ own[0].transpose(-1, -2))
        sooner = _vector(was[max(-2, -len(was))] @ back.transpose(-1, -2))
        # A turn of half a circle has two axes: one that changes sides has no speed.
        sooner = torch.where((now - sooner).norm(dim=-1, keepdim=True) > math.pi / 2.0, now, sooner)
        return (_matrix(self._faded(now, sooner)) @ own).to(walk)


def _step_over(fade: _Fade, own: LegTrack, was: LegTrack, now: LegTrack, rotations: Tensor) -> None:
    """Write a leg into rotations (T, J, 3, 3) whose foot goes from where it was over to that of the walk."""
    ankle = fade.places(own.ankle, was.ankle)
    lowest = torch.minimum(was.ankle[-1, 1], own.ankle[:, 1].min())
    x, y, z = ankle.unbind(-1)
    ankle = torch.stack((x, torch.maximum(y, lowest), z), dim=-1)
    # A leg is drawn in rather than stretched out: nearly straight, its knee would jump.
    gap = ankle - now.hip
    distance = gap.norm(dim=-1)
    ankle = now.hip + gap * (softened(now, distance) / distance.clamp_min(1e-9))[:, None]
    foot = None if own.foot is None or was.foot is None else fade.turns(own.foot, was.foot)
    still = torch.eye(3, dtype=torch.float64).expand(len(ankle), 3, 3)
    some = rotations.clone()
    bent(now, some, still, now.hip, ankle, foot, None)
    rotations[fade.frames] = some[fade.frames]


def _vector(rotations: Tensor) -> Tensor:
    """Rotation vectors (..., 3) of matrices (..., 3, 3) [rad]."""
    found = Rotation.from_matrix(rotations.detach().cpu().numpy().reshape(-1, 3, 3)).as_rotvec()
    return torch.from_numpy(found).reshape(rotations.shape[:-1])


def _matrix(vectors: Tensor) -> Tensor:
    """Matrices (..., 3, 3) of rotation vectors (..., 3) [rad]."""
    found = Rotation.from_rotvec(vectors.numpy().reshape(-1, 3)).as_matrix()
    return torch.from_numpy(found).reshape(*vectors.shape, 3)
