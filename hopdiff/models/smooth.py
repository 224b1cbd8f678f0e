"""The `smooth` model: a periodic run in closed pieces, differentiable and independent of any frame rate.

Hopper: `solve_cycle`. Legs: `make_swing`. Upper body: harmonic arm and pelvis motion plus `periodic_sway`.
One step is computed (left stance and the flight after it); the second is its mirror image, unless the run limps.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import torch
from torch import Tensor

from hopdiff.character import Character
from hopdiff.models.body import foot_height, lower_centre, sway_sensitivity, upper_centre, upper_channels
from hopdiff.models.limp import LimpSettings
from hopdiff.models.smooth_gait import SmoothGait, leg_channels, pelvis_channels, stance_pose
from hopdiff.models.steps import Steps
from hopdiff.models.trajectory import JOINT_CHANNELS, LEG_CHANNELS, Trajectory, join_steps
from hopdiff.numerics import (
    chebyshev_nodes,
    differentiation_matrix,
    even_interpolation,
    integration_matrix,
    second_differentiation_matrix,
)
from hopdiff.physics.balance import periodic_sway, support_path, support_side
from hopdiff.physics.legs import LegPose, SwingGenes, end_rates, make_swing

FOOT_SAMPLES = 48  # moments a phase at which a foot must be above the ground; it can dip between the nodes
CONNECTIVITY_STEP = 1.0 / 60.0  # s, the frame over which connectivity extrapolates, whatever the output frame rate


@dataclass(frozen=True)
class _Nodes:
    """All steps on the nodes of both phases (B, M), stance before flight, M = 2 N."""

    base: dict[str, Tensor]  # channels of pelvis and legs
    stride_phase: Tensor
    height: Tensor
    target_side: Tensor
    target_forward: Tensor


@dataclass(frozen=True)
class SmoothModel:
    """character: the body. nodes: Chebyshev nodes per phase. sweeps: corrections of the balance with the true body.

    limp: how the two legs differ, or None.
    """

    character: Character
    nodes: int = 28
    sweeps: int = 2
    limp: LimpSettings | None = None

    @property
    def sound(self) -> SmoothModel:
        """The same model on two equal legs."""
        return replace(self, limp=None)

    def gait(self, genes: dict[str, Tensor], speed: Tensor) -> SmoothGait:
        """genes: name -> (P,) in SI units and rad. speed: (P,) [m/s]."""
        return self._solve(genes, speed)[0]

    def _solve(self, genes: dict[str, Tensor], speed: Tensor) -> tuple[SmoothGait, _Nodes]:
        body = self.character
        steps = Steps.of(body, genes, speed, self.limp, swell=True)
        cycle, genes = steps.cycle, steps.genes
        x = self._nodes(speed)
        height = cycle.stance_height_nodes(self.nodes)
        pelvis = pelvis_channels(steps, x * cycle.contact_time.unsqueeze(-1))
        pose, reach = stance_pose(body, steps, x, height, pelvis)
        rates = [end_rates(values, cycle.contact_time) for values in pose]
        # The hip of the swinging leg hangs on the other side of the pelvis.
        swing_hip = height[:, -1] - body.hip_half_width * torch.sin(pelvis["pelvis_roll"][:, -1])
        swing = make_swing(
            steps.other(cycle.contact_time),
            cycle.flight_time,
            start=LegPose(*(values[:, -1] for values in pose)),
            start_rate=LegPose(*(r[1] for r in rates)),
            end=LegPose(*(values[:, 0] for values in pose)),
            end_rate=LegPose(*(r[0] for r in rates)),
            genes=SwingGenes(*(genes[f"swing_{name}"] for name in SwingGenes._fields)),
            hip_height=steps.other(swing_hip),
            thigh=body.thigh,
            shank=body.shank,
        )
        zero = height.new_zeros(height.shape[0], 2, self.nodes)
        gait = SmoothGait(body, steps, swing, reach.amax(-1), zero, zero)
        nodes = self._on_nodes(gait, pose, pelvis, height)
        return self._balance(gait, nodes), nodes

    def _nodes(self, like: Tensor) -> Tensor:
        return chebyshev_nodes(self.nodes, like.dtype, like.device)

    def _on_nodes(self, gait: SmoothGait, pose: LegPose, pelvis: dict[str, Tensor], height: Tensor) -> _Nodes:
        steps, cycle = gait.steps, gait.steps.cycle
        x = self._nodes(height).expand_as(height)

        def both(stance: Tensor, flight: Tensor) -> Tensor:
            return torch.cat((stance, flight), dim=-1)

        flight_time = cycle.contact_time.unsqueeze(-1) + x * cycle.flight_time.unsqueeze(-1)
        later = pelvis_channels(steps, flight_time)
        stance_legs = leg_channels(self.character, pose, gait.other_swing.swing(x))
        flight_legs = leg_channels(self.character, gait.swing.first_flight(x), gait.other_swing.last_flight(x))
        base = {name: both(pelvis[name], later[name]) for name in pelvis}
        base |= {name: both(stance_legs[name], flight_legs[name]) for name in stance_legs}
        width = 0.5 * steps.genes["step_width"]
        ahead = support_path(x, cycle.reach, steps.other(cycle.reach))
        return _Nodes(
            base,
            steps.phase(both(x * cycle.contact_time.unsqueeze(-1), flight_time)),
            both(height, cycle.flight_height(x)),
            both(*(support_side(kind, x, width) for kind in ("stance", "flight"))),
            both(-cycle.stance_forward(x), ahead) + steps.genes["com_lead"].unsqueeze(-1),
        )

    def _upper(self, gait: SmoothGait, nodes: _Nodes) -> dict[str, Tensor]:
        sway, side = gait.sway.flatten(1), gait.side_sway.flatten(1)
        upper = upper_channels(gait.steps.genes, nodes.stride_phase, sway, side, gait.steps.speed)
        return {**upper, "trunk_yaw": nodes.base["trunk_yaw"]}

    def _stiffness(self, steps: Steps) -> tuple[Tensor, Tensor]:
        """How fast the balance answers, fore-aft and sideways (B,) [1/s]."""
        forward, side = sway_sensitivity(self.character, steps.genes)
        return forward / steps.speed, side / steps.speed

    def _balance(self, gait: SmoothGait, nodes: _Nodes) -> SmoothGait:
        """The sway for which the centre of mass follows its target over the steps and comes back to where it was."""
        steps, cycle = gait.steps, gait.steps.cycle
        stiffness, side_stiffness = self._stiffness(steps)
        durations = torch.stack((cycle.contact_time, cycle.flight_time), dim=-1)
        lower = lower_centre(self.character, nodes.base)
        for _ in range(self.sweeps):
            upper = upper_centre(self.character, self._upper(gait, nodes))
            forward = (nodes.target_forward - lower[2] - upper[2]).unflatten(1, (2, -1))
            sideways = (nodes.target_side - lower[0] - upper[0]).unflatten(1, (2, -1))
            forward = forward + stiffness[:, None, None] * gait.sway
            sideways = sideways + side_stiffness[:, None, None] * gait.side_sway
            gait = replace(
                gait,
                sway=periodic_sway(forward, stiffness, durations, 1.0, steps.count),
                side_sway=periodic_sway(sideways, side_stiffness, durations, -1.0, steps.count),
            )
        return gait

    def trajectory(self, genes: dict[str, Tensor], speed: Tensor) -> Trajectory:
        """One step, or both of a limp, on the nodes of both phases, for the costs."""
        gait, nodes = self._solve(genes, speed)
        steps, n = gait.steps, self.nodes
        cycle = steps.cycle
        dtype, device = speed.dtype, speed.device
        durations = torch.stack((cycle.contact_time, cycle.flight_time), dim=-1)
        channels = {**nodes.base, **self._upper(gait, nodes)}
        lower, upper = lower_centre(self.character, nodes.base), upper_centre(self.character, channels)
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
        x = self._nodes(speed).expand(len(durations), -1)
        force = cycle.leg_force_bw(cycle.stance_forward(x), nodes.height[:, :n])
        stiffness, side_stiffness = self._stiffness(steps)
        found = Trajectory(
            weights=(integration_matrix(n, dtype, device)[-1] * durations.unsqueeze(-1)).flatten(1),
            angles=angles.flatten(2).transpose(1, 2),
            accelerations=accelerations.flatten(2).transpose(1, 2),
            rates_before=before,
            rates_after=after,
            balance_error=torch.stack(
                (nodes.target_side - lower[0] - upper[0], nodes.target_forward - lower[2] - upper[2]), dim=-1
            ),
            com_height=nodes.height + lower[1] + upper[1],
            foot_height=torch.stack([self._dense_foot_height(nodes, side) for side in ("left", "right")], dim=-1),
            leg_force=torch.cat((force, torch.zeros_like(force)), dim=-1),
            reach=gait.reach,
            pelvis_tilt=steps.genes["pelvis_tilt"],
            contact_time=cycle.contact_time,
            flight_time=cycle.flight_time,
            speed=steps.speed,
            sway_stiffness=stiffness,
            solved=cycle.converged,
        )
        return found if steps.count == 1 else join_steps(found, side_stiffness)

    def _dense_foot_height(self, nodes: _Nodes, side: str) -> Tensor:
        """Foot heights (B, 2 K) between the nodes of stance and flight too, K = FOOT_SAMPLES a phase."""
        heights = foot_height(self.character, nodes.base, nodes.height, side).unflatten(1, (2, -1))
        dense = even_interpolation(self.nodes, FOOT_SAMPLES, heights.dtype, heights.device)
        found: Tensor = (heights @ dense.T).flatten(1)
        return found
