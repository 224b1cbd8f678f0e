"""A curve on the ground, +x to the left and +z forward, so that a turn from +z towards +x is a turn to the left."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
import torch
from numpy.typing import NDArray
from torch import Tensor

from hopdiff.geometry.curve import PlaneCurve, curve_through
from hopdiff.types import HopdiffError

Array = NDArray[np.float64]

RADIUS = 5.0
BENDS = [[0.0, 0.0], [2.5, 6.0], [-2.5, 13.0], [0.0, 20.0]]
UNEVEN = [[0.0, 0.0], [0.1, 0.1], [4.0, 9.0], [4.2, 9.1], [1.0, 15.0]]
LOOP = [[0.0, 0.0], [6.0, 4.0], [3.0, 12.0], [-4.0, 7.0]]


def ring(count: int = 48, radius: float = RADIUS, left: bool = True) -> Array:
    """Points round a circle that starts at the origin, forward; the first does not come again."""
    angle = 2.0 * math.pi * np.arange(count) / count
    side = 1.0 if left else -1.0
    return radius * np.stack((side * (1.0 - np.cos(angle)), np.sin(angle)), axis=-1)


def arcs(curve: PlaneCurve, count: int = 2000, laps: float = 1.0) -> Tensor:
    return torch.linspace(0.0, laps * curve.length, count, dtype=torch.float64)


def misses(curve: PlaneCurve, points: Any) -> Array:
    """Distance of each point (K, 2) from the curve [m]."""
    near = curve.position(arcs(curve, 20_000)).numpy()
    return np.array([np.hypot(*(near - point).T).min() for point in np.asarray(points, dtype=float)])


def rate(values: Tensor, step: float) -> Tensor:
    """Central differences along the first dimension."""
    return (values[2:] - values[:-2]) / (2.0 * step)


def worst_bend(curve: PlaneCurve) -> float:
    return float(curve.curvature(arcs(curve)).abs().max())


@pytest.mark.parametrize(("points", "closed"), [(BENDS, None), (UNEVEN, None), (LOOP, True), (BENDS[:2], None)])
def test_the_curve_goes_through_all_points(points: list[list[float]], closed: bool | None) -> None:
    curve = curve_through(points, closed)
    assert misses(curve, points).max() < 1e-3
    first, last = curve.position(torch.tensor([0.0, curve.length], dtype=torch.float64)).tolist()
    assert first == pytest.approx(points[0], abs=1e-9)
    assert last == pytest.approx(points[0 if closed else -1], abs=1e-9)


def test_lengths_of_a_line_and_of_circles() -> None:
    assert curve_through([[1, 2], [4, 6]]).length == pytest.approx(5.0, abs=1e-9)
    assert curve_through([[0, 0], [0, 1], [0, 9], [0, 10]]).length == pytest.approx(10.0, abs=1e-9)
    for count, share in ((48, 1e-6), (6, 0.01)):
        assert curve_through(ring(count), True).length == pytest.approx(2.0 * math.pi * RADIUS, rel=share)


def test_a_list_of_many_points_is_measured_as_well_as_a_short_one() -> None:
    way = np.linspace(0.0, 400.0 * math.pi, 6001)
    waves = np.stack((np.sin(way / 2.0), way), axis=-1)
    fine = np.hypot(
        *np.diff(np.stack((np.sin(np.linspace(0, way[-1], 10**6) / 2.0), np.linspace(0, way[-1], 10**6))), 1)
    )
    curve = curve_through(waves)
    assert curve.length == pytest.approx(float(fine.sum()), rel=1e-4)


@pytest.mark.parametrize(
    ("points", "asked", "closed"),
    [
        (BENDS, None, False),
        (LOOP, None, False),
        ([*LOOP, LOOP[0]], None, True),
        ([*LOOP, [5e-7, 0.0]], None, True),
        ([*LOOP, [1e-3, 0.0]], None, False),
        (LOOP, True, True),
        ([*LOOP, LOOP[0]], True, True),
        ([*LOOP, LOOP[0]], False, False),
    ],
)
def test_a_list_is_closed_if_its_last_point_is_its_first_or_if_one_says_so(
    points: list[list[float]], asked: bool | None, closed: bool
) -> None:
    curve = curve_through(points, asked)
    assert curve.closed is closed
    ends = curve.heading(torch.tensor([0.0, curve.length], dtype=torch.float64))
    same_way = math.cos(float(ends[1] - ends[0])) > 1.0 - 1e-9
    assert same_way is closed


def test_a_first_point_that_comes_again_changes_nothing() -> None:
    once, twice = curve_through(LOOP, True), curve_through([*LOOP, LOOP[0]])
    assert once.length == twice.length
    assert torch.equal(once.position(arcs(once)), twice.position(arcs(twice)))


@pytest.mark.parametrize(
    ("points", "closed", "smooth"), [(BENDS, None, 0.0), (UNEVEN, None, 0.0), (LOOP, True, 0.0), (UNEVEN, None, 0.2)]
)
def test_position_moves_at_unit_speed_along_the_heading(
    points: list[list[float]], closed: bool | None, smooth: float
) -> None:
    curve = curve_through(points, closed, smooth)
    way, step = torch.linspace(0.01, 2.0 * curve.length, 1500, dtype=torch.float64), 1e-4
    between = (curve.position(way + step) - curve.position(way - step)) / (2.0 * step)
    assert between.norm(dim=-1).numpy() == pytest.approx(1.0, abs=1e-4)
    heading = curve.heading(way)
    tangent = torch.stack((torch.sin(heading), torch.cos(heading)), dim=-1)
    assert (between - tangent).abs().numpy().max() < 1e-3


@pytest.mark.parametrize(("left", "turn"), [(True, 1.0), (False, -1.0)])
def test_heading_goes_on_without_jumps_over_several_laps(left: bool, turn: float) -> None:
    curve = curve_through(ring(left=left), True)
    way = torch.linspace(-2.0 * curve.length, 3.0 * curve.length, 5001, dtype=torch.float64)
    assert curve.heading(way).numpy() == pytest.approx(turn * way.numpy() / RADIUS, abs=1e-3)


def test_heading_of_a_figure_of_eight_comes_back_to_where_it_was() -> None:
    angle = 2.0 * math.pi * np.arange(32) / 32
    curve = curve_through(np.stack((4.0 * np.sin(2.0 * angle), 9.0 * np.sin(angle)), axis=-1), True)
    heading = curve.heading(arcs(curve, 9001, laps=3.0))
    assert float(heading.diff().abs().max()) < 0.02
    assert float(heading[-1]) == pytest.approx(float(heading[0]), abs=1e-6)


def test_a_spiral_adds_up_its_turns() -> None:
    angle = np.linspace(0.0, 6.0 * math.pi, 200)
    curve = curve_through(((2.0 + angle) * np.stack((-np.cos(angle), np.sin(angle)))).T)
    heading = curve.heading(arcs(curve))
    assert float(heading.diff().abs().max()) < 0.1
    # The tangent of r = 2 + angle lies atan(r) from the radius.
    turned = 6.0 * math.pi + math.atan(2.0 + 6.0 * math.pi) - math.atan(2.0)
    assert float(heading[-1] - heading[0]) == pytest.approx(turned, abs=0.1)


@pytest.mark.parametrize(("left", "sign"), [(True, 1.0), (False, -1.0)])
@pytest.mark.parametrize("radius", [0.5, 5.0, 400.0])
def test_curvature_of_a_circle_is_one_over_its_radius_and_positive_to_the_left(
    left: bool, sign: float, radius: float
) -> None:
    curve = curve_through(ring(96, radius, left), True)
    assert curve.curvature(arcs(curve)).numpy() * radius == pytest.approx(sign, abs=1e-3)


@pytest.mark.parametrize(
    ("points", "closed", "smooth"), [(BENDS, None, 0.0), (LOOP, True, 0.0), (LOOP, True, 0.3), (BENDS, None, 0.3)]
)
def test_curvature_is_the_change_of_heading(points: list[list[float]], closed: bool | None, smooth: float) -> None:
    curve = curve_through(points, closed, smooth)
    way = arcs(curve, 20_001, laps=2.0 if closed else 1.0)
    step = float(way[1])
    changes = rate(curve.heading(way), step)
    assert (changes - curve.curvature(way)[1:-1]).abs().numpy().max() < 0.01 * worst_bend(curve)


def test_curvature_does_not_jump_where_a_closed_curve_comes_round() -> None:
    curve = curve_through(LOOP, True)
    before, after = curve.curvature(torch.tensor([-1e-6, 1e-6], dtype=torch.float64)).tolist()
    assert before == pytest.approx(after, abs=1e-4)
    assert abs(before) > 0.01


def test_an_open_curve_is_not_bent_at_its_ends_and_straight_beyond() -> None:
    curve = curve_through(BENDS)
    ends = torch.tensor([0.0, curve.length], dtype=torch.float64)
    assert curve.curvature(ends).numpy() == pytest.approx(0.0, abs=1e-9)
    beyond = torch.tensor([-3.0, -1.0, -1e-3], dtype=torch.float64)
    for way, end in ((beyond, ends[:1]), (curve.length - beyond, ends[1:])):
        assert curve.curvature(way).tolist() == [0.0] * 3
        assert curve.heading(way).numpy() == pytest.approx(float(curve.heading(end)), abs=1e-12)
        heading = curve.heading(end)
        along = (way - end)[:, None] * torch.stack((torch.sin(heading), torch.cos(heading)), dim=-1)
        assert (curve.position(way) - curve.position(end) - along).abs().numpy().max() < 1e-9


def test_a_closed_curve_goes_round_again() -> None:
    curve = curve_through(LOOP, True)
    way = arcs(curve, 101)[:-1]
    for lap in (-2, 1, 3):
        there = way + lap * curve.length
        assert (curve.position(there) - curve.position(way)).abs().numpy().max() < 1e-9
        assert (curve.curvature(there) - curve.curvature(way)).abs().numpy().max() < 1e-9


@pytest.mark.parametrize("closed", [True, False])
def test_smoothing_bends_less_the_longer_it_averages(closed: bool) -> None:
    rough = ring(40) + np.random.default_rng(5).normal(scale=0.3, size=(40, 2))
    curves = [curve_through(rough, closed, smooth) for smooth in (0.0, 0.3, 1.0, 3.0)]
    bends = [worst_bend(curve) for curve in curves]
    assert all(later < 0.8 * sooner for sooner, later in pairwise(bends))
    assert all(curve.closed is closed for curve in curves)
    assert all(later.length < sooner.length for sooner, later in pairwise(curves))
    missed = [misses(curve, rough).mean() for curve in curves]
    assert missed == sorted(missed)
    assert missed[-1] < 1.5


@pytest.mark.few(4)
@pytest.mark.parametrize("points", [BENDS[:3], BENDS, UNEVEN])
@pytest.mark.parametrize("smooth", [1e-3, 0.5, 2.0])
def test_smoothing_leaves_the_ends_of_an_open_curve_where_they_are_and_unbent(
    points: list[list[float]], smooth: float
) -> None:
    curve = curve_through(points, None, smooth)
    ends = torch.tensor([0.0, curve.length], dtype=torch.float64)
    assert (curve.position(ends).numpy() - np.array([points[0], points[-1]])).tolist() == pytest.approx(
        np.zeros((2, 2)), abs=1e-9
    )
    assert curve.curvature(ends).numpy() == pytest.approx(0.0, abs=1e-9)


def test_a_straight_line_is_smooth_already() -> None:
    curve = curve_through([[0.0, 0.0], [3.0, 4.0]], None, 1.0)
    assert curve.length == pytest.approx(5.0, abs=1e-9)


def test_a_corner_of_three_points_is_rounded() -> None:
    corner = [[0.0, 0.0], [0.0, 10.0], [3.0, 0.0]]
    assert worst_bend(curve_through(corner, None, 1.0)) < 0.6 * worst_bend(curve_through(corner))


def test_smoothing_that_leaves_nothing_is_refused() -> None:
    with pytest.raises(HopdiffError, match=r"path\.smooth must be below a quarter of the path's [0-9.]+ m, not 100\."):
        curve_through(LOOP, True, 100.0)


def test_numbers_come_back_as_doubles_whatever_goes_in() -> None:
    curve = curve_through([[0, 0], [1, 5], [0, 10]])
    way = torch.linspace(0.0, 10.0, 7)
    assert way.dtype == torch.float32
    assert {x.dtype for x in (curve.position(way), curve.heading(way), curve.curvature(way))} == {torch.float64}


PAIRS = "path.points must be a list of pairs of numbers: [[x, z], [x, z], ...]."


@pytest.mark.parametrize(
    ("points", "closed", "said"),
    [
        ([], None, PAIRS),
        ([1.0, 2.0], None, PAIRS),
        ([[0, 0, 0], [1, 1, 1]], None, PAIRS),
        ([[0, 0], [1, 1, 1]], None, PAIRS),
        ([["a", 0], [1, 1]], None, PAIRS),
        ([[None, 0], ["b", 1]], None, PAIRS),
        ("nonsense", None, PAIRS),
        ([[0, 0], [1, math.nan]], None, "path.points: point 2 is not a pair of finite numbers: [1.0, nan]."),
        ([[0, -math.inf], [1, 1]], None, "path.points: point 1 is not a pair of finite numbers: [0.0, -inf]."),
        ([[0, 0]], None, "path.points needs at least two points, not 1."),
        ([[0, 0], [0, 5], [0, 0]], None, "path.points: a closed path needs at least three different points."),
        ([[0, 0], [0, 5]], True, "path.points: a closed path needs at least three different points."),
        ([[3, 4], [3, 4]], False, "path.points: points 1 and 2 are the same, [3.0, 4.0]."),
        ([[0, 0], [3, 4], [3, 4], [5, 5]], None, "path.points: points 2 and 3 are the same, [3.0, 4.0]."),
    ],
)
def test_wrong_points_are_named(points: Any, closed: bool | None, said: str) -> None:
    with pytest.raises(HopdiffError) as caught:
        curve_through(points, closed)
    assert str(caught.value) == said
