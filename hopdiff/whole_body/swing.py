"""Curves through the air: polynomials with given values in between that go on smoothly at both ends."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import torch
from torch import Tensor

MOMENTS = (0.18, 0.34, 0.5, 0.66, 0.82)  # shares of the swing at which free values of thigh and knee are given
ANKLE_MOMENTS = (0.35, 0.7)  # and of the ankle, which hangs from the shank


@lru_cache(maxsize=16)
def _coefficients(moments: tuple[float, ...], smooth: int, dtype: torch.dtype, device: torch.device) -> Tensor:
    """(K, K) Chebyshev coefficients of the curve that has 1 in one condition and 0 in all others.

    Conditions: value and `smooth` rates at the start, values at `moments`, value and `smooth` rates at the end.
    """
    count = 2 * (smooth + 1) + len(moments)
    rows = []
    eye = np.eye(count)

    def condition(x: float, order: int) -> np.ndarray:
        series = [np.polynomial.chebyshev.chebder(row, order) if order else row for row in eye]
        return np.array([np.polynomial.chebyshev.chebval(2.0 * x - 1.0, row) for row in series]) * 2.0**order

    rows += [condition(0.0, order) for order in range(smooth + 1)]
    rows += [condition(x, 0) for x in moments]
    rows += [condition(1.0, order) for order in range(smooth + 1)]
    return torch.as_tensor(np.linalg.inv(np.stack(rows)), dtype=dtype, device=device)


def swing_basis(phase: Tensor, moments: tuple[float, ...], smooth: int) -> Tensor:
    """(P, M, K) weights of the conditions at phases (P, M) of the swing, see `_coefficients`."""
    coefficients = _coefficients(moments, smooth, phase.dtype, phase.device)
    # Chebyshev polynomials by their recurrence: its gradient is finite at the ends.
    x = 2.0 * phase - 1.0
    found = [torch.ones_like(x), x]
    for _ in range(len(coefficients) - 2):
        found.append(2.0 * x * found[-1] - found[-2])
    return torch.stack(found, dim=-1) @ coefficients
