"""Legs through the frames of a clip, without the rest of the body."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import torch
from torch import Tensor
from torch.nn import functional

from hopdiff.editing.leg_joints import Leg
from hopdiff.geometry.clip import Clip

USUAL = 0.2  # sine of the angle between thigh and leg below which a leg counts as straight, its bend as noise
STRAIGHT = 0.99  # of a leg's length from hip to ankle, above which it bends slowly at first
GIVE = 0.006  # m over which it does
ASKEW = 0.5  # cosine between a knee's way out of the line of the leg and its usual one, below which it counts less


@dataclass(frozen=True, eq=False)
class LegTrack:
    """A leg in T frames, in the world [m].

    hip, knee, ankle: (T, 3); ankle: the end of the shank where there is none. ball: (T, 3) toe joint, or the end of the
    foot; None without one. above, upper, lower: (T, 3, 3) frames of the joint that the thigh hangs on, of thigh and of
    shank. foot, toe: (T, 3, 3) frames, None without such a joint. between: (T, 3, 3) turns of the joints that lie
    between hip and knee, knee and ankle, ankle and toe.
    """

    leg: Leg
    hip: Tensor
    knee: Tensor
    ankle: Tensor
    ball: Tensor | None
    above: Tensor
    upper: Tensor
    lower: Tensor
    foot: Tensor | None
    toe: Tensor | None
    between: tuple[Tensor, Tensor, Tensor]

    def point(self, joint: int) -> Tensor:
        """(T, 3) a point of contact [m]: that of the toe joint, or the ankle."""
        return self.ball if self.ball is not None and joint == self.leg.toe else self.ankle

    @cached_property
    def left(self) -> Tensor:
        """(T, 3) axes to the left of the foot, in the world: level while it is, and turned with it otherwise."""
        if self.ball is None or self.foot is None:
            return self.upper[:, :, 0]
        ahead = (self.ball - self.ankle) * self.ball.new_tensor((1.0, 0.0, 1.0))
        level = torch.linalg.cross(ahead.new_tensor((0.0, 1.0, 0.0)).expand_as(ahead), ahead)
        # A foot that points down says nothing of its sides.
        local = turned(self.foot.transpose(-1, -2), level) * ahead.norm(dim=-1, keepdim=True)
        return turned(self.foot, functional.normalize(local.sum(dim=0), dim=0))

    @cached_property
    def length(self) -> Tensor:
        """(T,) of the leg, stretched out."""
        thigh, shank = self._bones
        return thigh + shank

    @cached_property
    def span(self) -> Tensor:
        """(T,) from hip to ankle, as a share of the leg's length."""
        found: Tensor = (self.ankle - self.hip).norm(dim=-1) / self.length
        return found

    def flexion(self, distance: Tensor) -> Tensor:
        """(T,) angle by which a knee is bent for an ankle to be so far (T,) from the hip [m, rad]."""
        thigh, shank = self._bones
        cosine = (distance**2 - thigh**2 - shank**2) / (2.0 * thigh * shank)
        return torch.acos(cosine.clamp(-1.0, 1.0))

    def distance(self, flexion: Tensor) -> Tensor:
        """(T,) how far the ankle is from the hip with a knee that is bent by (T,) [rad, m]."""
        thigh, shank = self._bones
        return (thigh**2 + shank**2 + 2.0 * thigh * shank * torch.cos(flexion)).clamp_min(0.0).sqrt()

    @cached_property
    def _bones(self) -> tuple[Tensor, Tensor]:
        """(T,) lengths of thigh and shank [m]."""
        return (self.knee - self.hip).norm(dim=-1), (self.ankle - self.knee).norm(dim=-1)


def leg_tracks(clip: Clip, legs: Sequence[Leg]) -> list[LegTrack]:
    """The legs of a clip in float64; no other joint is looked at."""
    known: dict[int, tuple[Tensor, Tensor]] = {}
    skeleton = clip.skeleton

    def at(joint: int) -> tuple[Tensor, Tensor]:
        """Place and frame of a joint."""
        if joint not in known:
            turn = clip.rotations[:, joint].double()
            if joint == 0:
                known[0] = clip.root_position.double(), turn
            else:
                place, frame = at(skeleton.parents[joint])
                offset = skeleton.offsets[joint] if clip.offsets is None else clip.offsets[:, joint]
                known[joint] = place + turned(frame, offset.double()), frame @ turn
        return known[joint]

    def end(joint: int) -> Tensor | None:
        site = skeleton.end_sites.get(skeleton.names[joint])
        return None if site is None else at(joint)[0] + turned(at(joint)[1], site.double())

    def between(joint: int | None, ancestor: int | None) -> Tensor:
        found = torch.eye(3, dtype=torch.float64)
        while joint is not None and ancestor is not None and (joint := skeleton.parents[joint]) != ancestor:
            found = clip.rotations[:, joint].double() @ found
        return found

    tracks = []
    for leg in legs:
        (hip, upper), (knee, lower) = at(leg.hip), at(leg.knee)
        foot = None if leg.ankle is None else at(leg.ankle)
        toe = None if leg.toe is None else at(leg.toe)
        ankle = foot[0] if foot is not None else end(leg.knee)
        assert ankle is not None, "a leg without an ankle ends in the end site of its knee"
        ball = toe[0] if toe is not None else end(leg.ankle) if leg.ankle is not None else None
        parent = skeleton.parents[leg.hip]
        above = torch.eye(3, dtype=torch.float64) if parent < 0 else at(parent)[1]
        joints = between(leg.knee, leg.hip), between(leg.ankle, leg.knee), between(leg.toe, leg.ankle)
        foot_frame, toe_frame = (None if one is None else one[1] for one in (foot, toe))
        tracks.append(LegTrack(leg, hip, knee, ankle, ball, above, upper, lower, foot_frame, toe_frame, joints))
    return tracks


def bent(
    track: LegTrack,
    rotations: Tensor,
    turn: Tensor,
    hip: Tensor,
    ankle: Tensor,
    foot: Tensor | None,
    toe: Tensor | None,
) -> None:
    """Write into rotations (T, J, 3, 3) the leg of a track bent and swung so that it goes from hip to ankle (T, 3).

    turn: (T, 3, 3) of the body since the track. foot, toe: (T, 3, 3) frames that these shall have in the world. A leg
    that is asked to be where it was stays as it is; a knee keeps the side to which it bends, also where the leg is so
    straight that the side is noise. An ankle out of reach is aimed at.
    """
    line, new_line = track.ankle - track.hip, ankle - hip
    across = functional.normalize(line, dim=-1)
    thigh, shank = track.knee - track.hip, track.ankle - track.knee
    side, other = thigh.norm(dim=-1), shank.norm(dim=-1)
    out = thigh - (thigh * across).sum(-1, keepdim=True) * across
    way = _way_of_knee(track, across, out, side)
    rise = (out * way).sum(-1)
    rest = out - rise[:, None] * way
    # The same in the new place: along the line by the law of cosines, the rest of the side out of it.
    new_across = functional.normalize(new_line, dim=-1)
    whole = _least(turned(turn, across), new_across) @ turn
    old, new = line.norm(dim=-1), new_line.norm(dim=-1)
    # A straight leg begins to bend without a jerk, for which its ankle may be off a little.
    lag = GIVE * smooth_step((track.span - STRAIGHT) / (1.0 - STRAIGHT)).clamp_min(1e-6)
    less = (old - new).clamp_min(0.0)
    new = torch.where(new < old, old - less * (1.0 - torch.exp(-less / lag)), new)
    new = torch.maximum(torch.minimum(new, side + other), (side - other).abs() + 1e-6)
    along = (side**2 + new**2 - other**2) / (2.0 * new)
    height = (side**2 - along**2).clamp_min(0.0)
    spread = out.norm(dim=-1)
    rest = rest * (height.sqrt() / spread.clamp_min(1e-9)).clamp_max(1.0)[:, None]
    bulge = (height - (rest**2).sum(-1)).clamp_min(0.0).sqrt()
    # A knee that is bent back a little comes forward as the leg gets shorter.
    forward = smooth_step(0.5 * (bulge / rise.abs().clamp_min(1e-9) - 1.0))
    bulge = torch.where(rise < 0.0, (2.0 * forward - 1.0) * bulge, bulge)
    new_way = turned(whole, way)
    knee = along[:, None] * new_across + bulge[:, None] * new_way + turned(whole, rest)
    reach = new[:, None] * new_across
    # Both bones turned so that they lie along their new lines, with the hinge of the knee in its new direction.
    hinge, new_hinge = torch.linalg.cross(across, way), torch.linalg.cross(new_across, new_way)
    upper = _frame(knee, new_hinge) @ _frame(thigh, hinge).transpose(-1, -2) @ track.upper
    lower = _frame(reach - knee, new_hinge) @ _frame(shank, hinge).transpose(-1, -2) @ track.lower
    leg, (to_knee, to_ankle, to_toe) = track.leg, track.between
    rotations[:, leg.hip] = ((turn @ track.above).transpose(-1, -2) @ upper).to(rotations)
    rotations[:, leg.knee] = ((upper @ to_knee).transpose(-1, -2) @ lower).to(rotations)
    if leg.ankle is not None and foot is not None:
        rotations[:, leg.ankle] = ((lower @ to_ankle).transpose(-1, -2) @ foot).to(rotations)
        if leg.toe is not None and toe is not None:
            rotations[:, leg.toe] = ((foot @ to_toe).transpose(-1, -2) @ toe).to(rotations)


def _way_of_knee(track: LegTrack, across: Tensor, out: Tensor, side: Tensor) -> Tensor:
    """(T, 3) unit vectors across the line of the leg to the side to which the knee bends.

    That is where it is, out of the line; the straighter the leg, the more where it is in the other frames, seen from
    the thigh, as what remains of the bend is noise then.
    """
    normal = torch.linalg.cross(out, across)
    usual = functional.normalize(turned(track.upper.transpose(-1, -2), normal).sum(dim=0), dim=0)
    if float(usual.norm()) < 0.5:
        usual = usual.new_tensor((-1.0, 0.0, 0.0))
    usual_way = torch.linalg.cross(across, turned(track.upper, usual))
    usual_way = functional.normalize(usual_way, dim=-1)
    size = out.norm(dim=-1)
    own = out / size.clamp_min(1e-12)[:, None]
    alike = (own * usual_way).sum(-1)
    trust = smooth_step(size / (USUAL * side)) * smooth_step(alike.abs() / ASKEW)
    mixed = (trust * alike.sign())[:, None] * own + (1.0 - trust)[:, None] * usual_way
    return functional.normalize(mixed, dim=-1)


def smooth_step(x: Tensor) -> Tensor:
    """From 0 to 1 without a corner."""
    x = x.clamp(0.0, 1.0)
    return x**2 * (3.0 - 2.0 * x)


def turned(frame: Tensor, vector: Tensor) -> Tensor:
    """Vectors (T, 3) or (3,) turned by frames (T, 3, 3)."""
    return (frame @ vector.unsqueeze(-1)).squeeze(-1)


def _frame(along: Tensor, hinge: Tensor) -> Tensor:
    """(T, 3, 3) frames with their first axis along a bone (T, 3) and the second as near to a hinge (T, 3) as can be."""
    x = functional.normalize(along, dim=-1)
    y = functional.normalize(hinge - (hinge * x).sum(-1, keepdim=True) * x, dim=-1)
    return torch.stack((x, y, torch.linalg.cross(x, y)), dim=-1)


def _least(a: Tensor, b: Tensor) -> Tensor:
    """(T, 3, 3) the least rotations that take unit vectors (T, 3) into others that are not opposite to them."""
    cross = torch.linalg.cross(a, b)
    x, y, z = cross.unbind(-1)
    zero = torch.zeros_like(x)
    skew = torch.stack((zero, -z, y, z, zero, -x, -y, x, zero), dim=-1).reshape(-1, 3, 3)
    cosine = (a * b).sum(-1).clamp_min(-1.0 + 1e-9)
    return torch.eye(3, dtype=a.dtype) + skew + skew @ skew / (1.0 + cosine)[:, None, None]
