"""Levenberg-Marquardt descent in the box, many starts side by side, for a merit that is a sum of squares.

How the residuals answer to every gene tells the curvature of the whole sum (Gauss and Newton), and a step goes to the
lowest point of that model within the box, damped as far as the model deserves (Marquardt 1963; Nielsen 1999). Between
two such looks, quasi-Newton updates keep the model up to date: near the end they know what Gauss and Newton leave out.
"""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor

from hopdiff.search.base import Eval
from hopdiff.search.model_step import eye_like, lowest, times, updated

FIRST_DAMPING = 0.02  # of the mean curvature along the genes
LEAST_DAMPING = 1e-12  # of the same
MISSES = 12  # failed trials in a row that end a descent


class Looks(NamedTuple):
    """When the residuals are looked at anew. A look costs as many evaluations as there are genes, and little time.

    steps: that a look serves at most. trusted: share of the promised fall below which it serves no longer. misses:
    failed trials in a row after which it does not, unless it is a fresh one.
    """

    steps: int
    trusted: float
    misses: int


OFTEN = Looks(5, 0.5, 1)  # what takes the least time


class Lm(NamedTuple):
    """P descents. x, gradient, direction: (P, G). value: (P,). model: (P, G, G), without the damping (P,).

    age: (P,) steps since the residuals were looked at; -1 before the first evaluation. stale: (P,) bool, which rows
    want a look before their next trial. misses: (P,) failed trials in a row. idle: (P,) steps in a row that lowered
    the value by less than `tolerance` of itself. done: (P,) bool: after `patience` idle steps, at a stationary point,
    or where no damping leads down. looks: when the residuals are looked at.
    """

    x: Tensor
    value: Tensor
    gradient: Tensor
    model: Tensor
    direction: Tensor
    damping: Tensor
    age: Tensor
    stale: Tensor
    misses: Tensor
    idle: Tensor
    done: Tensor
    tolerance: float
    patience: int
    looks: Looks = OFTEN

    @classmethod
    def begin(cls, x: Tensor, tolerance: float, patience: int, looks: Looks = OFTEN) -> Lm:
        """Rows (P, G) that nothing is known of: their first trial is x itself."""
        rows = len(x)
        count = torch.zeros(rows, dtype=torch.int64, device=x.device)
        return cls(
            x=x,
            value=x.new_full((rows,), torch.inf),
            gradient=torch.zeros_like(x),
            model=eye_like(x).expand(rows, -1, -1).contiguous(),
            direction=torch.zeros_like(x),
            damping=x.new_zeros(rows),
            age=count - 1,
            stale=count > 0,
            misses=count,
            idle=count,
            done=count > 0,
            tolerance=tolerance,
            patience=patience,
            looks=looks,
        )

    def trial(self) -> Tensor:
        """(P, G) points to be evaluated next, with gradient."""
        return (self.x + self.direction).clamp(0.0, 1.0)

    def advance(self, x: Tensor, value: Tensor, gradient: Tensor) -> Lm:
        """What the trial `x` (P, G), its value (P,), +inf allowed, and gradient (P, G) teach."""
        moved = x - self.x
        fresh = self.age < 0
        promised = -(moved * (self.gradient + 0.5 * times(self.model, moved))).sum(-1)
        fall = self.value - value
        kept = torch.where(value.isfinite() & (promised > 0), fall / promised, -1.0)
        accepted = value.isfinite() & (fresh | (fall > 0)) & ~self.done
        learned = accepted & ~fresh
        model = torch.where(learned[:, None, None], updated(self.model, moved, gradient - self.gradient), self.model)
        slow = learned & ~(fall > self.tolerance * value.abs())
        idle = torch.where(slow, self.idle + 1, torch.where(learned, 0, self.idle))
        misses = torch.where(accepted, 0, self.misses + 1)
        age = torch.where(accepted, self.age + 1, self.age)
        steps, trusted, often = self.looks
        still = moved.abs().amax(-1) == 0
        misled = (age > 0) & ~accepted & ((misses >= often) | still)
        old = (learned & ((age >= steps) | (kept < trusted))) | misled
        stale = ((fresh & accepted) | old) & ~self.done
        stuck = ~accepted & ~fresh & ~stale & ((misses > MISSES) | still)
        rows = self._replace(
            x=torch.where(accepted[:, None], x, self.x),
            value=torch.where(accepted, value, self.value),
            gradient=torch.where(accepted[:, None], gradient, self.gradient),
            model=model,
            damping=self.damping * _factor(kept, accepted, self.misses),
            age=age,
            stale=stale,
            misses=misses,
            idle=idle,
            done=self.done | (fresh & ~accepted) | stuck | (idle >= self.patience),
        )
        return rows._aimed()

    def probes(self, rows: Tensor) -> Tensor:
        """(K (G + 1), G) points whose residuals tell the curvature of K rows (K,): each x, and a nudge of each gene."""
        x = self.x[rows]
        nudge = _nudge(x)
        away = torch.where(x + nudge <= 1.0, nudge, -nudge)
        near = x[:, None] + torch.diag_embed(away)
        return torch.cat((x[:, None], near), dim=1).flatten(0, 1)

    def informed(self, rows: Tensor, result: Eval) -> Lm:
        """What the residuals at the probes of these rows (K,) teach. A gene whose nudge has no value tells nothing."""
        assert result.residuals is not None
        x = self.x[rows]
        count, genes = x.shape
        nudge = _nudge(x)
        away = torch.where(x + nudge <= 1.0, nudge, -nudge)
        known = result.merit.isfinite().unflatten(0, (count, genes + 1))
        residuals = result.residuals.unflatten(0, (count, genes + 1))
        slope = (residuals[:, 1:] - residuals[:, :1]) / away[..., None]
        sound = known[:, 1:] & known[:, :1] & slope.isfinite().all(-1)
        slope = torch.where(sound[..., None], slope, 0.0)
        found = 2.0 * slope @ slope.transpose(1, 2)
        mean = found.diagonal(dim1=1, dim2=2).mean(-1).clamp(min=torch.finfo(x.dtype).tiny)
        damping = self.damping[rows]
        first = damping == 0
        damping = torch.where(first, FIRST_DAMPING * mean, torch.maximum(damping, LEAST_DAMPING * mean))
        informed = self._replace(
            model=self.model.index_copy(0, rows, found),
            damping=self.damping.index_copy(0, rows, damping),
            age=self.age.index_fill(0, rows, 0),
            stale=self.stale.index_fill(0, rows, False),
        )
        return informed._aimed()

    def _aimed(self) -> Lm:
        """With the directions of the model, and the end of rows that it promises nothing."""
        damped = self.model + self.damping[:, None, None] * eye_like(self.x)
        direction = lowest(self.x, self.gradient, damped)
        promised = -(direction * self.gradient).sum(-1)
        flat = promised <= torch.finfo(self.x.dtype).eps * self.value.abs()
        return self._replace(direction=direction, done=self.done | (flat & ~self.stale))


def _factor(kept: Tensor, accepted: Tensor, misses: Tensor) -> Tensor:
    """(P,) of the damping, after a trial that kept a share of its promise; misses (P,) in a row before it."""
    better = torch.where(kept > 0.75, 0.2, torch.where(kept > 0.5, 0.6, torch.where(kept > 0.25, 1.0, 3.0)))
    return torch.where(accepted, better, 4.0 * 2.0 ** misses.clamp(max=8)).to(kept.dtype)


def _nudge(x: Tensor) -> float:
    return float(torch.finfo(x.dtype).eps ** 0.25)
