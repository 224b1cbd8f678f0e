# No `from __future__ import annotations`: Hydra reads the types of the settings classes.
"""Limping: the two legs run on different genes, and the body hurries over the lame one.

Kang (1999), section 3.3.2 and figure 3.13: a lame leg is shown by a higher speed while it carries, so that it
carries for a shorter time.
"""

import math
from dataclasses import dataclass

import torch
from torch import Tensor

from hopdiff.character import Character
from hopdiff.genes import LAME
from hopdiff.numerics import GRAVITY, safe_sqrt
from hopdiff.physics.hopper import Cycle, solve_cycle
from hopdiff.types import HopdiffError

MOST = 0.8  # largest amount; beyond it the lame leg hardly touches the ground


@dataclass
class LimpSettings:
    """leg: the lame one, "left" or "right". amount: how much shorter it carries, as a share of the sound leg's
    contact time; 0 is no limp. haste: share of that shortening (of its logarithm) that comes from running faster
    over the lame leg, the rest comes from a shorter way over it.
    """

    leg: str
    amount: float
    haste: float

    def check(self) -> None:
        """Raises HopdiffError, naming the setting, for a leg or a number that cannot be."""
        if self.leg not in ("left", "right"):
            raise HopdiffError(f"limp.leg must be left or right, not {self.leg!r}.")
        if not 0.0 <= self.amount <= MOST:
            raise HopdiffError(f"limp.amount must lie between 0 and {MOST:g}, not {self.amount:g}.")
        if not (math.isfinite(self.haste) and 0.0 <= self.haste <= 1.0):
            raise HopdiffError(f"limp.haste must lie between 0 and 1, not {self.haste:g}.")


def leg_genes(genes: dict[str, Tensor], leg: str) -> dict[str, Tensor]:
    """Genes (2 P,) of both legs, those of the left leg first; the lame `leg` takes its own where it has them."""
    both = {}
    for name, value in genes.items():
        if name.startswith(LAME):
            continue
        own = genes.get(LAME + name, value)
        both[name] = torch.cat((own, value) if leg == "left" else (value, own))
    return both


def limping_cycles(
    character: Character, genes: dict[str, Tensor], speed: Tensor, limp: LimpSettings, swell: bool
) -> Cycle:
    """The hops of both legs (2 P,), left first, that hand over to each other for ever.

    genes: name -> (P,). speed: mean speed of the stride (P,) [m/s]. swell: whether the speed rises smoothly over the
    lame leg, from and back to that of flight, or jumps at touchdown and take-off as in the thesis.

    Both stances are symmetric in time, and what lies between them is flight, so both legs see the same apex: the
    height at touchdown h and the vertical speed there r satisfy r^2 / 2 + g h = const, and both flights last
    T = (r_sound + r_lame) / g. The gene lame_ease is (r_sound - r_lame) / (r_sound + r_lame): how much softer the lame
    leg comes down. It fixes the height over the lame leg, and with it its length.
    """
    length, angle = genes["leg_extension"] * character.leg_length, genes["touchdown_angle"]
    reach, height = length * torch.sin(angle), length * torch.cos(angle)
    shorter = 1.0 - limp.amount
    quicker = shorter**-limp.haste
    lame_reach = reach * shorter * quicker
    # Times are sought for a cruising speed of 1 first: all of them are distances over speed.
    flight_way = 2.0 * reach * (0.5 / genes["duty_factor"] - 1.0)
    way = 2.0 * (reach + lame_reach + flight_way)
    cruise = speed * (way - 2.0 * lame_reach * (1.0 - 1.0 / quicker)) / way
    flight_time = flight_way / cruise
    ease = genes["lame_ease"]
    lame_height = height + 0.5 * GRAVITY * ease * flight_time**2
    lame_length = safe_sqrt(lame_reach**2 + lame_height**2)
    surge = torch.full_like(speed, quicker - 1.0)
    # A hop that comes down at r would by itself fly for 2 r / g.
    sound = (length, angle, flight_time * (1.0 + ease), torch.zeros_like(surge))
    lame = (lame_length, torch.atan2(lame_reach, lame_height), flight_time * (1.0 - ease), surge)
    left, right = (lame, sound) if limp.leg == "left" else (sound, lame)
    length, angle, own_flight, surge = (torch.cat(pair) for pair in zip(left, right, strict=True))
    cruise = cruise.repeat(2)
    if swell:
        cycle = solve_cycle(length, angle, cruise, flight_time=own_flight, surge=surge)
    else:
        cycle = solve_cycle(length, angle, cruise * (1.0 + surge), flight_time=own_flight)
    return cycle._replace(flight_time=flight_time.repeat(2), speed=cruise)
