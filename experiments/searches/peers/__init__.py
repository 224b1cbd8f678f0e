"""Optimisers of other libraries, a module each: run(meter, generator, **settings) goes on until `Spent` is raised.

Their settings are the libraries' own wherever nothing is said. All begin where hopdiff's searches begin: points
come from `Meter.first`, a distribution from `Meter.centre` and `Meter.spread`.
"""

from __future__ import annotations

import torch


def seed_of(generator: torch.Generator) -> int:
    """A seed for a library's own generator."""
    return int(torch.randint(1, 2**31 - 1, (1,), generator=generator))
