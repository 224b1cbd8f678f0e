"""What makes a found way a walk: bends, walls that the whole body keeps off, and no look at the clock."""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Sequence

import numpy as np
import pytest
import torch

from hopdiff.editing.root_path import RootPath
from hopdiff.editing.targets import Constraint, EditedPath, edit_path
from hopdiff.graph import finish
from hopdiff.graph import way as ways
from hopdiff.graph.body import bodies_of
from hopdiff.graph.finish import Finished, Miss, finished
from hopdiff.graph.graph import MotionGraph, build_graph
from hopdiff.graph.moves import BENDS, bent, moves_of
from hopdiff.graph.scene import Place, Wall
from hopdiff.graph.space import FreeSpace
from hopdiff.graph.way_search import Allowance, Goal, State, WaySearch
from hopdiff.types import HopdiffError
from tests.builders import way_settings
from tests.graph.rooms import hall, two_rooms
from tests.graph.test_way import HALF, check_way, deepest
from tests.graph.walkers import walker, wanderer
from tests.people import clip_of

RATE = math.radians(90.0)


@pytest.fixture(scope="module")
def graph() -> MotionGraph:
    return build_graph([wanderer()])


@pytest.fixture(scope="module")
def person() -> MotionGraph:
    return build_graph([clip_of("wander")])


def search_of(graph: MotionGraph, space: FreeSpace, goal: Place, **more: object) -> WaySearch:
    target = Goal(complex(goal.position[1], goal.position[0]), goal.heading, True)
    everywhere = np.ones(graph.frames, dtype=bool)
    moves = more.pop("moves", None) or moves_of(graph)
    geodesic = space.grid.geodesic(goal.position)
    return WaySearch(moves, space, geodesic, target, everywhere, way_settings(), Allowance(10**6), **more)  # type: ignore[arg-type]


def test_arms_stay_out_of_the_posts_of_a_narrow_door(person: MotionGraph, monkeypatch: pytest.MonkeyPatch) -> None:
    scene, start, goal = two_rooms(width=1.0), Place((1.2, 1.0), 0.3), Place((2.8, 8.0), 0.0)
    way = ways.find_way(person, scene, start, goal, way_settings())
    check_way(way, scene, start, goal)
    # Whoever looks at the middle of the body alone walks through the posts.
    monkeypatch.setattr(
        ways,
        "bodies_of",
        lambda graph: dataclasses.replace(bodies_of(graph), parts=np.zeros((graph.frames, 1), dtype=complex)),
    )
    monkeypatch.setattr(finish, "hits", lambda space, root, parts: np.zeros(len(root), dtype=complex))
    careless = ways.find_way(person, scene, start, goal, way_settings())
    assert deepest(careless.clip, scene) > 0.01


def test_a_search_leaves_out_moves_that_lead_a_hand_into_a_wall(person: MotionGraph) -> None:
    space = FreeSpace(two_rooms(width=1.0), HALF)
    search = search_of(person, space, Place((2.0, 7.8), 0.0), body=bodies_of(person))
    starts = [State(frame, 1.2 + 2.0j, 0.0) for frame in range(0, person.frames, 5)]
    body, moves = bodies_of(person), search.moves
    for found in itertools.islice(search.ways_from(starts), 3):
        frame, place, yaw = found.start.frame, found.start.place, found.start.yaw
        for move in found.moves:
            heading = yaw + moves.yaw[move]
            parts = (place + np.exp(1j * yaw) * moves.place[move])[:, None] + np.exp(1j * heading)[
                :, None
            ] * body.parts[moves.shown[move]]
            assert float(np.abs(space.way_out(parts)).max()) < 0.03  # a square of the raster
            place, yaw = place + np.exp(1j * yaw) * complex(moves.place[move, -1]), yaw + float(moves.yaw[move, -1])
            frame = int(moves.end[move])
        assert frame == found.state.frame


def test_what_is_near_behind_a_wall_is_not_near(graph: MotionGraph) -> None:
    space = FreeSpace(hall(6.0, 14.0, walls={"long": Wall((0.0, 7.0), (5.0, 7.0), 0.02)}), 0.05)
    search = search_of(graph, space, Place((3.0, 7.2), 0.0))
    assert search._sees(np.array([6.8 + 3.0j, 7.4 + 3.0j, 7.2 + 3.4j])).tolist() == [False, True, True]


def test_a_crowd_holds_few_states_at_one_place_but_all_that_a_way_may_start_in(graph: MotionGraph) -> None:
    space = FreeSpace(hall(6.0, 14.0), HALF)
    states = [State(frame, 3.0 + 3.0j, 0.0) for frame in range(0, graph.frames, 5)]
    held = {}
    for crowd in (2, None):
        search = search_of(graph, space, Place((3.0, 9.0), 0.0), crowd=crowd)
        next(search.ways_from(states))
        nodes = search._nodes
        assert int((nodes.parent[: nodes.count] < 0).sum()) == len(states)
        spots = nodes.key[: nodes.count][nodes.parent[: nodes.count] >= 0] % search._spots
        cells = np.unique(nodes.key[: nodes.count][nodes.parent[: nodes.count] >= 0]) % search._spots
        held[crowd] = int(np.unique(cells, return_counts=True)[1].max())
        assert search.crowded is (crowd is not None)
        assert len(spots) > 100
    # Cells that starts lie in are no news when they are reached again.
    assert held[2] <= 2 < (held[None] or 0)


def test_bent_stretches_turn_by_the_rate_and_go_along_arcs() -> None:
    straight = build_graph([walker([(8.0, 0.0)], speed=1.2, period=0.9713)])
    plain, moves = moves_of(straight), bent(moves_of(straight), RATE)
    stretches = int((plain.transition < 0).sum())
    assert len(moves.end) == len(plain.end) + len(BENDS) * stretches
    own = moves.bend == 0
    np.testing.assert_allclose(moves.place[own], plain.place)
    np.testing.assert_array_equal(moves.end[own], plain.end)
    start = np.repeat(np.arange(straight.frames), np.diff(moves.first))
    np.testing.assert_array_equal(
        np.unique(start), np.unique(np.repeat(np.arange(straight.frames), np.diff(plain.first)))
    )
    time = moves.frames * straight.frame_time
    for rate, share in BENDS:
        mine = (np.abs(moves.bend - rate * RATE * time) < 1e-12) & (moves.share == share) & ~own
        assert int(mine.sum()) == stretches
        # The chord of an arc, but for the sway of the walk.
        angle = rate * RATE * time[mine]
        chord = share * 1.2 * time[mine] * np.sin(0.5 * angle) / (0.5 * angle)
        np.testing.assert_allclose(np.abs(moves.place[mine, -1]), chord, rtol=0.02)


def test_a_bent_walk_is_where_the_search_says(person: MotionGraph) -> None:
    space, goal = FreeSpace(hall(8.0, 8.0), HALF), Place((4.0, 2.0), math.pi)
    moves = bent(moves_of(person), RATE)
    search = search_of(person, space, goal, moves=moves, body=bodies_of(person))
    starts = [State(frame, 5.0 + 6.0j, 0.5) for frame in range(0, person.frames, 40)]
    bends = 0
    for found in itertools.islice(search.ways_from(starts), 4):
        walk = finished(person, moves, space, found, Place((6.0, 5.0), 0.5), goal, edit_path)
        bends += bool(moves.bend[list(found.moves)].any())
        if isinstance(walk, Finished):
            end = walk.graph_path.place[-1].tolist()
            # Bends begin and end softly, which shifts what follows a little.
            assert math.dist(end, goal.position) == pytest.approx(found.gap[0], abs=0.05)
    assert bends


def test_of_a_long_walk_only_the_end_is_bent_to_the_goal(graph: MotionGraph) -> None:
    asked: list[Sequence[Constraint]] = []

    def watched(path: RootPath, constraints: Sequence[Constraint], frame_time: float) -> EditedPath:
        asked.append(constraints)
        return edit_path(path, constraints, frame_time)

    scene, start, goal = hall(6.0, 40.0), Place((3.0, 2.0), 0.0), Place((3.0, 36.0), 0.0)
    way = ways.find_way(graph, scene, start, goal, way_settings(), watched)
    held = [one for one in asked[-1][2:] if one.yaw is None]
    assert len(held) > 5
    moved = (way.path.place - way.graph_path.place).norm(dim=-1)
    far = (way.graph_path.place - way.graph_path.place[-1]).norm(dim=-1) > 8.0
    assert float(moved[far].max()) < 0.1 * float(moved[-1]) + 0.01


def test_a_walk_that_would_have_to_dash_is_told_from_one_that_meets_a_wall(graph: MotionGraph) -> None:
    space, start, goal = FreeSpace(hall(6.0, 14.0), HALF), Place((3.0, 2.0), 0.0), Place((3.0, 9.0), 0.0)
    search = search_of(graph, space, goal)
    found = next(search.ways_from([State(100, 2.0 + 3.0j, 0.0)]))
    assert isinstance(finished(graph, search.moves, space, found, start, goal, edit_path), Finished)
    far = Place((3.0, 13.0), 2.5)
    assert finished(graph, search.moves, space, found, start, far, edit_path) is Miss.HASTE

    def astray(path: RootPath, constraints: Sequence[Constraint], frame_time: float) -> EditedPath:
        edited = edit_path(path, constraints, frame_time)
        bulge = 4.0 * torch.sin(torch.linspace(0.0, math.pi, path.frames, dtype=torch.float64)) ** 2
        place = edited.path.place + torch.stack((bulge, torch.zeros_like(bulge)), dim=-1)
        return dataclasses.replace(edited, path=RootPath(place, edited.path.yaw))

    long = Place((3.0, 30.0), 0.0)
    space = FreeSpace(hall(6.0, 34.0), HALF)
    search = search_of(graph, space, long)
    found = next(search.ways_from([State(100, 2.0 + 3.0j, 0.0)]))
    assert finished(graph, search.moves, space, found, start, long, astray) is Miss.WALL


def test_no_clock_is_looked_at(graph: MotionGraph, monkeypatch: pytest.MonkeyPatch) -> None:
    start, goal = Place((1.0, 1.0), 0.5), Place((1.0, 8.0), 0.0)
    own = ways.find_way(graph, two_rooms(), start, goal, way_settings())
    late = itertools.count(0.0, 3600.0)
    monkeypatch.setattr("time.perf_counter", lambda: next(late))
    slow = ways.find_way(graph, two_rooms(), start, goal, way_settings())
    assert slow.numbers["seconds"] >= 3600.0
    assert torch.equal(own.clip.root_position, slow.clip.root_position)
    assert torch.equal(own.clip.rotations, slow.clip.rotations)


@pytest.mark.parametrize("what", ["start", "goal"])
def test_places_where_no_pose_fits_are_told(person: MotionGraph, what: str) -> None:
    scene = hall(6.0, 8.0, walls={"near": Wall((2.8, 0.0), (2.8, 8.0), 0.1), "far": Wall((3.2, 1.0), (3.2, 8.0), 0.1)})
    places = {"start": Place((5.0, 4.0), 0.0), "goal": Place((5.0, 6.0), 0.0), what: Place((3.0, 6.0), 0.0)}
    said = rf"no pose of the clips that is asked for fits at the {what} \[3.0, 6.0\] .* \w+ is \d+\.\d cm inside wall"
    with pytest.raises(HopdiffError, match=said):
        ways.find_way(person, scene, places["start"], places["goal"], way_settings(half_width=0.1))
