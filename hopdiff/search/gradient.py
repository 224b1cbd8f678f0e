"""Descents by gradients from the best of many random points."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import torch
from torch import Tensor

from hopdiff.search.adam import Adam
from hopdiff.search.base import Asked, Eval, Problem
from hopdiff.search.bfgs import Bfgs
from hopdiff.search.box import Box, best_first
from hopdiff.search.lm import OFTEN, Lm, Looks
from hopdiff.search.pack import KINDS, Pack, Rows, check_method, kind_of
from hopdiff.search.settings import require

STARTS, SCREEN, RESTARTS = 4, 64, 8  # of a problem that asks for no others
LM_PATIENCE, BFGS_PATIENCE = 3, 8


class Multistart(NamedTuple):
    """pack: the descents under way. kind: their method. waiting: (n, G) screened points, best first. screening: whether
    more are asked for next. over: whether there is nothing more to gain. signals: what the host has not read yet.
    starts, screen, restarts: the settings for this problem.
    """

    box: Box
    pack: Pack
    kind: str
    waiting: Tensor
    screening: bool
    over: bool
    signals: Tensor | None
    starts: int
    screen: int
    restarts: int


@dataclass(frozen=True)
class Gradient:
    """Random points are screened without gradient, the best become starts. Follows the merit, so that starts may be
    invalid. A descent is given up as soon as it falls too slowly to overtake the best. Others take the place of those
    that ended, until `restarts` in a row found nothing better: then the search is over.

    method: "lm" (Levenberg-Marquardt, of a problem with residuals), "bfgs" or "adam"; None: lm where it can be.
    starts: descents side by side. screen: points a screening. restarts: descents that must have been in vain. Where
    these three are None the problem says, if its method is the one that suits it, or 4, 64 and 8.
    gain: what a descent must be able to better the best by, relative to it.
    reach: length of the first step, root mean square over the genes, in box widths (bfgs).
    tolerance, patience: a descent is done after `patience` steps that each lower the merit by less than `tolerance`
    of itself (lm, bfgs; None: 3 of lm, 8 of bfgs). rate, steps: box widths a step at first, and steps a descent (adam).
    """

    name: str = "gradient"
    method: str | None = None
    starts: int | None = None
    screen: int | None = None
    restarts: int | None = None
    gain: float = 1e-3
    reach: float = 1.0
    tolerance: float = 1e-4
    patience: int | None = None
    rate: float = 0.03
    steps: int = 150

    def __post_init__(self) -> None:
        check_method(self.method, tuple(KINDS))
        if self.starts is not None:
            require("starts", self.starts, 1)
        if self.screen is not None:
            require("screen", self.screen, self.starts or 1)
        if self.restarts is not None:
            require("restarts", self.restarts, 0)
        require("gain", self.gain, 0, 1)
        require("reach", self.reach, 1e-6)
        require("tolerance", self.tolerance, 0)
        if self.patience is not None:
            require("patience", self.patience, 1)
        require("rate", self.rate, 1e-6, 1)
        require("steps", self.steps, 1)

    def init(self, problem: Problem, generator: torch.Generator) -> Multistart:
        """Raises HopdiffError if method is "lm" and the problem tells no residuals."""
        box = Box.of(problem)
        nowhere = box.uniform(0, generator)
        kind = kind_of(self.method, problem)
        # what a problem asks for goes with the method that suits it
        wishes = problem if kind == kind_of(None, problem) else None
        starts = getattr(wishes, "starts", STARTS) if self.starts is None else self.starts
        screen = getattr(wishes, "screen", SCREEN) if self.screen is None else self.screen
        restarts = getattr(wishes, "restarts", RESTARTS) if self.restarts is None else self.restarts
        require("screen", screen, starts)
        pack = Pack.begin(self.begun(kind, nowhere))
        return Multistart(box, pack, kind, nowhere, True, False, None, starts, screen, restarts)

    def ask(self, state: Multistart, generator: torch.Generator) -> tuple[Tensor, bool] | Asked:
        state = self._read(state)
        return (state.box.first(state.screen, generator), False) if state.screening else state.pack.ask()

    def tell(self, state: Multistart, genes: Tensor, result: Eval, generator: torch.Generator) -> Multistart:
        state = self._read(state)
        if state.screening:
            order = best_first(result.cost, result.merit)
            known = result.merit.isfinite().sum().to(genes.dtype).unsqueeze(0)
            return state._replace(waiting=genes[order], signals=known)
        pack, signals = state.pack.told(genes, result)
        return state._replace(pack=pack, signals=signals)

    def finished(self, state: Multistart) -> bool:
        return self._read(state).over

    def signals(self, state: Multistart) -> Tensor | None:
        return state.signals

    def steered(self, state: Multistart, signals: list[float]) -> Multistart:
        """Which descents are ended and which begun, now that the host knows how they stand."""
        state = state._replace(signals=None)
        if state.screening:
            return self._refilled(state._replace(waiting=state.waiting[: int(signals[0])], screening=False))
        return self._refilled(state._replace(pack=state.pack.steered(signals, self.gain)))

    def _read(self, state: Multistart) -> Multistart:
        return state if state.signals is None else self.steered(state, state.signals.tolist())

    def _refilled(self, state: Multistart) -> Multistart:
        pack, waiting = state.pack, state.waiting
        under_way = len(pack.curves.values)
        missing = state.starts - under_way
        if pack.curves.best is not None:
            missing = min(missing, state.restarts - pack.curves.vain - under_way)
        if missing > 0 and len(waiting):
            fresh, waiting = waiting[:missing], waiting[missing:]
            pack = pack.joined(self.begun(state.kind, fresh))
            missing -= len(fresh)
        over = missing <= 0 and not pack.curves.values
        return state._replace(pack=pack, waiting=waiting, screening=missing > 0, over=over)

    def begun(self, kind: str, x: Tensor, looks: Looks = OFTEN) -> Rows:
        """Descents from points (P, G) by the method `kind`; looks: of lm at its residuals."""
        if kind == "adam":
            return Adam.begin(x, self.rate, self.steps)
        if kind == "lm":
            return Lm.begin(x, self.tolerance, self.patience or LM_PATIENCE, looks)
        return Bfgs.begin(x, self.reach, self.tolerance, self.patience or BFGS_PATIENCE)


SEARCH = Gradient
