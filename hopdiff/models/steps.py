"""The steps of a stride as one batch.

A symmetric run needs one step only, a left one: the other is its mirror image. A limp needs both; the batch is then
twice as long, the left steps of all candidates first, and each step is described as if its left leg carried.
S is the number of steps (1 or 2), B = S P the length of the batch.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor

from hopdiff.character import Character
from hopdiff.models.base import hopper_cycle, with_duty_factor
from hopdiff.models.limp import LimpSettings, leg_genes, limping_cycles
from hopdiff.physics.hopper import Cycle


@dataclass(frozen=True)
class Steps:
    """count: S. genes: name -> (B,), of the leg that carries. cycle: its hops (B,). speed: mean of the stride (B,)."""

    count: int
    genes: dict[str, Tensor]
    cycle: Cycle
    speed: Tensor

    @classmethod
    def of(
        cls, character: Character, genes: dict[str, Tensor], speed: Tensor, limp: LimpSettings | None, swell: bool
    ) -> Steps:
        """genes: name -> (P,) in SI units and rad. speed: (P,) [m/s]. swell: see `limping_cycles`."""
        if limp is None:
            return cls(1, genes, hopper_cycle(character, genes, speed), speed)
        genes = with_duty_factor(character, genes, speed)
        cycle = limping_cycles(character, genes, speed, limp, swell)
        return cls(2, leg_genes(genes, limp.leg), cycle, speed.repeat(2))

    @property
    def ways(self) -> Tensor:
        """How far HIP travels in a step (B,) [m]."""
        return 2.0 * self.cycle.reach + self.cycle.speed * self.cycle.flight_time

    def other(self, values: Any) -> Any:
        """Values (B, ...) of the step before and after, which the other leg carries; tuples are gone through."""
        if self.count == 1:
            return values
        if isinstance(values, Tensor):
            return torch.cat(values.chunk(2)[::-1])
        swapped = [self.other(value) for value in values]
        return type(values)(*swapped) if hasattr(values, "_fields") else tuple(swapped)

    def starts(self) -> Tensor:
        """When each step starts, from left touchdown (B,) [s]."""
        times = self.cycle.step_time
        if self.count == 1:
            return torch.zeros_like(times)
        first = times.chunk(2)[0]
        return torch.cat((torch.zeros_like(first), first))

    def phase(self, time: Tensor) -> Tensor:
        """Phase of the stride (B, M) [rad] at times (B, M) since the step's touchdown: 0 there, pi at the next.

        Smooth over the whole stride also where its steps differ, and the same for both legs: time is bent by a sine
        about the middle of each step.
        """
        if self.count == 1:
            return math.pi * time / self.cycle.step_time.unsqueeze(-1)
        first, second = self.cycle.step_time.unsqueeze(-1).chunk(2)
        omega = 2.0 * math.pi / (first + second)
        middle = 0.5 * omega * first
        bend = (0.5 * math.pi - middle) / torch.sin(middle)
        late = torch.cat((torch.zeros_like(first), torch.full_like(second, math.pi)))
        omega, middle, bend = (x.repeat(2, 1) for x in (omega, middle, bend))
        turned = omega * (time + self.starts().unsqueeze(-1))
        return turned + bend * (torch.sin(turned - middle) + torch.sin(middle)) - late

    def mid_stance_phase(self) -> Tensor:
        """Phase of the stride at mid-stance (B, 1), the mean of both legs [rad]."""
        middle = self.phase(0.5 * self.cycle.contact_time.unsqueeze(-1))
        found: Tensor = 0.5 * (middle + self.other(middle))
        return found
