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


def elsewhere() -> Scene:
    """A room away from the origin, with a table."""
    return hall_at(-7.0, 11.0)


def hall_at(x: float, z: float) -> Scene:
    return Scene(
        "away", {"room": rectangle(x, z, 3.0, 5.0)}, furniture={"table": rectangle(x + 1.0, z + 2.0, 1.0, 1.0)}
    )


def test_nodes_have_their_places_and_places_their_nodes() -> None:
    grid = FreeSpace(elsewhere(), HALF).grid
    numbers = np.arange(grid.free.size)
    places = grid.place(numbers)
    rng = np.random.default_rng(0)
    near = places + grid.cell * rng.uniform(-0.49, 0.49, places.shape)
    x, z = grid.index(near[:, 1] + 1j * near[:, 0])
    np.testing.assert_array_equal(x * grid.shape[1] + z, numbers)
    np.testing.assert_allclose(np.diff(places[: grid.shape[1]], axis=0), [[0.0, grid.cell]] * (grid.shape[1] - 1))
    # The room with a margin around it, so that what lies outside is never free.
    np.testing.assert_allclose(grid.low, [-7.0 - 2 * grid.cell, 11.0 - 2 * grid.cell])
    assert (places[-1] > [-4.0 + grid.cell, 16.0 + grid.cell]).all()
    for side in (grid.free[0], grid.free[-1], grid.free[:, 0], grid.free[:, -1]):
        assert not side.any()


def test_free_nodes_are_those_a_half_width_off_everything() -> None:
    space = FreeSpace(elsewhere(), HALF)
    free = space.depth(space.grid.place(np.arange(space.grid.free.size))) >= HALF - 1e-9
    np.testing.assert_array_equal(space.grid.free.reshape(-1), free)


def test_the_nearest_free_node_and_the_nearest_clear_point_lie_just_off_the_table() -> None:
    space = FreeSpace(elsewhere(), HALF)
    inside = (-5.9, 13.5)
    node = space.grid.place(np.array(space.grid.nearest_free(inside)))
    assert node[0] == pytest.approx(-6.25, abs=1.5 * space.grid.cell)
    assert node[1] == pytest.approx(13.5, abs=space.grid.cell)
    spot = space.nearest(inside)
    assert spot == pytest.approx((-6.25, 13.5), abs=3e-3)
    assert space.clear([spot])
    assert space.nearest((-6.5, 12.0)) == pytest.approx((-6.5, 12.0))


def test_steps_along_the_grid_are_straight_diagonal_or_like_a_knight() -> None:
    grid = FreeSpace(hall(), HALF).grid
    start = (1.0, 1.0)
    for x, z in ((0, 1), (1, 0), (1, 1), (1, 2), (2, 1), (2, -1), (1, -2), (1, -1)):
        goal = (3.0 + 0.4 * x, 7.0 + 0.4 * z)
        found = grid.length(grid.geodesic(goal), (3.0, 7.0))
        # Ten or so of one kind of step lie on the straight line; ways start and end on nodes.
        assert found == pytest.approx(0.4 * math.hypot(x, z), abs=1.5 * grid.cell)
        there, back = grid.length(grid.geodesic(goal), start), grid.length(grid.geodesic(start), goal)
        assert there == pytest.approx(back)
    ways = grid.geodesic(start)
    assert int(ways.towards[grid.nearest_free(start)]) < 0
    assert grid.line(ways, start).shape == (1, 2)


def test_a_place_that_touches_two_things_names_the_nearer() -> None:
    space = FreeSpace(elsewhere(), HALF)
    with pytest.raises(HopdiffError, match=r"lies 0.10 m from furniture 'table', nearer than"):
        space.check("start", (-6.1, 13.5))
    with pytest.raises(HopdiffError, match=r"lies 0.05 m from a wall"):
        space.check("start", (-6.95, 13.5))
    space.check("start", (-6.75, 11.25))
