"""A solved movement with everything that costs and limits look at."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from hopdiff.numerics import GRAVITY
from hopdiff.whole_body.dynamics import Dynamics
from hopdiff.whole_body.movement import Body, Movement

POWER_WIDTH = 0.0024  # of g sqrt(g l)


@dataclass(frozen=True, eq=False)
class Priced:
    """P candidates on M nodes. moved: (P,) how far the last round of their solution still went.

    Quantities of mechanics are per body mass, as in `hopdiff.whole_body`.
    """

    movement: Movement
    body: Body
    dynamics: Dynamics
    moved: Tensor

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
        return self.movement.layout.character.leg_length

    @property
    def pace(self) -> float:
        """sqrt(l / g) [s]."""
        return float((self.leg / GRAVITY) ** 0.5)

    @property
    def power_width(self) -> float:
        """Power over which positive and negative work pass into each other, a share of g sqrt(g l) [W/kg]."""
        return POWER_WIDTH * GRAVITY * self.leg / self.pace

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
        carried = self.body.carried
        force = carried.force.sum(1)
        velocity = self.movement.grid.derivative(carried.com)
        return self.per_way(softly_positive((force * velocity).sum(1), self.power_width))

    def contact_times(self) -> Tensor:
        """(P, C) of each contact [s]."""
        return torch.stack([footing.grid.total for footing in self.movement.support.footings], dim=-1)


def softly_positive(values: Tensor, width: float) -> Tensor:
    """max(values, 0), rounded over about `width`, and 0 at 0."""
    return 0.5 * (values + torch.sqrt(values**2 + width**2) - width)
