"""A genetic algorithm outside, descents of its best inside."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import torch
from torch import Tensor

from hopdiff.search.base import Asked, Eval, Problem
from hopdiff.search.ga import GA, Population
from hopdiff.search.gradient import Gradient
from hopdiff.search.pack import Pack, Rows, kind_of
from hopdiff.search.settings import require
from hopdiff.types import HopdiffError

TO_THE_END = 1 << 30
CROWD = 8  # individuals that one who descends is chosen from


class Climbers(NamedTuple):
    """k individuals on their way down. origin: (k, G) their genes in the population. cost: (k,) where they are."""

    pack: Pack
    origin: Tensor
    cost: Tensor

    def take(self, rows: list[int]) -> Climbers:
        index = torch.tensor(rows, dtype=torch.int64, device=self.origin.device)
        return Climbers(self.pack.take(rows), self.origin[index], self.cost[index])

    def joined(self, descent: Rows, cost: Tensor) -> Climbers:
        """With more that begin, descent.x being their genes in the population."""
        return Climbers(self.pack.joined(descent), torch.cat((self.origin, descent.x)), torch.cat((self.cost, cost)))


class Brood(NamedTuple):
    """people: the population. climbers: those of them that descend. kind: by which method. settled: (m, G) where
    descents have ended. steps: that the climbers still take before the next generation. over: whether there is nothing
    more to gain. signals: what the host has not read yet.
    """

    people: Population
    climbers: Climbers
    kind: str
    settled: Tensor
    steps: int
    over: bool
    signals: Tensor | None


@dataclass(frozen=True)
class Hybrid:
    """Every generation is followed by a few steps down of its best individuals, which remember the curvature they met
    for as long as they stay among the best. After the last generation the best few descend to their end, those that
    fall behind given up on the way. Then all starts again from a new population, which leaves alone what has been
    searched, until `restarts` descents in a row found nothing better.

    generations: before the descent to the end. climbers: individuals that descend. steps: a generation.
    refine: how many descend to the end. apart: least distance between two of them, root mean square in box widths.
    write_back: whether an individual takes over the genes it has reached (Lamarck) or only their cost (Baldwin).
    restarts, gain, method, reach, tolerance, patience: as in `Gradient`, without Adam; all others as in `GA`.
    """

    name: str = "hybrid"
    generations: int = 3
    climbers: int = 1
    steps: int = 3
    refine: int = 2
    apart: float = 0.03
    write_back: bool = True
    restarts: int = 1
    gain: float = 1e-3
    method: str | None = None
    reach: float = 1.0
    tolerance: float = 1e-4
    patience: int | None = None
    population: int = 40
    elites: int = 4
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
        require("restarts", self.restarts, 0)
        if self.method == "adam":
            raise HopdiffError("search.method must be one of lm, bfgs, not 'adam'.")
        _ = self.ga, self.descents

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

    @property
    def descents(self) -> Gradient:
        """The settings of a descent."""
        return Gradient(
            method=self.method, gain=self.gain, reach=self.reach, tolerance=self.tolerance, patience=self.patience
        )

    def init(self, problem: Problem, generator: torch.Generator) -> Brood:
        """Raises HopdiffError if method is "lm" and the problem tells no residuals."""
        people = self.ga.init(problem, generator)
        kind = kind_of(self.method, problem)
        climbers = Climbers(Pack.begin(self.descents.begun(kind, people.genes)), people.genes, people.cost)
        return Brood(people, climbers, kind, people.genes, 0, False, None)

    def ask(self, state: Brood, generator: torch.Generator) -> tuple[Tensor, bool] | Asked:
        state = self._read(state)
        return state.climbers.pack.ask() if state.steps else self.ga.ask(state.people, generator)

    def tell(self, state: Brood, genes: Tensor, result: Eval, generator: torch.Generator) -> Brood:
        state = self._read(state)
        if not state.steps:
            people = self.ga.tell(state.people, genes, result, generator)
            return state._replace(people=people, signals=people.signals)
        climbers = state.climbers
        pack, signals = climbers.pack.told(genes, result)
        cost = climbers.cost
        if signals is not None:
            cost = torch.where((pack.descent.x == genes).all(-1), result.cost, cost)
        return state._replace(climbers=climbers._replace(pack=pack, cost=cost), signals=signals)

    def finished(self, state: Brood) -> bool:
        return self._read(state).over

    def signals(self, state: Brood) -> Tensor | None:
        return state.signals

    def steered(self, state: Brood, signals: list[float]) -> Brood:
        """Who descends, and who has ended, now that the host knows how they stand."""
        if not state.steps:
            people = self.ga.steered(state.people, signals)
            return self._sent(state._replace(people=people, signals=None))
        state = self._stepped(state._replace(signals=None), signals)
        if state.steps:
            return state
        if state.people.generation < self.generations:
            people, climbers = self._taught(state.people, state.climbers), state.climbers
            origin = climbers.pack.descent.x if self.write_back else climbers.origin
            return state._replace(people=people, climbers=climbers._replace(origin=origin))
        curves = state.climbers.pack.curves
        over = curves.best is not None and curves.vain >= self.restarts
        return state._replace(people=Population.empty(state.people.box), over=over)

    def _read(self, state: Brood) -> Brood:
        return state if state.signals is None else self.steered(state, state.signals.tolist())

    def _sent(self, state: Brood) -> Brood:
        """Choose who descends; whoever did before goes on from where it is."""
        people, old = state.people, state.climbers
        last = people.generation >= self.generations
        count = self.refine if last else self.climbers
        crowd = people.genes[: CROWD * count]
        known = (crowd[:, None] == old.origin[None]).all(-1)
        near = torch.cat((torch.cdist(crowd, torch.cat((crowd, state.settled))), known.to(crowd.dtype)), dim=1)
        rows = near.tolist()
        chosen = spread([row[: len(rows) + len(state.settled)] for row in rows], count, self._least(crowd))
        found = [rows[at][len(rows) + len(state.settled) :] for at in chosen]
        kept = [row.index(1.0) for row in found if 1.0 in row]
        index = torch.tensor([at for at, row in zip(chosen, found, strict=True) if 1.0 not in row], dtype=torch.int64)
        fresh = index.to(crowd.device)
        begun = self.descents.begun(state.kind, crowd[fresh])
        climbers = old.take(kept).joined(begun, people.cost[: len(crowd)][fresh])
        steps = (TO_THE_END if last else self.steps) if chosen and people.generation else 0
        if last and not steps:
            people = Population.empty(people.box)
        return state._replace(people=people, climbers=climbers, steps=steps)

    def _least(self, genes: Tensor) -> float:
        return self.apart * math.sqrt(genes.shape[-1])

    def _stepped(self, state: Brood, signals: list[float]) -> Brood:
        people, climbers, settled, steps = state.people, state.climbers, state.settled, state.steps
        count = len(climbers.origin)
        pack = climbers.pack.steered(signals, self.gain)
        kept = list(pack.curves.kept)
        if len(kept) < count:
            people = self._taught(people, climbers)
            ended = torch.tensor([row for row in range(count) if row not in kept], device=settled.device)
            settled = torch.cat((settled, climbers.pack.descent.x[ended]))
            index = torch.tensor(kept, dtype=torch.int64, device=settled.device)
            climbers = climbers._replace(origin=climbers.origin[index], cost=climbers.cost[index])
        steps = steps - 1 if kept else 0
        return state._replace(people=people, climbers=climbers._replace(pack=pack), settled=settled, steps=steps)

    def _taught(self, people: Population, climbers: Climbers) -> Population:
        """The population after its climbers' costs, and their genes if written back, took the place of the old ones."""
        if not len(climbers.origin) or not len(people.genes):
            return people
        mine = (people.genes[:, None] == climbers.origin[None]).all(-1)
        who = mine.int().argmax(1)
        gain = mine.any(1) & (climbers.cost[who] < people.cost)
        cost = torch.where(gain, climbers.cost[who], people.cost)
        genes = people.genes
        if self.write_back:
            genes = torch.where(gain[:, None], climbers.pack.descent.x[who], genes)
        order = torch.argsort(cost, stable=True)
        return people._replace(genes=genes[order], cost=cost[order])


def spread(distance: list[list[float]], count: int, least: float) -> list[int]:
    """The first `count` of n points that lie apart from one another and from m others.

    distance: (n, n + m) between the points, and from them to the others. least: between two of them.
    """
    chosen: list[int] = []
    for at, row in enumerate(distance):
        apart = all(row[other] >= least for other in [*chosen, *range(len(distance), len(row))])
        if apart and len(chosen) < count:
            chosen.append(at)
    return chosen


SEARCH = Hybrid
