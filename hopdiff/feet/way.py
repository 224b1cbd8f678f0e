"""The way of one foot over time, and the leg that follows it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import torch
from torch import Tensor
from torch.nn import functional

from hopdiff.feet.reach import EASY, EDGE, SOFT, STRETCHED, heel_up, lacking, longest, most_heel, softened, turned_up
from hopdiff.feet.track import LegTrack, bent, smooth_step, turned
from hopdiff.geometry.rotation import rotation_about

SETTLING = 0.3  # s in which the root is lowered and raised again
LANDING, LANDED = 0.1, 0.05  # s before and after a contact begins or ends in which a leg stretches more and more
HEEL_RAMP = 0.15  # s around a contact in which a heel is raised as in it


@dataclass(frozen=True, eq=False)
class FootWay:
    """Where a foot shall go. track: the leg as it was. hip: (T, 3) where it is now. ankle: (T, 3) where it shall be
    [m]. frame: (T, 3, 3) turn of the foot in the world since the track.

    stands: (T,) bool. weight: (T,) 1 while the foot stands, less and less on the ways to and from there. flat: (T,) 1
    while the heel stands too, less and less around that: then it is raised only as a last resort. edge: of the leg's
    length, from which on it stretches less and less as the foot lands or leaves.
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
        ankle = hip + gap * (drawn / distance.clamp_min(1e-9))[:, None]
        bent(track, rotations, turn, hip, ankle, foot, toe)


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


def apart(flags: Tensor) -> Tensor:
    """(T,) frames to the nearest one that is true; far where there is none."""
    if not bool(flags.any()):
        return torch.full((len(flags),), 1e9, dtype=torch.float64)
    frames = torch.arange(len(flags))
    return (frames - nearest(flags)).abs().double()


def nearest(flags: Tensor) -> Tensor:
    """(T,) the nearest frame that is true; 0 where there is none."""
    true = flags.nonzero().flatten()
    frames = torch.arange(len(flags))
    if not len(true):
        return torch.zeros_like(frames)
    after = torch.searchsorted(true, frames).clamp_max(len(true) - 1)
    before = (after - 1).clamp_min(0)
    nearer = (true[after] - frames).abs() < (true[before] - frames).abs()
    return torch.where(nearer, true[after], true[before])
