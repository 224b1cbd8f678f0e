"""The genetic algorithm: rank-based selection, crossover, mutation, elites; invalid individuals never breed."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import torch
from torch import Tensor

from hopdiff.search.base import Eval, Problem
from hopdiff.search.box import Box
from hopdiff.search.settings import require


class Population(NamedTuple):
    """The valid individuals, best first. genes: (n, G). cost: (n,). generation: bred so far.

    best: lowest cost that counted as progress; idle: generations since. signals: what the host has not read yet; until
    then invalid individuals stand at the end.
    """

    box: Box
    genes: Tensor
    cost: Tensor
    generation: int
    best: float = math.inf
    idle: int = 0
    signals: Tensor | None = None

    @classmethod
    def empty(cls, box: Box) -> Population:
        genes = torch.empty(0, box.dimension, dtype=box.dtype, device=box.device)
        return cls(box, genes, genes.sum(-1), 0)

    def joined(self, genes: Tensor, cost: Tensor) -> Population:
        """With genes (P, G) of cost (P,) sorted in, not yet without the invalid ones."""
        genes, cost = torch.cat([self.genes, genes]), torch.cat([self.cost, cost])
        order = torch.argsort(cost, stable=True)
        signals = torch.stack((cost.isfinite().sum().to(cost.dtype), cost.amin()))
        return self._replace(genes=genes[order], cost=cost[order], signals=signals)

    def possible(self, signals: list[float]) -> Population:
        """Without the invalid ones, now that the host knows how many are valid."""
        valid = int(signals[0])
        return self._replace(genes=self.genes[:valid], cost=self.cost[:valid], signals=None)


@dataclass(frozen=True)
class GA:
    """Kang's search. The first generation is random and is drawn on until a tenth of `population` is valid.

    population: individuals a generation, elites included. elites: best ones that live on unchanged.
    pressure: expected children of the best, relative to the average (1 none, 2 the most that linear ranking has).
    crossover: share of children with two parents. blend: share of those whose genes are mixed by interpolation,
    the others take each gene from either parent. stretch: how far beyond its parents a mixed gene may lie.
    mutation: chance of each gene. sigma: its standard deviation, in box widths; sigma_decay: factor a generation;
    sigma_floor: where the decay ends. patience: generations in which the best cost falls by less than `gain` of itself
    before the search is over.
    """

    name: str = "ga"
    population: int = 100
    elites: int = 8
    pressure: float = 1.9
    crossover: float = 0.9
    blend: float = 0.75
    stretch: float = 0.5
    mutation: float = 0.1
    sigma: float = 0.2
    sigma_decay: float = 0.96
    sigma_floor: float = 0.01
    patience: int = 40
    gain: float = 1e-3

    def __post_init__(self) -> None:
        require("population", self.population, 2)
        require("elites", self.elites, 0, self.population - 1)
        require("pressure", self.pressure, 1, 2)
        require("stretch", self.stretch, 0)
        require("sigma", self.sigma, 0)
        require("sigma_floor", self.sigma_floor, 0)
        require("patience", self.patience, 1)
        require("gain", self.gain, 0, 1)
        for share in ("crossover", "blend", "mutation", "sigma_decay"):
            require(share, getattr(self, share), 0, 1)

    def init(self, problem: Problem, generator: torch.Generator) -> Population:
        return Population.empty(Box.of(problem))

    def ask(self, state: Population, generator: torch.Generator) -> tuple[Tensor, bool]:
        state = self._read(state)
        if state.generation == 0:
            return state.box.first(self.population, generator), False
        return self.breed(state, self.population - self.elites, generator), False

    def tell(self, state: Population, genes: Tensor, result: Eval, generator: torch.Generator) -> Population:
        state = self._read(state)
        kept = len(state.genes) if state.generation == 0 else self.elites
        return state._replace(genes=state.genes[:kept], cost=state.cost[:kept]).joined(genes, result.cost)

    def finished(self, state: Population) -> bool:
        return self._read(state).idle >= self.patience

    def signals(self, state: Population) -> Tensor | None:
        return state.signals

    def steered(self, state: Population, signals: list[float]) -> Population:
        """The population without the invalid ones, one generation on."""
        grown, best = state.possible(signals), signals[1]
        valid = len(grown.genes)
        if state.generation == 0 and valid < max(2, self.population // 10):
            return grown
        progress = valid > 0 and not best >= state.best - self.gain * abs(state.best)
        return grown._replace(
            generation=state.generation + 1 if valid else 0,
            best=best if progress else state.best,
            idle=0 if progress else state.idle + 1,
        )

    def _read(self, state: Population) -> Population:
        return state if state.signals is None else self.steered(state, state.signals.tolist())

    def breed(self, parents: Population, count: int, generator: torch.Generator) -> Tensor:
        """(count, G) children of a population that is not empty."""
        box = parents.box
        mother, father = self._select(parents, 2 * count, generator).view(2, count, -1)
        coin, weight, hit = box.uniform(3 * count, generator).view(3, count, -1)
        fate = box._replace(dimension=1).uniform(count, generator)
        mixed = mother + (weight * (1 + 2 * self.stretch) - self.stretch) * (father - mother)
        swapped = torch.where(coin < 0.5, mother, father)
        child = torch.where(fate < self.crossover * self.blend, mixed, swapped)
        child = torch.where(fate < self.crossover, child, mother)
        sigma = max(self.sigma * self.sigma_decay ** (parents.generation - 1), self.sigma_floor)
        found: Tensor = (child + (hit < self.mutation) * sigma * box.normal(count, generator)).clamp(0.0, 1.0)
        return found

    def _select(self, parents: Population, count: int, generator: torch.Generator) -> Tensor:
        """(count, G) parents; the chance of one falls linearly with its rank."""
        n = len(parents.genes)
        chance = torch.linspace(self.pressure, 2.0 - self.pressure, n, dtype=torch.float64, device=generator.device)
        chosen = torch.multinomial(chance, count, replacement=True, generator=generator)
        return parents.genes[chosen.to(parents.genes.device)]


SEARCH = GA
