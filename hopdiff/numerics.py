"""Numerical building blocks: guards against NaN gradients, Chebyshev nodes, cubic pieces.

Every guard lives here, so that the physics can be read without them.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import torch
from torch import Tensor

GRAVITY = 9.81  # m/s^2, magnitude
DEGREE = np.pi / 180.0  # rad


def absent(number: float | Tensor) -> bool:
    """Whether a setting is 0, so that what it weighs can be left out. A number that a compiled kernel is told may be
    anything, and is a tensor: never."""
    return not isinstance(number, Tensor) and number == 0.0


def safe_sqrt(x: Tensor, floor: float = 1e-12) -> Tensor:
    """Square root whose value and gradient stay finite for x <= 0 (there it is the constant sqrt(floor))."""
    return torch.sqrt(x.clamp_min(floor))


def safe_acos(x: Tensor, margin: float = 1e-9) -> Tensor:
    """acos whose gradient stays finite at and beyond +-1."""
    return torch.acos(x.clamp(-1.0 + margin, 1.0 - margin))


def smooth_max(a: Tensor, b: Tensor | float, width: float) -> Tensor:
    """Upper envelope of two values, rounded over about `width` where they meet; never below either."""
    return 0.5 * (a + b + torch.sqrt((a - b) ** 2 + width**2))


@lru_cache(maxsize=256)
def constant(values: tuple[float, ...], dtype: torch.dtype, device: torch.device) -> Tensor:
    """A row of numbers that is made once a dtype and device: a new tensor a call is a copy to the device a call."""
    return torch.tensor(values, dtype=dtype, device=device)


def cross(a: Tensor, b: Tensor, dim: int) -> Tensor:
    """Vector product along an axis of 3 that is not the last: `torch.linalg.cross` takes ten times as long there."""
    (x, y, z), (u, v, w) = a.unbind(dim), b.unbind(dim)
    return torch.stack((y * w - z * v, z * u - x * w, x * v - y * u), dim=dim)


def solve_small(matrix: Tensor, right: Tensor) -> Tensor:
    """x (P, N) with matrix (P, N, N) x = right (P, N), written out for N = 2; not finite where there is none."""
    if right.shape[-1] != 2:
        found: Tensor = torch.linalg.solve_ex(matrix, right.unsqueeze(-1))[0].squeeze(-1)
        return found
    (a, b), (c, d) = (row.unbind(-1) for row in matrix.unbind(-2))
    e, f = right.unbind(-1)
    return torch.stack((e * d - b * f, a * f - e * c), dim=-1) / (a * d - b * c).unsqueeze(-1)


def gradient_of_each(values: Tensor, inputs: Tensor) -> tuple[Tensor, Tensor]:
    """Gradients (P, G) of values by the inputs of each (P, G), and whether they are finite (P,); 0 where they are not.

    values: of some or all of P candidates that do not mix, so that one backward pass of their sum serves all.
    """
    (gradient,) = torch.autograd.grad(values.sum(), inputs, allow_unused=True)
    gradient = torch.zeros_like(inputs) if gradient is None else gradient
    finite = torch.isfinite(gradient).all(-1)
    return torch.where(finite.unsqueeze(-1), gradient, 0.0), finite


@lru_cache
def _chebyshev(n: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Nodes on [0, 1] (ends included, ascending), differentiation, running integral, quadrature weights."""
    k = np.arange(n)
    x = -np.cos(np.pi * k / (n - 1))
    # Everything follows from values and integrals of Chebyshev polynomials at the nodes.
    coefficients = np.polynomial.chebyshev.chebvander(x, n - 1)
    to_coefficients = np.linalg.inv(coefficients)
    slopes = np.stack([_chebyshev_values(np.polynomial.chebyshev.chebder(row), x) for row in np.eye(n)], axis=1)
    areas = np.stack(
        [_chebyshev_values(np.polynomial.chebyshev.chebint(row, lbnd=-1.0), x) for row in np.eye(n)], axis=1
    )
    differentiation = 2.0 * slopes @ to_coefficients
    integral = 0.5 * areas @ to_coefficients
    return (x + 1.0) / 2.0, differentiation, integral, integral[-1]


def _chebyshev_values(coefficients: np.ndarray, x: np.ndarray) -> np.ndarray:
    found: np.ndarray = np.polynomial.chebyshev.chebval(x, coefficients)
    return found


@lru_cache
def chebyshev_nodes(n: int, dtype: torch.dtype, device: torch.device) -> Tensor:
    """(n,) Chebyshev-Lobatto nodes on [0, 1], ascending, both ends included."""
    return torch.as_tensor(_chebyshev(n)[0], dtype=dtype, device=device)


@lru_cache
def differentiation_matrix(n: int, dtype: torch.dtype, device: torch.device) -> Tensor:
    """(n, n) matrix D with (D f)(nodes) = f'(nodes) for polynomials on [0, 1] of degree < n."""
    return torch.as_tensor(_chebyshev(n)[1], dtype=dtype, device=device)


@lru_cache
def second_differentiation_matrix(n: int, dtype: torch.dtype, device: torch.device) -> Tensor:
    """(n, n) matrix of the second derivative on the nodes."""
    d = _chebyshev(n)[1]
    return torch.as_tensor(d @ d, dtype=dtype, device=device)


@lru_cache
def integration_matrix(n: int, dtype: torch.dtype, device: torch.device) -> Tensor:
    """(n, n) matrix of the integral from 0 to each node; its last row holds the Clenshaw-Curtis weights."""
    return torch.as_tensor(_chebyshev(n)[2], dtype=dtype, device=device)


@lru_cache
def _mirrored_half(n: int, m: int) -> np.ndarray:
    x = _chebyshev(n)[0]
    return chebyshev_interpolation_numpy(m, np.where(x <= 0.5, 2.0 * x, 2.0 - 2.0 * x))


@lru_cache
def mirrored_half(n: int, m: int, dtype: torch.dtype, device: torch.device) -> Tensor:
    """(n, m) matrix from m nodes on the first half to n nodes on the whole of a curve symmetric about its middle."""
    return torch.as_tensor(_mirrored_half(n, m), dtype=dtype, device=device)


@lru_cache
def even_interpolation(n: int, m: int, dtype: torch.dtype, device: torch.device) -> Tensor:
    """(m, n) matrix from n Chebyshev nodes to m even samples of [0, 1], both ends included."""
    matrix = chebyshev_interpolation_numpy(n, np.linspace(0.0, 1.0, m))
    return torch.as_tensor(matrix, dtype=dtype, device=device)


def chebyshev_interpolation_numpy(n: int, x: np.ndarray) -> np.ndarray:
    """(len(x), n) matrix from node values to values at x in [0, 1]."""
    nodes = _chebyshev(n)[0]
    vander = np.polynomial.chebyshev.chebvander
    return np.asarray(vander(2.0 * x - 1.0, n - 1) @ np.linalg.inv(vander(2.0 * nodes - 1.0, n - 1)))


def chebyshev_interpolate(values: Tensor, x: Tensor) -> Tensor:
    """Value of the interpolating polynomial at x.

    values: (..., n) at the nodes. x: (..., M) in [0, 1], same leading shape. Returns (..., M).
    """
    n = values.shape[-1]
    nodes = chebyshev_nodes(n, values.dtype, values.device)
    weights = torch.ones(n, dtype=values.dtype, device=values.device)
    weights[1::2] = -1.0
    weights[0] *= 0.5
    weights[-1] *= 0.5
    gap = x.unsqueeze(-1) - nodes
    # On a node the barycentric formula reads 0/0: move it by far less than it could matter.
    gap = torch.where(gap.abs() < 1e-13, torch.full_like(gap, 1e-13), gap)
    terms = weights / gap
    return (terms * values.unsqueeze(-2)).sum(-1) / terms.sum(-1)


def hermite(x: Tensor, start: Tensor, end: Tensor, start_rate: Tensor, end_rate: Tensor, duration: Tensor) -> Tensor:
    """Cubic with given end values and end rates (per unit of time) on x in [0, 1]."""
    change = end - start
    a = start_rate * duration
    b = end_rate * duration
    return start + x * (a + x * (3.0 * change - 2.0 * a - b + x * (a + b - 2.0 * change)))


def hermite_motion(
    x: Tensor, start: Tensor, end: Tensor, start_rate: Tensor, end_rate: Tensor, duration: Tensor
) -> tuple[Tensor, Tensor, Tensor]:
    """The same cubic with its first and second derivative by time."""
    change = end - start
    a = start_rate * duration
    b = end_rate * duration
    square, cube = 3.0 * change - 2.0 * a - b, a + b - 2.0 * change
    bent = square + x * cube
    # The derivatives of a x + x^2 (square + x cube) by x.
    rate = a + x * (2.0 * bent + x * cube)
    bend = 2.0 * (bent + 2.0 * x * cube)
    return start + x * (a + x * bent), rate / duration, bend / duration**2
