"""The lowest point of a quadratic model within the box, and how a model learns from a step; many rows side by side."""

from __future__ import annotations

import torch
from torch import Tensor

POWELL = 0.2  # share of the model's curvature that an update keeps at least
PASSES = 8  # rounds of finding out which genes end on a bound


def updated(hessian: Tensor, moved: Tensor, bent: Tensor) -> Tensor:
    """(P, G, G) the damped BFGS update after a step `moved` that bent the gradient by `bent`, both (P, G): Nocedal and
    Wright, Numerical Optimization (2006), procedure 18.2. A positive definite model stays so."""
    known = times(hessian, moved)
    curvature = (moved * bent).sum(-1)
    expected = (moved * known).sum(-1)
    damped = (1 - POWELL) * expected / (expected - curvature)
    damping = torch.where(curvature >= POWELL * expected, 1.0, damped)
    bent = damping[:, None] * bent + (1 - damping)[:, None] * known
    seen = (moved * bent).sum(-1)
    fresh = hessian + _outer(bent) / seen[:, None, None] - _outer(known) / expected[:, None, None]
    sound = (expected > 0) & (seen > 0) & fresh.isfinite().all(-1).all(-1)
    return torch.where(sound[:, None, None], fresh, hessian)


def lowest(x: Tensor, gradient: Tensor, hessian: Tensor) -> Tensor:
    """(P, G) from x to the lowest point of the quadratic model within the box; 0 at a stationary point.

    Genes whose free optimum lies outside are held on their bound, and let go again when the model pulls them back. A
    row that has settled stays as it is: all rows go through all rounds, so that the host need not know.
    """
    low, high, eye = -x, 1.0 - x, eye_like(x)
    at_low, at_high = (low == 0) & (gradient > 0), (high == 0) & (gradient < 0)
    for _ in range(PASSES):
        held = at_low | at_high
        given = torch.where(at_low, low, high).where(held, 0.0)
        pull = (gradient + times(hessian, given)).where(~held, 0.0)
        both_free = ~held[:, :, None] & ~held[:, None, :]
        factor, failed = torch.linalg.cholesky_ex(torch.where(both_free, hessian, eye))
        direction = given - torch.cholesky_solve(pull[..., None], factor).squeeze(-1)
        force = gradient + times(hessian, direction)
        at_low, at_high = (
            torch.where(at_low, force > 0, direction < low),
            torch.where(at_high, force < 0, direction > high),
        )
    direction = direction.clamp(low, high)
    # a row that has not settled is cut by the box, and what is left of its step may lead up
    downhill = ((direction * gradient).sum(-1) < 0) & (failed == 0)
    return torch.where(downhill[:, None], direction, (-gradient).clamp(low, high))


def eye_like(x: Tensor) -> Tensor:
    """(G, G) the identity for rows (P, G)."""
    return torch.eye(x.shape[-1], dtype=x.dtype, device=x.device)


def times(matrix: Tensor, vector: Tensor) -> Tensor:
    """(P, G) of matrices (P, G, G) and vectors (P, G)."""
    return (matrix @ vector[..., None]).squeeze(-1)


def _outer(v: Tensor) -> Tensor:
    return v[:, :, None] * v[:, None, :]
