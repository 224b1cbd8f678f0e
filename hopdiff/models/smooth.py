"""The `smooth` model: a periodic run in closed pieces, differentiable and independent of any frame rate.

Hopper: `solve_cycle`. Legs: `make_swing`. Upper body: harmonic arm and pelvis motion plus `periodic_sway`.
One step is computed (left stance and the flight after it); the second is its mirror image, unless the run limps.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import torch
from torch import Tensor

from hopdiff.character import Character
from hopdiff.models.body import Answer, Vector, foot_height, lower_centre, sway_sensitivity, upper_centre
from hopdiff.models.limp import LimpSettings
from hopdiff.models.smooth_gait import SmoothGait, join_phases, leg_rates, lower_angles, pelvis_channels, standing_foot
from hopdiff.models.steps import Steps
from hopdiff.models.trajectory import LEG_CHANNELS, Trajectory, join_steps
from hopdiff.numerics import (
    chebyshev_nodes,
    constant,
    differentiation_matrix,
    even_interpolation,
    integration_matrix,
    second_differentiation_matrix,
)
from hopdiff.physics.balance import periodic_sway, support_path, support_side
from hopdiff.physics.leg_motion import leg_motion
from hopdiff.physics.legs import LegMotion, LegPose, SwingGenes, make_swing

FOOT_SAMPLES = 48  # moments a phase at which a foot must be above the ground; it can dip between the nodes
CONNECTIVITY_STEP = 1.0 / 60.0  # s, the frame over which connectivity extrapolates, whatever the output frame rate

# Leg channels in stance and in flight whose acceleration has a kink, half-way through the swing. There its square is
# integrated with a quarter of the error from the polynomial through the nodes, which rounds it.
KINKED = (False, False, True, False, False, False, True, False)


@dataclass(frozen=True)
class _Nodes:
    """All steps on the nodes of both phases (B, M), stance before flight, M = 2 N.

    lower: (8, B, M), see `body.LOWER`. leg_rates, leg_accelerations: (4, B, M) of the curves of thighs and knees.
    answer: how the upper body answers the sway. ahead: (B, N) of HIP from the foot that stands [m]. target: (B, 2, M)
    of the centre of mass from HIP, forward and to the left; lower_centre: what pelvis and legs add to it, up too.
    """

    lower: Tensor
    leg_rates: Tensor
    leg_accelerations: Tensor
    answer: Answer
    height: Tensor
    ahead: Tensor
    target: Tensor
    lower_centre: Vector


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
        height, ahead = cycle.stance_height_nodes(self.nodes), cycle.stance_forward(x)
        flight_time = cycle.contact_time.unsqueeze(-1) + x * cycle.flight_time.unsqueeze(-1)
        time = torch.cat((x * cycle.contact_time.unsqueeze(-1), flight_time), dim=-1)
        pelvis = pelvis_channels(steps, time)
        standing = {name: values[:, : self.nodes] for name, values in pelvis.items()}
        foot = torch.stack(standing_foot(body, steps, ahead, height, standing))
        contact = cycle.contact_time.unsqueeze(-1)
        first, second = self._derivatives(speed)
        carrying = leg_motion(foot, foot @ first.T / contact, foot @ second.T / contact**2, body.thigh, body.shank)
        reach = foot.square().sum(0).amax(-1).sqrt() / (body.thigh + body.shank)
        # The hip of the swinging leg hangs on the other side of the pelvis.
        swing_hip = height[:, -1] - body.hip_half_width * torch.sin(standing["pelvis_roll"][:, -1])
        swing = make_swing(
            steps.other(cycle.contact_time),
            cycle.flight_time,
            start=LegPose(*(values[:, -1] for values in carrying.pose)),
            start_rate=LegPose(*(values[:, -1] for values in carrying.rate)),
            end=LegPose(*(values[:, 0] for values in carrying.pose)),
            end_rate=LegPose(*(values[:, 0] for values in carrying.rate)),
            genes=SwingGenes(*(genes[f"swing_{name}"] for name in SwingGenes._fields)),
            hip_height=steps.other(swing_hip),
            thigh=body.thigh,
            shank=body.shank,
        )
        gait = SmoothGait(body, steps, swing, reach, height.new_zeros(len(height), 2, 2, self.nodes))
        nodes = self._on_nodes(gait, carrying, pelvis, time, (height, ahead))
        return self._balance(gait, nodes), nodes

    def _nodes(self, like: Tensor) -> Tensor:
        return chebyshev_nodes(self.nodes, like.dtype, like.device)

    def _derivatives(self, like: Tensor) -> tuple[Tensor, Tensor]:
        """First and second derivative on the nodes of a phase (N, N), by the share of its duration."""
        of = (self.nodes, like.dtype, like.device)
        return differentiation_matrix(*of), second_differentiation_matrix(*of)

    def _on_nodes(
        self, gait: SmoothGait, carrying: LegMotion, pelvis: dict[str, Tensor], time: Tensor, hip: tuple[Tensor, Tensor]
    ) -> _Nodes:
        """carrying, hip: of the leg that stands and of HIP, up and ahead of the foot, on the nodes of the stance."""
        steps, cycle = gait.steps, gait.steps.cycle
        genes, (height, ahead) = steps.genes, hip
        x = self._nodes(height).expand_as(height)
        left = join_phases(carrying, gait.swing.first_flight(x))
        right = join_phases(gait.other_swing.swing(x), gait.other_swing.last_flight(x))
        lower = lower_angles(self.character, left.pose, right.pose, pelvis)
        width = 0.5 * genes["step_width"]
        path = support_path(x, cycle.reach, steps.other(cycle.reach))
        forward = torch.cat((-ahead, path), dim=-1) + genes["com_lead"].unsqueeze(-1)
        side = torch.cat([support_side(kind, x, width) for kind in ("stance", "flight")], dim=-1)
        return _Nodes(
            lower,
            *leg_rates(self.character, left, right),
            Answer.of(genes, steps.phase(time), pelvis["trunk_yaw"], steps.speed),
            torch.cat((height, cycle.flight_height(x)), dim=-1),
            ahead,
            torch.stack((forward, side), dim=1),
            lower_centre(self.character, lower, genes["pelvis_tilt"]),
        )

    def _upper(self, gait: SmoothGait, nodes: _Nodes) -> tuple[Tensor, Tensor, Tensor]:
        """Angles of the upper body (11, B, M), error of the balance (B, 2, M) and height of the centre of mass [m]."""
        upper = nodes.answer.angles(gait.sway.flatten(2))
        above, below = upper_centre(self.character, upper, gait.steps.genes["arm_inward"]), nodes.lower_centre
        centre = torch.stack((below[2] + above[2], below[0] + above[0]), dim=1)
        return upper, nodes.target - centre, nodes.height + below[1] + above[1]

    def _balance(self, gait: SmoothGait, nodes: _Nodes) -> SmoothGait:
        """The sway for which the centre of mass follows its target over the steps and comes back to where it was."""
        steps, cycle = gait.steps, gait.steps.cycle
        stiffness = sway_sensitivity(self.character, nodes.answer.gains).T
        durations = torch.stack((cycle.contact_time, cycle.flight_time), dim=-1)
        # Every second step is seen in the mirror, which turns what is sideways round.
        signs = constant((1.0, -1.0), durations.dtype, durations.device)
        for _ in range(self.sweeps):
            error = self._upper(gait, nodes)[1].unflatten(2, (2, -1))
            forcing = error + stiffness[:, :, None, None] * gait.sway
            gait = replace(gait, sway=periodic_sway(forcing, stiffness, durations, signs, steps.count))
        return gait

    def trajectory(self, genes: dict[str, Tensor], speed: Tensor) -> Trajectory:
        """One step, or both of a limp, on the nodes of both phases, for the costs."""
        gait, nodes = self._solve(genes, speed)
        steps, n = gait.steps, self.nodes
        cycle = steps.cycle
        dtype, device = speed.dtype, speed.device
        durations = torch.stack((cycle.contact_time, cycle.flight_time), dim=-1)
        upper, error, com_height = self._upper(gait, nodes)
        angles = torch.cat((nodes.lower, upper)).unflatten(2, (2, -1))
        _, second = self._derivatives(speed)
        # Of legs, whose knees stop short and start anew, a polynomial through the nodes has other ends than the curves.
        rates, accelerations = (x.unflatten(2, (2, -1)) for x in (nodes.leg_rates, nodes.leg_accelerations))
        bends = (angles @ second.T) / durations.unsqueeze(-1) ** 2
        kinked = constant(KINKED, torch.bool, device).view(LEG_CHANNELS, 1, 2, 1)
        legs = torch.where(kinked, bends[:LEG_CHANNELS], accelerations)
        bends = torch.cat((legs, bends[LEG_CHANNELS:]))
        # Kang (1999), equation (12): the rate found one frame into the flight against the one stance predicts.
        before, after = (
            rates[:, :, k, node] + CONNECTIVITY_STEP * accelerations[:, :, k, node] for k, node in ((0, -1), (1, 0))
        )
        force = cycle.leg_force_bw(nodes.ahead, nodes.height[:, :n])
        stiffness = sway_sensitivity(self.character, nodes.answer.gains)
        found = Trajectory(
            weights=(integration_matrix(n, dtype, device)[-1] * durations.unsqueeze(-1)).flatten(1),
            angles=angles.flatten(2).permute(1, 2, 0),
            accelerations=bends.flatten(2).permute(1, 2, 0),
            rates_before=before.T,
            rates_after=after.T,
            balance_error=error.flip(1).transpose(1, 2),
            com_height=com_height,
            foot_height=self._dense_foot_height(nodes),
            leg_force=torch.cat((force, torch.zeros_like(force)), dim=-1),
            reach=gait.reach,
            pelvis_tilt=steps.genes["pelvis_tilt"],
            contact_time=cycle.contact_time,
            flight_time=cycle.flight_time,
            speed=steps.speed,
            sway_stiffness=stiffness[0],
            solved=cycle.converged,
        )
        return found if steps.count == 1 else join_steps(found, stiffness[1])

    def _dense_foot_height(self, nodes: _Nodes) -> Tensor:
        """Heights (B, 2 K, 2) of left and right foot between the nodes too, K = FOOT_SAMPLES a phase."""
        heights = foot_height(self.character, nodes.lower, nodes.height).unflatten(2, (2, -1))
        dense = even_interpolation(self.nodes, FOOT_SAMPLES, heights.dtype, heights.device)
        found: Tensor = (heights @ dense.T).flatten(2).permute(1, 2, 0)
        return found
