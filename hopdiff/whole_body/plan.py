"""Which limb is on the ground when: the topology of a movement, apart from how long its phases last.

A period is cut into phases at every touchdown and take-off. In a mirrored plan the period is one step, the next step
is its mirror image, and one leg is worked out over both: its phases are counted on, those of the step first, then those
of the mirror image. A contact may last into the mirror image, as in walking. Otherwise the period is the whole stride.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import torch
from torch import Tensor

STANCE, FLIGHT = 33, 19  # Chebyshev nodes, odd: the middle of a contact is one of them
FINER = 2  # nodes for integrals of what is not smooth, for one of these


@dataclass(frozen=True)
class Contact:
    """limb: "left" or "right". phases: those it lasts, in order, counted on through the mirror image."""

    limb: str
    phases: tuple[int, ...]


@dataclass(frozen=True)
class Plan:
    """nodes: Chebyshev nodes of each phase of the period. contacts: one a limb that is worked out."""

    name: str
    nodes: tuple[int, ...]
    contacts: tuple[Contact, ...]
    mirrored: bool

    @cached_property
    def finer(self) -> Plan:
        """The same on the nodes of `Grid.fine`."""
        return replace(self, nodes=tuple(FINER * n for n in self.nodes))

    @property
    def count(self) -> int:
        """Phases of the period."""
        return len(self.nodes)

    @property
    def standing(self) -> set[int]:
        """The phases of the period in which something stands."""
        return {phase % self.count for contact in self.contacts for phase in contact.phases}

    @property
    def alternate(self) -> bool:
        """Whether both legs are worked out and stand one after the other."""
        return len(self.contacts) > 1 and self.contacts[0].phases != self.contacts[1].phases

    @property
    def unrolled(self) -> tuple[int, ...]:
        """Nodes of all phases of a stride."""
        return self.nodes * (2 if self.mirrored else 1)

    def swing(self, contact: Contact) -> tuple[int, ...]:
        """The phases in which a limb is in the air, in order from its take-off."""
        every = len(self.unrolled)
        first = contact.phases[-1] + 1
        return tuple((first + k) % every for k in range(every - len(contact.phases)))

    def durations(self, genes: dict[str, Tensor]) -> Tensor:
        """(P, B) of the phases of equal steps [s], from the genes step_time [s] and contact_share of it (P,)."""
        step, contact = genes["step_time"], genes["step_time"] * genes["contact_share"]
        if self.name == "walk":
            return torch.stack((contact - step, 2.0 * step - contact), dim=-1)
        return torch.stack((contact, step - contact), dim=-1)


RUN = Plan("run", (STANCE, FLIGHT), (Contact("left", (0,)),), mirrored=True)
WALK = Plan("walk", (FLIGHT, STANCE), (Contact("left", (0, 1, 2)),), mirrored=True)
HOP = Plan("hop", (STANCE, FLIGHT), (Contact("left", (0,)), Contact("right", (0,))), mirrored=False)
LIMP = Plan("limp", (STANCE, FLIGHT, STANCE, FLIGHT), (Contact("left", (0,)), Contact("right", (2,))), mirrored=False)
PLANS = {plan.name: plan for plan in (RUN, WALK, HOP, LIMP)}
