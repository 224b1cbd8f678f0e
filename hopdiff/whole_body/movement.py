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
from functools import cached_property
from typing import Protocol

import torch
from torch import Tensor
from torch.nn import functional

from hopdiff.numerics import constant, cross
from hopdiff.whole_body.fixed_point import fixed_point
from hopdiff.whole_body.grid import Grid
from hopdiff.whole_body.kinematics import Angles, all_frames, arm_frames, joint_places, segment_centres, trunk_frames
from hopdiff.whole_body.layout import CHEST, PELVIS, THIGHS, UPPER_BODY, WAIST, Layout
from hopdiff.whole_body.leg_poses import Legs
from hopdiff.whole_body.plan import Plan
from hopdiff.whole_body.support import Carried, Support

PELVIS_FOLLOWS = 0.5  # share of the chest's pitching that the pelvis takes part in
STEEPEST, FLATTEST = math.radians(-88.0), math.radians(5.0)  # pitch of the foot at take-off


@dataclass(frozen=True, eq=False)
class Body:
    """Everything about P candidates on the period's nodes (M).

    root: (P, 3, M) middle between the hips [m]. frames: (P, S, 3, 3, M). reach: a contact (P, K) from hip to ankle in
    leg lengths. slack: see `Legs.angles`. carried: forces and the centre of mass.
    """

    layout: Layout
    angles: Angles
    root: Tensor
    frames: Tensor
    reach: list[Tensor]
    slack: Tensor
    carried: Carried

    @cached_property
    def joints(self) -> Tensor:
        """(P, S, 3, M) [m]."""
        return joint_places(self.layout, self.root, self.frames)

    @cached_property
    def centres(self) -> Tensor:
        """(P, S, 3, M) centres of mass of the segments [m]."""
        return segment_centres(self.layout, self.root, self.frames)


class Guide(Protocol):
    """What is known of a movement of similar genes, see `hopdiff.whole_body.anchor`."""

    @property
    def told(self) -> Tensor: ...

    @property
    def answer(self) -> Tensor: ...

    def guess(self, genes: dict[str, Tensor]) -> Tensor: ...


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
        self._still = torch.zeros_like(self.arms[0])
        upright = torch.stack([self._still[:, 0]] * 3, dim=1)
        self.arm_frames = arm_frames(self._angles(upright, upright))

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
        angles = self._angles(pelvis, chest)
        trunk = trunk_frames(angles)
        hips = root.unsqueeze(1) + torch.einsum("pkim,sk->psim", trunk[:, PELVIS], self.layout.offsets[THIGHS])
        legs, reach, slack = self.legs.angles(hips, carried)
        thigh, knee, foot, turn = legs.unbind(1)
        angles = angles._replace(thigh=thigh, knee=knee, foot=foot, tilt=turn)
        frames = all_frames(angles, trunk, self.arm_frames)
        return Body(self.layout, angles, root, frames, reach, slack, carried)

    def _angles(self, pelvis: Tensor, chest: Tensor) -> Angles:
        """Angles of a trunk and of the arms, with legs that hang."""
        still, genes = self._still, self.genes
        waist, head = 0.5 * (pelvis + chest), torch.zeros_like(chest)
        arms = (*self.arms, genes["arm_abduction"], genes["arm_inward"])
        return Angles(pelvis, waist, chest, head, still, still, still, still, *arms)

    # -- one round --

    def momentum(self, body: Body) -> Tensor:
        """(P, 3, M) angular momentum about the body's centre of mass, per body mass [m^2/s]."""
        return self._weighed(body.frames)[1]

    def _weighed(self, frames: Tensor) -> tuple[Tensor, Tensor]:
        """Centre of mass from the root (P, 3, M) [m] and angular momentum about it (P, 3, M) of a body's frames."""
        axes = frames.flatten(1, 2)
        flat = axes.flatten(2)
        centre = (self.layout.balance @ flat).unflatten(2, (3, -1))[:, 0]
        return centre, self.grid.turning(axes, (self.layout.turning @ flat).unflatten(2, (3, -1)))

    def round(self, state: Tensor, inverse: Tensor) -> Tensor:
        """The next state. inverse: (P or 1, M, 3, 3) rates of the chest a unit of momentum, see `inverse_inertia`."""
        channels, _, height, takeoff = self.unpack(state)
        body = self.body(state)
        grid, carried = self.grid, body.carried
        centre, momentum = self._weighed(body.frames)
        lower = body.slack[:, :, 0].mean(-1)
        # Hips follow at once; a round later they would still be seen where they were, and the height overshoots.
        down = lower[:, None, None] * constant((0.0, 1.0, 0.0), lower.dtype, lower.device)[:, None]
        root = carried.com - centre - down
        off = grid.integral(carried.moment()) - momentum
        rates = grid.derivative(channels[:, 3:])
        turned = inverse.permute(0, 2, 3, 1)  # (P or 1, 3, 3, M)
        if self.plan.mirrored:
            # Yaw and roll turn round in the mirror image; pitch has to come back by itself.
            both = constant((0.0, 0.5, 0.5), off.dtype, off.device)[:, None]
            gained = grid.total_of(carried.moment()).unsqueeze(-1)
            off = off - both * gained
            asked = rates[:, 0] + (turned[:, 0] * off).sum(1)
            first = -grid.total_of(asked) / grid.total_of(turned[:, 0, 0].expand_as(asked))
            pitch_only = constant((1.0, 0.0, 0.0), off.dtype, off.device)[:, None]
            off = off + first[:, None, None] * pitch_only
        else:
            asked = grid.total_of(rates + (turned * off.unsqueeze(1)).sum(2))
            summed = grid.total_of(turned.expand(off.shape[0], -1, -1, -1))
            off = off - torch.linalg.solve_ex(summed, asked.unsqueeze(-1))[0]
        chest = grid.integral(rates + (turned * off.unsqueeze(1)).sum(2))
        mean = grid.mean_of(chest)
        if self.plan.mirrored:
            mean = torch.cat((mean[:, :1], 0.5 * (chest[:, 1:, 0] + chest[:, 1:, -1])), dim=1)
        lean = functional.pad(self.genes["trunk_lean"].unsqueeze(-1), (0, 2))
        chest = chest + (lean - mean).unsqueeze(-1)
        takeoff = (takeoff - body.slack[:, :, 1]).clamp(STEEPEST, FLATTEST)
        parts = (root.flatten(1), chest.flatten(1), carried.forward, (height - lower).unsqueeze(-1), takeoff)
        return torch.cat(parts, dim=-1)

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
                moved = cross(axis.expand_as(ahead), ahead, dim=2)
                linear = torch.einsum("s,psim->pim", self.shares[upper], cross(arms, moved, dim=2))
                turned = cross(axis.unsqueeze(1).expand_as(frames), frames, dim=3)
                around = cross(frames, turned, dim=3)
                spin = torch.einsum("s,sk,pskim->pim", share, self.spread[upper], around)
                columns.append(linear + spin)
            found: Tensor = torch.linalg.inv(torch.stack(columns, dim=-1).permute(0, 2, 1, 3))
            return found

    def solve(
        self, rounds: int, adjoint_rounds: int = 0, guide: Guide | None = None, start: Tensor | None = None
    ) -> tuple[Tensor, Tensor]:
        """The state (P, K) after `rounds` rounds, and how far its last round moved it (P,).

        With adjoint_rounds the state carries the gradient of the fixed point. guide: what makes them fewer. start:
        (P, K) a better guess than the guide's.
        """
        if guide is None:
            return fixed_point(self.start(), self.round, self.inverse_inertia, rounds, adjoint_rounds)
        with torch.no_grad():
            start = guide.guess(self.genes) if start is None else start
        return fixed_point(start, self.round, lambda _: guide.told, rounds, adjoint_rounds, guide.answer)
