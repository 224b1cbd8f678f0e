"""Individuals that breed, the best of which descend."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import torch
from torch import Tensor

from hopdiff.search.base import Asked, Eval, Problem
from hopdiff.search.box import Box
from hopdiff.search.brood import GRADIENT, Brood, Climbers, Pay, Settled, gain_of, share_of, spread
from hopdiff.search.ga import GA, Population
from hopdiff.search.gradient import Gradient
from hopdiff.search.lm import Looks
from hopdiff.search.pack import Pack, Rows, kind_of
from hopdiff.search.settings import require
from hopdiff.types import HopdiffError

POPULATION = 40  # where the problem does not ask for less
CROWD = 8  # individuals that one who descends is chosen from


class Progress(NamedTuple):
    """brood: individuals that do not descend. climbers: those that do, by the method `kind`. settled: where descents
    have ended. generation: bred so far. barren: generations since that gave nobody to descend. breeding: whether a
    generation is asked for next. best: lowest cost so far. generations, descents: what either has paid of late; due:
    value evaluations that generations have earned. price: of what was asked since the host last read. over: whether
    there is nothing more to gain. signals: what the host has not read yet. population: the setting for this problem.
    """

    box: Box
    brood: Brood
    climbers: Climbers
    kind: str
    settled: Settled
    population: int
    generation: int = 0
    barren: int = 0
    breeding: bool = True
    best: float = math.inf
    generations: Pay = Pay()
    descents: Pay = Pay()
    due: float = 0.0
    price: float = 0.0
    over: bool = False
    signals: Tensor | None = None


@dataclass(frozen=True)
class Hybrid:
    """The best individuals of a population descend to where their valleys end, those that fall behind, or come to where
    one has been before, given up on the way. After every descent a generation is bred, and the best individual apart
    from what has been searched is the next. While descents go on, generations get the share of the evaluations that
    they have earned: what they gained of late for their price, against what descents did. Over when `restarts` descents
    in a row found nothing better.

    population: individuals that are kept, the first ones random; None: 40, or fewer if the problem would screen fewer.
    children: bred a generation; the best of both live.
    climbers: individuals that descend side by side, one more while it is better than all of them.
    share: least share of the evaluations that generations get while descents go on.
    apart: least distance between two that descend, and to where one has ended, root mean square in box widths.
    write_back: whether an individual takes over the genes it has reached (Lamarck) or only their cost (Baldwin).
    renew, misses: lm: steps that a look at the residuals serves, and failed trials in a row after which it does no
    longer. restarts, gain, method, reach, tolerance, patience: as in `Gradient`, without Adam; all others as in `GA`.
    """

    name: str = "hybrid"
    population: int | None = None
    children: int = 10
    climbers: int = 1
    share: float = 0.05
    apart: float = 0.03
    write_back: bool = True
    restarts: int = 3
    gain: float = 1e-3
    method: str | None = None
    renew: int = 20
    misses: int = 3
    reach: float = 1.0
    tolerance: float = 2e-5
    patience: int | None = None
    pressure: float = 1.9
    crossover: float = 0.9
    blend: float = 0.75
    stretch: float = 0.5
    mutation: float = 0.1
    sigma: float = 0.2
    sigma_decay: float = 0.9
    sigma_floor: float = 0.01

    def __post_init__(self) -> None:
        if self.population is not None:
            require("population", self.population, 2)
        require("children", self.children, 1)
        require("climbers", self.climbers, 1)
        require("share", self.share, 0, 0.5)
        require("apart", self.apart, 0, 1)
        require("restarts", self.restarts, 0)
        require("renew", self.renew, 1)
        require("misses", self.misses, 1)
        if self.method == "adam":
            raise HopdiffError("search.method must be one of lm, bfgs, not 'adam'.")
        _ = self.ga, self.gradient

    @property
    def ga(self) -> GA:
        """The settings of breeding."""
        return GA(
            elites=0,
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
    def gradient(self) -> Gradient:
        """The settings of a descent."""
        return Gradient(
            method=self.method, gain=self.gain, reach=self.reach, tolerance=self.tolerance, patience=self.patience
        )

    def init(self, problem: Problem, generator: torch.Generator) -> Progress:
        """Raises HopdiffError if method is "lm" and the problem tells no residuals."""
        box = Box.of(problem)
        brood = Brood.empty(box)
        kind = kind_of(self.method, problem)
        climbers = Climbers(Pack.begin(self._begun(kind, brood.genes)), brood.genes, brood.cost)
        population = self.population or min(POPULATION, getattr(problem, "screen", POPULATION))
        return Progress(box, brood, climbers, kind, Settled(brood.genes, brood.merit), population)

    def ask(self, state: Progress, generator: torch.Generator) -> tuple[Tensor, bool] | Asked:
        state = self._read(state)
        if not state.breeding:
            return state.climbers.pack.ask()
        if not state.generation:
            return state.box.first(state.population, generator), False
        if state.barren:
            return state.box.first(self.children, generator), False
        return self.ga.breed(self._parents(state), self.children, generator), False

    def tell(self, state: Progress, genes: Tensor, result: Eval, generator: torch.Generator) -> Progress:
        state = self._read(state)
        if state.breeding:
            return self._bred(state, genes, result)
        price = len(genes) * (1.0 + GRADIENT * (result.grad is not None))
        climbers = state.climbers
        pack, signals = climbers.pack.told(genes, result)
        state = state._replace(price=state.price + price)
        if signals is None:
            return state._replace(climbers=climbers._replace(pack=pack))
        x, merit = pack.descent.x, pack.descent.value
        cost = torch.where((x == genes).all(-1), result.cost, climbers.cost)
        met = state.settled.meet(x, merit, self._least(x), self.gain)
        told = torch.cat((signals, met.to(signals), cost.to(signals)))
        return state._replace(climbers=climbers._replace(pack=pack, cost=cost), signals=told)

    def finished(self, state: Progress) -> bool:
        return self._read(state).over

    def signals(self, state: Progress) -> Tensor | None:
        return state.signals

    def steered(self, state: Progress, signals: list[float]) -> Progress:
        """Who descends, who has ended, and who breeds, now that the host knows how they stand."""
        state = state._replace(signals=None)
        return self._chosen(state, signals) if state.breeding else self._stepped(state, signals)

    def _read(self, state: Progress) -> Progress:
        return state if state.signals is None else self.steered(state, state.signals.tolist())

    def _begun(self, kind: str, x: Tensor) -> Rows:
        return self.gradient.begun(kind, x, Looks(self.renew, 0.0, self.misses))

    def _least(self, genes: Tensor) -> float:
        return self.apart * math.sqrt(genes.shape[-1])

    def _parents(self, state: Progress) -> Population:
        """All individuals that breed, those that descend among them."""
        own = state.climbers.brood(list(range(len(state.climbers.able))), self.write_back)
        genes = state.brood.joined(*own).parents()
        return Population(state.box, genes, genes.sum(-1), state.generation)

    def _bred(self, state: Progress, genes: Tensor, result: Eval) -> Progress:
        """With new individuals among the old; the host must know how many of all are possible, or have a merit at
        least, what the best of the new ones costs, and who is how near to whom."""
        brood = state.brood.joined(genes, result.cost, result.merit).best(state.population)
        crowd = brood.genes[: CROWD * self.climbers]
        near = torch.cdist(crowd, torch.cat((crowd, state.settled.x, state.climbers.pack.descent.x)))
        counts = torch.stack((brood.cost.isfinite().sum(), brood.merit.isfinite().sum())).to(genes)
        signals = torch.cat((counts, result.cost.amin(dim=0, keepdim=True).to(genes), near.flatten()))
        return state._replace(brood=brood, signals=signals, price=float(len(genes)))

    def _chosen(self, state: Progress, signals: list[float]) -> Progress:
        """After a generation: what it has paid, and who descends next."""
        possible, known, found = int(signals[0]), int(signals[1]), signals[2]
        width = min(CROWD * self.climbers, len(state.brood.genes))
        near, crowd = signals[3:], min(width, known)
        others = len(near) // width
        rows = [near[at * others : (at + 1) * others] for at in range(crowd)]
        rows = [[*row[:crowd], *row[width:]] for row in rows]
        brood = state.brood.best(known)._replace(possible=possible)
        under_way = len(state.climbers.able)
        overtaken = under_way > 0 and found < state.best
        wanted = max(self.climbers - under_way, int(overtaken))
        chosen = spread(rows, wanted, self._least(brood.genes))
        climbers, brood = self._sent(state, brood, chosen)
        barren = 0 if climbers.able else state.barren + 1
        curves = climbers.pack.curves
        paid = state.generations.after(state.price, gain_of(state.best, found)) if state.generation else Pay()
        return state._replace(
            brood=brood,
            climbers=climbers,
            generation=state.generation + (known > 0),
            barren=barren if known else 0,
            breeding=not climbers.able,
            best=min(state.best, found),
            generations=paid,
            due=0.0,
            price=0.0,
            over=not climbers.able and curves.best is not None and curves.vain + barren // 2 >= self.restarts,
        )

    def _sent(self, state: Progress, brood: Brood, chosen: list[int]) -> tuple[Climbers, Brood]:
        """These of the brood are on their way down, the rest stays."""
        if not chosen:
            return state.climbers, brood
        return state.climbers.joined(self._begun(state.kind, brood.taken(chosen).genes)), brood.without(chosen)

    def _stepped(self, state: Progress, signals: list[float]) -> Progress:
        """After a step of all that descend: what it has paid, who has ended, and whether a generation is due."""
        climbers = state.climbers
        count = len(climbers.able)
        told, met, cost = signals[: 4 * count], signals[4 * count : 5 * count], signals[5 * count :]
        told[count : 2 * count] = map(max, told[count : 2 * count], met)
        climbers = climbers._replace(able=tuple(flag > 0 for flag in told[3 * count :]))
        pack = climbers.pack.steered(told, self.gain)
        kept = list(pack.curves.kept)
        ended = [row for row in range(count) if row not in kept]
        brood, settled = state.brood, state.settled
        if ended:
            home = climbers.brood([row for row in ended if math.isfinite(told[row])], self.write_back)
            brood = brood.joined(*home).best(state.population)
            settled = settled.joined(climbers.ended(ended, self.write_back))
            climbers = climbers.kept(kept)
        best = min([*cost, state.best])
        descents = state.descents.after(state.price, gain_of(state.best, best))
        due = state.due + state.price * share_of(state.generations, descents, self.share)
        curves = pack.curves
        return state._replace(
            brood=brood,
            climbers=climbers._replace(pack=pack),
            settled=settled,
            breeding=bool(ended) or due >= self.children,
            best=best,
            descents=descents,
            due=due,
            price=0.0,
            over=not kept and curves.best is not None and curves.vain >= self.restarts,
        )


SEARCH = Hybrid
