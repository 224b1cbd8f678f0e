"""What the gradient methods have in common: descents side by side, one row each, that can be taken out and put in."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple, Protocol, Self, TypeVar

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


PROVEN = 6  # trials that a descent is given before it is judged


class Curves(NamedTuple):
    """How descents stand, on the host. values: merit of each one under way after every trial. best: lowest merit of
    those that ended at a possible candidate, None before. vain: how many have ended since one found something better.
    kept: numbers, among those before the last look, of the ones still under way.
    """

    values: tuple[tuple[float, ...], ...] = ()
    best: float | None = None
    vain: int = 0
    kept: tuple[int, ...] = ()

    def begun(self, count: int) -> Curves:
        """With so many new descents at the end."""
        return self._replace(values=self.values + ((),) * count)

    def seen(self, values: Sequence[float], done: Sequence[bool], possible: Sequence[bool], gain: float) -> Curves:
        """After one more trial of each. A descent ends when it is done, or so far behind that it would have to fall by
        more than in the last third of its trials to better the best by the share `gain`.

        possible: whether each is where a candidate is possible; others hold nobody back.
        """
        curves = [(*curve, value) for curve, value in zip(self.values, values, strict=True)]
        best, vain, kept = self.best, self.vain, []
        able = [value for value, flag in zip(values, possible, strict=True) if flag]
        leader = min(able + ([] if best is None else [best]), default=math.inf)
        for row, curve in enumerate(curves):
            value = curve[-1]
            ahead = value - (curve[2 * len(curve) // 3] - value)
            behind = len(curve) >= PROVEN and value > leader and not _better(ahead, leader, gain)
            if not (done[row] or behind):
                kept.append(row)
            elif possible[row] and (best is None or _better(value, best, gain)):
                best, vain = value, 0
            else:
                best, vain = min(best, value) if possible[row] and best is not None else best, vain + 1
        return Curves(tuple(curves[row] for row in kept), best, vain, tuple(kept))


def _better(value: float, best: float, gain: float) -> bool:
    """Whether a value betters the best by a share of it."""
    return math.isfinite(value) and not value >= best - gain * abs(best)
