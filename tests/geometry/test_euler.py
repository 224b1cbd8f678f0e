from __future__ import annotations

import itertools
import math

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from hopdiff.geometry.euler import continuous_euler, joined_euler, second_form
from hopdiff.geometry.rotation import axis_rotation, euler_to_matrix, matrix_to_euler

THREE = ["".join(order) for order in itertools.product("XYZ", repeat=3) if order[0] != order[1] != order[2]]
SHORT = ["X", "Y", "Z", *("".join(order) for order in itertools.permutations("XYZ", 2))]
TURN = st.floats(-math.pi, math.pi)


def assert_same_rotation(angles: torch.Tensor, order: str, matrix: torch.Tensor, atol: float = 1e-8) -> None:
    torch.testing.assert_close(euler_to_matrix(angles, order), matrix, atol=atol, rtol=0)


@pytest.mark.parametrize("order", [*THREE, *SHORT, "", "XX", "XYZX", "ZZYYXX"])
def test_any_row_of_letters_makes_the_rotation_that_scipy_makes(order: str) -> None:
    angles = 6 * torch.rand(5, len(order), generator=torch.Generator().manual_seed(2), dtype=torch.float64) - 3
    known = Rotation.identity(5)
    for i, axis in enumerate(order):
        known = known * Rotation.from_euler(axis, angles[:, [i]].numpy())
    torch.testing.assert_close(euler_to_matrix(angles, order), torch.as_tensor(known.as_matrix()))


@settings(max_examples=150, deadline=None)
@given(st.sampled_from(THREE + SHORT), st.tuples(TURN, TURN, TURN))
def test_every_order_is_undone(order: str, values: tuple[float, float, float]) -> None:
    matrix = euler_to_matrix(torch.tensor(values[: len(order)], dtype=torch.float64), order)
    assert_same_rotation(matrix_to_euler(matrix, order), order, matrix)


@pytest.mark.parametrize("order", THREE)
@pytest.mark.parametrize("given_first", [None, 0.4])
def test_poles_are_undone_with_the_first_angle_that_was_asked_for(order: str, given_first: float | None) -> None:
    poles = [0.0, math.pi] if order[0] == order[2] else [math.pi / 2, -math.pi / 2]
    first, pole, third = torch.meshgrid(
        torch.tensor([0.0, 1.0, -2.5]), torch.tensor(poles), torch.tensor([0.0, 0.7]), indexing="ij"
    )
    angles = torch.stack((first, pole, third), dim=-1).double()
    angles[..., 1] = torch.tensor(poles, dtype=torch.float64)[None, :, None]
    # As from a product of other matrices: exact to rounding only.
    matrix = euler_to_matrix(angles, order) + 1e-15
    ask = None if given_first is None else torch.full_like(angles[..., 0], given_first)
    found = matrix_to_euler(matrix, order, ask)
    assert_same_rotation(found, order, matrix)
    torch.testing.assert_close(found[..., 0], torch.full_like(found[..., 0], given_first or 0.0))


@pytest.mark.parametrize("order", THREE)
def test_the_second_form_is_the_same_rotation(order: str) -> None:
    angles = torch.rand(20, 3, dtype=torch.float64)
    other = second_form(angles, order)
    assert_same_rotation(other, order, euler_to_matrix(angles, order))
    assert float((other - angles).abs().amax(dim=-1).min()) > 1.0


@pytest.mark.parametrize("order", THREE)
def test_a_motion_that_rests_at_a_pole_holds_its_angles(order: str) -> None:
    pole = 0.0 if order[0] == order[2] else math.pi / 2
    middle = torch.cat((torch.linspace(0.6, pole, 30), torch.full((20,), pole), torch.linspace(pole, 0.6, 30))).double()
    middle[29:51] = pole
    angles = torch.stack((torch.full_like(middle, 0.8), middle, torch.full_like(middle, -0.3)), dim=-1)
    matrix = euler_to_matrix(angles, order)
    found = continuous_euler(matrix, order)
    assert_same_rotation(found, order, matrix)
    assert float(found.diff(dim=0).abs().max()) < 0.05


@pytest.mark.parametrize("order", THREE + SHORT)
def test_kept_frames_have_the_old_angles_and_the_others_join_them(order: str) -> None:
    count = 60
    t = torch.linspace(0, 1, count, dtype=torch.float64)
    size = torch.tensor([2.0, 0.6, 1.1], dtype=torch.float64)[: len(order)]
    start = torch.tensor([0.3, 0.5, -0.4], dtype=torch.float64)[: len(order)]
    old = start + size * t[:, None] ** 2
    kept = (t < 0.3) | (t > 0.7)
    new = old + torch.where(kept, 0.0, torch.sin(math.pi * (t - 0.3) / 0.4) ** 2)[:, None] * 0.2
    # What the file says may lie any number of turns away, and in the second form.
    said = old + 4 * math.pi
    if len(order) == 3:
        said = second_form(said, order)
    joined = joined_euler(euler_to_matrix(new, order), order, said, kept)
    assert torch.equal(joined[kept], said[kept])
    assert_same_rotation(joined, order, euler_to_matrix(new, order))
    assert float(joined.diff(dim=0).abs().max()) < 0.2


@pytest.mark.parametrize("order", ["ZXY", "YZX", "ZXZ", "Y"])
def test_frames_before_the_first_kept_one_lead_to_it(order: str) -> None:
    turning = torch.linspace(0.0, 9.0, 100, dtype=torch.float64)
    old = torch.zeros(100, len(order), dtype=torch.float64)
    old[:, order.index("Y") if "Y" in order else 0] = 20.0
    kept = torch.arange(100) == 99
    axis = "Y" if "Y" in order else order[0]
    matrix = axis_rotation(axis, 20.0 + turning - 9.0)
    joined = joined_euler(matrix, order, old, kept)
    assert torch.equal(joined[-1], old[-1])
    assert_same_rotation(joined, order, matrix)
    if "Y" in order:
        assert float(joined.diff(dim=0).abs().max()) < 0.1


def test_without_kept_frames_the_first_one_lies_near_the_old_angles() -> None:
    old = torch.full((50, 3), 0.0, dtype=torch.float64)
    old[:, 2] = 3 * math.pi
    matrix = axis_rotation("Y", torch.linspace(0.2, 12.0, 50, dtype=torch.float64))
    joined = joined_euler(matrix, "ZXY", old, torch.zeros(50, dtype=torch.bool))
    assert_same_rotation(joined, "ZXY", matrix)
    assert float(joined.diff(dim=0).abs().max()) < 0.3
    assert float((joined[0] - old[0]).abs().max()) < 3.5
