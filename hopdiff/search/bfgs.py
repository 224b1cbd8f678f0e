"""Quasi-Newton descent in the box, many starts side by side, as trial points and their answers.

Every row goes its own way: its own model of the curvature, step length, and end. A row never waits for another.
"""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor

ARMIJO = 1e-4  # share of the promised fall that a step must bring
POWELL = 0.2  # share of the model's curvature that an update keeps at least
BACKTRACKS = 12  # trials of one step before the model is thrown away
PASSES = 8  # rounds, at most, of finding out which genes end on a bound


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
        updated = _updated(hessian, moved, gradient - self.gradient)
        hessian = torch.where(learned[:, None, None], updated, hessian)
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
        hessian = torch.where(anew[:, None, None], steepness[:, None, None] * _eye(x), hessian)
        turned = accepted | lost
        direction = torch.where(turned[:, None], _direction(now_x, now_gradient, hessian), self.direction)
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


def _updated(hessian: Tensor, moved: Tensor, bent: Tensor) -> Tensor:
    """(P, G, G) the damped BFGS update after a step `moved` that bent the gradient by `bent`, both (P, G)."""
    known = _times(hessian, moved)
    curvature = (moved * bent).sum(-1)
    expected = (moved * known).sum(-1)
    damped = (1 - POWELL) * expected / (expected - curvature)
    damping = torch.where(curvature >= POWELL * expected, 1.0, damped)
    bent = damping[:, None] * bent + (1 - damping)[:, None] * known
    seen = (moved * bent).sum(-1)
    fresh = hessian + _outer(bent) / seen[:, None, None] - _outer(known) / expected[:, None, None]
    sound = (expected > 0) & (seen > 0) & fresh.isfinite().all(-1).all(-1)
    return torch.where(sound[:, None, None], fresh, hessian)


def _eye(like: Tensor) -> Tensor:
    return torch.eye(like.shape[-1], dtype=like.dtype, device=like.device)


def _times(matrix: Tensor, vector: Tensor) -> Tensor:
    return (matrix @ vector[..., None]).squeeze(-1)


def _outer(v: Tensor) -> Tensor:
    return v[:, :, None] * v[:, None, :]


def _direction(x: Tensor, gradient: Tensor, hessian: Tensor) -> Tensor:
    """(P, G) from x to the lowest point of the quadratic model within the box; 0 at a stationary point.

    Genes whose free optimum lies outside are held on their bound, and let go again when the model pulls them back.
    """
    low, high, eye = -x, 1.0 - x, _eye(x)
    at_low, at_high = (low == 0) & (gradient > 0), (high == 0) & (gradient < 0)
    for _ in range(PASSES):
        held = at_low | at_high
        given = torch.where(at_low, low, high).where(held, 0.0)
        pull = (gradient + _times(hessian, given)).where(~held, 0.0)
        both_free = ~held[:, :, None] & ~held[:, None, :]
        factor, failed = torch.linalg.cholesky_ex(torch.where(both_free, hessian, eye))
        direction = given - torch.cholesky_solve(pull[..., None], factor).squeeze(-1)
        force = gradient + _times(hessian, direction)
        low_now = torch.where(at_low, force > 0, direction < low)
        high_now = torch.where(at_high, force < 0, direction > high)
        settled = torch.equal(low_now, at_low) and torch.equal(high_now, at_high)
        at_low, at_high = low_now, high_now
        if settled:
            break
    direction = direction.clamp(low, high)
    # a row that has not settled is cut by the box, and what is left of its step may lead up
    downhill = ((direction * gradient).sum(-1) < 0) & (failed == 0)
    return torch.where(downhill[:, None], direction, (-gradient).clamp(low, high))
