"""Kernels with the numbers of one problem put in: candidates are solved and priced by them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import torch
from torch import Tensor

from hopdiff.effort.pricing import Bill
from hopdiff.effort.terms import ASKING, ORDINARY_TARGET
from hopdiff.kernels.numbers import numbers_of, packed
from hopdiff.kernels.pieces import Told
from hopdiff.kernels.store import MOST, Kernel
from hopdiff.whole_body.anchor import Anchor
from hopdiff.whole_body.fixed_point import fixed_point


@dataclass(frozen=True, eq=False)
class Bound:
    """kernels: by piece, of the structure of `told`."""

    kernels: Mapping[str, Kernel]
    told: Told

    @cached_property
    def _numbers(self) -> list[Tensor]:
        plain, tensors, _ = numbers_of(self.told)
        return [packed(plain, self.told.numbers.muscles.give), *tensors]

    @cached_property
    def _names(self) -> list[str]:
        return self.told.terms()

    def call(self, piece: str, each: Sequence[Tensor], shared: Sequence[Tensor] = ()) -> list[Tensor]:
        """What a piece gives. each: (P, ...) of every candidate; shared: of all of them together."""
        count = each[0].shape[0]
        if count > MOST:
            parts = zip(*(x.split(MOST) for x in each), strict=True)
            found = zip(*(self.call(piece, part, shared) for part in parts), strict=True)
            return [torch.cat(one) for one in found]
        # The kernels' loops are for two candidates and more.
        own = [x.expand(2, *x.shape[1:]) if count == 1 else x for x in each]
        # Nor do they ask how their inputs lie in memory.
        whole = self.kernels[piece]([x.contiguous() for x in (*own, *shared, *self._numbers)])
        return [x[:count] for x in whole] if count == 1 else whole

    def rounds(self, values: Tensor) -> Callable[[Tensor, Tensor], Tensor]:
        """`Movement.round` of candidates with those values (P, G), with a gradient where one is recorded."""

        def one_round(state: Tensor, told: Tensor) -> Tensor:
            found: Tensor = _Round.apply(self, values, state, told)  # type: ignore[no-untyped-call]
            return found

        return one_round

    def solve(
        self, values: Tensor, anchor: Anchor, rounds: int, adjoint_rounds: int = 0, start: Tensor | None = None
    ) -> tuple[Tensor, Tensor]:
        """`Movement.solve` of candidates with those values (P, G)."""
        with torch.no_grad():
            start = anchor.near(values) if start is None else start
        one_round = self.rounds(values)
        return fixed_point(start, one_round, lambda _: anchor.told, rounds, adjoint_rounds, anchor.answer)

    def price(
        self, values: Tensor, anchor: Anchor, rounds: int, adjoint_rounds: int, start: Tensor | None = None
    ) -> Bill:
        """Solve and price candidates; values: (P, G). With adjoint_rounds the merit carries its gradient."""
        state, moved = self.solve(values, anchor, rounds, adjoint_rounds, start)
        if not adjoint_rounds:
            merit, status, terms, residuals = self.call("roots", (values, state, moved))
            return Bill(merit, self._named(terms), status, moved, residuals)
        merit, status, terms = _Price.apply(self, values, state, moved)  # type: ignore[no-untyped-call]
        return Bill(merit, self._named(terms), status, moved)

    def _named(self, terms: Tensor) -> dict[str, Tensor]:
        named = dict(zip(self._names, terms.unbind(-1), strict=True))
        if not self.told.asks:
            named["energy"] = torch.full_like(named["energy"], ORDINARY_TARGET)
            for name in ASKING:
                named.pop(name, None)
        return named


class _Round(torch.autograd.Function):
    """The next state, and what a push on it means for the state before and for the values."""

    @staticmethod
    def forward(ctx: Any, kernels: Bound, values: Tensor, state: Tensor, told: Tensor) -> Tensor:
        ctx.kernels = kernels
        ctx.save_for_backward(values, state, told)
        return kernels.call("round", (values, state), (told,))[0]

    @staticmethod
    def backward(ctx: Any, *push: Tensor) -> tuple[None, Tensor, Tensor, None]:
        values, state, told = ctx.saved_tensors
        by_state, by_values = ctx.kernels.call("pull", (values, state, push[0]), (told,))
        return None, by_values, by_state, None


class _Price(torch.autograd.Function):
    """Merit, status and terms; of these the merit has a gradient."""

    @staticmethod
    def forward(
        ctx: Any, kernels: Bound, values: Tensor, state: Tensor, moved: Tensor
    ) -> tuple[Tensor, Tensor, Tensor]:
        merit, status, terms, by_state, by_values = kernels.call("slopes", (values, state, moved))
        ctx.save_for_backward(by_values, by_state)
        ctx.mark_non_differentiable(status, terms)
        return merit, status, terms

    @staticmethod
    def backward(ctx: Any, *push: Tensor) -> tuple[None, Tensor, Tensor, None]:
        by_values, by_state = ctx.saved_tensors
        share = push[0].unsqueeze(-1)
        return None, share * by_values, share * by_state, None
