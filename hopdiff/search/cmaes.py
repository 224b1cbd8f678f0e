"""CMA-ES with restarts (BIPOP), by the library `cma` (Hansen's pycma)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import cma
import numpy as np
import torch
from torch import Tensor

from hopdiff.search.base import Eval, Problem
from hopdiff.search.box import Box, best_first
from hopdiff.search.settings import require

SMALL_SIGMA = 100.0  # by which a small run's first step is shortened, at most


class Run(NamedTuple):
    """One run between two restarts. The library's optimiser keeps its own progress, so a Run is good for one tell.

    asked: what the optimiser asked for last. best: lowest cost of this run, idle: generations since it last fell by
    more than the tolerance. record: lowest cost of all runs, vain: runs since one lowered it. spent: evaluations of the
    growing and of the small runs; small: which this one is. large: the last growing population.
    """

    box: Box
    optimizer: Any
    asked: list[np.ndarray]
    best: float
    idle: int
    record: float
    vain: int
    spent: tuple[int, int]
    small: bool
    large: int


@dataclass(frozen=True)
class CMAES:
    """Covariance matrix adaptation. The first run starts at the start of the problem, or in the middle of the box where
    it names none, later ones where searches begin. Runs with a growing population take turns with short ones whose
    population is small (Hansen 2009), whichever kind has spent less.

    population: candidates a generation, 0 for the library's own choice. sigma: first step, in box widths; None: the
    spread of a problem that says so, otherwise a fifth. growth: factor of the population at a restart. small: whether
    there are small runs. patience: generations without progress before a restart. tolerance: the fall of the best cost,
    relative to its size, that counts as progress. restarts: runs in a row without progress before the search is over.
    """

    name: str = "cmaes"
    population: int = 0
    sigma: float | None = None
    growth: float = 2.0
    small: bool = True
    patience: int = 100
    tolerance: float = 1e-3
    restarts: int = 9

    def __post_init__(self) -> None:
        if self.population:
            require("population", self.population, 3)
        if self.sigma is not None:
            require("sigma", self.sigma, 1e-6, 1)
        require("growth", self.growth, 1)
        require("patience", self.patience, 1)
        require("tolerance", self.tolerance, 0)
        require("restarts", self.restarts, 0)

    def init(self, problem: Problem, generator: torch.Generator) -> Run:
        box = Box.of(problem)
        mean = np.full(box.dimension, 0.5) if box.start is None else box.start.double().cpu().numpy()
        optimizer = self._optimizer(box, mean, self.population, self._sigma(box), generator)
        return Run(box, optimizer, [], math.inf, 0, math.inf, 0, (0, 0), False, int(optimizer.popsize))

    def ask(self, state: Run, generator: torch.Generator) -> tuple[Tensor, bool]:
        state.asked[:] = state.optimizer.ask()
        points = torch.from_numpy(np.stack(state.asked)).clamp(0.0, 1.0)
        return points.to(state.box.device, state.box.dtype), False

    def tell(self, state: Run, genes: Tensor, result: Eval, generator: torch.Generator) -> Run:
        values = ranked_values(result.cost, result.merit).tolist()
        state.optimizer.tell(state.asked, values)
        best = float(result.cost.min())
        progress = not best >= state.best - self.tolerance * abs(state.best)
        grown, short = state.spent
        count = len(values)
        state = state._replace(
            best=best if progress else state.best,
            idle=0 if progress else state.idle + 1,
            spent=(grown, short + count) if state.small else (grown + count, short),
        )
        if state.idle < self.patience and not state.optimizer.stop():
            return state
        return self._restarted(state, generator)

    def finished(self, state: Run) -> bool:
        return state.vain > self.restarts

    def _restarted(self, state: Run, generator: torch.Generator) -> Run:
        box = state.box
        better = math.isfinite(state.best) and not state.best >= state.record - self.tolerance * abs(state.record)
        draw = torch.rand(2, generator=generator, device=generator.device, dtype=torch.float64).tolist()
        small = self.small and state.spent[1] < state.spent[0]
        usual, large, sigma = self.population or usual_population(box.dimension), state.large, self._sigma(box)
        if small:
            population = int(usual * max(0.5 * large / usual, 1.0) ** (draw[0] ** 2))
            sigma *= SMALL_SIGMA ** -draw[1]
        else:
            population = large = round(large * self.growth)
        mean = box.first(1, generator)[0].double().cpu().numpy()
        return state._replace(
            optimizer=self._optimizer(box, mean, population, sigma, generator),
            asked=[],
            best=math.inf,
            idle=0,
            record=min(state.best, state.record),
            vain=0 if better or not math.isfinite(min(state.best, state.record)) else state.vain + 1,
            small=small,
            large=large,
        )

    def _sigma(self, box: Box) -> float:
        return self.sigma or box.spread or 0.2

    def _optimizer(self, box: Box, mean: np.ndarray, population: int, sigma: float, generator: torch.Generator) -> Any:
        seed = int(torch.randint(2**31 - 1, (1,), generator=generator, device=generator.device))
        options = {
            "bounds": [[0.0], [1.0]],
            "popsize": population or usual_population(box.dimension),
            "randn": np.random.RandomState(seed).randn,  # NumPy's own generator stays the caller's
            "seed": math.nan,
            "verbose": -9,
        }
        return cma.CMAEvolutionStrategy(mean.clip(0.0, 1.0), sigma, options)


def usual_population(dimension: int) -> int:
    """4 + 3 ln(G), as Hansen (2016) has it."""
    return 4 + int(3.0 * math.log(dimension))


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
