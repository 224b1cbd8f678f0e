from __future__ import annotations

import numpy as np
import pytest
import torch

from hopdiff.editing.laplacian import Banded, laplacian, squared_bands
from hopdiff.editing.paper import laplacian_transposed


def matrix(count: int) -> torch.Tensor:
    """The Laplacian written out: I - D / 2 inside, the difference from the one neighbour at the ends."""
    full = torch.eye(count, dtype=torch.float64)
    for i in range(count):
        for j in (i - 1, i + 1):
            if 0 <= j < count:
                full[i, j] = -0.5 if 0 < i < count - 1 else -1.0
    return full


@pytest.mark.parametrize("count", [2, 3, 7, 40])
def test_it_is_the_matrix_and_its_rank_is_one_short(count: int) -> None:
    values = torch.randn(count, 3, dtype=torch.float64, generator=torch.Generator().manual_seed(0))
    full = matrix(count)
    assert (laplacian(values) - full @ values).abs().max() < 1e-14
    assert (laplacian_transposed(values) - full.T @ values).abs().max() < 1e-14
    assert int(torch.linalg.matrix_rank(full)) == count - 1


@pytest.mark.parametrize("count", [2, 3, 4, 30])
def test_the_bands_are_those_of_its_square(count: int) -> None:
    full = matrix(count).T @ matrix(count)
    bands = squared_bands(count)
    for k in range(3):
        below = torch.diagonal(full, -k) if k < count else torch.zeros(0)
        assert np.abs(bands[k, : max(count - k, 0)].numpy() - below.numpy()).max(initial=0.0) < 1e-14
    assert torch.count_nonzero(torch.triu(full, 3)) == 0


def banded(count: int) -> torch.Tensor:
    bands = squared_bands(count)
    bands[0] += 0.1 + torch.linspace(0.0, 1.0, count, dtype=torch.float64)
    return bands


def dense(bands: torch.Tensor) -> torch.Tensor:
    count = bands.shape[1]
    full = torch.diag(bands[0])
    for k in (1, 2):
        side = bands[k, : count - k]
        full = full + torch.diag(side, k) + torch.diag(side, -k)
    return full


def test_solving_is_that_of_the_dense_matrix() -> None:
    bands = banded(25)
    right = torch.randn(25, 4, dtype=torch.float64, generator=torch.Generator().manual_seed(1))
    assert (Banded(bands).solve(right) - torch.linalg.solve(dense(bands), right)).abs().max() < 1e-12


def test_gradients_are_those_of_the_dense_matrix() -> None:
    bands = banded(12).requires_grad_()
    right = torch.randn(12, 3, dtype=torch.float64, generator=torch.Generator().manual_seed(2)).requires_grad_()
    weight = torch.randn(12, 3, dtype=torch.float64, generator=torch.Generator().manual_seed(3))
    own = torch.autograd.grad((Banded(bands).solve(right) * weight).sum(), (bands, right))
    full = torch.autograd.grad((torch.linalg.solve(dense(bands), right) * weight).sum(), (bands, right))
    for a, b in zip(own, full, strict=True):
        assert (a - b).abs().max() < 1e-12
