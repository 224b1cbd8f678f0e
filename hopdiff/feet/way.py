"""The way of one foot over time, and the leg that follows it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import torch
from torch import Tensor
from torch.nn import functional

from hopdiff.feet.easing import calmed, jerk
from hopdiff.feet.frames import apart, nearest
from hopdiff.feet.reach import (
    EASY,
    EDGE,
    SOFT,
    STRETCHED,
    heel_up,
    lacking,
    longest,
    most_heel,
    softened,
    turned_up,
    unfolded,
)
from hopdiff.feet.track import LegTrack, bent, smooth_step, turned
from hopdiff.geometry.rotation import rotation_about

SETTLING = 0.3  # s in which the root is lowered and raised again
LANDING, LANDED = 0.1, 0.05  # s before and after a contact begins or ends in which a leg stretches more and more
GIVING = 0.034  # s after it lands and before it leaves in which a foot may be off its print a little for that
STIFF = 8.0  # how little
ROUGH = 1.4  # times the largest jerk of a leg in the source that it may have in the air
HEEL_RAMP = 0.15  # s around a contact in which a heel is raised as in it


@dataclass(frozen=True, eq=False)
class FootWay:
    """Where a foot shall go. track: the leg as it was. hip: (T, 3) where it is now. ankle: (T, 3) where it shall be
    [m]. frame: (T, 3, 3) turn of the foot in the world since the track.

    stands: (T,) bool. weight: (T,) 1 while the foot stands, less and less on the ways to and from there. flat: (T,) 1
    while the heel stands too, less and less around that: then it is raised only as a last resort. edge: of the leg's
    length, from which on it stretches less and less as the foot lands or leaves. kept: up to which frame and from which
    on the leg is led as it is, jerks or not; None: in all frames. floor: (T,) height of the ankle below which the foot
    would be in the ground [m]; None where that is level.
    """

    track: LegTrack
    hip: Tensor
    ankle: Tensor
    frame: Tensor
    stands: Tensor
    weight: Tensor
    flat: Tensor
    frame_time: float
    edge: float = EDGE
    kept: tuple[int, int] | None = None
    floor: Tensor | None = None

    @cached_property
    def ball(self) -> Tensor | None:
        """(T, 3) of the foot before its heel is raised [m]."""
        if self.track.ball is None:
            return None
        return self.ankle + turned(self.frame, self.track.ball - self.track.ankle)

    @cached_property
    def axis(self) -> Tensor:
        """(T, 3) to the left of the foot."""
        return turned(self.frame, self.track.left)

    def sink(self) -> Tensor:
        """(T,) how far the body must come down for the standing foot to be within reach [m]."""
        easy = EASY * (1.0 - self.flat)
        down = lacking(self.hip, self.ankle, self.ball, self.axis, longest(self.track), easy)[0]
        return torch.where(self.stands, down, torch.zeros_like(down))

    def missed(self, lowered: Tensor) -> Tensor:
        """(T,) by how much the print of the standing foot is out of reach of a body that is lowered [m]."""
        free = torch.ones_like(self.flat)
        off = lacking(sunk(self.hip, lowered), self.ankle, self.ball, self.axis, longest(self.track), free)[1]
        return torch.where(self.stands, off, torch.zeros_like(off))

    def pose(self, rotations: Tensor, turn: Tensor, lowered: Tensor) -> None:
        """Write the leg of a lowered body into rotations (T, J, 3, 3). turn: (T, 3, 3) of the body since the track."""
        track, hip, ankle, ball = self.track, sunk(self.hip, lowered), self.ankle, self.ball
        foot = None if track.foot is None else self.frame @ track.foot
        toe = None if track.toe is None else self.frame @ track.toe
        if ball is not None and foot is not None:
            near = smooth_step(1.0 - apart(self.stands) * self.frame_time / HEEL_RAMP)
            wanted = softened(track, (ankle - hip).norm(dim=-1), SOFT + self.flat * (STRETCHED - SOFT))
            axis = self.axis
            pitch = heel_up(hip, ankle, ball, axis, wanted, most_heel(hip, ball, axis))
            # In the air a foot keeps what it had on the ground, and lets go of it.
            pitch = near * pitch[nearest(self.stands)]
            ankle = turned_up(ankle, ball, axis, pitch)
            foot = rotation_about(axis, pitch) @ foot
            if toe is not None:
                # Toes stay on the ground while the heel is up, and follow the foot as it leaves.
                toe = rotation_about(axis, pitch * (1.0 - near)) @ toe
        # A foot in the air is drawn in rather than stretched for.
        gap = ankle - hip
        distance = gap.norm(dim=-1)
        landing = smooth_step(1.0 - apart(self.stands) * self.frame_time / LANDING)
        landed = smooth_step((apart(~self.stands) - 1.0) * self.frame_time / LANDED)
        soft = torch.where(
            self.stands, landed * (STRETCHED - self.edge) + self.edge, landing * (self.edge - SOFT) + SOFT
        )
        drawn = softened(track, distance, soft)
        drawn = torch.where(self.stands, drawn, unfolded(track, drawn))
        gap = self._even(hip, gap * (drawn / distance.clamp_min(1e-9))[:, None], turn)
        distance = gap.norm(dim=-1)
        ankle = hip + gap * (self._unhurried(distance) / distance.clamp_min(1e-9))[:, None]
        bent(track, rotations, turn, hip, ankle, foot, toe)

    def _unhurried(self, distance: Tensor) -> Tensor:
        """(T,) distances from hip to ankle [m] to which the knee bends without haste while the foot is in the air:
        near a straight leg a little of a distance is much of an angle."""
        track, firm = self.track, self._firm
        own, wanted = track.flexion((track.ankle - track.hip).norm(dim=-1)), track.flexion(distance)
        least = wanted
        if self.floor is None:
            least = torch.minimum(torch.minimum(own, wanted), track.flexion(longest(track)))
        # A knee is out of the line of its leg by about a quarter of the leg's length times the angle.
        most = self._most / (0.25 * track.length.mean())
        flexion = calmed(
            wanted[:, None], own[:, None], firm, self._stiff, most, self.frame_time, least[:, None]
        ).squeeze(-1)
        return torch.where(firm, distance, track.distance(flexion))

    def _even(self, hip: Tensor, gap: Tensor, turn: Tensor) -> Tensor:
        """(T, 3) ways from hip (T, 3) to ankle [m] without jerks while the foot is in the air. turn: (T, 3, 3) of the
        body."""
        track = self.track
        seen, own = turned(turn.transpose(-1, -2), gap), track.ankle - track.hip
        firm, least = self._firm, None
        if self.floor is not None:
            # An edge of a tread is no place to yield on.
            firm = firm | self.stands
            least = torch.full_like(gap, -math.inf)
            least[:, 1] = torch.minimum(self.floor - hip[:, 1], gap[:, 1])
        found = calmed(seen, own, firm, self._stiff, self._most, self.frame_time, least)
        size = found.norm(dim=-1)
        most = torch.maximum(longest(track), gap.norm(dim=-1))
        return turned(turn, found * (torch.minimum(size, most) / size.clamp_min(1e-9))[:, None])

    @cached_property
    def _firm(self) -> Tensor:
        """(T,) bool, frames in which the ankle has its place."""
        if self.kept is None:
            return torch.ones_like(self.stands)
        frames = torch.arange(len(self.stands))
        held = apart(~self.stands) * self.frame_time > GIVING
        return held | (frames <= self.kept[0]) | (frames >= self.kept[1])

    @cached_property
    def _stiff(self) -> Tensor:
        """(T,) how dear it is that an ankle is not where it is aimed at, against jerks."""
        return torch.where(self.stands, STIFF, 0.0).double()

    @cached_property
    def _most(self) -> Tensor:
        """(2,) somewhat more than the largest jerk of the leg in the source, from its hip: see `calmed`."""
        points = [self.track.knee, self.track.ankle, *([] if self.track.ball is None else [self.track.ball])]
        return ROUGH * torch.stack([jerk(p - self.track.hip, self.frame_time).amax(0) for p in points]).amax(0)


def lowering(ways: Sequence[FootWay], most: float, kept: tuple[int, int] | None = None) -> Tensor:
    """(T,) by how much the root is lowered for all feet that stand to be within reach, changing slowly [m].

    most: how far at most. kept: up to which frame and from which on nothing is lowered, None if anything may be.
    """
    need = torch.stack([way.sink() for way in ways]).amax(0).clamp_max(most)
    if float(need.max()) <= 1e-9:
        return torch.zeros_like(need)
    frame_time = ways[0].frame_time
    half = max(1, round(0.5 * SETTLING / frame_time))
    down = smoothed(widest(need, 4 * half + 1), 2 * half + 1)
    if kept is None:
        return down
    frames = torch.arange(len(need), dtype=torch.float64)
    return down * smooth_step(torch.minimum(frames - kept[0], kept[1] - frames) * frame_time / SETTLING)


def sunk(places: Tensor, down: Tensor) -> Tensor:
    """Places (T, 3) moved down by (T,) [m]."""
    x, y, z = places.unbind(-1)
    return torch.stack((x, y - down, z), dim=-1)


def widest(values: Tensor, wide: int) -> Tensor:
    """(T,) the largest value in a window around every frame."""
    found: Tensor = functional.max_pool1d(values[None, None], wide, stride=1, padding=wide // 2)[0, 0]
    return found


def smoothed(values: Tensor, wide: int) -> Tensor:
    """(T,) a mean over a window, the middle counting most."""
    window = torch.hann_window(wide + 2, periodic=False, dtype=values.dtype)[1:-1]
    padded = functional.pad(values[None, None], (wide // 2, wide // 2), mode="replicate")
    found: Tensor = functional.conv1d(padded, (window / window.sum())[None, None])[0, 0]
    return found
