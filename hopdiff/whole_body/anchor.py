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

from hopdiff.whole_body.fixed_point import fixed_point
from hopdiff.whole_body.movement import Movement

SOLVING = 60  # rounds of the movement itself
SOLVED = 1e-6  # m and rad that its last round may go
NUDGE = 1e-6  # of differences, in m, rad, s

Genes = dict[str, Tensor]
Rounds = Callable[[Tensor], Callable[[Tensor, Tensor], Tensor]]


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
    def of(cls, made: Callable[[Genes], Movement], genes: Genes, rounds: Rounds | None = None) -> Anchor | None:
        """The anchor at genes (1,) of movements that `made` makes of genes; None where that movement is not solved.

        rounds: from values (P, G) in the order of the genes to what `Movement.round` of them is, where something
        quicker than that does it.
        """
        with torch.no_grad():
            values = torch.stack(list(genes.values()), dim=-1)
            each: Rounds = rounds or (lambda many: made(dict(zip(genes, many.unbind(-1), strict=True))).round)
            own, one_round = made(genes), each(values)
            state, moved = fixed_point(own.start(), one_round, own.inverse_inertia, SOLVING, 0)
            if not bool(moved < SOLVED):
                return None
            told = own.inverse_inertia(state)
            size, count = state.shape[-1], values.shape[-1]
            nudged = state + NUDGE * torch.eye(size, dtype=state.dtype, device=state.device)
            still = one_round(state, told)
            # (K, K): row k, what number k of the state does
            bends = (each(values.expand(size, -1))(nudged, told) - still) / NUDGE
            turned = values + NUDGE * torch.eye(count, dtype=state.dtype, device=state.device)
            pushes = (each(turned)(state.expand(count, -1), told) - still) / NUDGE
            answer = torch.linalg.inv(torch.eye(size, dtype=state.dtype, device=state.device) - bends)
            if not bool(answer.isfinite().all()):
                return None
            return cls(values, state, told, pushes @ answer, answer)

    def near(self, values: Tensor) -> Tensor:
        """(P, K) the state of movements of similar genes (P, G), taken for linear."""
        return self.beside(self.state, values - self.genes)

    def beside(self, state: Tensor, moved: Tensor) -> Tensor:
        """(P, K) the state of movements whose values lie `moved` (P, G) beside those of solved ones (P or 1, K)."""
        return state + moved @ self.slopes

    def guess(self, genes: Genes) -> Tensor:
        """The same of genes (P,) by name."""
        return self.near(torch.stack(list(genes.values()), dim=-1))
