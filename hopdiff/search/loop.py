"""The one loop that drives every search, under one budget and one count."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from time import perf_counter
from typing import Any, NamedTuple

import torch
from torch import Tensor

from hopdiff.search.base import Asked, Eval, Problem, Search, check_search
from hopdiff.types import HopdiffError, Status

# Why a search ended: it had nothing more to gain, nothing more to spend, was good enough, or the user had enough.
CONVERGED, BUDGET, TARGET, USER = STOPPED = ("converged", "budget", "target", "user")


@dataclass(frozen=True)
class Budget:
    """How long a search may go on.

    evaluations: what may be spent, in value evaluations; a search that has nothing more to gain ends before.
    gradient_price: what a gradient costs on top of its value, in value evaluations (backward time / forward time).
    target: a cost that is good enough to stop at, or None.
    Raises HopdiffError if there is nothing to spend or the price is negative.
    """

    evaluations: int = 10_000
    gradient_price: float = 3.0
    target: float | None = None

    def __post_init__(self) -> None:
        if not self.evaluations >= 1:
            raise HopdiffError(f"budget.evaluations must be at least 1, not {self.evaluations}.")
        if not (math.isfinite(self.gradient_price) and self.gradient_price >= 0):
            raise HopdiffError(f"budget.gradient_price must be a number of 0 or more, not {self.gradient_price}.")

    def affordable(self, spent: float, with_grad: bool) -> int:
        """How many more rows can be paid for."""
        return int((self.evaluations - spent) / (1.0 + self.gradient_price * with_grad))


class HistoryRow(NamedTuple):
    """One step of the loop. Counts and `seconds` run from the start of the search; best, gamma and energy are those
    of the best candidate so far (inf and nan while there is none), as is terms, the named parts of its cost; median (of
    the finite costs, nan if there are none) and invalid (a share) are this step's own."""

    step: int
    evaluations: int
    gradient_evaluations: int
    spent: float
    seconds: float
    best: float
    median: float
    gamma: float
    energy: float
    invalid: float
    terms: Mapping[str, float] = {}

    def flat(self) -> dict[str, float]:
        """The row as one table, a term of the cost named cost_NAME."""
        row = {name: value for name, value in self._asdict().items() if name != "terms"}
        return row | {f"cost_{name}": value for name, value in self.terms.items() if name not in row}


@dataclass(frozen=True)
class SearchResult:
    """The best candidate and how it was come by.

    best_genes: (G,) in [0, 1]; NaN, with best_cost inf, as long as nothing valid was found (only `on_step` sees that).
    evaluations, gradient_evaluations: rows priced, and rows among them whose gradient was taken too.
    spent: evaluations + gradient_price * gradient_evaluations, the unit of the budget.
    invalid_fraction: share of all rows whose cost was not finite. statuses: how often each Status came up.
    stopped: why the search ended, one of STOPPED; "" as long as it goes on.
    """

    best_genes: Tensor
    best_cost: float
    best_terms: dict[str, float]
    best_status: Status
    history: list[HistoryRow]
    evaluations: int
    gradient_evaluations: int
    gradient_price: float
    spent: float
    seconds: float
    invalid_fraction: float
    statuses: Counter[Status]
    stopped: str

    @property
    def interrupted(self) -> bool:
        """Whether the user broke the search off (Ctrl-C, or `stop`)."""
        return self.stopped == USER


OnStep = Callable[[HistoryRow, SearchResult], None]


def run_search(
    problem: Problem,
    search: Search,
    budget: Budget,
    generator: torch.Generator,
    on_step: OnStep | None = None,
    stop: Callable[[], bool] | None = None,
) -> SearchResult:
    """Ask, evaluate, tell, until the search has nothing more to gain, its budget is spent, its target reached, or the
    user has had enough.

    The last batch is cut to what can still be paid for. A cost that is not a finite number counts as +inf. What the
    host must know of a step, the search's signals among it, is read in one transfer.
    on_step: called after every step. stop: asked after every step; True ends the search.
    Ctrl-C ends it too: the best so far is returned, or KeyboardInterrupt raised again if there is none.
    Raises HopdiffError if no valid candidate turned up.
    """
    check_search(search)
    ledger = _Ledger(problem, budget)
    finished = getattr(search, "finished", lambda state: False)
    signals, steered = getattr(search, "signals", lambda state: None), getattr(search, "steered", None)
    stopped = BUDGET
    try:
        state = search.init(problem, generator)
        while not finished(state):
            asked = _asked(search.ask(state, generator), problem.dimension)
            rows = min(len(asked.genes), budget.affordable(ledger.spent, asked.with_grad))
            if rows == 0:
                break
            whole = rows == len(asked.genes)
            evaluation = _cleaned(_evaluated(problem, asked._replace(genes=asked.genes[:rows])))
            ledger.enter(asked.genes[:rows], evaluation, asked.with_grad)
            state = search.tell(state, asked.genes, evaluation, generator) if whole else None
            wanted = signals(state) if whole else None
            row, told = ledger.read(wanted)
            if wanted is not None and steered is not None:
                state = steered(state, told)
            if on_step is not None:
                on_step(row, ledger.result(""))
            if ledger.reached_target:
                stopped = TARGET
                break
            if stop is not None and stop():
                stopped = USER
                break
            if not whole:
                break
        else:
            stopped = CONVERGED
    except KeyboardInterrupt:
        if not math.isfinite(ledger.best_cost):
            raise
        stopped = USER
    if not math.isfinite(ledger.best_cost):
        raise HopdiffError(ledger.failure)
    return ledger.result(stopped)


def _asked(answer: Any, dimension: int) -> Asked:
    """What a search asked for. Raises HopdiffError if that is no batch of points and a wish for gradients."""
    if isinstance(answer, Asked | tuple) and 2 <= len(answer) <= len(Asked._fields):
        asked = Asked(*answer)
        if isinstance(asked.genes, Tensor) and asked.genes.ndim == 2 and asked.genes.shape[1] == dimension:
            return asked._replace(with_grad=bool(asked.with_grad), with_residuals=bool(asked.with_residuals))
    raise HopdiffError(
        f"what a search asks for must be a tensor of shape (P, {dimension}) and whether its gradient is wanted."
    )


def _evaluated(problem: Problem, asked: Asked) -> Eval:
    if not asked.with_residuals:
        return problem.evaluate(asked.genes, asked.with_grad)
    residuals = getattr(problem, "residuals", None)
    if residuals is None:
        raise HopdiffError("the search asks for the residuals of the cost, which this problem does not tell.")
    about = getattr(problem, "residuals_about", None)
    # A batch that is cut has no whole groups, and none that would be told.
    whole = asked.group > 1 and len(asked.genes) % asked.group == 0
    found: Eval = about(asked.genes, asked.group) if about is not None and whole else residuals(asked.genes)
    return found


def _cleaned(evaluation: Eval) -> Eval:
    """NaN and -inf become +inf, what has no merit has no gradient, and an unexplained failure gets a status."""
    cost, grad, merit, terms, status, residuals = evaluation
    cost, merit = (x.detach().where(x.isfinite(), math.inf) for x in (cost, merit))
    if grad is not None:
        grad = grad.detach().where(merit.isfinite()[:, None], 0.0).nan_to_num(0.0, 0.0, 0.0)
    unexplained = cost.isinf() & (status == Status.OK)
    return Eval(cost, grad, merit, terms, status.masked_fill(unexplained, Status.NOT_FINITE), residuals)


class _Ledger:
    """What has been spent, and the best that was got for it. `enter` works on the device, `read` tells the host."""

    def __init__(self, problem: Problem, budget: Budget) -> None:
        self.budget = budget
        self.started = perf_counter()
        self.history: list[HistoryRow] = []
        self.evaluations = self.gradient_evaluations = self.invalid = 0
        self.statuses: Counter[Status] = Counter()
        self.best_cost = math.inf
        self.best_genes = torch.full((problem.dimension,), math.nan, dtype=problem.dtype, device=problem.device)
        self.best_terms: dict[str, float] = {}
        self.best_status = Status.NOT_FINITE
        self.codes = torch.tensor([int(code) for code in Status], device=problem.device)

    @property
    def spent(self) -> float:
        return self.evaluations + self.budget.gradient_price * self.gradient_evaluations

    @property
    def reached_target(self) -> bool:
        return self.budget.target is not None and self.best_cost <= self.budget.target

    @property
    def failure(self) -> str:
        reasons = ((count, status) for status, count in self.statuses.items() if status != Status.OK)
        sentence = max(reasons, default=(0, Status.NOT_FINITE))[1].sentence
        if self.evaluations == 0:
            return "The search asked for no candidate."
        if self.evaluations == 1:
            return f"The one candidate tried is not a possible run: {sentence}"
        return f"None of the {self.evaluations} candidates tried is a possible run, most often because: {sentence}"

    def enter(self, genes: Tensor, evaluation: Eval, with_grad: bool) -> None:
        """Count a batch, and gather on the device what `read` will want of it."""
        cost, status = evaluation.cost, evaluation.status
        self.evaluations += len(genes)
        self.gradient_evaluations += len(genes) * with_grad
        winner = cost.argmin(keepdim=True)
        valid = cost.isfinite()
        # the lower of the two in the middle; what is not finite comes last
        middle = ((valid.sum() - 1).clamp(min=0) // 2).unsqueeze(0)
        self.names = tuple(evaluation.terms)
        self.winner = genes[winner].squeeze(0).detach()
        self.entered = torch.cat(
            [
                cost[winner],
                cost.sort().values[middle],
                status[winner].to(cost),
                valid.sum().unsqueeze(0).to(cost),
                *(term[winner].detach().to(cost) for term in evaluation.terms.values()),
                (status == self.codes.unsqueeze(-1)).sum(-1).to(cost),
            ]
        )
        self.rows = len(genes)

    def read(self, signals: Tensor | None = None) -> tuple[HistoryRow, list[float]]:
        """The step that was entered last, and the search's signals (n,) beside it: one transfer to the host."""
        known = len(self.entered)
        told = self.entered if signals is None else torch.cat((self.entered, signals.to(self.entered)))
        numbers: list[float] = told.tolist()
        (cost, median, status, valid), numbers = numbers[:4], numbers[4:]
        terms, counts = numbers[: len(self.names)], numbers[len(self.names) : known - 4]
        for code, count in zip(Status, counts, strict=True):
            if count:
                self.statuses[code] += int(count)
        if cost < self.best_cost:
            self.best_cost, self.best_genes = cost, self.winner.clone()
            self.best_terms = dict(zip(self.names, terms, strict=True))
            self.best_status = Status(int(status))
        self.invalid += self.rows - int(valid)
        row = HistoryRow(
            step=len(self.history),
            evaluations=self.evaluations,
            gradient_evaluations=self.gradient_evaluations,
            spent=self.spent,
            seconds=perf_counter() - self.started,
            best=self.best_cost,
            median=median if valid else math.nan,
            gamma=self.best_terms.get("gamma", math.nan),
            energy=self.best_terms.get("energy", math.nan),
            invalid=1.0 - valid / self.rows,
            terms=self.best_terms,
        )
        self.history.append(row)
        return row, numbers[known - 4 :]

    def result(self, stopped: str) -> SearchResult:
        return SearchResult(
            best_genes=self.best_genes,
            best_cost=self.best_cost,
            best_terms=self.best_terms,
            best_status=self.best_status,
            history=self.history,
            evaluations=self.evaluations,
            gradient_evaluations=self.gradient_evaluations,
            gradient_price=self.budget.gradient_price,
            spent=self.spent,
            seconds=perf_counter() - self.started,
            invalid_fraction=self.invalid / max(self.evaluations, 1),
            statuses=Counter(self.statuses),
            stopped=stopped,
        )
