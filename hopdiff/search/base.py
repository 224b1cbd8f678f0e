"""The contract between a search and what it searches.

A search knows nothing of running: it asks for points of the unit box and is told what they cost.
Every search is driven by the same loop (`hopdiff.search.loop`), under the same budget.
"""

from __future__ import annotations

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
    """

    cost: Tensor
    grad: Tensor | None
    merit: Tensor
    terms: dict[str, Tensor]
    status: Tensor


@runtime_checkable
class Problem(Protocol):
    """Anything that prices points of the unit box [0, 1]^G.

    It may have attributes: `start` (G,), the point that it would try first; `spread`, how far from there searches
    begin, in box widths (without it they begin anywhere in the box); `starts` and `screen`, how many descents, and
    points to take them from, suit it.
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

    ask returns (P, G) genes in [0, 1] and whether their gradient is wanted; P may change from call to call.
    tell takes exactly what ask returned. All randomness comes from the generator.
    """

    @property
    def name(self) -> str: ...

    def init(self, problem: Problem, generator: torch.Generator) -> Any: ...

    def ask(self, state: Any, generator: torch.Generator) -> tuple[Tensor, bool]: ...

    def tell(self, state: Any, genes: Tensor, result: Eval, generator: torch.Generator) -> Any: ...


def check_search(search: Any) -> None:
    """Raises HopdiffError for what does not keep the contract `Search`, as a class in the place of an object of it."""
    whole = all(callable(getattr(search, part, None)) for part in ("init", "ask", "tell"))
    if isinstance(search, type) or not (whole and isinstance(getattr(search, "name", None), str)):
        raise HopdiffError(f"a search is an object with name, init, ask and tell (hopdiff.Search), not {search!r}.")
