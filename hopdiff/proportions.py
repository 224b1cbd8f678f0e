# No `from __future__ import annotations`: Hydra reads the types of the settings classes.
"""Changing a body: longer legs, shorter arms, and what follows from that."""

from dataclasses import dataclass
from typing import Any

from torch import Tensor

from hopdiff.types import HopdiffError


@dataclass
class ProportionSettings:
    """Factors of lengths: legs (thigh and shank), arms (upper arm and forearm), trunk (hips to neck), head.

    A part's mass goes with its length; the mass of the whole body stays what it is.
    """

    legs: float
    arms: float
    trunk: float
    head: float


_PARTS = {
    "pelvis": "trunk",
    "waist": "trunk",
    "neck": "head",
    "shoulder": "arms",
    "elbow": "arms",
    "hip": "legs",
    "knee": "legs",
}
PROPORTIONS = (0.5, 2.0)  # range of the factors


def factors_of(proportions: Any, order: list[str]) -> list[float]:
    """The factor of the body part that moves with each joint. Raises HopdiffError, naming the part."""
    low, high = PROPORTIONS
    factors = []
    for name in order:
        part = _PARTS[name.removeprefix("left_").removeprefix("right_")]
        factor = float(getattr(proportions, part))
        if not low <= factor <= high:
            raise HopdiffError(f"character.proportions.{part} must lie between {low:g} and {high:g}, not {factor:g}.")
        factors.append(factor)
    return factors


def grow(
    offsets: Tensor, ends: dict[str, Tensor], order: list[str], parents: tuple[int, ...], sizes: Tensor
) -> tuple[Tensor, dict[str, Tensor]]:
    """Joint offsets (J, 3) and end points of parts that are longer or shorter by factors (J,); widths stay."""
    grown = offsets.clone()
    for joint, parent in enumerate(parents):
        if parent >= 0:
            grown[joint, 1:] *= sizes[parent]
    longer = {name: end * sizes[order.index(name)] for name, end in ends.items()}
    # The sole stays on the ground.
    knee = order.index("left_knee")
    legs = offsets[knee].norm() + ends["left_knee"].norm()
    grown[0, 1] += grown[knee].norm() + longer["left_knee"].norm() - legs
    return grown, longer
