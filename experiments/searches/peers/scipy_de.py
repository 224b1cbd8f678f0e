"""Differential evolution of SciPy (Storn and Price 1997), a generation at a time."""

from __future__ import annotations

import numpy as np
import torch
from scipy.optimize import differential_evolution

from experiments.searches.meter import Meter
from experiments.searches.peers import seed_of


def run(meter: Meter, generator: torch.Generator, population: int = 100) -> None:
    """Restarted when the library finds its population converged. population: its rule, 15 a gene, would spend a small
    budget on the first generations."""
    while True:
        differential_evolution(
            lambda points: meter.values(points.T),
            [(0.0, 1.0)] * meter.dimension,
            init=meter.first(population, generator),
            vectorized=True,
            updating="deferred",
            polish=False,
            maxiter=10**9,
            rng=np.random.default_rng(seed_of(generator)),
        )
