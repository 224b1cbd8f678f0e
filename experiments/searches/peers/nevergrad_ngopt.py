"""Nevergrad's NGOpt (Meunier et al. 2022), which chooses an optimiser by dimension, budget and workers.

In five dimensions it chooses a metamodel that fails with NumPy 2.4; in 29 and 40, with 16 workers, it does not.
"""

from __future__ import annotations

import nevergrad as ng
import numpy as np
import torch

from experiments.searches.meter import Meter
from experiments.searches.peers import seed_of


def run(meter: Meter, generator: torch.Generator, workers: int = 16, optimizer: str = "NGOpt") -> None:
    """It is told the budget, and that `workers` points are priced side by side."""
    space = ng.p.Array(init=meter.centre).set_mutation(sigma=meter.spread).set_bounds(0.0, 1.0)
    space.random_state = np.random.RandomState(seed_of(generator))
    search = ng.optimizers.registry[optimizer](space, budget=meter.budget, num_workers=workers)
    while True:
        asked = [search.ask() for _ in range(workers)]
        values = meter.values(np.array([candidate.value for candidate in asked]))
        for candidate, value in zip(asked, values.tolist(), strict=True):
            search.tell(candidate, value)
