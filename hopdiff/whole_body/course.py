"""A whole-body run led along a curve on the ground.

What is forward in the straight run becomes arc length of the curve, what is sideways its normal. The body turns with
the tangent and leans into the turn as the ground force does, about the line on the ground. Each foot rolls over its
foothold exactly as in the straight run, on the heading the curve has there; the leg reaches for it. In the air the foot
passes from the one heading to the next, with value and rate.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import torch
from scipy.interpolate import PchipInterpolator
from torch import Tensor

from hopdiff.geometry.curve import PlaneCurve
from hopdiff.geometry.rotation import axis_rotation, from_vector, to_vector
from hopdiff.motion import SIDES, Motion, Phase
from hopdiff.numerics import hermite, smooth_max
from hopdiff.whole_body.finish import finish, phases
from hopdiff.whole_body.gait import BodyGait, BodyPose
from hopdiff.whole_body.layout import JOINT_OF, SEGMENTS

GLANCE = 1e-4  # s, for rates at take-off and touchdown
LONGEST = 1.0 - 1e-9  # of the straight leg
FREE = 0.985  # of the straight leg: how far legs reach that are more bent in the straight run
SLACK = 1e-9  # s
ENDS = 0.15  # share of a swing, after take-off and before touchdown, in which what bends a flying foot fades in and out
EASE, SOFT_GROUND = 0.004, 0.001  # leg lengths over which that, and lifting off the ground, sets in
LOOKS = 15  # moments a stance at which the reach of its leg is looked at

Lean = Callable[[Tensor], Tensor]  # arc length (T,) [m] -> lean to the left (T,) [rad]


class _Straight(NamedTuple):
    """The straight run at T moments: pose of the first candidate, places (T, J, 3) and frames (T, J, 3, 3)."""

    pose: BodyPose
    places: Tensor
    frames: Tensor


class _Carrier(NamedTuple):
    """What carries the body along the curve at T moments: point on the ground (T, 3) and axes (T, 3, 3)."""

    ground: Tensor
    axes: Tensor
    root: Tensor  # (T, 3) of the straight run


class Course:
    """`strides` strides of a gait's first candidate, from end to end of a curve, in `duration` seconds.

    The gait should need about this time for this length: what is left is stretched. lean: see `Lean`.
    """

    def __init__(self, gait: BodyGait, curve: PlaneCurve, strides: int, duration: float, lean: Lean) -> None:
        self.gait, self.curve, self.strides, self.duration, self.lean = gait, curve, strides, duration, lean
        self.layout = gait.layout
        self.names = self.layout.skeleton.names
        period = float(gait.stride_time[0])
        self.own_time = strides * period
        way = strides * float(gait.way[0]) * (2.0 if gait.plan.mirrored else 1.0)
        self.stretch = curve.length / way
        self.like = gait.way
        cycle = phases(gait, 1)
        # One stride before and after: a foot in the air comes from a foothold and goes to one.
        self.stances = [
            Phase(p.kind, p.side, p.start + k * period, p.end + k * period)
            for k in range(-1, strides + 1)
            for p in cycle
            if p.kind == "stance"
        ]
        self.sink: Lean = torch.zeros_like
        self.sink = self._sinking()

    def motion(self, fps: float) -> Motion:
        """The frames, at about `fps` a second."""
        intervals = max(4, round(self.duration * fps))
        share = torch.arange(intervals + 1, dtype=self.like.dtype, device=self.like.device) / intervals
        own = share * self.own_time
        straight = self._straight(own)
        carrier = self._carrier(own, straight)
        pose = straight.pose
        root = self._carried(carrier, straight.places[:, 0])
        rotations = pose.rotations[0].clone()
        rotations[:, 0] = carrier.axes @ rotations[:, 0]
        for side in SIDES:
            self._put_leg(side, own, straight, carrier, rotations)
        force = (carrier.axes.unsqueeze(1) @ pose.force[0].unsqueeze(-1)).squeeze(-1)
        cop = torch.stack([self._standing(side, own, pose.cop[0, :, k]) for k, side in enumerate(SIDES)], dim=1)
        com = self._centre(root, rotations)
        led = pose._replace(
            root=root.unsqueeze(0),
            rotations=rotations.unsqueeze(0),
            com=com.unsqueeze(0),
            force=force.unsqueeze(0),
            cop=cop.unsqueeze(0),
        )
        pace = self.duration / self.own_time
        course = tuple(Phase(p.kind, p.side, p.start * pace, p.end * pace) for p in phases(self.gait, self.strides))
        return finish(self.gait, share * self.duration, led, course)

    # -- the straight run, and what carries it --

    def _straight(self, times: Tensor) -> _Straight:
        pose = self.gait.sample(times)
        places, frames = self.layout.skeleton.forward(pose.root[0], pose.rotations[0])
        return _Straight(pose, places, frames)

    def _line(self, way: Tensor) -> tuple[Tensor, Tensor]:
        """Ground points (T, 3) and headings (T,) of the curve at ways (T,) of the straight run [m]."""
        arc = way * self.stretch
        point, heading = (x.to(self.like) for x in (self.curve.position(arc), self.curve.heading(arc)))
        return torch.stack((point[:, 0], torch.zeros_like(heading), point[:, 1]), dim=-1), heading

    def _carrier(self, times: Tensor, straight: _Straight) -> _Carrier:
        root = straight.places[:, 0]
        ground, heading = self._line(root[:, 2])
        axes = axis_rotation("Y", heading) @ axis_rotation("Z", -self.lean(root[:, 2] * self.stretch))
        down = self.sink(times).unsqueeze(-1) * root.new_tensor((0.0, 1.0, 0.0))
        return _Carrier(ground - down, axes, root)

    def _carried(self, carrier: _Carrier, points: Tensor) -> Tensor:
        """Points (T, 3) of the straight run where the body is carried."""
        local = points - carrier.root * points.new_tensor((0.0, 0.0, 1.0))
        return carrier.ground + (carrier.axes @ local.unsqueeze(-1)).squeeze(-1)

    # -- footholds --

    def _which(self, side: str, times: Tensor) -> tuple[list[Phase], Tensor]:
        """The stances of a side, and for times (T,) the number of the one that has begun last."""
        own = [stance for stance in self.stances if stance.side == side]
        starts = times.new_tensor([stance.start for stance in own])
        return own, (torch.searchsorted(starts, times + SLACK, right=True) - 1).clamp(0, len(own) - 2)

    def _holds(self, side: str) -> tuple[Tensor, Tensor, Tensor]:
        """Of the stances of a side: way of the straight run (N,), ground point (N, 3) and heading (N,) there."""
        own = [stance for stance in self.stances if stance.side == side]
        middle = self.like.new_tensor([0.5 * (stance.start + stance.end) for stance in own])
        way = self._straight(middle).places[:, self.names.index(f"{side}_ankle"), 2]
        return way, *self._line(way)

    def _held(self, side: str, which: Tensor, points: Tensor) -> tuple[Tensor, Tensor]:
        """Points (T, 3) of the straight run on footholds (T,), and the turns (T, 3, 3) of the feet there."""
        way, ground, heading = (x[which] for x in self._holds(side))
        turn = axis_rotation("Y", heading)
        ahead = points.new_tensor((0.0, 0.0, 1.0))
        return ground + (turn @ (points - way.unsqueeze(-1) * ahead).unsqueeze(-1)).squeeze(-1), turn

    def _standing(self, side: str, times: Tensor, points: Tensor) -> Tensor:
        """Points (T, 3) of the straight run where the foothold that was touched last has them."""
        return self._held(side, self._which(side, times)[1], points)[0]

    def _change(self, side: str, times: Tensor, which: Tensor) -> tuple[Tensor, Tensor]:
        """By how much footholds (T,) move and turn the ankle, (T, 3) [m, rad] each in the carrier's axes."""
        straight = self._straight(times)
        carrier = self._carrier(times, straight)
        ankle = straight.places[:, self.names.index(f"{side}_ankle")]
        held, turn = self._held(side, which, ankle)
        back = carrier.axes.transpose(-1, -2)
        return (back @ (held - self._carried(carrier, ankle)).unsqueeze(-1)).squeeze(-1), to_vector(back @ turn)

    def _put_leg(self, side: str, times: Tensor, straight: _Straight, carrier: _Carrier, rotations: Tensor) -> None:
        """Set hip, knee and ankle of a side in rotations (T, J, 3, 3), whose root is set."""
        hip, knee, ankle = (self.names.index(f"{side}_{part}") for part in ("hip", "knee", "ankle"))
        moved, turned, flying = self._moves(side, times)
        point = self._carried(carrier, straight.places[:, ankle])
        point = point + (carrier.axes @ moved.unsqueeze(-1)).squeeze(-1)
        foot = carrier.axes @ from_vector(turned) @ straight.frames[:, ankle]
        point = self._above_ground(point, foot, straight.places[:, ankle], straight.frames[:, ankle])
        pelvis = rotations[:, 0]
        offset = self.layout.skeleton.offsets[hip]
        start = self._carried(carrier, straight.places[:, 0]) + pelvis @ offset
        point = start + self._drawn_in(point - start, self._length(side, straight), flying)
        hinge = carrier.axes @ straight.frames[:, hip, :, 0].unsqueeze(-1)
        thigh, shank = self._reach(start, point, hinge.squeeze(-1))
        rotations[:, hip] = pelvis.transpose(-1, -2) @ thigh
        rotations[:, knee] = thigh.transpose(-1, -2) @ shank
        rotations[:, ankle] = shank.transpose(-1, -2) @ foot

    def _length(self, side: str, straight: _Straight) -> Tensor:
        """(T, 1) from hip to ankle in the straight run [m]."""
        hip, ankle = (straight.places[:, self.names.index(f"{side}_{part}")] for part in ("hip", "ankle"))
        found: Tensor = (ankle - hip).norm(dim=-1, keepdim=True)
        return found

    def _drawn_in(self, line: Tensor, before: Tensor, flying: Tensor) -> Tensor:
        """Lines (T, 3) from hip to ankle of a flying leg, softly no longer than (T, 1) the straight run has them."""
        length = line.norm(dim=-1, keepdim=True)
        longest, width = before.clamp(FREE * self.layout.leg, LONGEST * self.layout.leg), EASE * self.layout.leg
        # What the straight run itself is over the limit stays as it is.
        excess = smooth_max(length - longest, 0.0, width) - smooth_max(before - longest, 0.0, width)
        found: Tensor = line * (1.0 - flying * excess / length)
        return found

    def _moves(self, side: str, times: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """By how much the ankle is moved and turned from where it is carried, (T, 3) [m, rad] in the carrier's axes;
        and (T, 1) how freely the foot flies, 0 on the ground.
        """
        own, which = self._which(side, times)
        numbers = torch.arange(len(own), device=times.device)
        starts = times.new_tensor([stance.start for stance in own])
        ends = times.new_tensor([stance.end for stance in own])
        now = self._change(side, times, which)
        first, early = self._change(side, starts, numbers), self._change(side, starts + GLANCE, numbers)
        last, late = self._change(side, ends, numbers), self._change(side, ends - GLANCE, numbers)
        standing = (times <= ends[which] + SLACK).unsqueeze(-1)
        air = (starts[which + 1] - ends[which]).unsqueeze(-1)
        x = ((times - ends[which]).unsqueeze(-1) / air).clamp(0.0, 1.0)
        found = []
        for k in range(2):
            rate_first, rate_last = (early[k] - first[k]) / GLANCE, (last[k] - late[k]) / GLANCE
            fade = hermite(x, last[k][which], first[k][which + 1], rate_last[which], rate_first[which + 1], air)
            found.append(torch.where(standing, now[k], fade))
        inside = (torch.minimum(x, 1.0 - x) / ENDS).clamp(max=1.0)
        return found[0], found[1], torch.where(standing, 0.0, inside**2 * (3.0 - 2.0 * inside))

    def _above_ground(self, ankle: Tensor, foot: Tensor, before: Tensor, as_before: Tensor) -> Tensor:
        """An ankle (T, 3), softly lifted where heel or ball would be below the ground and were not in the straight run,
        which had the ankle at `before` (T, 3) and the foot's frame `as_before` (T, 3, 3).
        """
        points = torch.stack((self.layout.heel, self.layout.ball)).to(foot)

        def depth(place: Tensor, frame: Tensor) -> Tensor:
            heights = frame[:, 1] @ points.T + place[:, 1:2]
            return smooth_max(-heights.amin(-1, keepdim=True), 0.0, SOFT_GROUND * self.layout.leg)

        return ankle + (depth(ankle, foot) - depth(before, as_before)) * ankle.new_tensor((0.0, 1.0, 0.0))

    def _reach(self, hip: Tensor, ankle: Tensor, hinge: Tensor) -> tuple[Tensor, Tensor]:
        """Frames (T, 3, 3) of thigh and shank from hip to ankle (T, 3); hinge: about where the knee's axis points."""
        upper, lower = self.layout.thigh, self.layout.shank
        line = ankle - hip
        length = line.norm(dim=-1, keepdim=True).clamp(max=LONGEST * self.layout.leg)
        down = line / line.norm(dim=-1, keepdim=True)
        axis = hinge - (hinge * down).sum(-1, keepdim=True) * down
        axis = axis / axis.norm(dim=-1, keepdim=True)
        ahead = torch.linalg.cross(down, axis)
        cosine = ((upper**2 + length**2 - lower**2) / (2.0 * upper * length)).clamp(-1.0, 1.0)
        bend = torch.sqrt(1.0 - cosine**2)
        knee = hip + upper * (cosine * down + bend * ahead)
        end = hip + length * down

        def frame(top: Tensor, bottom: Tensor) -> Tensor:
            up = (top - bottom) / (top - bottom).norm(dim=-1, keepdim=True)
            return torch.stack((axis, up, torch.linalg.cross(axis, up)), dim=-1)

        return frame(hip, knee), frame(knee, end)

    def _sinking(self) -> Lean:
        """By how much the body sinks over time, so that no leg has to reach beyond its length (T,) -> (T,) [m]."""
        needs, middles = [], []
        for stance in self.stances:
            times = torch.linspace(stance.start, stance.end, LOOKS).to(self.like)
            own = [one for one in self.stances if one.side == stance.side]
            which = torch.full((LOOKS,), own.index(stance), device=times.device)
            straight = self._straight(times)
            carrier = self._carrier(times, straight)
            hip, ankle = (self.names.index(f"{stance.side}_{part}") for part in ("hip", "ankle"))
            held, _ = self._held(stance.side, which, straight.places[:, ankle])
            line = held - self._carried(carrier, straight.places[:, hip])
            # No straighter than in the straight run, where a knee would snap.
            longest = self._length(stance.side, straight)[:, 0].clamp(min=FREE * self.layout.leg)
            room = longest**2 - line[:, 0] ** 2 - line[:, 2] ** 2
            needs.append(float((-line[:, 1] - room.clamp_min(0.0).sqrt()).clamp_min(0.0).amax()))
            middles.append(0.5 * (stance.start + stance.end))
        padded = np.pad(needs, 1, mode="edge")
        held_down = np.max([padded[:-2], padded[1:-1], padded[2:]], axis=0)
        curve = PchipInterpolator(middles, held_down, extrapolate=False)

        def sink(times: Tensor) -> Tensor:
            inside = times.detach().cpu().double().clamp(middles[0], middles[-1])
            return torch.as_tensor(curve(inside.numpy())).to(self.like)

        return sink

    def _centre(self, root: Tensor, rotations: Tensor) -> Tensor:
        """(T, 3) centre of mass of the led body [m]."""
        places, frames = self.layout.skeleton.forward(root, rotations)
        total = torch.zeros_like(root)
        for k, segment in enumerate(SEGMENTS):
            joint = self.names.index(JOINT_OF[segment])
            share = self.layout.masses[k] / self.layout.masses.sum()
            total = total + share * (places[:, joint] + frames[:, joint] @ self.layout.centres[k])
        return total
