"""The objective as a list of rows: what the search prices, the metrics tell, the history keeps and the plots show."""

from __future__ import annotations

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
    """

    name: str
    weight: float
    value: Callable[[Any], Tensor]
    put_in: str = "own"
    view: str = "body"


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
