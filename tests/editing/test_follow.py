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


@pytest.mark.parametrize("turn", [1.1, 0.3])
def test_a_straight_walk_on_a_straight_line_is_turned_as_a_whole(turn: float) -> None:
    """Way, sway and facing keep their shape: the path is that of the clip, turned and moved."""
    path = walk(240, facing=0.4)
    middle = middle_line(path.place, FRAME)
    length = float(middle.diff(dim=0).norm(dim=-1).sum())
    start = torch.tensor([3.0, -2.0], dtype=torch.float64)
    way = torch.tensor([math.sin(0.3 + turn), math.cos(0.3 + turn)], dtype=torch.float64)
    line = curve_through(torch.stack((start, start + 0.5 * length * way, start + length * way)).numpy())
    laid, bound = follow(path, FRAME, line)
    c, s = math.cos(turn), math.sin(turn)
    x, z = (path.place - path.place[0]).unbind(-1)
    wanted = start + torch.stack((c * x + s * z, c * z - s * x), dim=-1)
    assert (laid.place - wanted).abs().max() < 0.02
    # Sway alone, across the line, is exact but for the bends of the middle line at its ends.
    across = torch.tensor([way[1], -way[0]], dtype=torch.float64)
    middle_of = slice(60, 180)
    assert ((laid.place - wanted) @ across)[middle_of].abs().max() < 3e-3
    assert (laid.yaw - path.yaw - turn).abs()[middle_of].max() < 0.02
    for constraint in bound:
        assert constraint.place == pytest.approx(tuple(laid.place[constraint.frame].tolist()))
        assert constraint.yaw == pytest.approx(float(laid.yaw[constraint.frame]))
    assert [b.frame for b in bound] == bound_frames(240, FRAME)


def test_one_who_stands_faces_as_the_curve_does_where_it_would_go_on() -> None:
    path = walk(240)
    place = path.place.clone()
    place[120:160] = place[120]
    place[160:] -= place[160] - place[120]
    laid, _ = follow(RootPath(place, path.yaw), FRAME, bends(9.0))
    assert torch.isfinite(laid.place).all()
    assert float(laid.yaw.diff().abs().max()) < 0.1
    still = RootPath(path.place[:1].expand(50, 2), path.yaw[:50])
    laid, _ = follow(still, FRAME, bends(9.0))
    torch.testing.assert_close(laid.yaw, bends(9.0).heading(torch.zeros(50).double()), rtol=0.0, atol=1e-9)


def test_frames_are_bound_every_fifth_of_a_second() -> None:
    assert bound_frames(61, 1 / 30) == list(range(0, 61, 6))
    assert bound_frames(5, 1 / 30) == [0, 4]
    assert len(bound_frames(10_001, 1 / 30)) == MOST + 1
    assert bound_frames(3, 1.0) == [0, 1, 2]


def test_a_middle_line_is_a_mean_over_time_by_a_bell() -> None:
    """Of a sine far from its ends: the bell of 0.4 s takes exp(-(w s)^2 / 2) of it."""
    time = 0.02 * torch.arange(1000, dtype=torch.float64)
    place = torch.stack((torch.sin(3.0 * time), 1.5 * time), dim=-1)
    middle = middle_line(place, 0.02)[300:700]
    torch.testing.assert_close(middle[:, 0], place[300:700, 0] * math.exp(-0.72), rtol=0.0, atol=2e-3)
    torch.testing.assert_close(middle[:, 1], place[300:700, 1], rtol=0.0, atol=1e-9)
    # Mirrored about its ends, a straight line stays one.
    straight = torch.stack((time, 2.0 - 0.5 * time), dim=-1)
    torch.testing.assert_close(middle_line(straight, 0.02), straight, rtol=0.0, atol=1e-9)
