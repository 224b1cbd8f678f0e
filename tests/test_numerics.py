"""Guards against NaN gradients, Chebyshev nodes and cubic pieces."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from scipy.interpolate import CubicHermiteSpline

from hopdiff import numerics

HERE = (torch.float64, torch.device("cpu"))


@pytest.mark.parametrize("guard", [numerics.safe_sqrt, numerics.safe_acos])
def test_guards_stay_finite_where_the_function_ends(guard) -> None:
    x = torch.tensor([-2.0, -1.0, 0.0, 1.0, 2.0], dtype=torch.float64, requires_grad=True)
    y = guard(x)
    (slope,) = torch.autograd.grad(y.sum(), x)
    assert torch.isfinite(y).all()
    assert torch.isfinite(slope).all()


def test_guards_are_exact_where_the_function_is_defined() -> None:
    x = torch.linspace(-0.99, 0.99, 33, dtype=torch.float64)
    assert torch.equal(numerics.safe_acos(x), torch.acos(x))
    assert torch.equal(numerics.safe_sqrt(x + 1.0), torch.sqrt(x + 1.0))


@given(st.floats(-5, 5), st.floats(-5, 5), st.floats(1e-3, 1.0))
def test_smooth_max_is_an_upper_envelope(a: float, b: float, width: float) -> None:
    value = float(numerics.smooth_max(torch.tensor(a, dtype=torch.float64), b, width))
    assert max(a, b) <= value + 1e-12
    assert value <= max(a, b) + 0.5 * width + 1e-12


@pytest.mark.parametrize("n", [4, 12, 33])
def test_nodes_differentiate_and_integrate_polynomials_exactly(n: int) -> None:
    x = numerics.chebyshev_nodes(n, *HERE)
    assert x[0] == 0.0
    assert x[-1] == 1.0
    assert (x.diff() > 0).all()
    powers = np.polynomial.Polynomial(np.linspace(-1.0, 1.0, n))  # of degree n - 1
    values = torch.from_numpy(powers(x.numpy()))
    for matrix, wanted in (
        (numerics.differentiation_matrix, powers.deriv()),
        (numerics.second_differentiation_matrix, powers.deriv(2)),
        (numerics.integration_matrix, powers.integ()),
    ):
        assert torch.allclose(matrix(n, *HERE) @ values, torch.from_numpy(wanted(x.numpy())), atol=1e-9, rtol=1e-9)


def test_quadrature_of_a_smooth_function() -> None:
    x = numerics.chebyshev_nodes(12, *HERE)
    area = numerics.integration_matrix(12, *HERE)[-1] @ torch.exp(x)
    assert float(area) == pytest.approx(math.e - 1.0, abs=1e-12)


def test_interpolation_on_and_between_the_nodes() -> None:
    x = numerics.chebyshev_nodes(12, *HERE)
    values = torch.stack((torch.cos(3.0 * x), torch.exp(-x)))
    dense = torch.linspace(0.0, 1.0, 101, dtype=torch.float64).expand(2, -1)
    found = numerics.chebyshev_interpolate(values, dense)
    assert torch.allclose(found, torch.stack((torch.cos(3.0 * dense[0]), torch.exp(-dense[1]))), atol=1e-8)
    assert torch.allclose(numerics.chebyshev_interpolate(values, x.expand(2, -1)), values, atol=1e-11)
    matrix = torch.from_numpy(numerics.chebyshev_interpolation_numpy(12, dense[0].numpy()))
    assert torch.allclose(values @ matrix.T, found, atol=1e-10)


def test_mirrored_half_continues_a_symmetric_curve() -> None:
    half = numerics.chebyshev_nodes(12, *HERE)
    whole = numerics.chebyshev_nodes(16, *HERE)
    matrix = numerics.mirrored_half(16, 12, *HERE)
    assert torch.allclose(
        matrix @ torch.cos(math.pi * (half - 1.0)), torch.cos(math.pi * (2.0 * whole - 1.0)), atol=1e-8
    )


def test_hermite_agrees_with_scipy() -> None:
    x = torch.linspace(0.0, 1.0, 21, dtype=torch.float64)
    start, end, start_rate, end_rate, duration = (
        torch.tensor(v, dtype=torch.float64) for v in (0.3, -1.2, 4.0, -7.0, 0.35)
    )
    spline = CubicHermiteSpline([0.0, 0.35], [0.3, -1.2], [4.0, -7.0])
    found = numerics.hermite(x, start, end, start_rate, end_rate, duration)
    assert np.allclose(found.numpy(), spline(0.35 * x.numpy()), atol=1e-12)
    motion = numerics.hermite_motion(x, start, end, start_rate, end_rate, duration)
    for order, values in enumerate(motion):
        assert np.allclose(values.numpy(), spline(0.35 * x.numpy(), nu=order), atol=1e-9)


def test_vector_products_along_any_axis_are_those_of_the_library() -> None:
    a, b = torch.randn(2, 4, 3, 3, 5, generator=torch.Generator().manual_seed(0), dtype=torch.float64)
    for dim in (1, 2):
        torch.testing.assert_close(numerics.cross(a, b, dim), torch.linalg.cross(a, b, dim=dim))


@pytest.mark.parametrize("size", [2, 3])
def test_small_systems_are_solved(size: int) -> None:
    generator = torch.Generator().manual_seed(size)
    matrix = torch.randn(5, size, size, generator=generator, dtype=torch.float64)
    wanted = torch.randn(5, size, generator=generator, dtype=torch.float64)
    right = (matrix @ wanted.unsqueeze(-1)).squeeze(-1)
    torch.testing.assert_close(numerics.solve_small(matrix, right), wanted, rtol=1e-9, atol=1e-9)
    # One without a solution says so, and leaves its neighbours alone.
    matrix[0] = 0.0
    found = numerics.solve_small(matrix, right)
    assert not bool(found[0].isfinite().all())
    torch.testing.assert_close(found[1:], wanted[1:], rtol=1e-9, atol=1e-9)
