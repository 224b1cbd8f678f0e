"""A run that the smooth model has solved: everything about it at any moment."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import torch
from torch import Tensor

from hopdiff.character import Character
from hopdiff.models.body import Answer, by_name, hip_joint, mirror
from hopdiff.models.gait import Pose
from hopdiff.models.steps import Steps
from hopdiff.numerics import chebyshev_interpolate
from hopdiff.physics.balance import support_path, support_side
from hopdiff.physics.leg_motion import knee_offset_slopes
from hopdiff.physics.legs import LegMotion, LegPose, Swing, knee_offset, leg_pose


def standing_foot(
    character: Character, steps: Steps, ahead: Tensor, height: Tensor, pelvis: dict[str, Tensor]
) -> tuple[Tensor, Tensor, Tensor]:
    """The foot that carries from its hip joint (B, M), to the left, up and forward, for places of HIP (B, M) ahead of
    and above the foot [m]."""
    hip = hip_joint(character, pelvis, "left")
    return 0.5 * steps.genes["step_width"].unsqueeze(-1) - hip[0], -height - hip[1], -ahead - hip[2]


def pelvis_channels(steps: Steps, time: Tensor) -> dict[str, Tensor]:
    """Pelvis and trunk attitudes that swing once a stride, at times (B, M) since the step's touchdown."""
    genes, phase = steps.genes, steps.phase(time)
    swing, drop = torch.cos(phase), torch.cos(phase - steps.mid_stance_phase())
    return {
        "pelvis_roll": genes["pelvis_roll"].unsqueeze(-1) * drop,
        "pelvis_yaw": -genes["pelvis_yaw"].unsqueeze(-1) * swing,
        "trunk_yaw": genes["trunk_yaw"].unsqueeze(-1) * swing,
    }


def lower_angles(character: Character, left: LegPose, right: LegPose, pelvis: dict[str, Tensor]) -> Tensor:
    """(8, B, M) in the order of `body.LOWER`; the right pose comes from curves of a left leg and is mirrored here."""
    angle, knee = (torch.stack(pair) for pair in ((left.angle, right.angle), (left.knee, right.knee)))
    thigh = angle + knee_offset(knee, character.thigh, character.shank)
    rest = torch.stack((left.tilt, -right.tilt, pelvis["pelvis_roll"], pelvis["pelvis_yaw"]))
    return torch.cat((thigh, knee, rest))


def leg_rates(character: Character, left: LegMotion, right: LegMotion) -> tuple[Tensor, Tensor]:
    """Rates and accelerations (4, B, M) of both thighs and both knees, see `lower_angles`."""
    knee, pace, bend = (torch.stack((a.knee, b.knee)) for a, b in zip(left, right, strict=True))
    slope, curve = knee_offset_slopes(knee, character.thigh, character.shank)
    thigh_pace = torch.stack((left.rate.angle, right.rate.angle)) + slope * pace
    thigh_bend = torch.stack((left.acceleration.angle, right.acceleration.angle)) + slope * bend + curve * pace**2
    return torch.cat((thigh_pace, pace)), torch.cat((thigh_bend, bend))


def join_phases(stance: LegMotion, flight: LegMotion) -> LegMotion:
    """A leg on moments of the stance (B, M) and of the flight (B, L) after it, one after the other."""
    pairs = zip(stance, flight, strict=True)
    return LegMotion(*(LegPose(*(torch.cat(pair, dim=-1) for pair in zip(*both, strict=True))) for both in pairs))


@dataclass(frozen=True, eq=False)
class SmoothGait:
    """A solved periodic run of P candidates. Implements `hopdiff.models.gait.Gait`.

    swing: of the leg that carries in each step. reach: of the stance leg (B,), see Trajectory. sway: (B, 2, 2, N)
    forward and to the left, on the nodes of stance and flight [m s].
    """

    character: Character
    steps: Steps
    swing: Swing
    reach: Tensor
    sway: Tensor

    @cached_property
    def other_swing(self) -> Swing:
        """The swing of the leg that does not carry."""
        swapped: Swing = self.steps.other(self.swing)
        return swapped

    @property
    def contact_times(self) -> Tensor:
        return self._by_leg(self.steps.cycle.contact_time)

    @property
    def flight_times(self) -> Tensor:
        return self._by_leg(self.steps.cycle.flight_time)

    def _by_leg(self, values: Tensor) -> Tensor:
        """(B,) to (P, 2)."""
        if self.steps.count == 1:
            return torch.stack((values, values), dim=-1)
        return torch.stack(values.chunk(2), dim=-1)

    def sample(self, times: Tensor) -> Pose:
        """The runs at times (T,) since left touchdown, anywhere in their endless course [s]."""
        spans = self._by_leg(self.steps.cycle.step_time).unsqueeze(-1)
        ways = self._by_leg(self.steps.ways).unsqueeze(-1)
        first, whole = spans[:, 0], spans.sum(1)
        # A moment that lies on a touchdown but for rounding belongs to the new step.
        count = torch.floor(times / whole + 1e-12)
        local = (times - count * whole).clamp_min(0.0)
        second = local >= first - 1e-12 * whole
        in_second = (local - first).clamp_min(0.0)
        if self.steps.count == 1:
            pose = self._in_step(torch.where(second, in_second, local))
        else:
            # Every moment is looked up in both steps; the one it does not belong to is thrown away.
            pair = self._in_step(torch.cat((torch.minimum(local, first), in_second)))
            pose = _choose(pair, second)
        gone = count * ways.sum(1) + torch.where(second, ways[:, 0], 0.0)
        side, forward = pose.target.unbind(-1)
        return Pose(
            mirror(pose.channels, second),
            pose.height,
            gone + pose.travel,
            torch.stack((torch.where(second, -side, side), forward), dim=-1),
            pose.leg_force,
        )

    def _in_step(self, time: Tensor) -> Pose:
        """Poses at times (B, T) since each step's touchdown, as if the left leg carried; travel from there."""
        steps, cycle, genes = self.steps, self.steps.cycle, self.steps.genes
        contact, flight = cycle.contact_time.unsqueeze(-1), cycle.flight_time.unsqueeze(-1)
        reach, width = cycle.reach.unsqueeze(-1), 0.5 * genes["step_width"]

        x = (time / contact).clamp(max=1.0)
        height, ahead = cycle.stance_height(x), cycle.stance_forward(x)
        foot = standing_foot(self.character, steps, ahead, height, pelvis_channels(steps, x * contact))
        pose, _ = leg_pose(*foot, self.character.thigh, self.character.shank)
        stance = [
            *pose,
            *self.other_swing.swing(x).pose,
            height,
            reach + ahead,
            *(chebyshev_interpolate(axis[:, 0], x) for axis in self.sway.unbind(1)),
            support_side("stance", x, width),
            -ahead,
            cycle.leg_force_bw(ahead, height),
        ]
        x = ((time - contact) / flight).clamp(min=0.0, max=1.0)
        air = [
            *self.swing.first_flight(x).pose,
            *self.other_swing.last_flight(x).pose,
            cycle.flight_height(x),
            2.0 * reach + cycle.speed.unsqueeze(-1) * flight * x,
            *(chebyshev_interpolate(axis[:, 1], x) for axis in self.sway.unbind(1)),
            support_side("flight", x, width),
            support_path(x, cycle.reach, steps.other(cycle.reach)),
            torch.zeros_like(x),
        ]
        in_flight = time >= contact
        *legs, height, travel, sway, side_sway, side, forward, force = (
            torch.where(in_flight, b, a) for a, b in zip(stance, air, strict=True)
        )
        pelvis = pelvis_channels(steps, time)
        lower = lower_angles(self.character, LegPose(*legs[:3]), LegPose(*legs[3:]), pelvis)
        answer = Answer.of(genes, steps.phase(time), pelvis["trunk_yaw"], steps.speed)
        channels = by_name(lower, answer.angles(torch.stack((sway, side_sway), dim=1)), genes)
        return Pose(
            channels, height, travel, torch.stack((side, forward + genes["com_lead"].unsqueeze(-1)), dim=-1), force
        )


def _choose(pair: Pose, second: Tensor) -> Pose:
    """The poses (P, T) of the right of two steps (2 P, T)."""

    def pick(values: Tensor) -> Tensor:
        first, other = values.chunk(2)
        return torch.where(second if values.dim() == 2 else second.unsqueeze(-1), other, first)

    channels = {name: pick(values) for name, values in pair.channels.items()}
    return Pose(channels, *(pick(values) for values in pair[1:]))
