"""Random search: the floor that every other search has to clear."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from hopdiff.search.base import Eval, Problem
from hopdiff.search.box import Box
from hopdiff.search.settings import require


@dataclass(frozen=True)
class Random:
    """Uniform points of the box, `population` at a time."""

    name: str = "random"
    population: int = 100

    def __post_init__(self) -> None:
        require("population", self.population, 1)

    def init(self, problem: Problem, generator: torch.Generator) -> Box:
        return Box.of(problem)

    def ask(self, state: Box, generator: torch.Generator) -> tuple[Tensor, bool]:
        return state.uniform(self.population, generator), False

    def tell(self, state: Box, genes: Tensor, result: Eval, generator: torch.Generator) -> Box:
        return state


SEARCH = Random
