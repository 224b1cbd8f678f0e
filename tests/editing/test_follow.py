"""Clips led along a drawn curve."""

from __future__ import annotations

import math

import pytest
import torch

from hopdiff.editing.follow import MOST, bound_frames, follow, middle_line
from hopdiff.editing.measure import path_measures
from hopdiff.editing.root_path import RootPath
from hopdiff.editing.targets import EditedPath, edit_path
from hopdiff.geometry.curve import PlaneCurve, curve_through
from tests.editing.walks import walk

FRAME = 1.0 / 30.0


def bends(length: float) -> PlaneCurve:
    scale = length / curve_through([[0, 0], [2, 6], [-2, 12], [0, 18]]).length
    return curve_through([[0, 0], [2 * scale, 6 * scale], [-2 * scale, 12 * scale], [0, 18 * scale]])


def led(path: RootPath, curve: PlaneCurve) -> EditedPath:
    guess, bound = follow(path, FRAME, curve)
    return edit_path(path, bound, FRAME, guess=guess)


@pytest.mark.parametrize("facing", [0.0, 1.2])
def test_the_middle_of_the_way_lies_on_the_curve_and_the_body_faces_as_it_did(facing: float) -> None:
    path = walk(240, facing=facing)
    curve = bends(10.5)
    edited = led(path, curve)
    assert edited.converged
    arc = torch.linspace(0.0, curve.length, 4000, dtype=torch.float64)
    away = torch.cdist(edited.path.place, curve.position(arc)).min(dim=-1)
    assert float(away.values.max()) < 0.05  # the sway of 3 cm is still there
    assert float(away.values.max()) > 0.02
    heading = curve.heading(arc)[away.indices]
    off = torch.remainder(edited.path.yaw - heading + math.pi, math.tau) - math.pi
    assert float((off - facing).abs().max()) < 0.25
    assert path_measures(path, edited.path, FRAME)["stretch"] == pytest.approx(curve.length / 10.36, rel=0.02)


def test_ends_are_those_of_the_curve() -> None:
    path = walk(240)
    curve = bends(9.0)
    edited = led(path, curve).path
    ends = curve.position(torch.tensor([0.0, curve.length], dtype=torch.float64))
    assert (edited.place[[0, -1]] - ends).abs().max() < 0.01


def test_rings_are_run_round_and_round() -> None:
    path = walk(400)
    angle = torch.linspace(0.0, 3.0 * math.tau, 60, dtype=torch.float64)
    ring = curve_through((2.0 * torch.stack((1.0 - torch.cos(angle), torch.sin(angle)), dim=-1)).numpy(), closed=False)
    edited = led(path, ring)
    assert edited.converged
    assert float(edited.path.yaw[-1] - edited.path.yaw[0]) == pytest.approx(3.0 * math.tau, abs=0.3)


def test_a_middle_line_is_the_way_without_sway() -> None:
    path = walk(240)
    middle = middle_line(path.place, FRAME)
    straight = torch.stack((torch.sin(torch.tensor(0.3)), torch.cos(torch.tensor(0.3)))).double()
    beside = (middle - middle[0]) @ torch.stack((straight[1], -straight[0]))
    assert float(beside.abs().max()) < 0.02
    assert (middle[[0, -1]] - path.place[[0, -1]]).abs().max() < 1e-12


@pytest.mark.parametrize(("frames", "frame_time"), [(3, 0.04), (50, 1 / 120), (200, 1 / 30), (72_000, 1 / 120)])
def test_bound_frames_hold_both_ends_and_are_not_too_many(frames: int, frame_time: float) -> None:
    bound = bound_frames(frames, frame_time)
    assert (bound[0], bound[-1]) == (0, frames - 1)
    assert len(bound) == len(set(bound)) <= MOST + 1
