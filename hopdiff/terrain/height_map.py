"""Ground given by heights on a grid."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import torch
from scipy.ndimage import maximum_filter
from torch import Tensor

from hopdiff.terrain.ground import Ground, normal_of, points_of


@dataclass(frozen=True, eq=False)
class HeightMap(Ground):
    """Heights (Z, X) [m] at the nodes of a grid, bilinear between them; beyond its border those of the border.

    grid[j, i] is the height at x = origin[0] + i cell, z = origin[1] + j cell. cell: [m].
    """

    grid: Tensor
    cell: float
    origin: tuple[float, float]
    _wider: dict[float, Tensor] = field(default_factory=dict, repr=False)

    def height(self, place: Tensor) -> Tensor:
        return self._read(self.grid, place)

    def normal(self, place: Tensor) -> Tensor:
        column, row, x, z, inside = self._within(place)
        a, b, c, d = self._corners(self.grid, column, row)
        along_x = ((b - a) * (1.0 - z) + (d - c) * z) / self.cell
        along_z = ((c - a) * (1.0 - x) + (d - b) * x) / self.cell
        return normal_of(torch.stack((along_x, along_z), dim=-1) * inside)

    def height_over(self, place: Tensor, reach: float) -> Tensor:
        """As of every ground; over a square about the place, so that it may lie above the highest within reach."""
        if reach not in self._wider:
            # What is read there mixes nodes up to a cell away, and so does every place within reach.
            nodes = math.ceil(reach / self.cell) + 1
            wide = maximum_filter(self.grid.numpy(), size=2 * nodes + 1, mode="nearest")
            self._wider[reach] = torch.as_tensor(wide)
        return self._read(self._wider[reach], place)

    def _read(self, grid: Tensor, place: Tensor) -> Tensor:
        column, row, x, z, _ = self._within(place)
        a, b, c, d = self._corners(grid, column, row)
        return (a * (1.0 - x) + b * x) * (1.0 - z) + (c * (1.0 - x) + d * x) * z

    def _within(self, place: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor, Tensor]:
        """Column and row of the cell of places, where they lie in it, and whether within the border (..., 2)."""
        here = points_of(place)
        last = here.new_tensor([self.grid.shape[1] - 1, self.grid.shape[0] - 1])
        free = (here - here.new_tensor(self.origin)) / self.cell
        at = free.clamp(torch.zeros_like(last), last)
        cell = torch.minimum(at.floor(), last - 1.0).clamp_min(0.0)
        column, row = cell.long().unbind(-1)
        x, z = (at - cell).unbind(-1)
        return column, row, x, z, (free == at).double()

    def _corners(self, grid: Tensor, column: Tensor, row: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        below, above = row, (row + 1).clamp_max(grid.shape[0] - 1)
        left, right = column, (column + 1).clamp_max(grid.shape[1] - 1)
        return grid[below, left], grid[below, right], grid[above, left], grid[above, right]
