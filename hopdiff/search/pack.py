"""Descents side by side with the host's view of them: what they ask for, and which of them go on."""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor

from hopdiff.search.adam import Adam
from hopdiff.search.base import Asked, Eval, Problem
from hopdiff.search.bfgs import Bfgs
from hopdiff.search.descent import Curves, joined, taken
from hopdiff.search.lm import Lm
from hopdiff.types import HopdiffError

Rows = Lm | Bfgs | Adam
KINDS: dict[str, type[Rows]] = {"lm": Lm, "bfgs": Bfgs, "adam": Adam}


class Pack(NamedTuple):
    """P descents. possible: (P,) whether each is where a candidate is possible. curves: their values after every trial.
    probing: rows that want their residuals looked at next.
    """

    descent: Rows
    possible: Tensor
    curves: Curves = Curves()
    probing: tuple[int, ...] = ()

    @classmethod
    def begin(cls, descent: Rows) -> Pack:
        """Descents that have not yet been evaluated."""
        return cls(descent, torch.zeros_like(descent.done), Curves().begun(len(descent.x)))

    def joined(self, descent: Rows) -> Pack:
        """With more descents at the end."""
        possible = torch.cat((self.possible, torch.zeros_like(descent.done)))
        return self._replace(
            descent=joined(self.descent, descent), possible=possible, curves=self.curves.begun(len(descent.x))
        )

    def take(self, rows: list[int]) -> Pack:
        """Some of them."""
        curves = self.curves._replace(values=tuple(self.curves.values[row] for row in rows))
        probing = tuple(at for at, row in enumerate(rows) if row in self.probing)
        index = self._index(rows)
        return Pack(taken(self.descent, index), self.possible[index], curves, probing)

    def ask(self) -> tuple[Tensor, bool] | Asked:
        if self.probing:
            assert isinstance(self.descent, Lm)
            probes = self.descent.probes(self._index(self.probing))
            return Asked(probes, with_residuals=True, group=probes.shape[-1] + 1)
        return self.descent.trial(), True

    def told(self, genes: Tensor, result: Eval) -> tuple[Pack, Tensor | None]:
        """After what `ask` returned was evaluated, and what the host must know now (4 P,), if anything."""
        if self.probing:
            assert isinstance(self.descent, Lm)
            return self._replace(descent=self.descent.informed(self._index(self.probing), result), probing=()), None
        assert result.grad is not None
        descent = self.descent.advance(genes, result.merit, result.grad)
        stale = descent.stale if isinstance(descent, Lm) else torch.zeros_like(descent.done)
        arrived = (descent.last if isinstance(descent, Adam) else descent.x) == genes
        possible = torch.where(arrived.all(-1), result.cost.isfinite(), self.possible)
        flags = torch.cat((descent.done, stale, possible)).to(genes)
        return self._replace(descent=descent, possible=possible), torch.cat((descent.value, flags))

    def steered(self, signals: list[float], gain: float) -> Pack:
        """Without the descents that have ended; `curves.kept` numbers those that go on. gain: see `Curves.seen`."""
        count = len(self.curves.values)
        value, done, stale, possible = (signals[k * count : (k + 1) * count] for k in range(4))
        curves = self.curves.seen(value, [flag > 0 for flag in done], [flag > 0 for flag in possible], gain)
        kept = list(curves.kept)
        descent, able = self.descent, self.possible
        if len(kept) < count:
            index = self._index(kept)
            descent, able = taken(descent, index), able[index]
        return Pack(descent, able, curves, tuple(at for at, row in enumerate(kept) if stale[row] > 0))

    def _index(self, rows: list[int] | tuple[int, ...]) -> Tensor:
        return torch.tensor(rows, dtype=torch.int64, device=self.descent.x.device)


def kind_of(method: str | None, problem: Problem) -> str:
    """The method of descent for a problem: Levenberg-Marquardt if it tells residuals and nothing else is asked for.

    Raises HopdiffError if method is "lm" and it tells none.
    """
    told = callable(getattr(problem, "residuals", None))
    if method == "lm" and not told:
        raise HopdiffError("search.method=lm needs the residuals of the cost, which this problem does not tell.")
    return method or ("lm" if told else "bfgs")


def check_method(method: str | None, known: tuple[str, ...]) -> None:
    """Raises HopdiffError for a method that there is not."""
    if method is not None and method not in known:
        raise HopdiffError(f"search.method must be one of {', '.join(known)}, not {method!r}.")
