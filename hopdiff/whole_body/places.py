"""Where the phases of a limb, counted on through the mirror image, lie in the period."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache

import torch
from torch import Tensor

from hopdiff.motion import SIDES
from hopdiff.whole_body.plan import Plan


@dataclass(frozen=True)
class Piece:
    """One phase of a contact or a swing: which nodes of its own are which of the period, and of which side."""

    own: slice
    period: slice
    side: int
    mirrored: bool


def pieces(plan: Plan, limb: str, phases: tuple[int, ...]) -> list[Piece]:
    """Where the phases of a limb, counted on through the mirror image, lie in the period."""
    starts = [sum(plan.nodes[:k]) for k in range(plan.count)]
    found, first = [], 0
    for phase in phases:
        place, mirrored = phase % plan.count, (phase // plan.count) % 2 == 1
        size = plan.nodes[place]
        side = SIDES.index(limb) ^ int(mirrored)
        found.append(Piece(slice(first, first + size), slice(starts[place], starts[place] + size), side, mirrored))
        first += size
    return found


class Places:
    """Where the K nodes of a contact or a swing lie among the M nodes of the period and its two sides.

    index: (K,) node of the period. sides: its K sides, 0 left, 1 right; number: the same (K,). whole: the slice of the
    period, where it is one that is not mirrored. middle: the node of the period half-way, and the sign that x has
    there. steps: (K,) 1 at nodes of the mirror image, which is a step ahead. flip, axial: (3, K) signs that vectors
    and moments change by in the mirror image. onto: (K, 2 M) to the period, left side first; both: (K, M) to the sum
    of the sides.
    """

    def __init__(self, plan: Plan, found: list[Piece], like: Tensor) -> None:
        size = sum(plan.nodes)
        index = [node for piece in found for node in range(piece.period.start, piece.period.stop)]
        sides = [piece.side for piece in found for _ in range(piece.own.start, piece.own.stop)]
        mirrored = [piece.mirrored for piece in found for _ in range(piece.own.start, piece.own.stop)]
        self.pieces, self.mirrored = found, any(mirrored)
        self.whole = found[0].period if len(found) == 1 and not self.mirrored else None
        self.middle = index[len(index) // 2], -1.0 if mirrored[len(index) // 2] else 1.0
        self.sides, self.number = sides, torch.tensor(sides, device=like.device)
        self.index = torch.tensor(index, device=like.device)
        self.steps = like.new_tensor([float(m) for m in mirrored])
        sign = 1.0 - 2.0 * self.steps
        one = torch.ones_like(sign)
        self.flip, self.axial = torch.stack((sign, one, one)), torch.stack((one, sign, sign))
        self.onto = like.new_zeros(len(index), 2 * size)
        self.onto[range(len(index)), [side * size + node for side, node in zip(sides, index, strict=True)]] = 1.0
        self.both = self.onto[:, :size] + self.onto[:, size:]

    def __iter__(self) -> Iterator[Piece]:
        return iter(self.pieces)

    def seen(self, values: Tensor) -> Tensor:
        """Values (..., M) of the period at these nodes (..., K)."""
        return values[..., self.whole] if self.whole is not None else values.index_select(-1, self.index)

    def of_both(self, values: Tensor) -> Tensor:
        """Of values (P, 2, M) of both sides those of the limb at these nodes (P, K)."""
        return values.flatten(1).index_select(-1, self.index + values.shape[-1] * self.number)


@lru_cache(maxsize=64)
def places_of(plan: Plan, limb: str, phases: tuple[int, ...], dtype: torch.dtype, device: torch.device) -> Places:
    """The places of the phases of a limb, counted on through the mirror image."""
    return Places(plan, pieces(plan, limb, phases), torch.empty(0, dtype=dtype, device=device))
