"""What the gradient methods have in common: descents side by side, one row each, that can be taken out and put in."""

from __future__ import annotations

from typing import Any, Protocol, Self, TypeVar

import torch
from torch import Tensor


class Descent(Protocol):
    """P descents, each at its own point x (P, G) with merit value (P,); done (P,) ones have nowhere left to go."""

    @property
    def x(self) -> Tensor: ...

    @property
    def value(self) -> Tensor: ...

    @property
    def done(self) -> Tensor: ...

    def trial(self) -> Tensor:
        """(P, G) points in the box to be evaluated next."""
        ...

    def advance(self, x: Tensor, value: Tensor, gradient: Tensor) -> Self:
        """The descents after the trial x (P, G) turned out to have value (P,), +inf allowed, and gradient (P, G)."""
        ...


Rows = TypeVar("Rows", bound=tuple[Any, ...])


def taken(rows: Rows, index: Tensor) -> Rows:
    """The rows of a NamedTuple of tensors that a mask or an index (P,) points at; plain fields stay."""
    return type(rows)(*(field[index] if isinstance(field, Tensor) else field for field in rows))


def joined(first: Rows, second: Rows) -> Rows:
    """The rows of both."""
    pairs = zip(first, second, strict=True)
    return type(first)(*(torch.cat(pair) if isinstance(pair[0], Tensor) else pair[0] for pair in pairs))
