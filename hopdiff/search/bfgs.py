"""Quasi-Newton descent in the box, many starts side by side, as trial points and their answers.

Every row goes its own way: its own model of the curvature, step length, and end. A row never waits for another.
"""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor

from hopdiff.search.model_step import eye_like, lowest, updated

ARMIJO = 1e-4  # share of the promised fall that a step must bring
BACKTRACKS = 12  # trials of one step before the model is thrown away


class Bfgs(NamedTuple):
    """P descents. x, gradient, direction: (P, G). value, step: (P,). hessian: (P, G, G), positive definite.

    age: (P,) steps since the Hessian was last set back; -1 before the first evaluation. misses: (P,) failed trials of
    the present step. idle: (P,) steps in a row that lowered the value by less than `tolerance` of itself.
    done: (P,) bool: after `patience` idle steps, at a stationary point, or when not even the steepest way leads down.
    reach: RMS length, in box widths, of the first step in a box without bounds.
    """

    x: Tensor
    value: Tensor
    gradient: Tensor
    hessian: Tensor
    direction: Tensor
    step: Tensor
    age: Tensor
    misses: Tensor
    idle: Tensor
    done: Tensor
    reach: float
    tolerance: float
    patience: int

    @classmethod
    def begin(cls, x: Tensor, reach: float, tolerance: float, patience: int) -> Bfgs:
        """Rows (P, G) that nothing is known of: their first trial is x itself."""
        rows, genes = x.shape
        count = torch.zeros(rows, dtype=torch.int64, device=x.device)
        return cls(
            x=x,
            value=x.new_full((rows,), torch.inf),
            gradient=torch.zeros_like(x),
            hessian=torch.eye(genes, dtype=x.dtype, device=x.device).expand(rows, -1, -1).contiguous(),
            direction=torch.zeros_like(x),
            step=x.new_ones(rows),
            age=count - 1,
            misses=count,
            idle=count,
            done=torch.zeros(rows, dtype=torch.bool, device=x.device),
            reach=reach,
            tolerance=tolerance,
            patience=patience,
        )

    def trial(self) -> Tensor:
        """(P, G) points to be evaluated next."""
        return (self.x + self.step[:, None] * self.direction).clamp(0.0, 1.0)

    def advance(self, x: Tensor, value: Tensor, gradient: Tensor) -> Bfgs:
        """What the trial `x` (P, G), its value (P,), +inf allowed, and gradient (P, G) teach."""
        moved = x - self.x
        slope = (self.gradient * moved).sum(-1)
        fresh = self.age < 0
        accepted = value.isfinite() & (fresh | (value <= self.value + ARMIJO * slope)) & ~self.done
        learned = accepted & ~fresh
        hessian, age = self.hessian, self.age
        bent = gradient - self.gradient
        hessian = torch.where(learned[:, None, None], updated(hessian, moved, bent), hessian)
        fall = self.value - value
        slow = learned & ~(fall > self.tolerance * value.abs())
        idle = torch.where(slow, self.idle + 1, torch.where(learned, 0, self.idle))
        misses = torch.where(accepted, 0, self.misses + 1)
        # no way down with this model: start afresh from the gradient, once
        lost = (misses > BACKTRACKS) | (~accepted & ~fresh & (moved.abs().amax(-1) == 0))
        hopeless = (lost & (age == 0)) | (fresh & ~accepted)
        age = torch.where(accepted, age + 1, torch.where(lost, 0, age))
        misses = torch.where(lost, 0, misses)
        now_x = torch.where(accepted[:, None], x, self.x)
        now_gradient = torch.where(accepted[:, None], gradient, self.gradient)
        now_value = torch.where(accepted, value, self.value)
        anew = (accepted | lost) & (age == 0)
        steepness = (now_gradient.square().mean(-1).sqrt() / self.reach).clamp(min=torch.finfo(x.dtype).tiny)
        hessian = torch.where(anew[:, None, None], steepness[:, None, None] * eye_like(x), hessian)
        turned = accepted | lost
        direction = torch.where(turned[:, None], lowest(now_x, now_gradient, hessian), self.direction)
        shorter = _shorter(self.step, value - self.value, slope)
        promised = -(direction * now_gradient).sum(-1)
        stationary = turned & (promised <= torch.finfo(x.dtype).eps * now_value.abs())
        return self._replace(
            x=now_x,
            value=now_value,
            gradient=now_gradient,
            hessian=hessian,
            direction=direction,
            step=torch.where(turned, 1.0, shorter),
            age=age,
            misses=misses,
            idle=idle,
            done=self.done | hopeless | stationary | (idle >= self.patience),
        )


def _shorter(step: Tensor, rise: Tensor, slope: Tensor) -> Tensor:
    """(P,) the next step length to try: where a parabola has its bottom, within a tenth to a half of this one."""
    bottom = -0.5 * slope / (rise - slope)
    factor = torch.where(rise.isfinite() & bottom.isfinite(), bottom, 0.25)
    return step * factor.clamp(0.1, 0.5)
