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

from hopdiff.search.base import Eval, Problem, Search, check_search
from hopdiff.types import HopdiffError, Status


@dataclass(frozen=True)
class Budget:
    """How long a search may go on.

    evaluations: what may be spent, in value evaluations.
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
    interrupted: whether the user broke the search off (Ctrl-C, or `stop`).
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
    interrupted: bool


OnStep = Callable[[HistoryRow, SearchResult], None]


def run_search(
    problem: Problem,
    search: Search,
    budget: Budget,
    generator: torch.Generator,
    on_step: OnStep | None = None,
    stop: Callable[[], bool] | None = None,
) -> SearchResult:
    """Ask, evaluate, tell, until the budget is spent, its target is reached, or the user has had enough.

    The last batch is cut to what can still be paid for. A cost that is not a finite number counts as +inf.
    on_step: called after every step. stop: asked after every step; True ends the search.
    Ctrl-C ends it too: the best so far is returned, or KeyboardInterrupt raised again if there is none.
    Raises HopdiffError if no valid candidate turned up.
    """
    check_search(search)
    ledger = _Ledger(problem, budget)
    interrupted = False
    try:
        state = search.init(problem, generator)
        while not ledger.reached_target:
            genes, with_grad = _asked(search.ask(state, generator), problem.dimension)
            rows = min(len(genes), budget.affordable(ledger.spent, with_grad))
            if rows == 0:
                break
            evaluation = _cleaned(problem.evaluate(genes[:rows], with_grad))
            row = ledger.enter(genes[:rows], evaluation, with_grad)
            if on_step is not None:
                on_step(row, ledger.result())
            if stop is not None and stop():
                interrupted = True
                break
            if rows < len(genes):
                break
            state = search.tell(state, genes, evaluation, generator)
    except KeyboardInterrupt:
        if not math.isfinite(ledger.best_cost):
            raise
        interrupted = True
    if not math.isfinite(ledger.best_cost):
        raise HopdiffError(ledger.failure)
    return ledger.result(interrupted)


def _asked(answer: Any, dimension: int) -> tuple[Tensor, bool]:
    """What a search asked for. Raises HopdiffError if that is no batch of points and a wish for gradients."""
    if isinstance(answer, tuple) and len(answer) == 2:
        genes, with_grad = answer
        if isinstance(genes, Tensor) and genes.ndim == 2 and genes.shape[1] == dimension:
            return genes, bool(with_grad)
    raise HopdiffError(
        f"what a search asks for must be a tensor of shape (P, {dimension}) and whether its gradient is wanted."
    )


def _cleaned(evaluation: Eval) -> Eval:
    """NaN and -inf become +inf, what has no merit has no gradient, and an unexplained failure gets a status."""
    cost, grad, merit, terms, status = evaluation
    cost, merit = (x.detach().where(x.isfinite(), math.inf) for x in (cost, merit))
    if grad is not None:
        grad = grad.detach().where(merit.isfinite()[:, None], 0.0).nan_to_num(0.0, 0.0, 0.0)
    unexplained = cost.isinf() & (status == Status.OK)
    return Eval(cost, grad, merit, terms, status.masked_fill(unexplained, Status.NOT_FINITE))


class _Ledger:
    """What has been spent, and the best that was got for it."""

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

    def enter(self, genes: Tensor, evaluation: Eval, with_grad: bool) -> HistoryRow:
        cost, status = evaluation.cost, evaluation.status
        self.evaluations += len(genes)
        self.gradient_evaluations += len(genes) * with_grad
        for code, count in zip(*(x.tolist() for x in status.unique(return_counts=True)), strict=True):
            self.statuses[Status(code)] += count
        winner = int(cost.argmin())
        if (winner_cost := float(cost[winner])) < self.best_cost:
            self.best_cost, self.best_genes = winner_cost, genes[winner].detach().clone()
            self.best_terms = {name: float(term[winner]) for name, term in evaluation.terms.items()}
            self.best_status = Status(int(status[winner]))
        valid = cost[cost.isfinite()]
        self.invalid += len(cost) - len(valid)
        row = HistoryRow(
            step=len(self.history),
            evaluations=self.evaluations,
            gradient_evaluations=self.gradient_evaluations,
            spent=self.spent,
            seconds=perf_counter() - self.started,
            best=self.best_cost,
            median=float(valid.median()) if len(valid) else math.nan,
            gamma=self.best_terms.get("gamma", math.nan),
            energy=self.best_terms.get("energy", math.nan),
            invalid=1.0 - len(valid) / len(cost),
            terms=self.best_terms,
        )
        self.history.append(row)
        return row

    def result(self, interrupted: bool = False) -> SearchResult:
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
            interrupted=interrupted,
        )
