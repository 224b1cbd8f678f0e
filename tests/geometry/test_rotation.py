from __future__ import annotations

import itertools
import math

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from hopdiff.geometry.rotation import axis_rotation, euler_to_matrix, matrix_to_euler, unwrap

ORDERS = ["".join(order) for order in itertools.permutations("XYZ")]
TURN = st.floats(-math.pi, math.pi)


@pytest.mark.parametrize(("axis", "start", "goal"), [("X", 1, 2), ("Y", 2, 0), ("Z", 0, 1)])
def test_a_quarter_turn_is_right_handed(axis, start, goal):
    unit = torch.eye(3, dtype=torch.float64)
    quarter = axis_rotation(axis, torch.tensor(math.pi / 2, dtype=torch.float64))
    torch.testing.assert_close(quarter @ unit[start], unit[goal])
    torch.testing.assert_close(quarter @ unit[goal], -unit[start])


def test_the_first_letter_turns_last():
    """Intrinsic "ZXY": the vector meets Y first, then X, then Z."""
    angles = torch.tensor([0.3, -0.8, 1.1], dtype=torch.float64)
    vector = torch.tensor([0.2, 0.5, -0.7], dtype=torch.float64)
    turned = vector
    for axis, angle in (("Y", angles[2]), ("X", angles[1]), ("Z", angles[0])):
        turned = axis_rotation(axis, angle) @ turned
    torch.testing.assert_close(euler_to_matrix(angles, "ZXY") @ vector, turned)


@settings(max_examples=60, deadline=None)
@given(st.sampled_from(ORDERS), st.tuples(TURN, TURN, TURN))
def test_euler_angles_round_trip_as_rotations(order, values):
    angles = torch.tensor(values, dtype=torch.float64)
    matrix = euler_to_matrix(angles, order)
    torch.testing.assert_close(matrix @ matrix.T, torch.eye(3, dtype=torch.float64))
    assert float(torch.linalg.det(matrix)) == pytest.approx(1.0)
    again = euler_to_matrix(matrix_to_euler(matrix, order), order)
    torch.testing.assert_close(again, matrix, atol=1e-7, rtol=0)


@settings(max_examples=60, deadline=None)
@given(st.sampled_from(ORDERS), st.tuples(TURN, st.floats(-1.55, 1.55), TURN))
def test_angles_come_back_where_they_are_unique(order, values):
    angles = torch.tensor(values, dtype=torch.float64)
    back = matrix_to_euler(euler_to_matrix(angles, order), order)
    assert float(back[1]) == pytest.approx(values[1], abs=1e-7)
    torch.testing.assert_close(torch.cos(back - angles), torch.ones(3, dtype=torch.float64), atol=1e-9, rtol=0)


@pytest.mark.parametrize("order", ORDERS)
def test_batches_keep_their_shape(order):
    angles = torch.rand(4, 2, 3, dtype=torch.float64)
    matrix = euler_to_matrix(angles, order)
    assert matrix.shape == (4, 2, 3, 3)
    torch.testing.assert_close(matrix[3, 1], euler_to_matrix(angles[3, 1], order))
    torch.testing.assert_close(matrix_to_euler(matrix, order), angles)


@settings(max_examples=60, deadline=None)
@given(st.lists(st.floats(-3.0, 3.0), min_size=1, max_size=30))
def test_unwrap_undoes_wrapping(steps):
    path = torch.tensor(steps, dtype=torch.float64).cumsum(0)
    wrapped = torch.atan2(torch.sin(path), torch.cos(path))
    torch.testing.assert_close(unwrap(wrapped) - wrapped[0], path - path[0])


def test_unwrap_works_along_any_dimension_and_leaves_smooth_paths_alone():
    smooth = torch.linspace(0, 12, 40, dtype=torch.float64).repeat(3, 1)
    torch.testing.assert_close(unwrap(smooth, dim=1), smooth)
    torch.testing.assert_close(unwrap(torch.remainder(smooth, 2 * math.pi), dim=1), smooth)
