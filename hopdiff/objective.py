"""The objective as a list of rows: what the search prices, the metrics tell, the history keeps and the plots show."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Any

from torch import Tensor

from hopdiff.messages import near
from hopdiff.types import HopdiffError

VIEWS = {"body": ("body",), "hopper": ("smooth", "thesis")}  # what candidates are seen as -> the models that make it


@dataclass(frozen=True)
class Term:
    """One row: it adds weight * value(view) to the cost of P candidates.

    value: from what the problem knows of the candidates to (P,): of model=body a `hopdiff.effort.priced.Priced`, of
    smooth and thesis a `hopdiff.costs.Judged`. It must be differentiable, and finite for every possible run.
    put_in: what kind of thing it puts into runs: "effort", "energy", "human", "style", "paper", or a word of your own.
    view: which of the two it reads: "body" or "hopper".
    residuals: from the same to (P, ...), whose squares sum to the value but for a constant. They tell a search how the
    cost bends; without them a term counts as one, its root.
    """

    name: str
    weight: float
    value: Callable[[Any], Tensor]
    put_in: str = "own"
    view: str = "body"
    residuals: Callable[[Any], Tensor] | None = None

    def __post_init__(self) -> None:
        if self.view not in VIEWS:
            raise HopdiffError(f"the view of the cost term {self.name!r} must be body or hopper, not {self.view!r}.")
        told = isinstance(self.weight, Tensor)  # as compiled kernels are
        if not told and not (isinstance(self.weight, int | float) and 0.0 <= self.weight < math.inf):
            raise HopdiffError(f"the weight of the cost term {self.name!r} must be 0 or more, not {self.weight!r}.")


def priced(terms: Iterable[Term], seen: Any, count: int) -> dict[str, Tensor]:
    """Weight times value of every term, (P,) each, by name. seen: what they read of P = `count` candidates.

    Raises HopdiffError for a term that returns something else.
    """
    found = {}
    for term in terms:
        value = term.value(seen)
        if not (isinstance(value, Tensor) and value.shape == (count,)):
            shape = tuple(value.shape) if isinstance(value, Tensor) else type(value).__name__
            raise HopdiffError(f"the cost term {term.name!r} must return a tensor of shape ({count},), not {shape}.")
        found[term.name] = term.weight * value
    return found


def residuals_of(terms: Iterable[Term], seen: Any, prices: Mapping[str, Tensor]) -> list[Tensor]:
    """(P, R) of every term, weighted, so that all their squares sum to the cost but for a constant.

    prices: what `priced` returned for the same candidates. Their gradient at 0 is no number where a term is its root.
    """
    found = []
    for term in terms:
        if term.residuals is None:
            found.append(prices[term.name].clamp_min(0.0).sqrt().unsqueeze(-1))
        else:
            found.append(term.weight**0.5 * term.residuals(seen).flatten(1))
    return found


def with_brought(
    rows: Iterable[Term],
    brought: Iterable[Term],
    extra: Mapping[str, float],
    view: str,
    given: Iterable[Term] = (),
    settings: Iterable[str] = (),
) -> list[Term]:
    """Rows with those of other packages, whose weights `extra` names (0 otherwise), and those given as objects.

    extra: weights by name that no setting of the costs is called. view: what these candidates are seen as. settings:
    names that a misspelt one may have meant. Raises HopdiffError for a name that is no row's, a weight that is no
    number of 0 or more, a row that reads the other view, or two rows of one name.
    """
    own, found = list(rows), []
    by_name = {term.name: term for term in brought}
    known = [*(row.name for row in own), *by_name]
    for name, weight in extra.items():
        if name not in known:
            raise HopdiffError(f"Unknown setting 'costs.{name}'.{near(name, [*known, *settings])}")
        if not weight >= 0.0:
            raise HopdiffError(f"costs.{name} must be a number of 0 or more, not {weight}.")
        if name in by_name:
            found.append(replace(by_name[name], weight=float(weight)))
    for term in (*found, *given):
        if term.view != view:
            models = " or ".join(VIEWS.get(term.view, (term.view,)))
            raise HopdiffError(f"the cost term {term.name!r} judges runs of model={models}, not of this one.")
    rows = [*own, *found, *given]
    names = [row.name for row in rows]
    for name in names:
        if names.count(name) > 1:
            raise HopdiffError(f"two terms of the cost are called {name!r}.")
    return rows
