"""Numbers of an edit, of paths whose steps are written down."""

from __future__ import annotations

import math

import pytest
import torch
from torch import Tensor

from hopdiff.editing.measure import FRAME, largest_turn, path_measures
from hopdiff.editing.root_path import RootPath, path_of


def path_with(steps: Tensor) -> RootPath:
    return path_of(steps, torch.tensor([1.0, 2.0], dtype=torch.float64), torch.tensor(0.4, dtype=torch.float64))


def ahead(paces: Tensor, aside: float = 0.0) -> Tensor:
    """Steps (T - 1, 3) of these lengths, turned by `aside` from where the body faces."""
    return torch.stack((paces * math.sin(aside), paces * math.cos(aside), torch.zeros_like(paces)), dim=-1)


def test_stretch_is_that_of_the_whole_and_of_single_steps() -> None:
    paces = torch.full((101,), 0.05, dtype=torch.float64)
    factors = 1.0 + 0.01 * torch.arange(101, dtype=torch.float64)
    found = path_measures(path_with(ahead(paces)), path_with(ahead(paces * factors)), FRAME)
    assert found["path_length_before"] == pytest.approx(5.05)
    assert found["path_length"] == pytest.approx(5.05 * 1.5)
    assert found["stretch"] == pytest.approx(1.5)
    assert (found["stretch_p05"], found["stretch_p95"]) == pytest.approx((1.05, 1.95))


def test_steps_of_one_who_stands_do_not_count() -> None:
    """Those below 0.3 of the mean pace: here 1 of 10, against 0.9."""
    paces = torch.tensor([0.1] * 9 + [0.02], dtype=torch.float64)
    other = ahead(2.0 * paces)
    other[-1] = torch.tensor([-0.5, 0.0, 0.0])
    found = path_measures(path_with(ahead(paces)), path_with(other), FRAME)
    assert (found["stretch_p05"], found["stretch_p95"]) == pytest.approx((2.0, 2.0))
    assert found["side_slip_p95_deg"] == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize(("before", "after", "slip"), [(0.0, 0.3, 0.3), (0.2, -0.3, 0.5), (3.0, -3.0, math.tau - 6.0)])
def test_slip_is_the_change_between_way_and_facing_on_the_shorter_side(
    before: float, after: float, slip: float
) -> None:
    paces = torch.full((20,), 0.05, dtype=torch.float64)
    found = path_measures(path_with(ahead(paces, before)), path_with(ahead(paces, after)), FRAME)
    assert found["side_slip_p95_deg"] == pytest.approx(math.degrees(slip))


def test_differential_coordinates_are_largest_where_one_step_stands_out() -> None:
    steps = ahead(torch.full((9,), 0.05, dtype=torch.float64))
    kicked = steps.clone()
    kicked[4, 0], kicked[4, 1] = 0.03, 0.09
    found = path_measures(path_with(steps), path_with(kicked), FRAME)
    assert found["delta_max_before"] == pytest.approx(0.0, abs=1e-12)
    assert found["delta_max"] == pytest.approx(math.hypot(0.03, 0.04))
    back = path_measures(path_with(kicked), path_with(steps), FRAME)
    assert back["delta_max_before"] == pytest.approx(math.hypot(0.03, 0.04))


@pytest.mark.parametrize(("frame_time", "turn"), [(1 / 30, 0.06), (1 / 120, 0.14), (1 / 10, 0.06), (1 / 3000, 0.24)])
def test_turns_are_measured_over_a_thirtieth_of_a_second(frame_time: float, turn: float) -> None:
    turns = [0.01, -0.02, -0.06, -0.04, -0.02, 0.0, 0.01, -0.01, -0.04, -0.02, -0.02, 0.0, -0.03]
    steps = torch.zeros(len(turns), 3, dtype=torch.float64)
    steps[:, 2] = torch.tensor(turns)
    path = path_with(steps)
    assert largest_turn(path, frame_time) == pytest.approx(turn, abs=1e-6)
    measures = path_measures(path, path_with(2.0 * steps), frame_time)
    assert measures["turn_max_deg_before"] == pytest.approx(math.degrees(turn), abs=1e-4)
    assert measures["turn_max_deg"] == pytest.approx(2.0 * math.degrees(turn), abs=1e-4)


def test_one_who_stands_has_no_share_to_tell() -> None:
    still = path_with(torch.zeros(5, 3, dtype=torch.float64))
    found = path_measures(still, still, FRAME)
    assert found["stretch"] == math.inf
    assert (found["stretch_p05"], found["side_slip_p95_deg"]) == (0.0, 0.0)
