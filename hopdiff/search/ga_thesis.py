"""The genetic algorithm as Kang (1999) describes it, without anything of ours: chapter 4 and section 2.2."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from hopdiff.search.base import Eval, Problem
from hopdiff.search.box import Box
from hopdiff.search.ga import Population
from hopdiff.search.settings import require


@dataclass(frozen=True)
class GAThesis:
    """Random genes at first; what is impossible is removed; the rest are ranked, and the better breed the more.

    The thesis says that much, and figure 5.7 that 100 individuals lived for 100 generations. Where it is silent the
    plainest choice is taken (Goldberg 1989, Genetic Algorithms in Search, Optimization and Machine Learning): the
    chance to breed falls linearly with the rank, from twice the average to none; two parents swap what lies beyond one
    random place of their genes; a gene mutates to a random value, one a child on average; children take the place of
    all parents, the best one too. A generation with fewer than two possible individuals is drawn anew.

    population: individuals a generation. crossover: share of children with two parents. mutation: chance of each gene;
    None: one over the number of genes.
    """

    name: str = "ga_thesis"
    population: int = 100
    crossover: float = 1.0
    mutation: float | None = None

    def __post_init__(self) -> None:
        require("population", self.population, 2)
        require("crossover", self.crossover, 0, 1)
        if self.mutation is not None:
            require("mutation", self.mutation, 0, 1)

    def init(self, problem: Problem, generator: torch.Generator) -> Population:
        return Population.empty(Box.of(problem))

    def ask(self, state: Population, generator: torch.Generator) -> tuple[Tensor, bool]:
        state = state if state.signals is None else self.steered(state, state.signals.tolist())
        if len(state.genes) < 2:
            return state.box.uniform(self.population, generator), False
        return self._bred(state, generator), False

    def tell(self, state: Population, genes: Tensor, result: Eval, generator: torch.Generator) -> Population:
        return Population.empty(state.box).joined(genes, result.cost)._replace(generation=state.generation + 1)

    def signals(self, state: Population) -> Tensor | None:
        return state.signals

    def steered(self, state: Population, signals: list[float]) -> Population:
        return state.possible(signals)

    def _bred(self, parents: Population, generator: torch.Generator) -> Tensor:
        """(population, G) children of two possible parents or more."""
        count, box = self.population, parents.box
        n, size = parents.genes.shape
        chance = torch.linspace(2.0, 0.0, n, dtype=torch.float64, device=generator.device)
        chosen = torch.multinomial(chance, 2 * count, replacement=True, generator=generator)
        mother, father = parents.genes[chosen.to(parents.genes.device)].view(2, count, size)
        crossed, place = box._replace(dimension=2).uniform(count, generator).split(1, dim=-1)
        hit, fresh = box.uniform(2 * count, generator).view(2, count, size)
        # A child takes at least one gene of either parent.
        cut = 1 + torch.floor(place * (size - 1))
        before = torch.arange(size, device=mother.device) < cut
        child = torch.where((crossed < self.crossover) & ~before, father, mother)
        mutation = 1.0 / size if self.mutation is None else self.mutation
        found: Tensor = torch.where(hit < mutation, fresh, child)
        return found


SEARCH = GAThesis
