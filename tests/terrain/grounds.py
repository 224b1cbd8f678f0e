"""Grounds of every kind, and what is asked of each."""

from __future__ import annotations

import math

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from hopdiff.terrain.ground import Flat, Ground
from hopdiff.terrain.height_map import HeightMap
from hopdiff.terrain.patches import Patch, Patches, plane_through
from hopdiff.terrain.profile import slope, stairs

AHEAD, BEHIND = 0.15, 0.1  # m; of a sole


def box(left: float, low: float, right: float, high: float) -> NDArray[np.float64]:
    return np.array([[left, low], [right, low], [right, high], [left, high]])


def bumps() -> HeightMap:
    x, z = torch.meshgrid(torch.arange(80.0).double(), torch.arange(60.0).double(), indexing="xy")
    return HeightMap(0.05 * torch.sin(0.2 * x) * torch.cos(0.3 * z), 0.1, (-3.0, -2.0))


def ramp() -> Patches:
    """A platform of 30 cm, a ramp up to it, a kerb of 10 cm on the platform, and a pit of 20 cm."""
    corners = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.3, 2.0]]
    flat = [Patch(box(0, 2, 2, 4), (0.3, 0.0, 0.0)), Patch(box(1, 3, 2, 4), (0.4, 0.0, 0.0))]
    return Patches([Patch(box(0, 0, 2, 2), plane_through(corners)), *flat, Patch(box(-2, 0, -1, 1), (-0.2, 0.0, 0.0))])


def every_kind() -> dict[str, Ground]:
    return {
        "flat": Flat(),
        "slope": slope(math.radians(10.0), 0.3, (0.2, -0.5), 1.5),
        "stairs": stairs(0.17, 0.29, -0.4, (0.1, -1.0), 8),
        "map": bumps(),
        "polygons": ramp(),
    }


def scattered(count: int, seed: int = 0) -> tuple[Tensor, Tensor]:
    """Places (N, 2) within 4 m, and headings (N,)."""
    generator = torch.Generator().manual_seed(seed)
    place = 8.0 * torch.rand(count, 2, generator=generator, dtype=torch.float64) - 4.0
    return place, 7.0 * torch.rand(count, generator=generator, dtype=torch.float64)


def sole(place: Tensor, heading: Tensor) -> Tensor:
    """(N, K, 2) places from heel to toes."""
    along = torch.stack((torch.sin(heading), torch.cos(heading)), dim=-1)
    reach = torch.linspace(-BEHIND, AHEAD, 26, dtype=torch.float64)
    return place[:, None] + reach[:, None] * along[:, None]
