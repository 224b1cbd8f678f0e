"""What every motion model offers."""

from __future__ import annotations

from typing import Protocol

import torch
from torch import Tensor

from hopdiff.character import Character
from hopdiff.models.gait import Gait
from hopdiff.models.trajectory import Trajectory
from hopdiff.physics.hopper import Cycle, solve_cycle


class Model(Protocol):
    """Genes (name -> (P,) in SI units and rad) and speed (P,) [m/s] to motion."""

    @property
    def character(self) -> Character: ...

    @property
    def sound(self) -> Model:
        """The same model on two equal legs."""
        ...

    def trajectory(self, genes: dict[str, Tensor], speed: Tensor) -> Trajectory:
        """One step of every candidate (of a limp: both), for the costs."""
        ...

    def gait(self, genes: dict[str, Tensor], speed: Tensor) -> Gait:
        """The endless runs of all candidates, to be sampled in time."""
        ...


def hopper_cycle(character: Character, genes: dict[str, Tensor], speed: Tensor) -> Cycle:
    """The periodic hop of the genes: contact time from leg, angle and speed, flight time from the duty factor."""
    length, angle = genes["leg_extension"] * character.leg_length, genes["touchdown_angle"]
    contact = 2.0 * length * torch.sin(angle) / speed
    return solve_cycle(length, angle, speed, flight_time=contact * (0.5 / genes["duty_factor"] - 1.0))
