"""Closed-form problems on the unit box, with known optima."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import torch
from torch import Tensor

from hopdiff.search.base import Eval
from hopdiff.types import Status


@dataclass
class Function:
    """f: (P, G) -> (P,) as a Problem. valid: (P, G) -> (P,) bool; where it is False the cost is +inf, the merit f.

    evaluated, differentiated: rows so far. seen: the batches, if `keep`.
    """

    f: Callable[[Tensor], Tensor]
    dimension: int
    valid: Callable[[Tensor], Tensor] | None = None
    dtype: torch.dtype = torch.float64
    device: torch.device = field(default_factory=lambda: torch.device("cpu"))
    keep: bool = False
    evaluated: int = 0
    differentiated: int = 0
    seen: list[Tensor] = field(default_factory=list)

    def evaluate(self, genes: Tensor, with_grad: bool) -> Eval:
        self.evaluated += len(genes)
        self.differentiated += len(genes) * with_grad
        if self.keep:
            self.seen.append(genes.clone())
        x = genes.detach().requires_grad_(with_grad)
        with torch.set_grad_enabled(with_grad):
            merit = self.f(x)
            grad = torch.autograd.grad(merit.sum(), x)[0] if with_grad else None
        merit = merit.detach()
        valid = torch.ones_like(merit, dtype=torch.bool) if self.valid is None else self.valid(genes)
        cost = merit.where(valid, math.inf)
        status = torch.where(valid, Status.OK, Status.LEG_FORCE).long()
        terms = {"gamma": merit, "energy": genes.sum(-1)}
        return Eval(cost, grad, merit, terms, status)


def optimum(dimension: int, low: float = 0.25, high: float = 0.75) -> Tensor:
    """(G,) a fixed point without symmetry."""
    spread = torch.frac(torch.arange(1, dimension + 1, dtype=torch.float64) * 0.618034)
    return low + (high - low) * spread


def sphere(dimension: int = 20) -> Function:
    centre = optimum(dimension)
    return Function(lambda x: (x - centre.to(x)).square().sum(-1), dimension)


def corner(dimension: int = 20) -> Function:
    """A sphere whose centre lies outside; the minimum, where half of the genes sit on a bound, has the value 0."""
    centre = optimum(dimension)
    centre[::4] = -0.2
    centre[1::4] = 1.3
    least = float((centre - centre.clamp(0, 1)).square().sum())
    return Function(lambda x: (x - centre.to(x)).square().sum(-1) - least, dimension)


def rosenbrock(dimension: int = 10) -> Function:
    """On [-2, 2]^G; minimum 0 at 1, which is 0.75 in the box."""

    def f(x: Tensor) -> Tensor:
        z = 4.0 * x - 2.0
        return (100.0 * (z[:, 1:] - z[:, :-1] ** 2) ** 2 + (1.0 - z[:, :-1]) ** 2).sum(-1)

    return Function(f, dimension)


def rotation(dimension: int) -> Tensor:
    """(G, G) a fixed orthogonal matrix that mixes all axes."""
    draw = torch.randn(dimension, dimension, generator=torch.Generator().manual_seed(1), dtype=torch.float64)
    return torch.linalg.qr(draw)[0]


def ellipsoid(dimension: int = 20, condition: float = 1e4) -> Function:
    """Rotated; minimum 0 inside."""
    axes, centre = rotation(dimension), optimum(dimension)
    weight = torch.logspace(0, math.log10(condition), dimension, dtype=torch.float64)
    return Function(lambda x: (((x - centre.to(x)) @ axes.to(x)).square() * weight.to(x)).sum(-1), dimension)


def bound_ellipsoid(dimension: int = 20, condition: float = 1e4) -> Function:
    """Rotated; its minimum over the box sits on several bounds. No closed form: compare runs with one another."""
    axes, centre = rotation(dimension), optimum(dimension)
    centre[::3] = 1.2
    weight = torch.logspace(0, math.log10(condition), dimension, dtype=torch.float64)
    return Function(lambda x: (((x - centre.to(x)) @ axes.to(x)).square() * weight.to(x)).sum(-1), dimension)


def rastrigin(dimension: int = 20, height: float = 10.0) -> Function:
    """On [-5.12, 5.12]^G, shifted; minimum 0."""
    centre = optimum(dimension)

    def f(x: Tensor) -> Tensor:
        z = 10.24 * (x - centre.to(x))
        return (z**2 + height * (1.0 - torch.cos(2 * math.pi * z))).sum(-1)

    return Function(f, dimension)


def half_invalid(dimension: int = 20) -> Function:
    """An ellipsoid; every point left of the middle plane is invalid, and the minimum lies close to that plane."""
    problem = ellipsoid(dimension, 100.0)
    axis, centre = rotation(dimension)[:, 0], optimum(dimension)
    problem.valid = lambda x: (x - centre.to(x)) @ axis.to(x) >= -0.01
    return problem


def all_invalid(dimension: int = 5) -> Function:
    problem = sphere(dimension)
    problem.valid = lambda x: torch.zeros(len(x), dtype=torch.bool, device=x.device)
    return problem


def patchy(dimension: int = 10) -> Function:
    """A sphere that is not a number, and neither is its gradient, wherever the first gene exceeds 0.7."""
    inner = sphere(dimension).f
    return Function(lambda x: inner(x) + torch.where(x[:, 0] > 0.7, math.nan, 0.0) * x[:, 0], dimension)


def kinked(dimension: int = 30) -> Function:
    """What a running objective is like: squared residuals of smooth nonlinear maps of all genes, a gentle waviness,
    and one-sided penalties, a fifth of the box invalid; minimum 0."""
    axes, centre = rotation(dimension), optimum(dimension)
    weight = torch.logspace(0, 2, dimension, dtype=torch.float64)

    def f(x: Tensor) -> Tensor:
        z = (x - centre.to(x)) @ axes.to(x)
        bent = z + 0.5 * z.roll(1, -1) ** 2
        waves = 0.02 * (1.0 - torch.cos(12.0 * z)).sum(-1)
        walls = 20.0 * torch.relu(-z[:, :5] - 0.15).square().sum(-1)
        return (bent.square() * weight.to(x)).sum(-1) + waves + walls

    problem = Function(f, dimension)
    problem.valid = lambda x: ((x - centre.to(x)) @ axes.to(x))[:, :5].amin(-1) > -0.45
    return problem


@dataclass
class Squares(Function):
    """roots: (P, G) -> (P, R), whose squares sum to f."""

    roots: Callable[[Tensor], Tensor] | None = None

    def residuals(self, genes: Tensor) -> Eval:
        assert self.roots is not None
        return self.evaluate(genes, False)._replace(residuals=self.roots(genes))


def of_squares(roots: Callable[[Tensor], Tensor], dimension: int) -> Squares:
    return Squares(lambda x: roots(x).square().sum(-1), dimension, roots=roots)


def squares(dimension: int = 20) -> Squares:
    """A sphere that tells its residuals."""
    centre = optimum(dimension)
    return of_squares(lambda x: x - centre.to(x), dimension)


def rosenbrock_squares(dimension: int = 10) -> Squares:
    """`rosenbrock` with its residuals."""

    def roots(x: Tensor) -> Tensor:
        z = 4.0 * x - 2.0
        return torch.cat((10.0 * (z[:, 1:] - z[:, :-1] ** 2), 1.0 - z[:, :-1]), dim=-1)

    return of_squares(roots, dimension)


def bound_squares(dimension: int = 20, condition: float = 1e4) -> Squares:
    """`bound_ellipsoid` with its residuals."""
    axes, centre = rotation(dimension), optimum(dimension)
    centre[::3] = 1.2
    weight = torch.logspace(0, math.log10(condition), dimension, dtype=torch.float64).sqrt()
    return of_squares(lambda x: ((x - centre.to(x)) @ axes.to(x)) * weight.to(x), dimension)
