"""The ground force and where it acts: what carries the centre of mass.

Per unit of body mass throughout. Every contact has a vertical force of four sine terms over its time, whose impulse is
given; fore and aft it points at, above or below the centre of mass, and so far aside that nothing is gained or lost
over the period; sideways it points at the centre of mass in mid-contact.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor

from hopdiff.motion import SIDES
from hopdiff.numerics import GRAVITY
from hopdiff.whole_body.foot import pitch_course, sole
from hopdiff.whole_body.grid import Grid
from hopdiff.whole_body.layout import Layout
from hopdiff.whole_body.plan import Contact, Plan

TERMS = 4  # sine terms of the vertical force


@dataclass(frozen=True, eq=False)
class Footing:
    """One contact of P candidates on its own nodes (P, K), as its own limb sees it.

    grid: its phases. phase: 0 at touchdown, 1 at take-off. lift: vertical force [m/s^2]. side: 1 for a left limb, -1
    for a right one. base: (P,) how far ahead of the period's first foothold it stands [m].
    """

    contact: Contact
    grid: Grid
    phase: Tensor
    lift: Tensor
    side: float
    base: Tensor


@dataclass(frozen=True)
class Piece:
    """One phase of a contact or a swing: which nodes of its own are which of the period, and of which side."""

    own: slice
    period: slice
    side: int
    mirrored: bool


def pieces(plan: Plan, limb: str, phases: tuple[int, ...]) -> list[Piece]:
    """Where the phases of a limb, counted on through the mirror image, lie in the period."""
    starts = [sum(plan.nodes[:k]) for k in range(plan.count)]
    found, first = [], 0
    for phase in phases:
        place, mirrored = phase % plan.count, (phase // plan.count) % 2 == 1
        size = plan.nodes[place]
        side = SIDES.index(limb) ^ int(mirrored)
        found.append(Piece(slice(first, first + size), slice(starts[place], starts[place] + size), side, mirrored))
        first += size
    return found


def vertical_force(phase: Tensor, impulse: Tensor, contact_time: Tensor, shape: Tensor) -> Tensor:
    """(P, K) force of a contact [m/s^2] with the given impulse (P,) [m/s]; shape: (P, 3) of the terms after the first.

    The first term is a spring's half sine; the odd ones share the impulse.
    """
    first = 0.5 * math.pi - shape[:, 1] / 3.0
    weights = torch.stack((first, *shape.unbind(-1)), dim=-1)
    order = torch.arange(1, TERMS + 1, dtype=phase.dtype, device=phase.device)
    waves = torch.sin(math.pi * phase.unsqueeze(-1) * order)
    return (waves * weights.unsqueeze(1)).sum(-1) * (impulse / contact_time).unsqueeze(-1)


@dataclass(frozen=True, eq=False)
class Carried:
    """The way of the centre of mass and what pushes it, on the period's nodes (M), both feet's (2) apart.

    com: (P, 3, M) [m]. force: (P, 2, 3, M) [m/s^2]. cop: (P, 2, 3, M) centre of pressure [m]. ankles: a contact
    (P, 3, K) as its own limb sees it [m]. pitches: a contact (P, K) of the foot [rad]. forward: (P, M) the way ahead
    that the force just found makes, to be put in again [m].
    """

    com: Tensor
    force: Tensor
    cop: Tensor
    ankles: list[Tensor]
    pitches: list[Tensor]
    forward: Tensor

    def moment(self) -> Tensor:
        """(P, 3, M) of the ground force about the centre of mass [m^2/s^2]."""
        arms = self.cop - self.com.unsqueeze(1)
        found: Tensor = torch.linalg.cross(arms, self.force, dim=2).sum(1)
        return found


class Support:
    """The contacts of P candidates. genes: name -> (P,). speed: (P,) [m/s]."""

    def __init__(
        self,
        layout: Layout,
        plan: Plan,
        grid: Grid,
        genes: dict[str, Tensor],
        speed: Tensor,
        shares: Tensor | None = None,
    ) -> None:
        self.layout, self.plan, self.grid, self.genes, self.speed = layout, plan, grid, genes, speed
        period = grid.total
        self.way = speed * period
        shape = torch.stack([genes[f"force_{k}"] for k in range(2, TERMS + 1)], dim=-1)
        self.footings: list[Footing] = []
        self.pieces: list[list[Piece]] = []
        count = len(plan.contacts)
        shares = speed.new_full((len(speed), count), 1.0 / count) if shares is None else shares
        middles = []
        for k, contact in enumerate(plan.contacts):
            durations = torch.stack([grid.durations[:, k % plan.count] for k in contact.phases], dim=-1)
            own = Grid(tuple(plan.nodes[k % plan.count] for k in contact.phases), durations)
            phase = own.times / own.total.unsqueeze(-1)
            lift = vertical_force(phase, shares[:, k] * GRAVITY * period, own.total, shape)
            side = 1.0 if contact.limb == "left" else -1.0
            middles.append(grid.durations[:, : contact.phases[0]].sum(-1) + 0.5 * own.total)
            self.footings.append(Footing(contact, own, phase, lift, side, speed * (middles[k] - middles[0])))
            self.pieces.append(pieces(plan, contact.limb, contact.phases))
        lift = self.onto([footing.lift for footing in self.footings]).sum(1)
        rate = grid.integral(lift - GRAVITY)
        rise = grid.integral(rate)
        start = -rise[:, -1:] / period.unsqueeze(-1)
        self.rise = start * grid.times + rise  # height above that at the start of the period
        self.half_width = 0.5 * genes["step_width"]

    def onto(self, values: list[Tensor]) -> Tensor:
        """Values a contact (P, K) on the nodes of the period (P, 2, M), by side; 0 where a foot is in the air."""
        first = values[0]
        found = first.new_zeros(first.shape[0], 2, self.grid.size)
        for value, places in zip(values, self.pieces, strict=True):
            for piece in places:
                found[:, piece.side, piece.period] = value[:, piece.own]
        return found

    def onto_vectors(self, values: list[Tensor]) -> Tensor:
        """Vectors a contact (P, 3, K), as their limb sees them, on the period's nodes (P, 2, 3, M), by side."""
        found = values[0].new_zeros(values[0].shape[0], 2, 3, self.grid.size)
        flip = values[0].new_tensor((-1.0, 1.0, 1.0))[:, None]
        for value, places in zip(values, self.pieces, strict=True):
            for piece in places:
                own = value[:, :, piece.own]
                found[:, piece.side, :, piece.period] = own * flip if piece.mirrored else own
        return found

    def seen(self, values: Tensor, which: int) -> Tensor:
        """Values (P, M) of the period at the nodes of a contact (P, K)."""
        return torch.cat([values[:, piece.period] for piece in self.pieces[which]], dim=-1)

    def steps_gone(self, which: int) -> Tensor:
        """(K,) 1 at the nodes of a contact that belong to the mirror image, which is a step ahead."""
        parts = [
            self.grid.times.new_full((piece.own.stop - piece.own.start,), float(piece.mirrored))
            for piece in self.pieces[which]
        ]
        return torch.cat(parts)

    def carry(self, forward: Tensor, height: Tensor, takeoff: Tensor) -> Carried:
        """The forces for a way ahead (P, M) and a height at the start (P,) of the centre of mass [m].

        takeoff: (P, C) pitch of the foot at each contact's end [rad].
        """
        genes, grid = self.genes, self.grid
        y = height.unsqueeze(-1) + self.rise
        side_forces, x = self._sideways(y)
        above = 1.0 - genes["aim_below"].unsqueeze(-1)
        stands, pitches = [], []
        for k, footing in enumerate(self.footings):
            pitch = pitch_course(
                footing.phase,
                genes["foot_touchdown"],
                takeoff[:, k],
                genes["foot_settle"],
                genes["foot_slap"],
                genes["foot_rise"],
            )
            standing = sole(self.layout, pitch)
            rolled = footing.base.unsqueeze(-1) - footing.grid.integral(
                standing.height * footing.grid.derivative(pitch)
            )
            stands.append((standing, rolled, self.steps_gone(k) * self.way.unsqueeze(-1)))
            pitches.append(pitch)
        # The push ahead is lift / height times how far the force aims from the contact point: an affine function of
        # where the first foot stands and of what is aimed aside, which have to leave nothing over the period.
        pushes, aheads = [], []
        for k, (footing, (standing, rolled, gone)) in enumerate(zip(self.footings, stands, strict=True)):
            pull = footing.lift / self.seen(y, k)
            ahead = self.seen(forward, k) + gone - rolled - standing.ahead
            wave = genes["aim_sway"].unsqueeze(-1) * torch.sin(2.0 * math.pi * footing.phase)
            own = [-pull if not self.plan.alternate or j == k else torch.zeros_like(pull) for j in range(self.asides)]
            pushes.append(torch.stack((pull * (above * ahead - wave), -pull * above, *own), dim=1))
            aheads.append(ahead)
        place, answer = self._balanced(pushes, aheads, side_forces, x, y)
        horizontal = [(push * answer.unsqueeze(-1)).sum(1) for push in pushes]
        cops, ankles = [], []
        for footing, (standing, rolled, gone) in zip(self.footings, stands, strict=True):
            ankle = place.unsqueeze(-1) + rolled - gone
            left = footing.side * self.half_width.unsqueeze(-1).expand_as(ankle)
            cops.append(torch.stack((left, torch.zeros_like(ankle), ankle + standing.ahead), dim=1))
            ankles.append(torch.stack((left, standing.height, ankle), dim=1))
        push = self.onto(horizontal).sum(1)
        gained = grid.integral(grid.integral(push))
        start = self.speed.unsqueeze(-1) - gained[:, -1:] / grid.total.unsqueeze(-1)
        new_forward = start * grid.times + gained
        parts = zip(side_forces, self.footings, horizontal, strict=True)
        force = self.onto_vectors([torch.stack((s, footing.lift, h), dim=1) for s, footing, h in parts])
        com = torch.stack((x, y, new_forward), dim=1)
        return Carried(com, force, self.onto_vectors(cops), ankles, pitches, new_forward)

    @property
    def asides(self) -> int:
        """Numbers that say how far the push aims aside: one for all contacts, or one each."""
        return len(self.footings) if self.plan.alternate else 1

    def _balanced(
        self, pushes: list[Tensor], aheads: list[Tensor], side_forces: list[Tensor], x: Tensor, y: Tensor
    ) -> tuple[Tensor, Tensor]:
        """Where the first foot stands (P,) [m], and the weights (P, 2 + A) of pushes (P, 2 + A, K) with 1 in front.

        Over the period neither speed nor pitch is gained; of legs that stand one after the other nor is yaw.
        """
        conditions: list[Tensor] = []
        for k, (footing, push, ahead) in enumerate(zip(self.footings, pushes, aheads, strict=True)):
            up = self.seen(y, k).unsqueeze(1)
            lever = torch.zeros_like(push)
            lever[:, 0], lever[:, 1] = ahead, -1.0  # centre of mass ahead of the contact point
            rows = [push, footing.lift.unsqueeze(1) * lever - up * push]
            if self.plan.alternate:
                across = (footing.side * self.half_width.unsqueeze(-1) - self.seen(x, k)).unsqueeze(1)
                rows.append(-lever * side_forces[k].unsqueeze(1) - across * push)
            conditions.append(footing.grid.total_of(torch.stack(rows, dim=1)))
        total = torch.stack(conditions).sum(0)
        found = torch.linalg.solve(total[:, :, 1:], -total[:, :, 0])
        return found[:, 0], torch.cat((torch.ones_like(found[:, :1]), found), dim=-1)

    def _sideways(self, y: Tensor) -> tuple[list[Tensor], Tensor]:
        """Sideways force a contact (P, K) as its limb sees it [m/s^2], and place (P, M) of the centre of mass [m]."""
        grid = self.grid
        if not (self.plan.mirrored or self.plan.alternate):
            # Equal feet that stand together push against each other: nothing is left.
            return [torch.zeros_like(footing.lift) for footing in self.footings], torch.zeros_like(y)
        footing = self.footings[0]
        impulses = [one.grid.total_of(one.lift) for one in self.footings]
        units = [
            -one.side * (impulses[0] / own).unsqueeze(-1) * one.lift
            for one, own in zip(self.footings, impulses, strict=True)
        ]
        unit = self._left(self.onto(units))
        rate = grid.integral(unit)
        gone = grid.integral(rate)
        middle = footing.lift.shape[-1] // 2
        high = self.seen(y, 0)[:, middle]
        if self.plan.mirrored:
            start = -0.5 * rate[:, -1:]
            x = -0.5 * (start * grid.total.unsqueeze(-1) + gone[:, -1:]) + start * grid.times + gone
            share = self.half_width / (high + self._own(x)[:, middle])
            return [share.unsqueeze(-1) * units[0]], share.unsqueeze(-1) * x
        x = gone - gone[:, -1:] * grid.times / grid.total.unsqueeze(-1)
        x = x - grid.mean_of(x).unsqueeze(-1)
        # The force of the first contact points at the centre of mass half-way, and nothing is gained in roll.
        lift = self.onto([one.lift for one in self.footings]).sum(1)
        apart = self.half_width * (impulses[0] - impulses[1])
        rolling = torch.stack((grid.total_of(y * unit - x * lift), -grid.total_of(lift)), dim=-1)
        aiming = torch.stack((high + x[:, middle], torch.ones_like(high)), dim=-1)
        answer = torch.linalg.solve(
            torch.stack((aiming, rolling), dim=1), torch.stack((self.half_width, -apart), dim=-1)
        )
        share = answer[:, :1]
        return [share * own for own in units], share * x + answer[:, 1:]

    def _left(self, forces: Tensor) -> Tensor:
        """Forces (P, 2, M), as their limbs see them, to the left in the world (P, M)."""
        if not self.plan.mirrored:
            return forces.sum(1)
        return forces[:, 0] - forces[:, 1]

    def _own(self, x: Tensor) -> Tensor:
        """A sideways place (P, M) as the first contact's limb sees it (P, K)."""
        return torch.cat([-x[:, p.period] if p.mirrored else x[:, p.period] for p in self.pieces[0]], dim=-1)
