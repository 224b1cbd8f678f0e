"""CMA-ES with restarts (IPOP), by the library `cmaes`."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import torch
from cmaes import CMA
from torch import Tensor

from hopdiff.search.base import Eval, Problem
from hopdiff.search.box import Box, best_first
from hopdiff.search.settings import require


class Run(NamedTuple):
    """One run between two restarts. The library's optimiser keeps its own progress, so a Run is good for one tell.

    best: lowest cost of this run. idle: generations since it last fell by more than the tolerance.
    """

    box: Box
    optimizer: CMA
    best: float
    idle: int


@dataclass(frozen=True)
class CMAES:
    """Covariance matrix adaptation. The first run starts in the middle of the box, later ones at random points.

    population: candidates a generation, 0 for the library's own choice. sigma: first step, in box widths.
    growth: factor of the population at a restart. patience: generations without progress before a restart.
    tolerance: the fall of the best cost, relative to its size, that counts as progress.
    """

    name: str = "cmaes"
    population: int = 0
    sigma: float = 0.2
    growth: float = 2.0
    patience: int = 100
    tolerance: float = 1e-3

    def __post_init__(self) -> None:
        if self.population:
            require("population", self.population, 2)
        require("sigma", self.sigma, 1e-6, 1)
        require("growth", self.growth, 1)
        require("patience", self.patience, 1)
        require("tolerance", self.tolerance, 0)

    def init(self, problem: Problem, generator: torch.Generator) -> Run:
        box = Box.of(problem)
        return self._start(box, np.full(box.dimension, 0.5), self.population or None, generator)

    def ask(self, state: Run, generator: torch.Generator) -> tuple[Tensor, bool]:
        points = np.stack([state.optimizer.ask() for _ in range(state.optimizer.population_size)])
        return torch.from_numpy(points).to(state.box.device, state.box.dtype), False

    def tell(self, state: Run, genes: Tensor, result: Eval, generator: torch.Generator) -> Run:
        optimizer = state.optimizer
        values = ranked_values(result.cost, result.merit).tolist()
        optimizer.tell(list(zip(genes.double().cpu().numpy(), values, strict=True)))
        best = float(result.cost.min())
        progress = best < state.best - self.tolerance * abs(best)
        idle = 0 if progress else state.idle + 1
        if idle < self.patience and not optimizer.should_stop():
            return Run(state.box, optimizer, best if progress else state.best, idle)
        mean = state.box.first(1, generator)[0].double().cpu().numpy()
        return self._start(state.box, mean, round(optimizer.population_size * self.growth), generator)

    def _start(self, box: Box, mean: np.ndarray, population: int | None, generator: torch.Generator) -> Run:
        seed = int(torch.randint(2**31 - 1, (1,), generator=generator, device=generator.device))
        bounds = np.tile([0.0, 1.0], (box.dimension, 1))
        # what leaves the box is clipped at once: redrawing hardly ever succeeds when the optimum sits on a bound
        optimizer = CMA(mean, self.sigma, bounds, n_max_resampling=0, seed=seed, population_size=population)
        return Run(box, optimizer, math.inf, 0)


def ranked_values(cost: Tensor, merit: Tensor) -> Tensor:
    """(P,) finite float64 values in the order of `best_first`: costs where they are finite, above them the rest."""
    order = best_first(cost, merit)
    value = cost.double()
    invalid = order[value[order].isinf()]
    worst = value[value.isfinite()].amax() if len(invalid) < len(value) else value.new_zeros(())
    step = 1.0 + worst.abs()
    value = value.clone()
    value[invalid] = worst + step * torch.arange(1, len(invalid) + 1, dtype=value.dtype, device=value.device)
    return value


SEARCH = CMAES
