"""A genetic algorithm outside, quasi-Newton descent of its best inside."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import torch
from torch import Tensor

from hopdiff.search.base import Eval, Problem
from hopdiff.search.bfgs import Bfgs
from hopdiff.search.descent import joined, taken
from hopdiff.search.ga import GA, Population
from hopdiff.search.settings import require

TO_THE_END = 1 << 30


class Climbers(NamedTuple):
    """k individuals on their way down. origin: (k, G) their genes in the population. cost: (k,) at descent.x."""

    descent: Bfgs
    origin: Tensor
    cost: Tensor

    def take(self, index: Tensor) -> Climbers:
        return Climbers(taken(self.descent, index), self.origin[index], self.cost[index])


class Brood(NamedTuple):
    """people: the population. climbers: those of them that descend. settled: (m, G) where descents have ended.
    steps: that the climbers still take before the next generation."""

    people: Population
    climbers: Climbers
    settled: Tensor
    steps: int


@dataclass(frozen=True)
class Hybrid:
    """Every generation is followed by a few quasi-Newton steps of its best individuals, which remember the curvature
    they met for as long as they stay among the best. After the last generation the best few descend to their end,
    and all starts again from a new population, which leaves alone what has been searched.

    generations: before the descent to the end. climbers: individuals that descend. steps: a generation.
    refine: how many descend to the end. apart: least distance between two of them, root mean square in box widths.
    write_back: whether an individual takes over the genes it has reached (Lamarck) or only their cost (Baldwin).
    reach, tolerance, patience: as in `Gradient`; all others as in `GA`.
    """

    name: str = "hybrid"
    generations: int = 8
    climbers: int = 8
    steps: int = 2
    refine: int = 8
    apart: float = 0.03
    write_back: bool = True
    reach: float = 1.0
    tolerance: float = 1e-4
    patience: int = 5
    population: int = 100
    elites: int = 8
    pressure: float = 1.9
    crossover: float = 0.9
    blend: float = 0.75
    stretch: float = 0.5
    mutation: float = 0.1
    sigma: float = 0.2
    sigma_decay: float = 0.9
    sigma_floor: float = 0.01

    def __post_init__(self) -> None:
        require("generations", self.generations, 1)
        require("climbers", self.climbers, 1)
        require("steps", self.steps, 0)
        require("refine", self.refine, 1)
        require("apart", self.apart, 0, 1)
        require("reach", self.reach, 1e-6)
        require("tolerance", self.tolerance, 0)
        require("patience", self.patience, 1)
        _ = self.ga

    @property
    def ga(self) -> GA:
        return GA(
            population=self.population,
            elites=self.elites,
            pressure=self.pressure,
            crossover=self.crossover,
            blend=self.blend,
            stretch=self.stretch,
            mutation=self.mutation,
            sigma=self.sigma,
            sigma_decay=self.sigma_decay,
            sigma_floor=self.sigma_floor,
        )

    def init(self, problem: Problem, generator: torch.Generator) -> Brood:
        people = self.ga.init(problem, generator)
        return Brood(people, self._climbers(people.genes, people.cost), people.genes, 0)

    def ask(self, state: Brood, generator: torch.Generator) -> tuple[Tensor, bool]:
        if state.steps:
            return state.climbers.descent.trial(), True
        return self.ga.ask(state.people, generator)

    def tell(self, state: Brood, genes: Tensor, result: Eval, generator: torch.Generator) -> Brood:
        if not state.steps:
            return self._send(state._replace(people=self.ga.tell(state.people, genes, result, generator)))
        state = self._stepped(state, genes, result)
        if state.steps:
            return state
        if state.people.generation >= self.generations:
            return state._replace(people=Population.empty(state.people.box))
        return state._replace(people=self._taught(state.people, state.climbers), climbers=self._moved(state.climbers))

    def _send(self, state: Brood) -> Brood:
        """Choose who descends; whoever did before goes on from where it is."""
        people, old = state.people, state.climbers
        last = people.generation >= self.generations
        chosen = spread(people.genes, state.settled, self.refine if last else self.climbers, self.apart)
        origin, cost = people.genes[chosen], people.cost[chosen]
        known = (origin[:, None] == old.origin[None]).all(-1)
        new = ~known.any(1)
        fresh = self._climbers(origin[new], cost[new])
        kept = old.take(known.any(0))
        climbers = Climbers(
            joined(kept.descent, fresh.descent),
            torch.cat([kept.origin, fresh.origin]),
            torch.cat([kept.cost, fresh.cost]),
        )
        steps = (TO_THE_END if last else self.steps) if len(chosen) and people.generation else 0
        if last and not steps:
            people = Population.empty(people.box)
        return state._replace(people=people, climbers=climbers, steps=steps)

    def _stepped(self, state: Brood, genes: Tensor, result: Eval) -> Brood:
        assert result.grad is not None
        people, climbers, settled, steps = state
        descent = climbers.descent.advance(genes, result.merit, result.grad)
        arrived = (descent.x == genes).all(-1)
        climbers = Climbers(descent, climbers.origin, torch.where(arrived, result.cost, climbers.cost))
        if descent.done.any():
            people = self._taught(people, climbers)
            settled = torch.cat([settled, descent.x[descent.done]])
            climbers = climbers.take(~descent.done)
        return Brood(people, climbers, settled, steps - 1 if len(climbers.origin) else 0)

    def _taught(self, people: Population, climbers: Climbers) -> Population:
        """The population after its climbers' costs, and their genes if written back, took the place of the old ones."""
        if not len(climbers.origin):
            return people
        mine = (people.genes[:, None] == climbers.origin[None]).all(-1)
        who = mine.int().argmax(1)
        gain = mine.any(1) & (climbers.cost[who] < people.cost)
        if not gain.any():
            return people
        genes, cost = people.genes.clone(), people.cost.clone()
        cost[gain] = climbers.cost[who[gain]]
        if self.write_back:
            genes[gain] = climbers.descent.x[who[gain]]
        return people._replace(genes=genes[:0], cost=cost[:0]).joined(genes, cost)

    def _moved(self, climbers: Climbers) -> Climbers:
        return climbers._replace(origin=climbers.descent.x) if self.write_back else climbers

    def _climbers(self, genes: Tensor, cost: Tensor) -> Climbers:
        return Climbers(Bfgs.begin(genes, self.reach, self.tolerance, self.patience), genes, cost)


def spread(genes: Tensor, taboo: Tensor, count: int, apart: float) -> Tensor:
    """Indices of the first `count` rows of genes (n, G) that lie apart from one another and from taboo (m, G).

    apart: the least distance, root mean square over the genes.
    """
    least = apart * genes.shape[-1] ** 0.5
    open_ = (torch.cdist(genes, taboo) >= least).all(1)
    chosen: list[int] = []
    while len(chosen) < count and open_.any():
        chosen.append(int(open_.int().argmax()))
        open_ &= torch.cdist(genes, genes[chosen[-1:]])[:, 0] >= least
        open_[chosen[-1]] = False
    return torch.tensor(chosen, dtype=torch.int64, device=genes.device)


SEARCH = Hybrid
