"""The `smooth` model: a periodic run in closed pieces, differentiable and independent of any frame rate.

Hopper: `solve_cycle`. Legs: `make_swing`. Upper body: harmonic arm and pelvis motion plus `periodic_sway`.
One step is computed (left stance and the flight after it); the second is its mirror image.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import torch
from torch import Tensor

from hopdiff.character import Character
from hopdiff.models.base import hopper_cycle
from hopdiff.models.body import (
    foot_height,
    hip_joint,
    lower_centre,
    mirror,
    sway_sensitivity,
    upper_centre,
    upper_channels,
)
from hopdiff.models.stride import Pose, finish_stride
from hopdiff.models.trajectory import JOINT_CHANNELS, LEG_CHANNELS, Trajectory
from hopdiff.motion import Motion
from hopdiff.numerics import (
    chebyshev_interpolate,
    chebyshev_nodes,
    differentiation_matrix,
    even_interpolation,
    integration_matrix,
    second_differentiation_matrix,
)
from hopdiff.physics.balance import periodic_sway, support_path, support_side
from hopdiff.physics.hopper import Cycle
from hopdiff.physics.legs import LegPose, Swing, SwingGenes, end_rates, knee_offset, leg_pose, make_swing

FOOT_SAMPLES = 48  # moments a phase at which a foot must be above the ground; it can dip between the nodes
CONNECTIVITY_STEP = 1.0 / 60.0  # s, the frame over which connectivity extrapolates, whatever the output frame rate


class Gait(NamedTuple):
    """A solved periodic run of P candidates; everything can be sampled at any time.

    sway, side_sway: (P, 2, N) on the nodes of stance and flight. sway_stiffness: (P,) of the fore-aft balance [1/s].
    """

    genes: dict[str, Tensor]
    cycle: Cycle
    swing: Swing
    reach: Tensor
    sway: Tensor
    side_sway: Tensor
    sway_stiffness: Tensor


class _Step(NamedTuple):
    """One step on the nodes of both phases, stance before flight, M = 2 N."""

    base: dict[str, Tensor]  # channels of pelvis and legs
    stride_phase: Tensor
    height: Tensor
    target_side: Tensor
    target_forward: Tensor


@dataclass(frozen=True)
class SmoothModel:
    """character: the body. nodes: Chebyshev nodes per phase. sweeps: corrections of the balance with the true body."""

    character: Character
    nodes: int = 28
    sweeps: int = 2

    def solve(self, genes: dict[str, Tensor], speed: Tensor) -> Gait:
        """genes: name -> (P,) in SI units and rad. speed: (P,) [m/s]."""
        return self._solve(genes, speed)[0]

    def _solve(self, genes: dict[str, Tensor], speed: Tensor) -> tuple[Gait, _Step]:
        body = self.character
        cycle = hopper_cycle(body, genes, speed)
        x = self._nodes(speed)
        height = cycle.stance_height_nodes(self.nodes)
        pelvis = self._pelvis(genes, cycle, x * cycle.contact_time.unsqueeze(-1))
        pose, reach = self._stance_pose(genes, cycle, x, height, pelvis)
        rates = [end_rates(values, cycle.contact_time) for values in pose]
        swing = make_swing(
            cycle.contact_time,
            cycle.flight_time,
            start=LegPose(*(values[:, -1] for values in pose)),
            start_rate=LegPose(*(r[1] for r in rates)),
            end=LegPose(*(values[:, 0] for values in pose)),
            end_rate=LegPose(*(r[0] for r in rates)),
            genes=SwingGenes(*(genes[f"swing_{name}"] for name in SwingGenes._fields)),
            # The hip of the swinging leg hangs on the other side of the pelvis.
            hip_height=height[:, -1] - body.hip_half_width * torch.sin(pelvis["pelvis_roll"][:, -1]),
            thigh=body.thigh,
            shank=body.shank,
        )
        forward_gain, side_gain = sway_sensitivity(body, genes)
        zero = x.new_zeros(x.shape[0], 2, self.nodes)
        gait = Gait(genes, cycle, swing, reach.amax(-1), zero, zero, forward_gain / speed)
        step = self._step(gait, pose, pelvis, height)
        return self._balance(gait, step, side_gain / speed), step

    def _nodes(self, like: Tensor) -> Tensor:
        return chebyshev_nodes(self.nodes, like.dtype, like.device).expand(like.shape[0], -1)

    def _stance_pose(
        self, genes: dict[str, Tensor], cycle: Cycle, x: Tensor, height: Tensor, pelvis: dict[str, Tensor]
    ) -> tuple[LegPose, Tensor]:
        """Left leg pose and reach at stance phases x (P, M) for HIP heights (P, M)."""
        hip = hip_joint(self.character, pelvis, "left")
        foot = (0.5 * genes["step_width"].unsqueeze(-1), -height, -cycle.stance_forward(x))
        return leg_pose(
            foot[0] - hip[0], foot[1] - hip[1], foot[2] - hip[2], self.character.thigh, self.character.shank
        )

    def _pelvis(self, genes: dict[str, Tensor], cycle: Cycle, time: Tensor) -> dict[str, Tensor]:
        """Pelvis and trunk attitudes that swing once a stride, at times (P, M) since left touchdown."""
        turn = math.pi / cycle.step_time.unsqueeze(-1)
        swing = torch.cos(turn * time)
        drop = torch.cos(turn * (time - 0.5 * cycle.contact_time.unsqueeze(-1)))
        return {
            "pelvis_tilt": genes["pelvis_tilt"].unsqueeze(-1).expand_as(time),
            "pelvis_roll": genes["pelvis_roll"].unsqueeze(-1) * drop,
            "pelvis_yaw": -genes["pelvis_yaw"].unsqueeze(-1) * swing,
            "trunk_yaw": genes["trunk_yaw"].unsqueeze(-1) * swing,
        }

    def _legs(self, left: LegPose, right: LegPose) -> dict[str, Tensor]:
        """Leg channels; the right pose comes from curves of a left leg and is mirrored here."""
        channels = {}
        for side, pose, sign in (("left", left, 1.0), ("right", right, -1.0)):
            offset = knee_offset(pose.knee, self.character.thigh, self.character.shank)
            channels[f"{side}_thigh"] = pose.angle + offset
            channels[f"{side}_knee"] = pose.knee
            channels[f"{side}_tilt"] = sign * pose.tilt
        return channels

    def _step(self, gait: Gait, pose: LegPose, pelvis: dict[str, Tensor], height: Tensor) -> _Step:
        genes, cycle, swing = gait.genes, gait.cycle, gait.swing
        x = self._nodes(cycle.speed)

        def both(stance: Tensor, flight: Tensor) -> Tensor:
            return torch.cat((stance, flight), dim=-1)

        flight_time = cycle.contact_time.unsqueeze(-1) + x * cycle.flight_time.unsqueeze(-1)
        later = self._pelvis(genes, cycle, flight_time)
        stance_legs = self._legs(pose, swing.swing(x))
        flight_legs = self._legs(swing.first_flight(x), swing.last_flight(x))
        base = {name: both(pelvis[name], later[name]) for name in pelvis}
        base |= {name: both(stance_legs[name], flight_legs[name]) for name in stance_legs}
        times = both(x * cycle.contact_time.unsqueeze(-1), flight_time)
        width = 0.5 * genes["step_width"]
        forward = [support_path(k, x, cycle.contact_time, cycle.flight_time, cycle.speed) for k in ("stance", "flight")]
        return _Step(
            base,
            math.pi * times / cycle.step_time.unsqueeze(-1),
            both(height, cycle.flight_height(x)),
            both(*(support_side(kind, x, width) for kind in ("stance", "flight"))),
            both(*forward) + genes["com_lead"].unsqueeze(-1),
        )

    def _upper(self, gait: Gait, step: _Step) -> dict[str, Tensor]:
        sway, side = gait.sway.flatten(1), gait.side_sway.flatten(1)
        upper = upper_channels(gait.genes, step.stride_phase, sway, side, gait.cycle.speed)
        return {**upper, "trunk_yaw": step.base["trunk_yaw"]}

    def _balance(self, gait: Gait, step: _Step, side_stiffness: Tensor) -> Gait:
        """The sway for which the centre of mass follows its target over the step and comes back to where it was."""
        cycle, stiffness = gait.cycle, gait.sway_stiffness
        durations = torch.stack((cycle.contact_time, cycle.flight_time), dim=-1)
        lower = lower_centre(self.character, step.base)
        for _ in range(self.sweeps):
            upper = upper_centre(self.character, self._upper(gait, step))
            forward = (step.target_forward - lower[2] - upper[2]).unflatten(1, (2, -1))
            sideways = (step.target_side - lower[0] - upper[0]).unflatten(1, (2, -1))
            forward = forward + stiffness[:, None, None] * gait.sway
            sideways = sideways + side_stiffness[:, None, None] * gait.side_sway
            gait = gait._replace(
                sway=periodic_sway(forward, stiffness, durations, sign=1.0),
                side_sway=periodic_sway(sideways, side_stiffness, durations, sign=-1.0),
            )
        return gait

    def trajectory(self, genes: dict[str, Tensor], speed: Tensor) -> Trajectory:
        """One step on the nodes of both phases, for the costs."""
        gait, step = self._solve(genes, speed)
        cycle, n = gait.cycle, self.nodes
        dtype, device = speed.dtype, speed.device
        durations = torch.stack((cycle.contact_time, cycle.flight_time), dim=-1)
        channels = {**step.base, **self._upper(gait, step)}
        lower, upper = lower_centre(self.character, step.base), upper_centre(self.character, channels)
        angles = torch.stack([channels[name] for name, _, _ in JOINT_CHANNELS], dim=1).unflatten(2, (2, -1))
        first = differentiation_matrix(n, dtype, device)
        second = second_differentiation_matrix(n, dtype, device)
        accelerations = (angles @ second.T) / durations[:, None, :, None] ** 2
        legs = angles[:, :LEG_CHANNELS]
        # Kang (1999), equation (12): the rate found one frame into the flight against the one stance predicts.
        before, after = (
            legs[:, :, k] @ first[node] / durations[:, k, None]
            + CONNECTIVITY_STEP * accelerations[:, :LEG_CHANNELS, k, node]
            for k, node in ((0, -1), (1, 0))
        )
        force = cycle.leg_force_bw(cycle.stance_forward(self._nodes(speed)), step.height[:, :n])
        return Trajectory(
            weights=(integration_matrix(n, dtype, device)[-1] * durations.unsqueeze(-1)).flatten(1),
            angles=angles.flatten(2).transpose(1, 2),
            accelerations=accelerations.flatten(2).transpose(1, 2),
            rates_before=before,
            rates_after=after,
            balance_error=torch.stack(
                (step.target_side - lower[0] - upper[0], step.target_forward - lower[2] - upper[2]), dim=-1
            ),
            com_height=step.height + lower[1] + upper[1],
            foot_height=torch.stack([self._dense_foot_height(step, side) for side in ("left", "right")], dim=-1),
            leg_force=torch.cat((force, torch.zeros_like(force)), dim=-1),
            reach=gait.reach,
            pelvis_tilt=genes["pelvis_tilt"],
            contact_time=cycle.contact_time,
            flight_time=cycle.flight_time,
            speed=speed,
            sway_stiffness=gait.sway_stiffness,
            solved=cycle.converged,
        )

    def _dense_foot_height(self, step: _Step, side: str) -> Tensor:
        """Foot heights (P, 2 K) between the nodes of stance and flight too, K = FOOT_SAMPLES a phase."""
        heights = foot_height(self.character, step.base, step.height, side).unflatten(1, (2, -1))
        dense = even_interpolation(self.nodes, FOOT_SAMPLES, heights.dtype, heights.device)
        return (heights @ dense.T).flatten(1)

    def sample(self, gait: Gait, times: Tensor) -> Pose:
        """The first candidate at times (T,) since left touchdown, anywhere in its endless run [s]."""
        genes, cycle, swing = gait.genes, gait.cycle, gait.swing
        step = cycle.step_time.unsqueeze(-1)
        count = torch.floor(times / step + 1e-12)
        local = (times - count * step).clamp_min(0.0)
        contact, flight = cycle.contact_time.unsqueeze(-1), cycle.flight_time.unsqueeze(-1)
        in_flight = local >= contact
        pelvis = self._pelvis(genes, cycle, local)

        x = (local / contact).clamp(max=1.0)
        height = cycle.stance_height(x)
        pose, _ = self._stance_pose(genes, cycle, x, height, self._pelvis(genes, cycle, x * contact))
        force = cycle.leg_force_bw(cycle.stance_forward(x), height)
        stance = [
            *self._legs(pose, swing.swing(x)).values(),
            height,
            *(chebyshev_interpolate(sway[:, 0], x) for sway in (gait.sway, gait.side_sway)),
            support_side("stance", x, 0.5 * genes["step_width"]),
            support_path("stance", x, cycle.contact_time, cycle.flight_time, cycle.speed),
            force,
        ]
        x = ((local - contact) / flight).clamp(min=0.0, max=1.0)
        legs = self._legs(swing.first_flight(x), swing.last_flight(x))
        air = [
            *legs.values(),
            cycle.flight_height(x),
            *(chebyshev_interpolate(sway[:, 1], x) for sway in (gait.sway, gait.side_sway)),
            support_side("flight", x, 0.5 * genes["step_width"]),
            support_path("flight", x, cycle.contact_time, cycle.flight_time, cycle.speed),
            torch.zeros_like(x),
        ]
        *leg_values, height, sway, side_sway, side, forward, force = (
            torch.where(in_flight, b, a) for a, b in zip(stance, air, strict=True)
        )
        upper = upper_channels(genes, math.pi * local / step, sway, side_sway, cycle.speed)
        second = torch.remainder(count, 2.0) == 1.0
        channels = mirror({**pelvis, **upper, **dict(zip(legs, leg_values, strict=True))}, second)
        side = torch.where(second, -side, side)
        return Pose(
            {name: values[0] for name, values in channels.items()},
            height[0],
            torch.stack((side, forward + genes["com_lead"].unsqueeze(-1)), dim=-1)[0],
            force[0],
        )

    def motion(self, genes: dict[str, Tensor], speed: Tensor, fps: float) -> Motion:
        """One stride of a single candidate."""
        gait = self.solve(genes, speed)
        cycle = gait.cycle
        return finish_stride(
            self.character,
            lambda times: self.sample(gait, times),
            float(cycle.contact_time),
            float(cycle.flight_time),
            float(speed),
            fps,
            speed,
        )
