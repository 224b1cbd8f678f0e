"""The graph Laplacian of a chain of frames, and solving with its square (Kim & Lee 2021, eq. 5-9)."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.linalg import cho_solve_banded, cholesky_banded
from torch import Tensor

BANDS = 3  # of the square of a tridiagonal matrix: the diagonal and two below it


def laplacian(values: Tensor) -> Tensor:
    """Differential coordinates: by how much each of (..., N, D) differs from the mean of its neighbours.

    At the ends, which have one neighbour, from that. (With the rows of the paper's eq. 7 the matrix would be regular
    there, against what the paper says of its rank.)
    """
    inner = values[..., 1:-1, :] - 0.5 * (values[..., :-2, :] + values[..., 2:, :])
    first, last = values[..., :1, :] - values[..., 1:2, :], values[..., -1:, :] - values[..., -2:-1, :]
    return torch.cat((first, inner, last), dim=-2)


def squared_bands(count: int) -> Tensor:
    """(3, N) the diagonal and the two below it of transposed Laplacian times Laplacian; entry (b, j) is row j + b."""
    below, here, above = (torch.full((count,), value, dtype=torch.float64) for value in (-0.5, 1.0, -0.5))
    above[0] = below[-1] = -1.0
    below[0] = above[-1] = 0.0
    # Row i of the Laplacian has below, here, above in columns i - 1, i, i + 1.
    bands = torch.zeros(BANDS, count, dtype=torch.float64)
    bands[0] += here**2
    bands[0, :-1] += below[1:] ** 2
    bands[0, 1:] += above[:-1] ** 2
    bands[1, :-1] += here[:-1] * above[:-1] + below[1:] * here[1:]
    bands[2, :-2] += below[1:-1] * above[1:-1]
    return bands


class Banded:
    """A symmetric positive definite matrix with five diagonals, factored once, to solve with.

    bands: (3, N) as `squared_bands` gives them. Gradients flow to the bands and to the right-hand sides.
    """

    def __init__(self, bands: Tensor) -> None:
        self.bands = bands
        self.factor: NDArray[np.float64] = cholesky_banded(bands.detach().cpu().numpy(), lower=True, check_finite=False)

    def solve(self, right: Tensor) -> Tensor:
        """The solutions for right-hand sides (N, M)."""
        if self.bands.requires_grad or right.requires_grad:
            solved: Tensor = _Solve.apply(self.bands, self.factor, right)  # type: ignore[no-untyped-call]
            return solved
        return _solve(self.factor, right)


def _solve(factor: NDArray[np.float64], right: Tensor) -> Tensor:
    numbers = right.detach().cpu().numpy()
    return torch.from_numpy(cho_solve_banded((factor, True), numbers, check_finite=False))


class _Solve(torch.autograd.Function):
    """x = K^-1 b: with g the gradient of x, that of b is K^-1 g, that of K is - (K^-1 g) x^T."""

    @staticmethod
    def forward(ctx: Any, bands: Tensor, factor: NDArray[np.float64], right: Tensor) -> Tensor:
        solved = _solve(factor, right)
        ctx.factor = factor
        ctx.save_for_backward(solved)
        return solved

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor | None, None, Tensor]:
        (solved,) = ctx.saved_tensors
        adjoint = _solve(ctx.factor, gradients[0])
        bands = None
        if ctx.needs_input_grad[0]:
            bands = torch.zeros(BANDS, len(solved), dtype=solved.dtype)
            bands[0] = -(adjoint * solved).sum(-1)
            for k in range(1, BANDS):
                # An entry below the diagonal stands for its mirror image too.
                bands[k, :-k] = -(adjoint[k:] * solved[:-k] + adjoint[:-k] * solved[k:]).sum(-1)
        return bands, None, adjoint
