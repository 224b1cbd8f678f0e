"""Separable natural evolution strategy (Schaul, Glasmachers and Schmidhuber 2011) of EvoTorch."""

from __future__ import annotations

import logging
import math

import numpy as np
import torch
from evotorch import Problem, SolutionBatch
from evotorch.algorithms import SNES

from experiments.searches.meter import Meter
from experiments.searches.peers import seed_of

PATIENCE = 100  # generations without progress before a restart, which the library does not have
LEAST = 1e-4  # relative fall that counts as progress, and standard deviation below which nothing is left to do
GROWTH = 2.0  # of the population at a restart


class Box(Problem):  # type: ignore[misc]
    """The unit box. The library knows no bounds here: what lies outside is priced where it is clipped to, and the
    squared distance from there added."""

    def __init__(self, meter: Meter, seed: int) -> None:
        super().__init__(
            "min",
            solution_length=meter.dimension,
            initial_bounds=(0.0, 1.0),
            dtype=torch.float64,
            seed=seed,
            store_solution_stats=False,
        )
        self.meter = meter

    def _evaluate_batch(self, batch: SolutionBatch) -> None:
        points = batch.values.numpy()
        outside = ((points - np.clip(points, 0.0, 1.0)) ** 2).sum(1)
        batch.set_evals(torch.from_numpy(self.meter.values(points) + outside))


def run(meter: Meter, generator: torch.Generator) -> None:
    """Restarts with a growing population, at points drawn as first points are."""
    logging.getLogger("evotorch").setLevel(logging.ERROR)
    centre, population = meter.centre, 4 + int(3 * math.log(meter.dimension))
    while True:
        search = SNES(
            Box(meter, seed_of(generator)),
            stdev_init=meter.spread,
            center_init=torch.from_numpy(np.array(centre)),
            popsize=population,
        )
        idle, best = 0, math.inf
        while idle < PATIENCE and float(search.status["stdev"].max() if search.step_count else 1.0) > LEAST:
            before = meter.best
            search.step()
            best = min(best, float(search.status["pop_best_eval"]))
            idle = 0 if meter.best < before - LEAST * abs(before) or math.isinf(before) else idle + 1
        centre, population = meter.first(1, generator)[0], int(GROWTH * population)
