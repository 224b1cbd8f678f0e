"""One movement, solved and linearised, from which those of similar genes are guessed and their solution is guided.

The body's fixed point takes many rounds from a crude guess. Beside a movement whose answer to every gene, and whose
rounds' answer to every number of the state, is known, a guess is close and a round corrects nearly all of what is left
(Newton's method with one Jacobian for all: Kelley 1995, section 5.4). What is found is the same; only the way there is
shorter.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import torch
from torch import Tensor

from hopdiff.whole_body.movement import Movement

SOLVING = 60  # rounds of the movement itself
SOLVED = 1e-6  # m and rad that its last round may go
NUDGE = 1e-6  # of differences, in m, rad, s

Genes = dict[str, Tensor]


@dataclass(frozen=True, eq=False)
class Anchor:
    """genes: (1, G) in SI units and rad, in the order of their names. state: (1, K). told: see `Movement.round`.
    slopes: (G, K) of the solved state by the genes. answer: (K, K) what a state has to change for a round's step of 1
    to vanish.
    """

    genes: Tensor
    state: Tensor
    told: Tensor
    slopes: Tensor
    answer: Tensor

    @classmethod
    def of(cls, made: Callable[[Genes], Movement], genes: Genes) -> Anchor | None:
        """The anchor at genes (1,) of movements that `made` makes of genes; None where that movement is not solved."""
        with torch.no_grad():
            own = made(genes)
            state, moved = own.solve(SOLVING)
            if not bool(moved < SOLVED):
                return None
            told = own.inverse_inertia(state)
            values = torch.stack(list(genes.values()), dim=-1)
            size, count = state.shape[-1], values.shape[-1]
            many = made({name: value.expand(size) for name, value in genes.items()})
            nudged = state + NUDGE * torch.eye(size, dtype=state.dtype, device=state.device)
            still = own.round(state, told)
            bends = (many.round(nudged, told) - still) / NUDGE  # (K, K): row k, what number k of the state does
            turned = values + NUDGE * torch.eye(count, dtype=state.dtype, device=state.device)
            others = made(dict(zip(genes, turned.unbind(-1), strict=True)))
            pushes = (others.round(state.expand(count, -1), told) - still) / NUDGE
            answer = torch.linalg.inv(torch.eye(size, dtype=state.dtype, device=state.device) - bends)
            if not bool(answer.isfinite().all()):
                return None
            return cls(values, state, told, pushes @ answer, answer)

    def guess(self, genes: Genes) -> Tensor:
        """(P, K) the state of movements of similar genes (P,), taken for linear."""
        return self.state + (torch.stack(list(genes.values()), dim=-1) - self.genes) @ self.slopes
