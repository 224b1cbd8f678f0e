"""What every motion model offers."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import torch
from torch import Tensor

from hopdiff.character import Character
from hopdiff.models.gait import Gait
from hopdiff.models.trajectory import Trajectory
from hopdiff.physics.hopper import Cycle, solve_cycle


@dataclass
class ModelSettings:
    """name: "body", "smooth" or "thesis". rounds, adjoint_rounds: of the whole-body model's solution and of its
    gradient. nodes, sweeps: of the smooth model. step, strides: of the thesis model.

    nodes: Chebyshev nodes per phase. sweeps: corrections of the balance with the true body.
    step: frame interval h of the stepping equations [s]. strides: how many are run before the one that is kept.
    """

    name: str = "body"
    rounds: int = 11
    adjoint_rounds: int = 8
    nodes: int = 28
    sweeps: int = 2
    step: float = 0.005
    strides: int = 8


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
