"""The ground force and where it acts: what carries the centre of mass.

Per unit of body mass throughout. Every contact has a vertical force of four sine terms over its time, whose impulse is
given; fore and aft it points at, above or below the centre of mass, and so far aside that nothing is gained or lost
over the period; sideways it points at the centre of mass in mid-contact.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import torch
from torch import Tensor
from torch.nn import functional

from hopdiff.numerics import GRAVITY, cross, solve_small
from hopdiff.whole_body.foot import pitch_shapes, sole
from hopdiff.whole_body.grid import Grid
from hopdiff.whole_body.layout import Layout
from hopdiff.whole_body.places import Places, places_of
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
    """The way of the centre of mass and what pushes it: on the period's nodes (M), both feet's (2) apart, and a contact
    on its own nodes (K), as its own limb sees it.

    com: (P, 3, M) [m]. forces: a contact (P, 3, K) [m/s^2]. cops: a contact (P, 3, K) centre of pressure [m]. ankles:
    a contact (P, 3, K) [m]. pitches: a contact (P, K) of the foot [rad]. forward: (P, M) the way ahead that the force
    just found makes, to be put in again [m].
    """

    support: Support
    com: Tensor
    forces: list[Tensor]
    cops: list[Tensor]
    ankles: list[Tensor]
    pitches: list[Tensor]
    forward: Tensor

    @cached_property
    def force(self) -> Tensor:
        """(P, 2, 3, M) [m/s^2]."""
        return self.support.onto_vectors(self.forces)

    @cached_property
    def cop(self) -> Tensor:
        """(P, 2, 3, M) centre of pressure [m]; 0 where a foot is in the air."""
        return self.support.onto_vectors(self.cops)

    def moment(self) -> Tensor:
        """(P, 3, M) of the ground force about the centre of mass [m^2/s^2]."""
        support = self.support
        parts = []
        for k, (force, cop) in enumerate(zip(self.forces, self.cops, strict=True)):
            places = support.pieces[k]
            seen = places.seen(self.com)
            arm = cop - (seen * places.flip if places.mirrored else seen)
            turning = cross(arm, force, dim=1)
            here = (turning * places.axial if places.mirrored else turning) @ places.both
            parts.append(here)
        return parts[0] if len(parts) == 1 else torch.stack(parts).sum(0)


@dataclass(frozen=True, eq=False)
class _Rolling:
    """What a contact's foot does that its end does not change, (P, K) each: pitch at a take-off of 0 and its rate; what
    a radian of the take-off's pitch adds; how the aim sways [m]."""

    down: Tensor
    down_rate: Tensor
    climb: Tensor
    climb_rate: Tensor
    sway: Tensor


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
        self.pieces: list[Places] = []
        count = len(plan.contacts)
        shares = speed.new_full((speed.shape[0], count), 1.0 / count) if shares is None else shares
        middles = []
        for k, contact in enumerate(plan.contacts):
            durations = torch.stack([grid.durations[:, k % plan.count] for k in contact.phases], dim=-1)
            own = Grid(tuple(plan.nodes[k % plan.count] for k in contact.phases), durations)
            phase = own.times / own.total.unsqueeze(-1)
            lift = vertical_force(phase, shares[:, k] * GRAVITY * period, own.total, shape)
            side = 1.0 if contact.limb == "left" else -1.0
            middles.append(grid.durations[:, : contact.phases[0]].sum(-1) + 0.5 * own.total)
            self.footings.append(Footing(contact, own, phase, lift, side, speed * (middles[k] - middles[0])))
            self.pieces.append(places_of(plan, contact.limb, contact.phases, speed.dtype, speed.device))
        self.lift = self.onto([footing.lift for footing in self.footings]).sum(1)
        rate = grid.integral(self.lift - GRAVITY)
        rise = grid.integral(rate)
        start = -rise[:, -1:] / period.unsqueeze(-1)
        self.rise = start * grid.times + rise  # height above that at the start of the period
        self.half_width = 0.5 * genes["step_width"]
        self.above = 1.0 - genes["aim_below"].unsqueeze(-1)
        self.gone = [places.steps * self.way.unsqueeze(-1) if places.mirrored else None for places in self.pieces]
        self.rolling = [self._rolling(footing) for footing in self.footings]
        self._aside = self._unit_aside()

    def _rolling(self, footing: Footing) -> _Rolling:
        genes, phase = self.genes, footing.phase
        fall, climb = pitch_shapes(phase, genes["foot_settle"], genes["foot_slap"], genes["foot_rise"])
        down = genes["foot_touchdown"].unsqueeze(-1) * fall
        sway = genes["aim_sway"].unsqueeze(-1) * torch.sin(2.0 * math.pi * phase)
        return _Rolling(down, footing.grid.derivative(down), climb, footing.grid.derivative(climb), sway)

    def onto(self, values: list[Tensor]) -> Tensor:
        """Values a contact (P, K) on the nodes of the period (P, 2, M), by side; 0 where a foot is in the air."""
        parts = [value @ places.onto for value, places in zip(values, self.pieces, strict=True)]
        whole = parts[0] if len(parts) == 1 else torch.stack(parts).sum(0)
        found: Tensor = whole.unflatten(-1, (2, -1))
        return found

    def onto_vectors(self, values: list[Tensor]) -> Tensor:
        """Vectors a contact (P, 3, K), as their limb sees them, on the period's nodes (P, 2, 3, M), by side."""
        flipped = [v * p.flip if p.mirrored else v for v, p in zip(values, self.pieces, strict=True)]
        return self.onto(flipped).transpose(1, 2)

    def seen(self, values: Tensor, which: int) -> Tensor:
        """Values (P, M) of the period at the nodes of a contact (P, K)."""
        return self.pieces[which].seen(values)

    def carry(self, forward: Tensor, height: Tensor, takeoff: Tensor) -> Carried:
        """The forces for a way ahead (P, M) and a height at the start (P,) of the centre of mass [m].

        takeoff: (P, C) pitch of the foot at each contact's end [rad].
        """
        grid = self.grid
        y = height.unsqueeze(-1) + self.rise
        side_forces, x = self._sideways(y)
        stands, pitches = [], []
        for k, (footing, rolling) in enumerate(zip(self.footings, self.rolling, strict=True)):
            end = takeoff[:, k : k + 1]
            pitch = rolling.down + end * rolling.climb
            standing = sole(self.layout, pitch)
            rolled = -footing.grid.integral(standing.height * (rolling.down_rate + end * rolling.climb_rate))
            gone = self.gone[k]
            if k > 0:
                rolled = rolled + footing.base.unsqueeze(-1)
            stands.append((standing, rolled if gone is None else rolled - gone))
            pitches.append(pitch)
        # The push ahead is lift / height times how far the force aims from the contact point: an affine function of
        # where the first foot stands and of what is aimed aside, which have to leave nothing over the period.
        pushes, aheads, heights = [], [], []
        for k, (footing, (standing, rolled)) in enumerate(zip(self.footings, stands, strict=True)):
            up = self.seen(y, k)
            pull = footing.lift / up
            ahead = self.seen(forward, k) - rolled - standing.ahead
            own = [-pull if not self.plan.alternate or j == k else torch.zeros_like(pull) for j in range(self.asides)]
            aimed = pull * (self.above * ahead - self.rolling[k].sway)
            pushes.append(torch.stack((aimed, -pull * self.above, *own), dim=1))
            aheads.append(ahead)
            heights.append(up)
        place, answer = self._balanced(pushes, aheads, heights, side_forces, x)
        cops, ankles, forces, horizontal = [], [], [], []
        for footing, (standing, rolled), push, aside in zip(self.footings, stands, pushes, side_forces, strict=True):
            ankle = place.unsqueeze(-1) + rolled
            left = (footing.side * self.half_width).unsqueeze(-1).expand_as(ankle)
            ahead = (push * answer.unsqueeze(-1)).sum(1)
            cops.append(torch.stack((left, torch.zeros_like(ankle), ankle + standing.ahead), dim=1))
            ankles.append(torch.stack((left, standing.height, ankle), dim=1))
            forces.append(torch.stack((aside, footing.lift, ahead), dim=1))
            horizontal.append(ahead)
        pushed = [value @ places.both for value, places in zip(horizontal, self.pieces, strict=True)]
        gained = grid.integral(grid.integral(pushed[0] if len(pushed) == 1 else torch.stack(pushed).sum(0)))
        start = self.speed.unsqueeze(-1) - gained[:, -1:] / grid.total.unsqueeze(-1)
        new_forward = start * grid.times + gained
        com = torch.stack((x, y, new_forward), dim=1)
        return Carried(self, com, forces, cops, ankles, pitches, new_forward)

    @property
    def asides(self) -> int:
        """Numbers that say how far the push aims aside: one for all contacts, or one each."""
        return len(self.footings) if self.plan.alternate else 1

    def _balanced(
        self,
        pushes: list[Tensor],
        aheads: list[Tensor],
        heights: list[Tensor],
        side_forces: list[Tensor],
        x: Tensor,
    ) -> tuple[Tensor, Tensor]:
        """Where the first foot stands (P,) [m], and the weights (P, 2 + A) of pushes (P, 2 + A, K) with 1 in front.

        Over the period neither speed nor pitch is gained; of legs that stand one after the other nor is yaw.
        """
        conditions: list[Tensor] = []
        for k, (footing, push, ahead, up) in enumerate(zip(self.footings, pushes, aheads, heights, strict=True)):
            weights = footing.grid.weights
            pressed = footing.lift * weights
            across, turned = [-up * weights], [pressed]
            if self.plan.alternate:
                across.append((self.seen(x, k) - (footing.side * self.half_width).unsqueeze(-1)) * weights)
                turned.append(-side_forces[k] * weights)
            found = push @ torch.stack((weights, *across), dim=-1)
            # Centre of mass ahead of the contact point, and what a foot that stands further ahead takes from it.
            lever = torch.stack((ahead, -torch.ones_like(ahead)), dim=1) @ torch.stack(turned, dim=-1)
            conditions.append(
                torch.cat((found[:, :, :1], found[:, :, 1:] + functional.pad(lever, (0, 0, 0, self.asides))), -1)
            )
        total = conditions[0] if len(conditions) == 1 else torch.stack(conditions).sum(0)
        found = solve_small(total[:, 1:].transpose(1, 2), -total[:, 0])
        return found[:, 0], torch.cat((torch.ones_like(found[:, :1]), found), dim=-1)

    def _unit_aside(self) -> tuple[list[Tensor], Tensor]:
        """Sideways forces a contact (P, K), all alike in the first one's lift, and the way (P, M) that they make."""
        grid = self.grid
        if not (self.plan.mirrored or self.plan.alternate):
            # Equal feet that stand together push against each other: nothing is left.
            return [torch.zeros_like(footing.lift) for footing in self.footings], torch.zeros_like(grid.times)
        impulses = [one.grid.total_of(one.lift) for one in self.footings]
        units = [
            -one.side * (impulses[0] / own).unsqueeze(-1) * one.lift
            for one, own in zip(self.footings, impulses, strict=True)
        ]
        unit = self._left(self.onto(units))
        rate = grid.integral(unit)
        gone = grid.integral(rate)
        if self.plan.mirrored:
            start = -0.5 * rate[:, -1:]
            return units, -0.5 * (start * grid.total.unsqueeze(-1) + gone[:, -1:]) + start * grid.times + gone
        x = gone - gone[:, -1:] * grid.times / grid.total.unsqueeze(-1)
        return units, x - grid.mean_of(x).unsqueeze(-1)

    def _sideways(self, y: Tensor) -> tuple[list[Tensor], Tensor]:
        """Sideways force a contact (P, K) as its limb sees it [m/s^2], and place (P, M) of the centre of mass [m]."""
        units, x = self._aside
        if not (self.plan.mirrored or self.plan.alternate):
            return units, x
        places = self.pieces[0]
        node, sign = places.middle
        high = y[:, node]
        if self.plan.mirrored:
            share = (self.half_width / (high + sign * x[:, node])).unsqueeze(-1)
            return [share * units[0]], share * x
        # The force of the first contact points at the centre of mass half-way, and nothing is gained in roll.
        grid = self.grid
        unit = self._left(self.onto(units))
        impulses = [one.grid.total_of(one.lift) for one in self.footings]
        apart = self.half_width * (impulses[0] - impulses[1])
        rolling = torch.stack((grid.total_of(y * unit - x * self.lift), -grid.total_of(self.lift)), dim=-1)
        aiming = torch.stack((high + x[:, node], torch.ones_like(high)), dim=-1)
        answer = solve_small(torch.stack((aiming, rolling), dim=1), torch.stack((self.half_width, -apart), dim=-1))
        share = answer[:, :1]
        return [share * own for own in units], share * x + answer[:, 1:]

    def _left(self, forces: Tensor) -> Tensor:
        """Forces (P, 2, M), as their limbs see them, to the left in the world (P, M)."""
        if not self.plan.mirrored:
            return forces.sum(1)
        return forces[:, 0] - forces[:, 1]
