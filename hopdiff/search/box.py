"""The unit box [0, 1]^G, and every draw of random numbers from it."""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor

from hopdiff.search.base import Problem


class Box(NamedTuple):
    """Where genes live. Draws are made in float64 on the generator's device, so that one seed gives the same
    points in every dtype and on every device."""

    dimension: int
    dtype: torch.dtype
    device: torch.device
    start: Tensor | None = None
    spread: float | None = None

    @classmethod
    def of(cls, problem: Problem) -> Box:
        start, spread = getattr(problem, "start", None), getattr(problem, "spread", None)
        return cls(problem.dimension, problem.dtype, problem.device, start, spread)

    def first(self, rows: int, generator: torch.Generator) -> Tensor:
        """(rows, G) points that a search begins with: uniform, or normal about the start of a problem that says so."""
        if self.start is None or self.spread is None:
            return self.uniform(rows, generator)
        return (self.start + self.spread * self.normal(rows, generator)).clamp(0.0, 1.0)

    def uniform(self, rows: int, generator: torch.Generator) -> Tensor:
        """(rows, G) points, each gene uniform in [0, 1)."""
        draw = torch.rand(rows, self.dimension, generator=generator, device=generator.device, dtype=torch.float64)
        return draw.to(self.device, self.dtype).clamp(0.0, 1.0)

    def normal(self, rows: int, generator: torch.Generator) -> Tensor:
        """(rows, G) standard normal numbers."""
        draw = torch.randn(rows, self.dimension, generator=generator, device=generator.device, dtype=torch.float64)
        return draw.to(self.device, self.dtype)


def best_first(cost: Tensor, merit: Tensor) -> Tensor:
    """(P,) row numbers: valid rows by cost, then invalid ones by merit, then those that have neither."""
    by_merit = torch.argsort(merit, stable=True)
    return by_merit[torch.argsort(cost[by_merit], stable=True)]
