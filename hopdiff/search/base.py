"""The contract between a search and what it searches.

A search knows nothing of running: it asks for points of the unit box and is told what they cost.
Every search is driven by the same loop (`hopdiff.search.loop`), under the same budget.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple, Protocol, runtime_checkable

import torch
from torch import Tensor

from hopdiff.types import HopdiffError


class Eval(NamedTuple):
    """What a population costs.

    cost: (P,), lower is better, +inf where the candidate is not a possible run (elimination).
    grad: (P, G) gradient of `merit` with respect to the unit-box genes, or None if not asked for;
        finite everywhere (zero where `merit` is not finite).
    merit: (P,) the smooth objective that gradients follow: equal to `cost` for a candidate well inside
        all constraints, with penalties added near and beyond them; +inf where nothing can be computed.
    terms: named parts of the cost, each (P,), for the history (at least "gamma" and "energy").
    status: (P,) int64, a `hopdiff.types.Status`.
    residuals: (P, R) whose squares sum to `merit`, about and but for a constant, or None if not asked for.
    """

    cost: Tensor
    grad: Tensor | None
    merit: Tensor
    terms: dict[str, Tensor]
    status: Tensor
    residuals: Tensor | None = None


def joined(parts: Sequence[Eval]) -> Eval:
    """The evaluations of all parts of a population, one after the other."""
    if len(parts) == 1:
        return parts[0]

    def row(values: list[Tensor | None]) -> Tensor | None:
        known = [value for value in values if value is not None]
        return torch.cat(known) if known else None

    return Eval(
        cost=torch.cat([part.cost for part in parts]),
        grad=row([part.grad for part in parts]),
        merit=torch.cat([part.merit for part in parts]),
        terms={name: torch.cat([part.terms[name] for part in parts]) for name in parts[0].terms},
        status=torch.cat([part.status for part in parts]),
        residuals=row([part.residuals for part in parts]),
    )


class Asked(NamedTuple):
    """What a search wants to know: genes (P, G) of the unit box, and what of them besides cost and merit. A plain pair
    (genes, with_grad) says the same without residuals; gradient and residuals are not to be had at once.

    group: candidates whose residuals are wanted come in groups of so many, each about its first.
    """

    genes: Tensor
    with_grad: bool = False
    with_residuals: bool = False
    group: int = 1


@runtime_checkable
class Problem(Protocol):
    """Anything that prices points of the unit box [0, 1]^G.

    It may have attributes: `start` (G,), the point that it would try first; `spread`, how far from there searches
    begin, in box widths (without it they begin anywhere in the box); `starts`, `screen` and `restarts`, which settings
    of the search `gradient` suit it.

    A problem whose merit is a sum of squares may have a method `residuals(genes) -> Eval`: what `evaluate` returns
    without gradient, with `Eval.residuals`. Their number R may be any, but the same for every candidate. A sum of
    squares tells its curvature: with it descents take a fraction of the steps (`hopdiff.search.lm`). A method
    `residuals_about(genes, group) -> Eval` may do the same more quickly of candidates in groups, where only differences
    from the first of each matter.
    """

    @property
    def dimension(self) -> int: ...

    @property
    def dtype(self) -> torch.dtype: ...

    @property
    def device(self) -> torch.device: ...

    def evaluate(self, genes: Tensor, with_grad: bool) -> Eval:
        """genes: (P, G) in [0, 1]. A candidate's result never depends on its neighbours."""
        ...


class Search(Protocol):
    """State in, state out: a search object holds settings only, never progress.

    ask returns (P, G) genes in [0, 1] and whether their gradient is wanted, as a pair or as `Asked`; P may change from
    call to call. tell takes exactly what ask returned. All randomness comes from the generator.

    A search may have, besides:
    finished(state) -> bool: whether it has nothing more to gain; the loop then ends before the budget does.
    signals(state) -> Tensor (n,) and steered(state, list of n floats) -> state: what it must know on the host before
    it can ask again. The loop reads them with its own numbers in one transfer; a state that was not steered is one too.
    """

    @property
    def name(self) -> str: ...

    def init(self, problem: Problem, generator: torch.Generator) -> Any: ...

    def ask(self, state: Any, generator: torch.Generator) -> tuple[Tensor, bool] | Asked: ...

    def tell(self, state: Any, genes: Tensor, result: Eval, generator: torch.Generator) -> Any: ...


def check_search(search: Any) -> None:
    """Raises HopdiffError for what does not keep the contract `Search`, as a class in the place of an object of it."""
    whole = all(callable(getattr(search, part, None)) for part in ("init", "ask", "tell"))
    if isinstance(search, type) or not (whole and isinstance(getattr(search, "name", None), str)):
        raise HopdiffError(f"a search is an object with name, init, ask and tell (hopdiff.Search), not {search!r}.")
