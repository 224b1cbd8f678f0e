"""A straight run led along a curve on the ground.

Everything that is forward in the straight run becomes arc length of the curve, everything sideways its normal: HIP
rides on the curve, footholds stay where the bent run puts them. The body turns with the tangent and leans into the
turn about the line on the ground. Legs that stand reach for their pinned foothold; what that changes fades in and out
through the air, with value and rate, so that nothing jumps.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import torch
from scipy.interpolate import PchipInterpolator
from scipy.ndimage import gaussian_filter1d
from torch import Tensor

from hopdiff.geometry.curve import PlaneCurve
from hopdiff.geometry.rotation import axis_rotation
from hopdiff.models.body import hip_joint
from hopdiff.models.gait import SLACK, Gait, finish, phases, stride_time
from hopdiff.motion import SIDES, Motion, Phase
from hopdiff.numerics import GRAVITY, hermite, smooth_max
from hopdiff.physics.legs import LegPose, knee_offset, leg_pose, leg_reach

SAMPLES = 2000  # of the lean along the curve, at least, and at most 2 cm apart
SETTLING = 0.5  # strides over which the body takes up a lean (standard deviation)
LONGEST_REACH = 0.998  # of the straight leg
FREE_REACH, EASE = 0.993, 0.005  # leg lengths to which a leg in the air is drawn in, and over which that sets in
ENDS = 0.15  # share of the time in the air, after take-off and before touchdown, in which that fades in and out
GLANCE = 1e-4  # s, for rates at take-off and touchdown


Curve = Callable[[Tensor], Tensor]  # (T,) -> (T,)


class _Foothold(NamedTuple):
    """Where a foot stands: its phase, and the place (3,) on the ground [m]."""

    phase: Phase
    place: Tensor


@dataclass(frozen=True)
class _Frame:
    """HIP's frame along the curve at T moments: ground point, axes (left, up, forward as columns), and the pose."""

    ground: Tensor
    axes: Tensor
    height: Tensor
    channels: dict[str, Tensor]


def run_along(gait: Gait, curve: PlaneCurve, strides: int, duration: float, fps: float, max_lean: float) -> Motion:
    """`strides` strides of a gait's first candidate, from end to end of a curve, in `duration` seconds.

    The gait should need about this time for this length: what is left, a few per cent at most, is stretched.
    max_lean: of the body into a turn [rad]; a runner leans by atan(v^2 / (g r)).
    """
    return _Course(gait, curve, strides, duration, max_lean).motion(fps)


class _Course:
    def __init__(self, gait: Gait, curve: PlaneCurve, strides: int, duration: float, max_lean: float) -> None:
        self.gait, self.curve, self.body = gait, curve, gait.character
        self.like = gait.contact_times
        self.duration, self.strides = duration, strides
        self.own_time = strides * float(stride_time(gait)[0])
        way = float(gait.sample(self.like.new_tensor([self.own_time])).travel[0, 0])
        self.stretch = curve.length / way
        self.lean = turning_lean(curve, strides, duration, max_lean)
        self.sink: Curve = torch.zeros_like
        # One stride before and after: a foot in the air comes from a foothold and goes to one.
        cycle = phases(gait, 1)
        period = self.own_time / strides
        stances = [
            Phase(p.kind, p.side, p.start + k * period, p.end + k * period)
            for k in range(-1, strides + 1)
            for p in cycle
            if p.kind == "stance"
        ]
        self.footholds = [_Foothold(phase, self._foothold(phase)) for phase in stances]
        self.sink = self._sinking()

    def motion(self, fps: float) -> Motion:
        intervals = max(4, round(self.duration * fps))
        share = torch.arange(intervals + 1, dtype=self.like.dtype, device=self.like.device) / intervals
        own = share * self.own_time
        pose = self.gait.sample(own)
        frame = self._frame(own)
        legs = {side: self._leg(side, own, frame) for side in SIDES}
        channels = dict(frame.channels)
        for side, leg in legs.items():
            channels |= self._leg_channels(side, leg)
        rotations = self.body.rotations(channels)
        rotations = torch.cat(((frame.axes @ rotations[:, 0]).unsqueeze(1), rotations[:, 1:]), dim=1)
        root = frame.ground + frame.height.unsqueeze(-1) * frame.axes[:, :, 1]
        pace = self.duration / self.own_time
        course = tuple(Phase(p.kind, p.side, p.start * pace, p.end * pace) for p in phases(self.gait, self.strides))
        here = self._place(pose.travel[0] + pose.target[0, :, 1], pose.target[0, :, 0])
        shown = pose._replace(channels={name: values.unsqueeze(0) for name, values in channels.items()})
        return finish(self.body, root, rotations, share * self.duration, shown, here, course)

    def _place(self, travel: Tensor, left: Tensor) -> Tensor:
        """Ground points (T, 3) of places of the straight run, forward and to the left (T,) [m]."""
        way = travel * self.stretch
        point, heading = (x.to(self.like) for x in (self.curve.position(way), self.curve.heading(way)))
        x = point[:, 0] + left * torch.cos(heading)
        return torch.stack((x, torch.zeros_like(x), point[:, 1] - left * torch.sin(heading)), dim=-1)

    def _frame(self, times: Tensor) -> _Frame:
        """At the gait's own times (T,) [s]."""
        pose = self.gait.sample(times)
        way = pose.travel[0] * self.stretch
        heading = self.curve.heading(way).to(self.like)
        axes = axis_rotation("Y", heading) @ axis_rotation("Z", -self.lean(way))
        ground = self._place(pose.travel[0], torch.zeros_like(way))
        channels = {name: values[0] for name, values in pose.channels.items()}
        return _Frame(ground, axes, pose.height[0] - self.sink(times), channels)

    def _straight(self, side: str, channels: dict[str, Tensor]) -> Tensor:
        """The foot from its hip joint in the straight run (T, 3), to the left, up and forward [m]."""
        knee, tilt = channels[f"{side}_knee"], channels[f"{side}_tilt"]
        angle = channels[f"{side}_thigh"] - knee_offset(knee, self.body.thigh, self.body.shank)
        reach = leg_reach(knee, self.body.thigh, self.body.shank)
        down = reach * torch.cos(angle)
        return torch.stack((down * torch.sin(tilt), -down * torch.cos(tilt), reach * torch.sin(angle)), dim=-1)

    def _leg_channels(self, side: str, leg: LegPose) -> dict[str, Tensor]:
        offset = knee_offset(leg.knee, self.body.thigh, self.body.shank)
        return {f"{side}_thigh": leg.angle + offset, f"{side}_knee": leg.knee, f"{side}_tilt": leg.tilt}

    def _foothold(self, phase: Phase) -> Tensor:
        """Where the foot of a stance stands (3,) [m]: the straight run's place, bent with the curve."""
        pose = self.gait.sample(self.like.new_tensor([0.5 * (phase.start + phase.end)]))
        channels = {name: values[0] for name, values in pose.channels.items()}
        left, _, ahead = (self._straight(phase.side, channels) + self._hip(phase.side, channels)).unbind(-1)
        return self._place(pose.travel[0] + ahead, left)[0]

    def _hip(self, side: str, channels: dict[str, Tensor]) -> Tensor:
        """Hip joint from HIP (T, 3) [m]."""
        return torch.stack(hip_joint(self.body, channels, side), dim=-1)

    def _pinned(self, side: str, places: Tensor, frame: _Frame) -> Tensor:
        """The foot from its hip joint (T, 3) where it stands on places (T, 3) [m]."""
        hip = frame.ground + frame.height.unsqueeze(-1) * frame.axes[:, :, 1]
        foot = (frame.axes.transpose(-1, -2) @ (places - hip).unsqueeze(-1)).squeeze(-1)
        return foot - self._hip(side, frame.channels)

    def _in_reach(self, foot: Tensor, change: Tensor, weight: Tensor) -> Tensor:
        """A foot in the air (T, 3) moved by a change (T, 3), but not beyond the leg's length or where it was before.

        weight: (T, 1) how far it is drawn in; zero at take-off and touchdown, where it has to be where it is.
        """
        before, after = (x.norm(dim=-1, keepdim=True) for x in (foot, foot + change))
        longest, width = FREE_REACH * self.body.leg_length, EASE * self.body.leg_length
        excess = [smooth_max(reach - longest, 0.0, width) for reach in (before, after)]
        found: Tensor = (foot + change) * (1.0 - weight * (excess[1] - excess[0]) / after)
        return found

    def _above_ground(self, side: str, foot: Tensor, frame: _Frame) -> Tensor:
        """A foot in the air (T, 3), lifted to the ground where a hasty start of its swing would take it below."""
        up = frame.axes[:, 1]
        hip = self._hip(side, frame.channels)
        hip[:, 1] += frame.height
        height = (up * (hip + foot)).sum(-1, keepdim=True)
        return foot - height.clamp(max=0.0) * up

    def _sinking(self) -> Curve:
        """By how much HIP sinks over time, so that no leg has to reach beyond its length [m]."""
        needs, middles = [], []
        longest = LONGEST_REACH * self.body.leg_length
        for foothold in self.footholds:
            phase = foothold.phase
            times = torch.linspace(phase.start, phase.end, 15).to(self.like)
            foot = self._pinned(phase.side, foothold.place.expand(15, 3), self._frame(times))
            room = longest**2 - foot[:, 0] ** 2 - foot[:, 2] ** 2
            need = (-foot[:, 1] - room.clamp_min(0.0).sqrt()).clamp_min(0.0).amax()
            needs.append(float(need))
            middles.append(0.5 * (phase.start + phase.end))
        padded = np.pad(needs, 1, mode="edge")
        held = np.max([padded[:-2], padded[1:-1], padded[2:]], axis=0)
        curve = PchipInterpolator(middles, held, extrapolate=False)
        return lambda times: torch.as_tensor(
            curve(times.detach().cpu().double().clamp(middles[0], middles[-1]).numpy())
        ).to(self.like)

    def _leg(self, side: str, times: Tensor, frame: _Frame) -> LegPose:
        """One leg at the gait's own times (T,)."""
        own = [foothold for foothold in self.footholds if foothold.phase.side == side]
        starts = times.new_tensor([foothold.phase.start for foothold in own])
        ends = times.new_tensor([foothold.phase.end for foothold in own])
        places = torch.stack([foothold.place for foothold in own])

        def change(at: Tensor) -> Tensor:
            """By how much the foothold moves the foot (K, 3) [m], each stance at its own moment (K,)."""
            frame = self._frame(at)
            return self._pinned(side, places, frame) - self._straight(side, frame.channels)

        first, last = change(starts), change(ends)
        first_rate = (change(starts + GLANCE) - first) / GLANCE
        last_rate = (last - change(ends - GLANCE)) / GLANCE
        # The stance before each moment, and whether it still lasts.
        which = (torch.searchsorted(starts, times + SLACK, right=True) - 1).clamp(0, len(own) - 2)
        standing = (times <= ends[which] + SLACK).unsqueeze(-1)
        air = (starts[which + 1] - ends[which]).unsqueeze(-1)
        x = ((times - ends[which]).unsqueeze(-1) / air).clamp(0.0, 1.0)
        fading = hermite(x, last[which], first[which + 1], last_rate[which], first_rate[which + 1], air)
        inside = (torch.minimum(x, 1.0 - x) / ENDS).clamp(max=1.0)
        flying = self._in_reach(self._straight(side, frame.channels), fading, inside**2 * (3.0 - 2.0 * inside))
        foot = torch.where(standing, self._pinned(side, places[which], frame), self._above_ground(side, flying, frame))
        left, up, forward = foot.unbind(-1)
        return leg_pose(left, up, forward, self.body.thigh, self.body.shank)[0]


def turning_lean(curve: PlaneCurve, strides: int, duration: float, most: float) -> Curve:
    """Lean to the left along a curve run in `duration` seconds, a function of arc length (T,) -> (T,) [rad].

    atan(v^2 / (g r)), `most` at most, taken up and given up over about a stride.
    """
    settling = SETTLING * curve.length / strides
    count = max(SAMPLES, math.ceil(curve.length / 0.02))
    spacing = curve.length / count
    # An open curve is straight beyond its ends, where the lean may still fade.
    margin = 0 if curve.closed else math.ceil(4.0 * settling / spacing)
    way = spacing * np.arange(-margin, count + margin + 1)
    turn = curve.curvature(torch.as_tensor(way)).numpy()
    speed = curve.length / duration
    lean = np.clip(np.arctan(speed**2 * turn / GRAVITY), -most, most)
    if curve.closed:
        smooth = gaussian_filter1d(lean[:-1], settling / spacing, mode="wrap")
        smooth = np.append(smooth, smooth[0])
    else:
        smooth = gaussian_filter1d(lean, settling / spacing, mode="nearest")

    def at(arc: Tensor) -> Tensor:
        place = arc.detach().cpu().double().numpy()
        place = np.mod(place, curve.length) if curve.closed else place
        return torch.as_tensor(np.interp(place, way, smooth)).to(arc)

    return at
