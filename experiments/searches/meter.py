"""What a method spends and gets: one count for all, whoever's loop it runs in."""

from __future__ import annotations

import math
from collections.abc import Callable
from time import process_time
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from hopdiff.search.base import Eval, Problem
from hopdiff.search.box import Box

BEYOND = 1e6  # above every cost of a possible run: where impossible ones are put for libraries that know no infinity


class Spent(Exception):  # noqa: N818 - no error: it ends a library's loop
    """The budget is spent, or the target reached."""


class Point(NamedTuple):
    """A moment at which something better had been found, or the last. seconds: of one core, the method's own work
    too."""

    evaluations: int
    gradient_evaluations: int
    seconds: float
    best: float


class Log:
    """The trace of one run. The clock is that of the process, which other programs do not stop, and of all its
    threads. genes: (G,) of the best, None while there is none."""

    def __init__(self, clock: Callable[[], float] = process_time) -> None:
        self.points: list[Point] = []
        self.genes: Tensor | None = None
        self.clock = clock
        self.started = clock()

    def enter(self, evaluations: int, gradient_evaluations: int, best: float, genes: Tensor) -> None:
        """After a batch: all counts so far, and the best so far."""
        point = Point(evaluations, gradient_evaluations, self.clock() - self.started, best)
        if math.isfinite(best) and (not self.points or best < self.points[-1].best):
            self.genes = genes
        # Of a stretch without progress only its end is kept.
        if len(self.points) > 1 and self.points[-1].best == self.points[-2].best == best:
            self.points.pop()
        self.points.append(point)


class Meter:
    """A problem as a library of its own loop sees it: what it asks is priced, counted, and refused beyond the budget.

    The budget is that of `hopdiff.search.loop`: `price` more for a gradient; the last batch is cut to what can still
    be paid for. target: a cost that ends the run.
    """

    def __init__(self, problem: Problem, evaluations: int, price: float, target: float = -math.inf) -> None:
        self.problem, self.budget, self.price, self.target = problem, evaluations, price, target
        self.evaluations = self.gradient_evaluations = 0
        self.best = math.inf
        self.log = Log()

    @property
    def dimension(self) -> int:
        return self.problem.dimension

    @property
    def centre(self) -> np.ndarray:
        """(G,) where methods that begin at one point begin: the problem's start, or the middle of the box."""
        start = getattr(self.problem, "start", None) if self.spread_given else None
        return np.full(self.dimension, 0.5) if start is None else start.double().cpu().numpy()

    @property
    def spread(self) -> float:
        """Standard deviation of the points that searches begin with; where they lie anywhere in the box, a quarter."""
        return float(self.problem.spread) if self.spread_given else 0.25  # type: ignore[attr-defined]

    @property
    def spread_given(self) -> bool:
        return getattr(self.problem, "spread", None) is not None

    @property
    def starts(self) -> int:
        """Descents side by side that suit the problem."""
        return int(getattr(self.problem, "starts", 16))

    def first(self, rows: int, generator: torch.Generator) -> np.ndarray:
        """(rows, G) points to begin with, drawn as hopdiff's own searches draw theirs."""
        return Box.of(self.problem).first(rows, generator).double().cpu().numpy()

    def evaluate(self, points: np.ndarray, with_grad: bool) -> Eval:
        """Price points (P, G), clipped to the box. Raises Spent, the affordable part counted, if P is too many."""
        genes = torch.from_numpy(np.array(points, dtype=np.float64)).clamp(0.0, 1.0)
        genes = genes.to(self.problem.device, self.problem.dtype)
        spent = self.evaluations + self.price * self.gradient_evaluations
        rows = min(len(genes), int((self.budget - spent) / (1.0 + self.price * with_grad)))
        if rows <= 0:
            raise Spent
        found = self.problem.evaluate(genes[:rows], with_grad)
        self.evaluations += rows
        self.gradient_evaluations += rows * with_grad
        cost = found.cost.where(found.cost.isfinite(), math.inf)
        winner = int(cost.argmin())
        self.best = min(self.best, float(cost[winner]))
        self.log.enter(self.evaluations, self.gradient_evaluations, self.best, genes[winner].clone())
        if rows < len(genes) or self.best <= self.target:
            raise Spent
        return found

    def values(self, points: np.ndarray) -> np.ndarray:
        """(P,) finite values of points (P, G) without gradient; see `finite_values`."""
        found = self.evaluate(points, False)
        return finite_values(found.cost, found.merit)


def finite_values(cost: Tensor, merit: Tensor) -> np.ndarray:
    """(P,) costs for libraries that know no infinity.

    Possible runs keep their cost. Impossible ones come after all of them, BEYOND to twice that, in the order of their
    merit; those of which nothing can be computed at twice BEYOND.
    """
    bounded = merit.double().clamp(min=0.0)
    order = torch.where(bounded.isfinite(), bounded / (1.0 + bounded), 1.0)
    values = torch.where(cost.isfinite(), cost.double(), BEYOND * (1.0 + order))
    found: np.ndarray = values.cpu().numpy()
    return found
