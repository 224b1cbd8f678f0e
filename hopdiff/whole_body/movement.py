"""A whole body that obeys momentum: genes to a periodic movement, by a fixed point over all moments at once.

Given the ground force, the centre of mass moves as the force says and the angular momentum about it changes as its
moment says. What is sought is the root's place, the chest's attitude, and three numbers of the stance, for which the
body does both. One round of the map: legs reach for the ground from where the hips are, the root moves by what the
centre of mass is off, the chest turns by what the momentum is off (times the inverse of its inertia), the hips are as
high and the heel comes up as far as straightens the leg at touchdown and take-off as much as the genes say.

The gradient is that of the fixed point: the adjoint equation is solved by the same iteration.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor

from hopdiff.whole_body.fixed_point import fixed_point
from hopdiff.whole_body.grid import Grid
from hopdiff.whole_body.kinematics import Angles, all_frames, joint_places, segment_centres, trunk_frames
from hopdiff.whole_body.layout import CHEST, PELVIS, THIGHS, UPPER_BODY, WAIST, Layout
from hopdiff.whole_body.leg_poses import Legs
from hopdiff.whole_body.plan import Plan
from hopdiff.whole_body.support import Carried, Support

PELVIS_FOLLOWS = 0.5  # share of the chest's pitching that the pelvis takes part in
STEEPEST, FLATTEST = math.radians(-88.0), math.radians(5.0)  # pitch of the foot at take-off


@dataclass(frozen=True, eq=False)
class Body:
    """Everything about P candidates on the period's nodes (M).

    frames: (P, S, 3, 3, M). joints, centres: (P, S, 3, M) [m]. root: (P, 3, M) middle between the hips [m].
    reach: a contact (P, K) from hip to ankle in leg lengths. carried: forces and the centre of mass.
    """

    angles: Angles
    root: Tensor
    frames: Tensor
    joints: Tensor
    centres: Tensor
    reach: list[Tensor]
    slack: Tensor
    carried: Carried


class Movement:
    """P candidates of a plan. genes: name -> (P,) in SI units and rad. speed: (P,) [m/s]."""

    def __init__(
        self,
        layout: Layout,
        plan: Plan,
        genes: dict[str, Tensor],
        speed: Tensor,
        durations: Tensor,
        shares: Tensor | None = None,
    ) -> None:
        self.layout, self.plan, self.genes, self.speed = layout, plan, genes, speed
        self.grid = Grid(plan.nodes, durations)
        self.support = Support(layout, plan, self.grid, genes, speed, shares)
        self.shares = layout.masses / layout.masses.sum()
        self.spread = layout.spread / layout.masses.sum()
        self.legs = Legs(self.support)
        turn = (math.pi if plan.mirrored else 2.0 * math.pi) * self.grid.times / self.grid.total.unsqueeze(-1)
        self._waves = torch.cos(turn), torch.sin(turn)
        together = not (plan.mirrored or plan.alternate)  # limbs that work in pairs
        self.pelvis_roll = self._wave("pelvis_roll") * (0.0 if together else 1.0)
        self.pelvis_yaw = self._wave("pelvis_yaw") * (0.0 if together else 1.0)
        self.arms = []
        for name in ("shoulder", "elbow"):
            wave, mean = self._wave(name), genes[f"{name}_mean"].unsqueeze(-1)
            self.arms.append(torch.stack((mean + wave, mean + wave if together else mean - wave), dim=1))

    def _wave(self, name: str) -> Tensor:
        """(P, M) once a stride."""
        return self.genes[f"{name}_cos"].unsqueeze(-1) * self._waves[0] + (
            self.genes[f"{name}_sin"].unsqueeze(-1) * self._waves[1]
        )

    # -- the state: what is solved for, in one row a candidate --

    @property
    def _sizes(self) -> tuple[int, ...]:
        m = self.grid.size
        return 6 * m, m, 1, len(self.plan.contacts)

    def unpack(self, state: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        """Root and chest (P, 6, M), way ahead of the centre of mass (P, M), its height (P,), take-off pitch (P, C)."""
        body, forward, height, takeoff = state.split(self._sizes, dim=-1)
        return body.unflatten(1, (6, -1)), forward, height[:, 0], takeoff

    def start(self) -> Tensor:
        """A first guess (P, K)."""
        with torch.no_grad():
            layout, genes = self.layout, self.genes
            forward = self.speed.unsqueeze(-1) * self.grid.times
            standing = 0.98 * layout.leg + float(-layout.heel[1])
            height = torch.full_like(self.speed, standing + 0.09 * layout.leg)
            takeoff = torch.full_like(height, math.radians(-45.0)).unsqueeze(-1)
            takeoff = takeoff.expand(-1, len(self.plan.contacts))
            y = height.unsqueeze(-1) + self.support.rise - 0.09 * layout.leg
            lean = genes["trunk_lean"].unsqueeze(-1).expand_as(y)
            none = torch.zeros_like(y)
            body = torch.stack((none, y, forward, lean, none, none), dim=1)
            return torch.cat((body.flatten(1), forward, height.unsqueeze(-1), takeoff), dim=-1)

    # -- from the state to the body --

    def body(self, state: Tensor) -> Body:
        """The body that a state stands for."""
        channels, forward, height, takeoff = self.unpack(state)
        carried = self.support.carry(forward, height, takeoff)
        genes = self.genes
        root, chest = channels[:, :3], channels[:, 3:]
        tilt = genes["pelvis_tilt"].unsqueeze(-1) + PELVIS_FOLLOWS * (chest[:, 0] - genes["trunk_lean"].unsqueeze(-1))
        pelvis = torch.stack((tilt, self.pelvis_roll, self.pelvis_yaw), dim=1)
        none = torch.zeros_like(self.arms[0])
        angles = Angles(
            pelvis,
            0.5 * (pelvis + chest),
            chest,
            torch.zeros_like(chest),
            none,
            none,
            none,
            none,
            self.arms[0],
            self.arms[1],
            genes["arm_abduction"],
            genes["arm_inward"],
        )
        trunk = trunk_frames(angles)
        hips = root.unsqueeze(1) + torch.einsum("pkim,sk->psim", trunk[:, PELVIS], self.layout.offsets[THIGHS])
        legs, reach, slack = self.legs.angles(hips, carried)
        thigh, knee, foot, turn = legs.unbind(2)
        angles = angles._replace(thigh=thigh, knee=knee, foot=foot, tilt=turn)
        frames = all_frames(angles, trunk)
        joints = joint_places(self.layout, root, frames)
        centres = segment_centres(self.layout, joints, frames)
        return Body(angles, root, frames, joints, centres, reach, slack, carried)

    # -- one round --

    def momentum(self, body: Body) -> Tensor:
        """(P, 3, M) angular momentum about the centre of mass that the force asks for, per body mass [m^2/s]."""
        arms = body.centres - body.carried.com.unsqueeze(1)
        moving = torch.linalg.cross(arms, self.grid.derivative(arms), dim=2)
        turning = torch.linalg.cross(body.frames, self.grid.derivative(body.frames), dim=3)
        linear = torch.einsum("s,psim->pim", self.shares, moving)
        return linear + torch.einsum("sk,pskim->pim", self.spread, turning)

    def round(self, state: Tensor, inverse: Tensor) -> Tensor:
        """The next state. inverse: (P, M, 3, 3) rates of the chest a unit of momentum, see `inverse_inertia`."""
        channels, _, height, takeoff = self.unpack(state)
        body = self.body(state)
        grid, carried = self.grid, body.carried
        centre = torch.einsum("s,psim->pim", self.shares, body.centres)
        root = body.root + carried.com - centre
        wanted = grid.integral(carried.moment())
        off = wanted - self.momentum(body)
        rates = grid.derivative(channels[:, 3:])
        if self.plan.mirrored:
            # Yaw and roll turn round in the mirror image; pitch has to come back by itself.
            half = torch.cat((torch.zeros_like(wanted[:, :1, -1:]), 0.5 * wanted[:, 1:, -1:]), dim=1)
            off = off - half
            asked = rates[:, 0] + (inverse[:, :, 0] * off.transpose(1, 2)).sum(-1)
            first = -grid.total_of(asked) / grid.total_of(inverse[:, :, 0, 0])
            off = torch.cat((off[:, :1] + first[:, None, None], off[:, 1:]), dim=1)
            rates = rates + (inverse @ off.transpose(1, 2).unsqueeze(-1)).squeeze(-1).transpose(1, 2)
            chest = grid.integral(rates)
            pitch, others = chest[:, :1], chest[:, 1:]
            others = others - 0.5 * (others[..., :1] + others[..., -1:])
        else:
            asked = grid.total_of(rates + (inverse @ off.transpose(1, 2).unsqueeze(-1)).squeeze(-1).transpose(1, 2))
            summed = grid.total_of(inverse.permute(0, 2, 3, 1))
            off = off - torch.linalg.solve(summed, asked).unsqueeze(-1)
            rates = rates + (inverse @ off.transpose(1, 2).unsqueeze(-1)).squeeze(-1).transpose(1, 2)
            chest = grid.integral(rates)
            pitch, others = chest[:, :1], chest[:, 1:]
            others = others - grid.mean_of(others).unsqueeze(-1)
        pitch = pitch - grid.mean_of(pitch).unsqueeze(-1) + self.genes["trunk_lean"][:, None, None]
        lower = body.slack[:, :, 0].mean(-1)
        height = height - lower
        # Hips follow at once; a round later they would still be seen where they were, and the height overshoots.
        root = root - lower[:, None, None] * root.new_tensor((0.0, 1.0, 0.0))[:, None]
        takeoff = (takeoff - body.slack[:, :, 1]).clamp(STEEPEST, FLATTEST)
        found = torch.cat((root, pitch, others), dim=1)
        return torch.cat((found.flatten(1), carried.forward, height.unsqueeze(-1), takeoff), dim=-1)

    def inverse_inertia(self, state: Tensor) -> Tensor:
        """(P, M, 3, 3) rates of the chest (pitch, roll, yaw) that a unit of momentum (x, y, z) makes [1/m^2]."""
        with torch.no_grad():
            channels, *_ = self.unpack(state)
            body = self.body(state)
            upper = list(UPPER_BODY)
            joints, frames = body.joints, body.frames[:, upper]
            arms = body.centres[:, upper] - body.carried.com.unsqueeze(1)
            waist, chest = joints[:, WAIST : WAIST + 1], joints[:, CHEST : CHEST + 1]
            roll, yaw = channels[:, 4], channels[:, 5]
            cr, sr, cy, sy = roll.cos(), roll.sin(), yaw.cos(), yaw.sin()
            none = torch.zeros_like(roll)
            axes = (
                torch.stack((cy * cr, sr, -sy * cr), dim=1),
                torch.stack((sy, none, cy), dim=1),
                torch.stack((none, none + 1.0, none), dim=1),
            )
            # The abdomen turns half as far as the chest; the head is held upright and moves with the neck.
            own = body.centres[:, upper] - chest
            own[:, 0] = 0.5 * (body.centres[:, WAIST] - waist[:, 0])
            own[:, 2] = joints[:, 3] - chest[:, 0]
            lift = 0.5 * (chest - waist)
            share = own.new_tensor((0.5, 1.0, 0.0, 1.0, 1.0, 1.0, 1.0))
            lifted = own.new_tensor((0.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0))[:, None, None]
            columns = []
            for k, axis in enumerate(axes):
                axis = axis.unsqueeze(1)
                ahead = own + lifted * lift
                if k == 0:
                    ahead = ahead + PELVIS_FOLLOWS * (waist - body.root.unsqueeze(1))
                moved = torch.linalg.cross(axis.expand_as(ahead), ahead, dim=2)
                linear = torch.einsum("s,psim->pim", self.shares[upper], torch.linalg.cross(arms, moved, dim=2))
                turned = torch.linalg.cross(axis.unsqueeze(1).expand_as(frames), frames, dim=3)
                around = torch.linalg.cross(frames, turned, dim=3)
                spin = torch.einsum("s,sk,pskim->pim", share, self.spread[upper], around)
                columns.append(linear + spin)
            found: Tensor = torch.linalg.inv(torch.stack(columns, dim=-1).permute(0, 2, 1, 3))
            return found

    def solve(self, rounds: int, adjoint_rounds: int = 0) -> tuple[Tensor, Tensor]:
        """The state (P, K) after `rounds` rounds, and how far its last round moved it (P,).

        With adjoint_rounds the state carries the gradient of the fixed point.
        """
        return fixed_point(self.start(), self.round, self.inverse_inertia, rounds, adjoint_rounds)
