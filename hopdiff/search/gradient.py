"""Gradient descent from many starts at once."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import torch
from torch import Tensor

from hopdiff.search.adam import Adam
from hopdiff.search.base import Eval, Problem
from hopdiff.search.bfgs import Bfgs
from hopdiff.search.box import Box, best_first
from hopdiff.search.descent import joined, taken
from hopdiff.search.settings import require
from hopdiff.types import HopdiffError

METHODS = ("bfgs", "adam")
STARTS, SCREEN = 16, 128  # of a problem that asks for no others


class Multistart(NamedTuple):
    """running: the descents under way. waiting: (n, G) screened points, best first. screening: what is asked next.
    starts, screen: how many of each."""

    box: Box
    running: Bfgs | Adam
    waiting: Tensor
    screening: bool
    starts: int
    screen: int


@dataclass(frozen=True)
class Gradient:
    """Random points are screened without gradient, the best become starts; a descent that is done makes room for the
    next best, and when none are left the screening is repeated. Follows the merit, so that starts may be invalid.

    method: "bfgs" or "adam". starts: descents side by side. screen: points a screening; where they are None the
    problem says, or 16 and 128.
    reach: length of the first step, root mean square over the genes, in box widths (bfgs).
    tolerance, patience: a descent is done after `patience` steps that each lower the merit by less than `tolerance`
    of itself (bfgs). rate, steps: box widths a step at first, and steps a descent (adam).
    """

    name: str = "gradient"
    method: str = "bfgs"
    starts: int | None = None
    screen: int | None = None
    reach: float = 1.0
    tolerance: float = 1e-4
    patience: int = 5
    rate: float = 0.03
    steps: int = 150

    def __post_init__(self) -> None:
        if self.method not in METHODS:
            raise HopdiffError(f"search.method must be one of {', '.join(METHODS)}, not {self.method!r}.")
        if self.starts is not None:
            require("starts", self.starts, 1)
        if self.screen is not None:
            require("screen", self.screen, self.starts or 1)
        require("reach", self.reach, 1e-6)
        require("tolerance", self.tolerance, 0)
        require("patience", self.patience, 1)
        require("rate", self.rate, 1e-6, 1)
        require("steps", self.steps, 1)

    def init(self, problem: Problem, generator: torch.Generator) -> Multistart:
        box = Box.of(problem)
        nowhere = box.uniform(0, generator)
        starts = getattr(problem, "starts", STARTS) if self.starts is None else self.starts
        screen = getattr(problem, "screen", SCREEN) if self.screen is None else self.screen
        require("screen", screen, starts)
        return Multistart(box, self._begin(nowhere), nowhere, True, starts, screen)

    def ask(self, state: Multistart, generator: torch.Generator) -> tuple[Tensor, bool]:
        if state.screening:
            return state.box.first(state.screen, generator), False
        return state.running.trial(), True

    def tell(self, state: Multistart, genes: Tensor, result: Eval, generator: torch.Generator) -> Multistart:
        if state.screening:
            order = best_first(result.cost, result.merit)
            return self._refilled(state._replace(waiting=genes[order[result.merit[order].isfinite()]]))
        assert result.grad is not None
        return self._refilled(state._replace(running=state.running.advance(genes, result.merit, result.grad)))

    def _refilled(self, state: Multistart) -> Multistart:
        running, waiting = state.running, state.waiting
        if running.done.any():
            running = taken(running, ~running.done)
        missing = state.starts - len(running.done)
        if missing and len(waiting):
            running = joined(running, self._begin(waiting[:missing]))
            waiting = waiting[missing:]
        return state._replace(running=running, waiting=waiting, screening=len(running.done) < state.starts)

    def _begin(self, x: Tensor) -> Bfgs | Adam:
        if self.method == "adam":
            return Adam.begin(x, self.rate, self.steps)
        return Bfgs.begin(x, self.reach, self.tolerance, self.patience)


SEARCH = Gradient
