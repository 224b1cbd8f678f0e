"""What a hybrid search is made of: individuals, those of them that descend, and what either way of progress pays."""

from __future__ import annotations

import math
from typing import NamedTuple

import torch
from torch import Tensor

from hopdiff.search.box import Box, best_first
from hopdiff.search.pack import Pack, Rows

GRADIENT = 2.0  # values that a gradient is taken to cost on top of its own
MEMORY = 0.8  # of what a way of progress has paid so far, at its next step
MOST = 0.5  # share of the price that generations get while descents go on


class Brood(NamedTuple):
    """Individuals, best first: the possible ones by cost, then the others by merit, which is finite.

    genes: (n, G). cost, merit: (n,). possible: how many of them are.
    """

    genes: Tensor
    cost: Tensor
    merit: Tensor
    possible: int = 0

    @classmethod
    def empty(cls, box: Box) -> Brood:
        genes = torch.empty(0, box.dimension, dtype=box.dtype, device=box.device)
        return cls(genes, genes.sum(-1), genes.sum(-1))

    def joined(self, genes: Tensor, cost: Tensor, merit: Tensor, possible: int = 0) -> Brood:
        """With m others (m, G) sorted in, so many of them possible."""
        genes, cost, merit = (torch.cat(pair) for pair in zip(self[:3], (genes, cost, merit), strict=True))
        order = best_first(cost, merit)
        return Brood(genes[order], cost[order], merit[order], self.possible + possible)

    def best(self, count: int) -> Brood:
        """The first so many."""
        return Brood(self.genes[:count], self.cost[:count], self.merit[:count], min(self.possible, count))

    def taken(self, rows: list[int]) -> Brood:
        """These, in this order."""
        index = _index(rows, self.genes)
        possible = sum(row < self.possible for row in rows)
        return Brood(self.genes[index], self.cost[index], self.merit[index], possible)

    def without(self, rows: list[int]) -> Brood:
        """All but these."""
        return self.taken([row for row in range(len(self.genes)) if row not in rows])

    def parents(self) -> Tensor:
        """(n, G) those that breed, best first: impossible ones only where there are no two others."""
        return self.genes[: self.possible] if self.possible > 1 else self.genes


class Climbers(NamedTuple):
    """k individuals on their way down. origin: (k, G) their genes before. cost: (k,) where they are now. able: (k) on
    the host, whether a candidate is possible there."""

    pack: Pack
    origin: Tensor
    cost: Tensor
    able: tuple[bool, ...] = ()

    def joined(self, descent: Rows) -> Climbers:
        """With more that begin; their costs are not known."""
        x = descent.x
        cost = torch.cat((self.cost, x.new_full((len(x),), math.inf)))
        return Climbers(self.pack.joined(descent), torch.cat((self.origin, x)), cost, self.able + (False,) * len(x))

    def kept(self, rows: list[int]) -> Climbers:
        """These; their pack stays as it is."""
        index = _index(rows, self.origin)
        able = tuple(self.able[row] for row in rows)
        return self._replace(origin=self.origin[index], cost=self.cost[index], able=able)

    def brood(self, rows: list[int], write_back: bool) -> Brood:
        """Some of them as individuals: with the genes that they have reached if written back, or those before."""
        index = _index(rows, self.origin)
        genes = (self.pack.descent.x if write_back else self.origin)[index]
        possible = sum(self.able[row] for row in rows)
        return Brood(genes, self.cost[index], self.pack.descent.value[index], possible)

    def ended(self, rows: list[int], write_back: bool) -> Settled:
        """Where these are, and, if individuals stay where they were, where they have come from."""
        index = _index(rows, self.origin)
        settled = Settled(self.pack.descent.x[index], self.pack.descent.value[index])
        if write_back:
            return settled
        return settled.joined(Settled(self.origin[index], torch.full_like(settled.merit, math.inf)))


class Settled(NamedTuple):
    """What has been searched: x (m, G), where descents have ended with merit (m,), or begun, with merit infinite."""

    x: Tensor
    merit: Tensor

    def joined(self, more: Settled) -> Settled:
        return Settled(torch.cat((self.x, more.x)), torch.cat((self.merit, more.merit)))

    def meet(self, x: Tensor, merit: Tensor, least: float, gain: float) -> Tensor:
        """(P,) bool: whether points (P, G) lie nearer than `least` to an end and do not better it by a share `gain`."""
        near = (torch.cdist(x, self.x) < least) & self.merit.isfinite()
        return (near & (merit[:, None] >= self.merit - gain * self.merit.abs())).any(1)


class Pay(NamedTuple):
    """What a way of progress has cost in value evaluations, and brought in shares of the best cost; old steps fade."""

    price: float = 0.0
    gain: float = 0.0

    def after(self, price: float, gain: float) -> Pay:
        return Pay(MEMORY * self.price + price, MEMORY * self.gain + gain)

    @property
    def rate(self) -> float:
        return self.gain / self.price if self.price else 0.0


def share_of(generations: Pay, descents: Pay, least: float) -> float:
    """The share of the price that generations should have, least to MOST: as much as they bring of all that is gained
    for the same price."""
    both = generations.rate + descents.rate
    return min(max(least, generations.rate / both if both else 0.0), MOST)


def gain_of(before: float, after: float) -> float:
    """The fall of a cost as a share of what is left of it, 1 at most."""
    if not after < before:
        return 0.0
    return 1.0 if math.isinf(before) or before - after >= abs(after) else (before - after) / abs(after)


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


def _index(rows: list[int], like: Tensor) -> Tensor:
    return torch.tensor(rows, dtype=torch.int64, device=like.device)
