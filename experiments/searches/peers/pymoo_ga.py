"""The genetic algorithm of pymoo (Blank and Deb 2020) for one objective: tournaments, SBX, polynomial mutation."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from pymoo.algorithms.soo.nonconvex.ga import GA
from pymoo.core.problem import Problem
from pymoo.core.termination import NoTermination
from pymoo.optimize import minimize

from experiments.searches.meter import Meter
from experiments.searches.peers import seed_of


class Box(Problem):  # type: ignore[misc]
    """The unit box, priced a generation at a time."""

    def __init__(self, meter: Meter) -> None:
        super().__init__(n_var=meter.dimension, n_obj=1, xl=0.0, xu=1.0)
        self.meter = meter

    def _evaluate(self, x: np.ndarray, out: dict[str, Any], *args: Any, **kwargs: Any) -> None:
        out["F"] = self.meter.values(x)[:, None]


def run(meter: Meter, generator: torch.Generator, population: int = 100) -> None:
    algorithm = GA(pop_size=population, sampling=meter.first(population, generator))
    minimize(Box(meter), algorithm, NoTermination(), seed=seed_of(generator), copy_algorithm=False)
