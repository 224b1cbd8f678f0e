"""A possible run, priced, that the tests of effort start from."""

from __future__ import annotations

from functools import cache

import torch
from torch import Tensor

from hopdiff.effort.priced import Priced
from hopdiff.effort.problem import BodyProblem
from tests.whole_body.bodies import DTYPE, body_problem, values_of

ORDINARY = ("speed=3.5", "beta=0.2")
EXACT = ("model.rounds=25", "model.adjoint_rounds=25")


def unit_genes(problem: BodyProblem, count: int = 1, wobble: float = 0.0) -> Tensor:
    """(count, G) of the unit box: the run of `tests.whole_body.bodies`, the others off by `wobble` box widths."""
    table, values = problem.table, values_of("run")
    genes = table.to_unit(torch.tensor([values[name] for name in table.names], dtype=DTYPE))
    noise = wobble * torch.randn(count, len(genes), generator=torch.Generator().manual_seed(6), dtype=DTYPE)
    noise[0] = 0.0
    return (genes + noise).clamp(0.01, 0.99)


@cache
def priced(*overrides: str, count: int = 1, wobble: float = 0.0) -> Priced:
    """Runs, solved to rounding."""
    problem = body_problem(*(overrides or ORDINARY))
    return problem.solved(unit_genes(problem, count, wobble))
