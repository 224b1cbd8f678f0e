"""The whole-body model: genes to solved movements."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import torch
from torch import Tensor

from hopdiff.character import Character
from hopdiff.numerics import absent
from hopdiff.whole_body.anchor import Anchor, Rounds
from hopdiff.whole_body.gait import BodyGait
from hopdiff.whole_body.layout import Layout
from hopdiff.whole_body.movement import Body, Movement
from hopdiff.whole_body.plan import LIMP, RUN, Plan

FINAL_ROUNDS = 30  # of a movement that is written
BESIDE_ROUNDS = 3  # of one so close to a solved movement that only differences between them matter
UNGUIDED = 3  # more rounds that a movement takes without an anchor


@dataclass(frozen=True)
class BodyModel:
    """character: the body. rounds: of the solution, and of its adjoint. plan: which limb stands when.

    lame, amount: the leg that stands shorter, and by which share of the other's contact time; 0 is no limp.
    """

    character: Character
    rounds: int = 8
    adjoint_rounds: int = 5
    plan: Plan = RUN
    lame: str = "left"
    amount: float = 0.0

    @cached_property
    def layout(self) -> Layout:
        return Layout.of(self.character)

    @classmethod
    def limping(cls, character: Character, rounds: int, adjoint_rounds: int, lame: str, amount: float) -> BodyModel:
        """A run on one lame leg."""
        return cls(character, rounds, adjoint_rounds, LIMP, lame, amount)

    def movement(self, genes: dict[str, Tensor], speed: Tensor) -> Movement:
        """genes: name -> (P,) in SI units and rad. speed: (P,) [m/s]. Nothing is solved yet."""
        if absent(self.amount):
            return Movement(self.layout, self.plan, genes, speed, self.plan.durations(genes))
        step, contact = genes["step_time"], genes["step_time"] * genes["contact_share"]
        # Contacts are as long on the average as without a limp, flights are equal, and feet press equally hard.
        sound = 2.0 * contact / (2.0 - self.amount)
        # The lame leg is worked out as the left one; `gait` exchanges left and right where it is the other.
        left, right, flight = sound * (1.0 - self.amount), sound, step - contact
        share = left / (left + right)
        return Movement(
            self.layout,
            self.plan,
            genes,
            speed,
            torch.stack((left, flight, right, flight), dim=-1),
            torch.stack((share, 1.0 - share), dim=-1),
        )

    def anchor(self, genes: dict[str, Tensor], speed: Tensor, rounds: Rounds | None = None) -> Anchor | None:
        """What guides the solution of movements near that of genes (1,) at a speed (1,) [m/s]; None if it has none.

        rounds: see `Anchor.of`.
        """
        return Anchor.of(lambda near: self.movement(near, speed.expand(len(near["step_time"]))), genes, rounds)

    def solved(
        self,
        genes: dict[str, Tensor],
        speed: Tensor,
        with_grad: bool,
        anchor: Anchor | None = None,
        start: Tensor | None = None,
    ) -> tuple[Movement, Body, Tensor]:
        """Movement, body, and how far the last round of the solution still went (P,).

        start: (P, K) of movements beside solved ones, see `Anchor.beside`; the last rounds of them are enough.
        """
        movement = self.movement(genes, speed)
        rounds, adjoint = self.rounds if start is None else BESIDE_ROUNDS, self.adjoint_rounds
        if anchor is None:
            rounds, adjoint = rounds + UNGUIDED, adjoint + UNGUIDED
        state, moved = movement.solve(rounds, adjoint if with_grad else 0, anchor, start)
        return movement, movement.body(state), moved

    def exact(
        self, genes: dict[str, Tensor], speed: Tensor, anchor: Anchor | None = None
    ) -> tuple[Movement, Body, Tensor]:
        """As `solved`, but to rounding, and without a gradient."""
        with torch.no_grad():
            movement = self.movement(genes, speed)
            state, moved = movement.solve(FINAL_ROUNDS, guide=anchor)
            return movement, movement.body(state), moved

    def gait(self, genes: dict[str, Tensor], speed: Tensor, anchor: Anchor | None = None) -> BodyGait:
        """The endless runs of all candidates, solved to rounding, to be sampled in time."""
        movement, body, _ = self.exact(genes, speed, anchor)
        with torch.no_grad():
            return BodyGait.of(movement, body, self.amount > 0.0 and self.lame == "right")
