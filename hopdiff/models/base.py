"""What every motion model offers."""

from __future__ import annotations

from typing import Protocol

import torch
from torch import Tensor

from hopdiff.character import Character
from hopdiff.models.gait import Gait
from hopdiff.models.trajectory import Trajectory
from hopdiff.physics.hopper import Cycle, solve_cycle

STIFFNESS = "stiffness"  # the gene that tells the table of the thesis from ours, which has a duty factor


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
    """The periodic hop of the genes: contact time from leg, angle and speed, the rest from stiffness or duty factor.

    The thesis has the stiffness among its genes (kappa); with the duty factor in its place the hop is solved for a
    flight time. Either way the vertical speed at touchdown, which the thesis leaves open, is that of the hop which
    repeats itself.
    """
    length, angle = genes["leg_extension"] * character.leg_length, genes["touchdown_angle"]
    if STIFFNESS in genes:
        return solve_cycle(length, angle, speed, stiffness=genes[STIFFNESS])
    contact = 2.0 * length * torch.sin(angle) / speed
    return solve_cycle(length, angle, speed, flight_time=contact * (0.5 / genes["duty_factor"] - 1.0))


def with_duty_factor(character: Character, genes: dict[str, Tensor], speed: Tensor) -> dict[str, Tensor]:
    """Genes with the duty factor that the stiffness stands for; as they are, if they hold none.

    Where no hop repeats itself the duty factor is above 1/2, which has no flight.
    """
    if STIFFNESS not in genes:
        return genes
    cycle = hopper_cycle(character, genes, speed)
    duty = torch.where(cycle.converged, 0.5 * cycle.contact_time / cycle.step_time, 0.6)
    return {name: value for name, value in genes.items() if name != STIFFNESS} | {"duty_factor": duty}
