from __future__ import annotations

import math

import numpy as np
import pytest

from hopdiff.graph.scene import Scene
from hopdiff.graph.space import FreeSpace
from hopdiff.types import HopdiffError
from tests.graph.rooms import hall, rectangle, split_hall, two_rooms

HALF = 0.25


@pytest.mark.parametrize(
    ("path", "room"),
    [
        ([[1.0, 1.0], [1.0, 13.0]], 1.0),
        ([[3.0, 3.0]], 3.0),
        ([[0.25, 2.0], [0.25, 4.0]], 0.25),
        ([[0.1, 2.0], [3.0, 4.0]], 0.1),
        ([[3.0, 3.0], [3.0, 14.6]], -0.6),
        ([[5.0, 5.0], [7.0, 5.0], [5.0, 6.0]], -1.0),
        ([[-2.0, -1.0], [-1.5, -1.0]], -math.hypot(2.0, 1.0)),
    ],
)
def test_the_clearance_is_the_least_distance_to_what_is_not_free(path: list, room: float) -> None:
    space = FreeSpace(hall(), HALF)
    assert space.clearance(path) == pytest.approx(room)
    assert space.clear(path) == (room >= HALF)


def test_a_path_that_jumps_over_a_wall_between_frames_is_not_clear() -> None:
    space = FreeSpace(split_hall(), HALF)
    assert space.clear([[1.0, 5.0]])
    assert space.clear([[1.0, 7.0]])
    assert not space.clear([[1.0, 5.0], [1.0, 7.0]])
    assert space.clearance([[5.25, 4.0], [5.25, 8.0]]) == pytest.approx(0.75)


def test_furniture_and_doors_count() -> None:
    space = FreeSpace(two_rooms(), HALF)
    assert space.clearance([[2.0, 1.0], [2.0, 8.0]]) == pytest.approx(0.6, abs=1e-4)
    assert space.clear([[2.3, 1.0], [2.3, 8.0]])
    assert not space.clear([[2.4, 1.0], [2.4, 8.0]])
    depth = FreeSpace(split_hall(), HALF).depth([[2.5, 8.0], [2.5, 8.6], [3.0, 3.0], [-1.0, 1.0]])
    np.testing.assert_allclose(depth, [0.5, -0.1, 2.9, -1.0], atol=1e-9)


@pytest.mark.parametrize(
    ("point", "said"),
    [
        ((2.5, 9.0), r"the goal \[2.5, 9\] lies inside furniture 'table'"),
        ((1.0, 6.0), r"the goal \[1, 6\] lies inside wall 'across'"),
        ((-1.0, 2.0), "lies inside a wall or outside the rooms, 1.00 m off"),
        ((0.1, 2.0), "lies 0.10 m from a wall, nearer than the body's half width of 0.25 m"),
        ((3.2, 9.0), "lies 0.20 m from furniture 'table'"),
        ((4.6, 6.0), "lies 0.10 m from wall 'across'"),
        ((math.nan, 6.0), "must be two finite numbers"),
    ],
)
def test_a_place_where_a_body_cannot_be_is_told_with_what_is_in_its_way(point: tuple, said: str) -> None:
    space = FreeSpace(split_hall(), HALF)
    with pytest.raises(HopdiffError, match=said):
        space.check("goal", point)
    space.check("goal", (5.0, 5.0))


@pytest.mark.parametrize("half_width", [-0.1, math.nan, math.inf, 2.0])
def test_half_widths_that_cannot_be_are_told(half_width: float) -> None:
    with pytest.raises(HopdiffError, match=r"way\.half_width must be|no floor for a body 4 m wide"):
        FreeSpace(two_rooms(), half_width)


@pytest.mark.parametrize("point", [(0.3, 0.3), (5.7, 13.7), (3.0, 1.0), (1.0, 9.0), (4.4, 7.9)])
def test_ways_in_an_empty_room_are_straight(point: tuple[float, float]) -> None:
    grid = FreeSpace(hall(), HALF).grid
    goal = (2.0, 6.0)
    found = grid.length(grid.geodesic(goal), point)
    straight = math.dist(goal, point)
    assert 0.99 * straight - grid.cell <= found <= 1.03 * straight + 2 * grid.cell


def test_ways_lead_around_walls_and_keep_off_them() -> None:
    space = FreeSpace(split_hall(), HALF)
    start, goal = (1.0, 5.0), (1.0, 7.0)
    ways = space.grid.geodesic(goal)
    # Around the end of the wall, a half width off its corners.
    corner = math.dist(start, (4.5, 5.9 - HALF)) + math.dist(goal, (4.5, 6.1 + HALF)) + math.pi * HALF
    assert space.grid.length(ways, start) == pytest.approx(corner, rel=0.06)
    line = space.grid.line(ways, start)
    assert space.clearance(line) > HALF - space.grid.cell
    np.testing.assert_allclose(line[0], start, atol=space.grid.cell)
    np.testing.assert_allclose(line[-1], goal, atol=space.grid.cell)
    steps = np.hypot(*np.diff(line, axis=0).T)
    assert steps.sum() == pytest.approx(space.grid.length(ways, start))


@pytest.mark.parametrize(("width", "open_"), [(1.2, True), (0.6, True), (0.45, False)])
def test_a_door_lets_through_who_is_thin_enough(width: float, open_: bool) -> None:
    grid = FreeSpace(two_rooms(width), HALF).grid
    assert math.isfinite(grid.length(grid.geodesic((2.0, 8.0)), (2.0, 1.0))) == open_


def test_the_grid_of_a_large_scene_is_coarser_and_not_larger() -> None:
    space = FreeSpace(Scene("field", {"field": rectangle(0.0, 0.0, 200.0, 150.0)}), HALF)
    assert space.grid.free.size < 300_000
    assert space.grid.cell > 0.2


def test_points_outside_the_grid_are_not_free() -> None:
    grid = FreeSpace(hall(), HALF).grid
    places = np.array([-50.0 - 50.0j, 1e6 + 0j, 3.0 + 99.0j, 3.0 + 3.0j])
    assert grid.free[grid.index(places)].tolist() == [False, False, False, True]
