"""CMA-ES with BIPOP restarts of pycma (Hansen, Akimoto and Baudis 2019), a generation at a time."""

from __future__ import annotations

import cma
import numpy as np
import torch

from experiments.searches.meter import Meter
from experiments.searches.peers import seed_of


def run(meter: Meter, generator: torch.Generator, bipop: bool = True) -> None:
    """The first run begins about the problem's start, every other one at a point drawn as first points are."""
    began = False

    def first() -> np.ndarray:
        nonlocal began
        if began:
            return meter.first(1, generator)[0]
        began = True
        return meter.centre

    # every point is priced only once, so no noise is asked about; the library would otherwise write files and print
    options = {"bounds": [0.0, 1.0], "seed": seed_of(generator), "verbose": -9, "maxfevals": np.inf}
    while True:
        cma.fmin2(
            None,
            first,
            meter.spread,
            options,
            parallel_objective=lambda points: meter.values(np.array(points)).tolist(),
            bipop=bipop,
            restarts=1000,
        )
