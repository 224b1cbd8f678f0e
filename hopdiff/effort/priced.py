"""A solved movement with everything that costs and limits look at."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, TypeVar

import torch
from torch import Tensor

from hopdiff.numerics import GRAVITY
from hopdiff.whole_body.dynamics import Dynamics
from hopdiff.whole_body.grid import Fine
from hopdiff.whole_body.movement import Body, Movement

POWER_WIDTH = 0.0024  # of g sqrt(g l)

Made = TypeVar("Made")


@dataclass(frozen=True, eq=False)
class Priced:
    """P candidates on M nodes. moved: (P,) how far the last round of their solution still went.

    Quantities of mechanics are per body mass, as in `hopdiff.whole_body`.
    """

    movement: Movement
    body: Body
    dynamics: Dynamics
    moved: Tensor
    known: dict[str, Any] = field(default_factory=dict, init=False)

    @property
    def weights(self) -> Tensor:
        """(P, M) of the integral over the period [s]."""
        return self.movement.grid.weights

    @property
    def shares(self) -> Tensor:
        """(P, M) of the mean over the period."""
        return self.weights / self.movement.grid.total.unsqueeze(-1)

    @property
    def way(self) -> Tensor:
        """(P,) that is gone in a period [m]."""
        return self.movement.speed * self.movement.grid.total

    @property
    def leg(self) -> float:
        """From hip to sole, standing [m]: the length that numbers without units are told in."""
        return self.movement.layout.leg_length

    @property
    def pace(self) -> float:
        """sqrt(l / g) [s]."""
        pace: float = (self.leg / GRAVITY) ** 0.5
        return pace

    def once(self, name: str, make: Callable[[], Made]) -> Made:
        """What `make` gives, made the first time that it is asked for by this name: terms of the cost share it."""
        if name not in self.known:
            self.known[name] = make()
        found: Made = self.known[name]
        return found

    # Work, effort and limits have kinks and narrow turns: smooth curves are carried over to more nodes, and what is
    # made of them is integrated there.

    @property
    def fine(self) -> Fine:
        """More nodes of the period (F)."""
        return self.movement.grid.fine

    @cached_property
    def fine_shares(self) -> Tensor:
        """(P, F) of the mean over the period."""
        return self.fine.weights / self.movement.grid.total.unsqueeze(-1)

    def finer(self, values: Tensor) -> Tensor:
        """Smooth curves (P, ..., M) on the finer nodes (P, ..., F)."""
        return self.movement.grid.finer(values)

    def fine_per_way(self, values: Tensor) -> Tensor:
        """`per_way` of values (P, ..., F)."""
        summed = values.flatten(1, -2).sum(1)
        return (summed * self.fine.weights).sum(-1) / (GRAVITY * self.way)

    @property
    def power_width(self) -> float:
        """Power over which positive and negative work pass into each other, a share of g sqrt(g l) [W/kg]."""
        return POWER_WIDTH * GRAVITY * self.leg / self.pace

    def work_per_way(self, power: Tensor) -> tuple[Tensor, Tensor]:
        """Positive and negative work (P,) of powers (P, C, F) [W/kg], in body weights times the way."""
        positive, negative = self.fine.signed(power, self.power_width)
        weight = GRAVITY * self.way
        return positive.sum(1) / weight, negative.sum(1) / weight

    def per_way(self, values: Tensor) -> Tensor:
        """Integral over time of (P, ..., M), summed over everything else, in body weights times the way (P,)."""
        summed = values.reshape(values.shape[0], -1, values.shape[-1]).sum(1)
        return (summed * self.weights).sum(-1) / (GRAVITY * self.way)

    def mean(self, values: Tensor) -> Tensor:
        """Mean over time of (P, ..., M), summed over everything else (P,)."""
        summed = values.reshape(values.shape[0], -1, values.shape[-1]).sum(1)
        return (summed * self.shares).sum(-1)

    def external_work(self) -> Tensor:
        """(P,) positive work of the ground force on the centre of mass, in body weights times the way."""
        return self.once("external_work", self._external_work)

    def _external_work(self) -> Tensor:
        carried = self.body.carried
        velocity = self.movement.grid.derivative(carried.com)
        force, velocity = self.finer(torch.cat((carried.force.sum(1), velocity), dim=1)).split(3, dim=1)
        return self.work_per_way((force * velocity).sum(1, keepdim=True))[0]

    def contact_times(self) -> Tensor:
        """(P, C) of each contact [s]."""
        return torch.stack([footing.grid.total for footing in self.movement.support.footings], dim=-1)
