"""The `thesis` model: the equations of Kang (1999) stepped frame by frame.

One step is run from touchdown: hopper (1) to (4), legs (5), (6), balance (7) to (11) from an upright body at rest; of
a limp both steps. Genes are those of the thesis (conf/genes/thesis.yaml) or those of the smooth model. The thesis
leaves the vertical speed at touchdown open: it is that of the hop which repeats itself (`hopper_cycle`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from hopdiff.character import Character
from hopdiff.models.active_leg import ActiveLeg, knee_in_flight, standing_knee_rate
from hopdiff.models.body import LOWER, Answer, by_name, foot_height, lower_centre, sway_sensitivity, upper_centre
from hopdiff.models.limp import LimpSettings
from hopdiff.models.steps import Steps
from hopdiff.models.thesis_gait import Frames, ThesisGait, along, last_stride, lay_out
from hopdiff.models.trajectory import LEG_CHANNELS, Trajectory, join_steps
from hopdiff.numerics import GRAVITY
from hopdiff.physics.legs import LegPose, knee_offset, leg_pose
from hopdiff.physics.stepping import Hops, flight_blend, step_balance, step_hopper


@dataclass(frozen=True)
class ThesisModel:
    """character: the body. step: frame interval h [s]. strides: run before the one that a gait repeats.

    limp: how the two legs differ, or None. knee: how the knees go through the air, a name of `active_leg.KNEES`.
    impulse: whether joint accelerations reach across take-off, where the printed knee changes its rate at once; they
    then hold a term that grows as 1 / h.
    """

    character: Character
    step: float = 0.005
    strides: int = 8
    limp: LimpSettings | None = None
    knee: str = "printed"
    impulse: bool = False

    @property
    def sound(self) -> ThesisModel:
        """The same model on two equal legs."""
        return replace(self, limp=None)

    def frames(self, genes: dict[str, Tensor], speed: Tensor) -> Frames:
        """genes: name -> (P,) in SI units and rad. speed: (P,) [m/s]."""
        steps = Steps.of(self.character, genes, speed, self.limp, swell=False)
        cycle, g = steps.cycle, steps.genes
        # A step that takes half as long again as the periodic one has lost its cycle.
        longest = math.ceil(1.5 * float(torch.nan_to_num(cycle.step_time.detach()).max()) / self.step) + 2
        hops = step_hopper(
            cycle.leg_length,
            cycle.touchdown_angle,
            2.0 * cycle.reach / cycle.contact_time,
            cycle.stiffness,
            cycle.touchdown_rate,
            self.step,
            hops=1,
            max_frames=longest,
            landing_height=steps.other(cycle.leg_length * torch.cos(cycle.touchdown_angle)),
            flight_speed=cycle.speed,
        )
        count = hops.alive.sum(-1)
        stance_count = (hops.alive & ~hops.in_flight).sum(-1)
        base, reach = self._base(steps, hops)
        width = 0.5 * g["step_width"].unsqueeze(-1)
        behind, ahead = cycle.reach.unsqueeze(-1), steps.other(cycle.reach).unsqueeze(-1)
        side = torch.where(hops.in_flight, width * (1.0 - 2.0 * hops.phase), width.expand_as(hops.phase))
        forward = torch.where(hops.in_flight, (behind + ahead) * hops.phase - behind, hops.foot - hops.forward)
        forward = forward + g["com_lead"].unsqueeze(-1)
        times = torch.arange(hops.phase.shape[-1], dtype=speed.dtype, device=speed.device) * self.step
        # Stretched over what the frames make of the step, so that the next one takes over where it ends.
        framed = (count.clamp_min(1).to(speed) * self.step).unsqueeze(-1)
        phase = steps.phase(times * (cycle.step_time.unsqueeze(-1) / framed))
        return Frames(steps, hops, base, phase, side, forward, reach, stance_count, count)

    def _base(self, steps: Steps, hops: Hops) -> tuple[dict[str, Tensor], Tensor]:
        """Pelvis and leg channels (B, F); the pelvis of the thesis does not turn."""
        body, cycle, g = self.character, steps.cycle, steps.genes
        side = (0.5 * g["step_width"] - body.hip_half_width).unsqueeze(-1)
        zero = torch.zeros_like(hops.height)
        stance, reach = leg_pose(side + zero, -hops.height, hops.foot - hops.forward, body.thigh, body.shank)
        takeoff, _ = leg_pose(
            side + zero, -hops.takeoff_height.clamp_min(0.1), hops.foot - hops.takeoff_forward, body.thigh, body.shank
        )
        height, ahead = cycle.leg_length * torch.cos(cycle.touchdown_angle), cycle.reach
        touchdown, _ = leg_pose(side, -height.unsqueeze(-1), ahead.unsqueeze(-1), body.thigh, body.shank)
        own, own_touchdown = ActiveLeg.of(body, steps, touchdown), touchdown
        # From here on the leg in the air is the other one.
        touchdown, swing = steps.other((touchdown, own))
        # Stance: the active leg moves with the way of HIP, its knee on the parabola through three genes.
        p = hops.phase
        active = LegPose(
            swing.angle_start + (swing.angle_end - swing.angle_start) * p, swing.knee(p), touchdown.tilt + zero
        )
        # Flight, equation (5), leg angles on the parabola (6); the legs swap their roles.
        blend = flight_blend(p, swing.alpha.squeeze(-1))
        leaving = self._knee_rate(steps, hops, takeoff.knee)
        passing = swing.knee_slope() / cycle.contact_time.unsqueeze(-1)
        duration = hops.flight.clamp_min(1e-9)
        trailing = LegPose(
            takeoff.angle + (own.angle_start - takeoff.angle) * blend,
            knee_in_flight(self.knee, body, p, (takeoff.knee, own.knee_start), leaving, duration),
            takeoff.tilt + (own_touchdown.tilt - takeoff.tilt) * p,
        )
        leading = LegPose(
            swing.angle_end + (touchdown.angle - swing.angle_end) * blend,
            knee_in_flight(self.knee, body, p, (swing.knee_end, touchdown.knee), passing, duration),
            touchdown.tilt + zero,
        )
        channels = {
            "pelvis_tilt": g["pelvis_tilt"].unsqueeze(-1) + zero,
            "pelvis_roll": zero,
            "pelvis_yaw": zero,
            "trunk_yaw": zero,
        }
        for name, air, ground, sign in (("left", trailing, stance, 1.0), ("right", leading, active, -1.0)):
            pose = LegPose(*(torch.where(hops.in_flight, a, b) for a, b in zip(air, ground, strict=True)))
            channels[f"{name}_thigh"] = pose.angle + knee_offset(pose.knee, body.thigh, body.shank)
            channels[f"{name}_knee"] = pose.knee
            channels[f"{name}_tilt"] = sign * pose.tilt
        standing = hops.alive & ~hops.in_flight
        return channels, reach.masked_fill(~standing, 0.0).amax(-1)

    def _knee_rate(self, steps: Steps, hops: Hops, takeoff: Tensor) -> Tensor:
        """Rate of the carrying knee at take-off (B, F) [rad/s], from its flexion there."""
        cycle = steps.cycle
        pace = (2.0 * cycle.reach / cycle.contact_time).unsqueeze(-1)
        landing = steps.other(cycle.leg_length * torch.cos(cycle.touchdown_angle)).unsqueeze(-1)
        duration = hops.flight.clamp_min(1e-9)
        rise = (landing - hops.takeoff_height) / duration + 0.5 * GRAVITY * duration
        place = (hops.takeoff_forward - hops.foot, hops.takeoff_height)
        return standing_knee_rate(self.character, takeoff, place, (pace, rise))

    def _balance(
        self, genes: dict[str, Tensor], speed: Tensor, lower: Tensor, answer: Answer, target: Tensor
    ) -> tuple[Tensor, Tensor, Tensor]:
        """Upper-body angles (11, P, F), errors (P, F, 2) and centre of mass height above HIP, by frames from rest.

        lower: (8, P, F). target: (P, 2, F) forward and to the left of HIP [m]; so are errors.
        """
        left, up, forward = lower_centre(self.character, lower, genes["pelvis_tilt"])
        low = torch.stack((forward, left), dim=1)
        still = torch.zeros_like(target[:, :, 0])
        sway = (still, still, still)
        columns, errors, heights = [], [], []
        for frame in range(lower.shape[-1]):
            here = answer._replace(base=answer.base[:, :, frame : frame + 1])
            upper = here.angles((sway[0] * speed.unsqueeze(-1)).unsqueeze(-1))
            high = upper_centre(self.character, upper, genes["arm_inward"])
            error = target[:, :, frame] - low[:, :, frame] - torch.cat((high[2], high[0]), dim=-1)
            columns.append(upper)
            errors.append(error)
            heights.append(up[:, frame] + high[1][:, 0])
            sway = (step_balance(sway, error, self.step, speed.unsqueeze(-1)), sway[0], sway[1])
        return torch.cat(columns, dim=-1), torch.stack(errors, dim=1), torch.stack(heights, dim=1)

    def trajectory(self, genes: dict[str, Tensor], speed: Tensor) -> Trajectory:
        """One step, or both of a limp, on frames; joint accelerations do not reach across take-off, gamma does."""
        f = self.frames(genes, speed)
        genes, speed, cycle = f.steps.genes, f.steps.speed, f.steps.cycle
        lower = torch.stack([f.base[name] for name in LOWER])
        answer = Answer.of(genes, f.stride_phase, f.base["trunk_yaw"], speed)
        target = torch.stack((f.target_forward, f.target_side), dim=1)
        upper, error, com_height = self._balance(genes, speed, lower, answer, target)
        angles = torch.cat((lower, upper)).permute(1, 2, 0)
        rates = torch.diff(angles, dim=1) / self.step
        inner = torch.diff(rates, dim=1) / self.step
        accelerations = torch.cat((inner[:, :1], inner, inner[:, -1:]), dim=1)
        # The rows next to take-off mix stance and flight: each takes over its own side's neighbour, but for an impulse.
        frame = torch.arange(angles.shape[1], device=angles.device)
        last = f.stance_frames.clamp_min(3) - 1
        final = f.step_frames.clamp_min(5) - 1
        near = frame.expand(speed.shape[0], -1)
        if not self.impulse:
            near = torch.where(near == last[:, None], near - 1, torch.where(near == last[:, None] + 1, near + 1, near))
        near = torch.minimum(near, (final - 1)[:, None]).clamp(1, angles.shape[1] - 2)
        accelerations = accelerations.gather(1, near.unsqueeze(-1).expand_as(accelerations))

        def leg_rates(index: Tensor) -> Tensor:
            index = index.clamp(0, rates.shape[1] - 1)
            return rates[..., :LEG_CHANNELS].gather(1, index[:, None, None].expand(-1, 1, LEG_CHANNELS))[:, 0]

        ending = leg_rates(last - 1)
        before = ending + (ending - leg_rates(last - 2))
        after = leg_rates(last + 1)
        used = f.hops.alive
        force = cycle.leg_force_bw(f.hops.forward - f.hops.foot, f.hops.height)
        # A finished step ends in a frame of the next hop; one that fell or was cut off does not.
        complete = (
            cycle.converged & (f.hops.hop[:, -1] > 0) & (f.stance_frames > 3) & (f.step_frames > f.stance_frames + 2)
        )
        stiffness = sway_sensitivity(self.character, answer.gains)
        found = Trajectory(
            weights=used.to(speed) * self.step,
            angles=angles,
            accelerations=accelerations,
            rates_before=before,
            rates_after=after,
            balance_error=error.flip(-1),
            com_height=f.hops.height + com_height,
            foot_height=foot_height(self.character, lower, f.hops.height)
            .permute(1, 2, 0)
            .masked_fill(~used.unsqueeze(-1), 0.0),
            leg_force=torch.where(f.hops.in_flight, torch.zeros_like(force), force),
            reach=f.reach,
            pelvis_tilt=genes["pelvis_tilt"],
            contact_time=f.stance_frames.to(speed) * self.step,
            flight_time=(f.step_frames - f.stance_frames).to(speed) * self.step,
            speed=speed,
            sway_stiffness=stiffness[0],
            solved=complete,
        )
        return found if f.steps.count == 1 else join_steps(found, stiffness[1])

    def gait(self, genes: dict[str, Tensor], speed: Tensor) -> ThesisGait:
        """The stride after `strides` strides in which the balance settles, over and over.

        The steps of the hopper are repeated; a balance that has not settled shows as a jump at the end of the stride.
        genes: name -> (P,) in SI units and rad. speed: (P,) [m/s].
        """
        f = self.frames(genes, speed)
        # The frame at which the next stride begins is wanted too.
        course = lay_out(f.steps, f.step_frames, 2 * (self.strides + 1) + 1)
        values = along(course, f, self.step)
        own = {name: value[: len(speed)] for name, value in f.steps.genes.items()}
        lower = torch.stack([values[name] for name in LOWER])
        answer = Answer.of(own, values["stride_phase"], values["trunk_yaw"], speed)
        target = torch.stack((values["target_forward"], values["target_side"]), dim=1)
        upper, _, _ = self._balance(own, speed, lower, answer, target)
        return last_stride(self.character, {**values, **by_name(lower, upper, own)}, f, self.strides, self.step)
