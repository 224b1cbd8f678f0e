from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
import torch

from hopdiff.editing.root_path import RootPath, root_path
from hopdiff.editing.targets import Constraint, EditedPath, edit_path
from hopdiff.geometry.clip import Clip
from hopdiff.graph import way as ways
from hopdiff.graph.blend import assemble
from hopdiff.graph.body import bodies_of
from hopdiff.graph.finish import pieces_of
from hopdiff.graph.graph import MotionGraph, build_graph
from hopdiff.graph.moves import moves_of, standing
from hopdiff.graph.scene import Place, Scene
from hopdiff.graph.scene_file import read_scene
from hopdiff.graph.settings import WaySettings
from hopdiff.graph.space import FreeSpace
from hopdiff.graph.way import Way, start_states
from hopdiff.graph.way_search import Allowance, Found, Goal, State, WaySearch
from hopdiff.types import HopdiffError
from tests.builders import way_settings
from tests.graph.rooms import hall, split_hall, two_rooms
from tests.graph.walkers import angles_between, walker, wanderer
from tests.people import clip_of

SCENES = Path(__file__).resolve().parents[2] / "conf" / "scenes"
HALF = 0.25


def find_way(
    graph: MotionGraph, scene: Scene, start: Place, goal: Place, settings: WaySettings | None = None, **edit: Any
) -> Way:
    return ways.find_way(graph, scene, start, goal, settings or way_settings(), **edit)


@pytest.fixture(scope="module")
def graph() -> MotionGraph:
    return build_graph([wanderer()])


@pytest.fixture(scope="module", params=["wander", "wander_snu_93s_30hz"])
def person(request: pytest.FixtureRequest) -> MotionGraph:
    """Of someone who walks about, turns to both sides and stands at times."""
    return build_graph([clip_of(request.param)])


def deepest(clip: Clip, scene: Scene) -> float:
    """How deep any joint or end site of a clip gets into what is no free floor [m]."""
    parts = torch.cat([clip.joint_positions(), *(end[:, None] for end in clip.end_positions().values())], dim=1)
    return float(shapely.distance(scene.free(), shapely.points(parts[..., [0, 2]].reshape(-1, 2).numpy())).max())


def check_way(way: Way, scene: Scene, start: Place, goal: Place, half_width: float = HALF) -> None:
    """Exact at both ends, clear of everything, and as quick as the clips; from the finished clip itself."""
    path = root_path(way.clip)
    for frame, place in ((0, start), (-1, goal)):
        assert math.dist(path.place[frame].tolist(), place.position) <= 1e-3
        assert abs(math.remainder(float(path.yaw[frame]) - place.heading, math.tau)) <= math.radians(0.1)
    space = FreeSpace(scene, half_width)
    assert space.clearance(path.place) >= half_width - 1e-6
    assert way.numbers["clearance"] == pytest.approx(space.clearance(path.place), abs=1e-9)
    assert deepest(way.clip, scene) <= 0.01
    assert way.numbers["gap"] <= 0.5 + 1e-6
    assert way.numbers["gap_deg"] <= 45.0 + 3.0  # blends turn a little otherwise than the search thinks
    assert way.clip.frames == way.graph_clip.frames == way.numbers["frames"]
    # Only the root is edited, and legs are put right after that.
    assert torch.equal(way.edited_clip.rotations[:, 1:], way.graph_clip.rotations[:, 1:])
    lean = way.edited_clip.rotations[:, 0, 1, :]  # where up is, seen from the root
    torch.testing.assert_close(lean, way.graph_clip.rotations[:, 0, 1, :])


def test_a_straight_way_is_walked_straight(graph: MotionGraph) -> None:
    start, goal = Place((3.0, 1.0), 0.0), Place((3.0, 11.0), 0.0)
    way = find_way(graph, hall(), start, goal, way_settings())
    check_way(way, hall(), start, goal)
    assert way.numbers["length"] < 1.03 * 10.0
    assert way.numbers["duration"] < 1.1 * 10.0 / 1.2
    assert float((way.path.place[:, 0] - 3.0).abs().max()) < 0.3


@pytest.mark.few(3)
@pytest.mark.parametrize("heading", [0.0, 90.0, 180.0, -90.0])
def test_the_goal_is_met_with_any_heading(graph: MotionGraph, heading: float) -> None:
    start, goal = Place((3.0, 2.0), 0.4), Place((3.0, 9.0), math.radians(heading))
    way = find_way(graph, hall(), start, goal)
    check_way(way, hall(), start, goal)


def test_a_way_leads_through_a_door(graph: MotionGraph) -> None:
    start, goal = Place((1.0, 1.0), math.radians(45.0)), Place((1.2, 7.5), math.radians(-45.0))
    way = find_way(graph, two_rooms(), start, goal)
    check_way(way, two_rooms(), start, goal)
    inside = (way.path.place[:, 1] > 4.0) & (way.path.place[:, 1] < 5.0)
    assert bool(inside.any())
    assert float((way.path.place[inside, 0] - 2.0).abs().max()) <= 0.6 - HALF + 1e-6


def test_the_search_alone_finds_the_quickest_of_all_walks() -> None:
    # One straight walk that can start anywhere and go on for ever: the time is the way over the speed.
    graph = build_graph([walker([(8.0, 0.0)], speed=1.2, period=0.9713)])
    space = FreeSpace(hall(6.0, 30.0), HALF)
    ways = space.grid.geodesic((3.0, 25.0))
    settings = way_settings(weight=1.0, radius=0.1, angle_deg=10.0)
    everywhere = np.ones(graph.frames, dtype=bool)
    goal = Goal(25.0 + 3.0j, 0.0, True)
    search = WaySearch(moves_of(graph), space, ways, goal, everywhere, settings, Allowance(10**7))
    found = next(search.ways_from([State(frame, 2.0 + 3.0j, 0.0) for frame in range(0, graph.frames, 5)]))
    assert found.frames / 30.0 == pytest.approx(23.0 / 1.2, rel=0.02)
    assert found.gap[0] <= 0.1
    assert search.expansions == search.budget.expansions > 0


def test_the_first_frame_and_standing_can_be_asked_for(person: MotionGraph) -> None:
    scene = read_scene(SCENES / "two_rooms.yaml")
    start, goal = scene.place("start"), scene.place("goal")
    way = find_way(person, scene, start, goal, way_settings(start_frame=300))
    check_way(way, scene, start, goal)
    assert way.numbers["start_frame"] == 300
    way = find_way(person, scene, start, goal, way_settings(start="standing", end="standing"))
    check_way(way, scene, start, goal)
    able = standing(person)
    assert able[int(way.numbers["start_frame"])]
    last = way.graph_path.place[-4:].diff(dim=0).norm(dim=-1)
    assert float(last.mean()) * 30.0 < 0.4


@pytest.mark.parametrize(("name", "expansions"), [("two_rooms", 12_000), ("flat", 80_000)])
def test_walks_of_people_cross_the_shipped_scenes(person: MotionGraph, name: str, expansions: int) -> None:
    scene = read_scene(SCENES / f"{name}.yaml")
    start, goal = scene.place("start"), scene.place("goal")
    way = find_way(person, scene, start, goal)
    check_way(way, scene, start, goal)
    assert way.numbers["expansions"] < expansions
    source = person.clips[0]
    own, made = (angles_between(clip.rotations[:-1, 1:], clip.rotations[1:, 1:]).max() for clip in (source, way.clip))
    assert float(made) <= 1.5 * float(own)


def test_the_edit_that_is_given_is_the_one_that_is_used(graph: MotionGraph) -> None:
    asked: list[Sequence[Constraint]] = []

    def watched(path: RootPath, constraints: Sequence[Constraint], frame_time: float) -> EditedPath:
        asked.append(constraints)
        return edit_path(path, constraints, frame_time)

    start, goal = Place((3.0, 1.0), 0.0), Place((3.0, 8.0), 0.2)
    way = find_way(graph, hall(), start, goal, edit_path=watched)
    first, last = asked[-1][:2]
    assert (first.frame, first.place, first.yaw) == (0, start.position, start.heading)
    assert (last.frame, last.place, last.yaw) == (way.clip.frames - 1, goal.position, goal.heading)


def bulging(width: float, times: int) -> tuple[list[int], object]:
    """An edit that adds a bulge to the side to the first paths that it makes."""
    calls: list[int] = []

    def edit(path: RootPath, constraints: Sequence[Constraint], frame_time: float) -> EditedPath:
        calls.append(len(constraints))
        edited = edit_path(path, constraints, frame_time)
        if len(calls) > times:
            return edited
        bulge = width * torch.sin(torch.linspace(0.0, math.pi, path.frames, dtype=torch.float64)) ** 2
        place = edited.path.place + torch.stack((bulge, torch.zeros_like(bulge)), dim=-1)
        return dataclasses.replace(edited, path=RootPath(place, edited.path.yaw))

    return calls, edit


def test_a_path_that_the_edit_bends_into_a_wall_is_bound_there_or_given_up_for_the_next(graph: MotionGraph) -> None:
    start, goal = Place((2.0, 1.0), 0.0), Place((2.0, 8.0), 0.0)
    calls, edit = bulging(0.35, 1)
    way = find_way(graph, two_rooms(), start, goal, edit_path=edit)  # type: ignore[arg-type]
    check_way(way, two_rooms(), start, goal)
    assert way.numbers["pins"] == 1
    assert calls == [2, 3]
    calls, edit = bulging(0.6, 40)
    way = find_way(graph, two_rooms(), start, goal, edit_path=edit)  # type: ignore[arg-type]
    check_way(way, two_rooms(), start, goal)
    assert way.numbers["tries"] > 1


def test_where_no_edit_keeps_off_the_walls_it_is_told(graph: MotionGraph) -> None:
    _, edit = bulging(3.0, 10**9)
    start, goal = Place((2.0, 1.0), 0.0), Place((2.0, 8.0), 0.0)
    with pytest.raises(HopdiffError, match=r"\d+ walks come near it, but none can be bent"):
        find_way(graph, two_rooms(), start, goal, way_settings(tries=2), edit_path=edit)  # type: ignore[arg-type]


def test_a_short_walk_is_not_bent_into_a_dash(graph: MotionGraph) -> None:
    # The goal lies within the radius of the start, but a walk of no way cannot be stretched to it.
    start, goal = Place((3.0, 3.0), 0.0), Place((3.35, 3.2), math.radians(40.0))
    way = find_way(graph, hall(), start, goal)
    check_way(way, hall(), start, goal)
    source = root_path(graph.clips[0])
    for part in (lambda path: path.place.diff(dim=0).norm(dim=-1), lambda path: path.yaw.diff().abs()):
        own = max(float(part(source).max()), float(part(way.graph_path).max()))
        assert float(part(way.path).max()) <= 1.3 * own + 1e-9
    assert way.numbers["tries"] > 1  # the first that comes near has to be bent too far


@pytest.mark.parametrize(
    ("start", "goal", "said"),
    [
        ((2.5, 9.0), (3.0, 3.0), r"the start \[2.5, 9\] lies inside furniture 'table'"),
        ((3.0, 3.0), (1.0, 6.0), r"the goal \[1, 6\] lies inside wall 'across'"),
        ((3.0, 3.0), (9.0, 6.0), r"the goal \[9, 6\] lies inside a wall or outside the rooms"),
    ],
)
def test_places_inside_something_are_told(graph: MotionGraph, start: tuple, goal: tuple, said: str) -> None:
    with pytest.raises(HopdiffError, match=said):
        find_way(graph, split_hall(), Place(start, 0.0), Place(goal, 0.0))


@pytest.mark.parametrize("scene", [two_rooms(door=False), two_rooms(width=0.4)], ids=["no door", "narrow door"])
def test_walls_all_around_are_told(graph: MotionGraph, scene: Scene) -> None:
    said = r"no way leads from the start \[1.0, 1.0\] to the goal \[1.0, 8.0\] for a body 0.5 m wide"
    with pytest.raises(HopdiffError, match=said):
        find_way(graph, scene, Place((1.0, 1.0), 0.0), Place((1.0, 8.0), 0.0))


def test_clips_that_cannot_turn_are_told_with_how_near_they_came() -> None:
    straight = build_graph([walker([(6.0, 0.0)], period=0.9713)])
    start, goal = Place((3.0, 2.0), 0.0), Place((3.0, 6.0), math.pi)
    said = (
        r"the clips hold no walk to the goal: all that they can do was searched .* came within .* m and 1[67]. degrees"
    )
    with pytest.raises(HopdiffError, match=said):
        find_way(straight, hall(), start, goal, way_settings(bend=0.0))
    with pytest.raises(HopdiffError, match="it never came near it"):
        find_way(straight, hall(20.0, 20.0), Place((2.0, 2.0), 0.0), Place((18.0, 18.0), 0.0), way_settings(bend=0.0))
    # Bent they turn.
    way = find_way(straight, hall(), start, goal)
    check_way(way, hall(), start, goal)
    assert way.numbers["bend_deg"] > 120.0
    assert float(way.path.yaw.diff().abs().max()) < 1.3 * math.radians(90.0 + 30.0) / 30.0


@pytest.mark.parametrize(
    ("limits", "said"),
    [
        ({"expansions": 100}, r"after \d+ steps, with way.expansions=100: it (never came near|came within)"),
    ],
)
def test_a_search_that_is_cut_short_says_so(graph: MotionGraph, limits: dict, said: str) -> None:
    with pytest.raises(HopdiffError, match=said):
        find_way(graph, split_hall(), Place((1.0, 1.0), 0.0), Place((1.0, 10.5), 0.0), way_settings(**limits))


@pytest.mark.parametrize(
    ("settings", "said"),
    [
        ({"radius": 0.0}, "way.radius must be above 0"),
        ({"angle_deg": -1.0}, "way.angle_deg must be above 0"),
        ({"radius": math.nan}, "way.radius must be a finite number"),
        ({"tries": 0}, "way.tries must be above 0"),
        ({"expansions": 0}, "way.expansions must be above 0"),
        ({"blend_cost": -0.1}, "way.blend_cost must be 0 or more"),
        ({"half_width": -0.1}, "way.half_width must be 0 or more"),
        ({"weight": 0.5}, "way.weight must be 1 or more"),
        ({"start": "sitting"}, "Unknown way.start 'sitting'"),
        ({"end": "lying"}, "Unknown way.end 'lying'"),
        ({"start_frame": 10**6}, "way.start_frame must be from 0 to"),
        ({"start_frame": -1}, "way.start_frame must be from 0 to"),
        ({"start": "standing"}, "way.start=standing: the body stands in no frame"),
        ({"end": "standing"}, "way.end=standing: the body stands in no frame"),
    ],
)
def test_settings_of_a_way_are_checked(graph: MotionGraph, settings: dict, said: str) -> None:
    with pytest.raises(HopdiffError, match=said):
        find_way(graph, hall(), Place((3.0, 1.0), 0.0), Place((3.0, 5.0), 0.0), way_settings(**settings))


@pytest.mark.parametrize("what", ["start", "goal"])
def test_headings_must_be_numbers(graph: MotionGraph, what: str) -> None:
    places = {"start": Place((3.0, 1.0), 0.0), "goal": Place((3.0, 5.0), 0.0)}
    places[what] = dataclasses.replace(places[what], heading=math.nan)
    with pytest.raises(HopdiffError, match=f"the {what}'s heading must be a finite number"):
        find_way(graph, hall(), places["start"], places["goal"])


@pytest.mark.thorough
@pytest.mark.parametrize("name", ["two_rooms", "flat"])
def test_walks_are_found_between_places_drawn_at_random(
    person: MotionGraph, name: str, request: pytest.FixtureRequest
) -> None:
    """All of them from captured walking; the made-up person turns in fewer ways, and gets to most."""
    captured = request.node.callspec.params["person"] != "wander"
    scene = read_scene(SCENES / f"{name}.yaml")
    grid = FreeSpace(scene, HALF).grid
    rng = np.random.default_rng(0)
    free = np.flatnonzero(grid.free)
    missed = 0
    for _ in range(20 if captured else 7):
        spots = [Place(tuple(grid.place(rng.choice(free)).tolist()), rng.uniform(-math.pi, math.pi)) for _ in range(2)]
        try:
            way = find_way(person, scene, *spots)
        except HopdiffError:
            missed += 1
            continue
        check_way(way, scene, *spots)
    assert missed <= (0 if captured else 3)


def test_pieces_show_every_frame_of_a_chain_and_end_where_it_does(graph: MotionGraph) -> None:
    """Walks of random moves."""
    moves = moves_of(graph)
    rng = np.random.default_rng(3)
    jumped = 0
    for _ in range(12):
        frame = int(rng.integers(0, graph.frames // 2))
        state, taken = State(frame, 2.0 - 1.0j, 0.7), []
        while len(taken) < 6 and moves.first[frame + 1] > moves.first[frame]:
            move = int(rng.integers(moves.first[frame], moves.first[frame + 1]))
            taken.append(move)
            place = state.place + np.exp(1j * state.yaw) * complex(moves.place[move, -1])
            state = State(int(moves.end[move]), complex(place), state.yaw + float(moves.yaw[move, -1]))
            frame = state.frame
        start = State(int(np.searchsorted(moves.first, taken[0], side="right")) - 1, 2.0 - 1.0j, 0.7)
        jumped += sum(int(moves.transition[move]) >= 0 for move in taken)
        count = int(moves.frames[taken].sum())
        pieces, frames = pieces_of(moves, Found(start, tuple(taken), count, state, (0.0, 0.0)))
        assert frames == count + 1
        # It may end within its last move.
        assert pieces_of(moves, Found(start, tuple(taken), count - 1, state, (0.0, 0.0))) == (pieces, count)
        clip = assemble(graph, pieces)
        assert clip.frames == count + 1
        path = root_path(clip)
        assert path.place[0].tolist() == pytest.approx([-1.0, 2.0])
        assert path.place[-1].tolist() == pytest.approx([state.place.imag, state.place.real], abs=1e-6)
        assert math.remainder(float(path.yaw[0]) - 0.7, math.tau) == pytest.approx(0.0, abs=1e-9)
        assert math.remainder(float(path.yaw[-1]) - state.yaw, math.tau) == pytest.approx(0.0, abs=0.02)
    assert jumped > 20


def searched(graph: MotionGraph, goal: Goal, **settings: float) -> WaySearch:
    space = FreeSpace(hall(6.0, 20.0), HALF)
    ways = space.grid.geodesic((goal.place.imag, goal.place.real))
    everywhere = np.ones(graph.frames, dtype=bool)
    return WaySearch(moves_of(graph), space, ways, goal, everywhere, way_settings(**settings), Allowance(10**7))


def test_a_gap_is_a_share_of_what_may_be_left(graph: MotionGraph) -> None:
    search = searched(graph, Goal(9.0 + 3.0j, 0.0, True), radius=0.4, angle_deg=30.0)
    assert search.badness((0.1, 0.0)) == pytest.approx(0.25)
    assert search.badness((0.1, math.radians(15.0))) == pytest.approx(0.5)
    assert search.badness((0.6, math.radians(15.0))) == pytest.approx(1.5)


def test_a_turn_that_is_left_takes_as_long_as_the_quickest_turn(graph: MotionGraph) -> None:
    """What the search expects to be left, at the goal but for its heading: 1.5 rad, less what may be left."""
    search = searched(graph, Goal(9.0 + 3.0j, 1.0, True), weight=1.0, radius=0.4, angle_deg=30.0)
    nothing = np.array([-1])
    search._push(np.array([0]), np.array([9.0 + 3.0j]), np.array([-0.5]), np.zeros(1), nothing, nothing)
    rate = float(np.abs(search.moves.yaw[:, -1] / (search.moves.frames * graph.frame_time)).max())
    assert search._queue[0][0] >= (1.5 - math.radians(30.0)) / search.moves.quickest - 1e-9
    assert search.moves.quickest >= rate
    assert search._queue[0][0] > 0.0


def test_transitions_are_taken_only_where_they_save_what_they_cost(graph: MotionGraph) -> None:
    """The best walk where they cost nothing, and where they cost a second each."""
    starts = [State(frame, 1.5 + 3.0j, 0.0) for frame in range(0, graph.frames, 40)]
    jumps = []
    for price in (0.0, 1.0):
        search = searched(graph, Goal(9.5 + 2.0j, 0.3, True), weight=1.0, blend_cost=price, radius=0.3, angle_deg=20.0)
        found = next(search.ways_from(starts))
        taken = search.moves.transition[list(found.moves)] >= 0
        jumps.append(int(taken.sum()))
    assert jumps[1] < jumps[0]


def test_the_last_gap_is_walked_where_that_is_sooner_than_it_counts() -> None:
    """At 1.2 m/s a metre takes .83 s, and counts a second for a radius of a metre: it is walked to the end."""
    graph = build_graph([walker([(8.0, 0.0)], speed=1.2, period=0.9713)])
    starts = [State(0, 2.0 + 3.0j, 0.0)]
    gaps = []
    for last in (True, False):
        found = next(searched(graph, Goal(8.0 + 3.0j, 0.0, last), weight=1.0, radius=1.0).ways_from(starts))
        gaps.append(found.gap[0])
    assert gaps[0] < 0.25
    # A point on the way need not be met.
    assert gaps[1] > 0.5
    fast = build_graph([walker([(8.0, 0.0)], speed=0.8, period=0.9713)])
    found = next(searched(fast, Goal(7.0 + 3.0j, 0.0, True), weight=1.0, radius=1.0).ways_from(starts))
    assert found.gap[0] > 0.5


def test_a_found_way_is_told_move_by_move(graph: MotionGraph) -> None:
    starts = [State(frame, 1.5 + 3.0j, 0.2) for frame in range(0, graph.frames, 40)]
    goal = Goal(9.0 + 2.5j, -0.3, True)
    search = searched(graph, goal)
    moves = search.moves
    for _, found in zip(range(5), search.ways_from(starts), strict=False):
        assert found.start in starts
        frame, place, yaw = found.start.frame, found.start.place, found.start.yaw
        for move in found.moves:
            assert moves.first[frame] <= move < moves.first[frame + 1]
            before = (place, yaw)
            place = place + np.exp(1j * yaw) * complex(moves.place[move, -1])
            frame, yaw = int(moves.end[move]), yaw + float(moves.yaw[move, -1])
        assert found.state.frame == frame
        assert found.state.place == pytest.approx(place)
        assert found.state.yaw == pytest.approx(yaw)
        whole = int(moves.frames[list(found.moves[:-1])].sum())
        inside = np.flatnonzero(moves.passed[found.moves[-1]] == found.frames - whole)
        assert len(inside) >= 1
        there = before[0] + np.exp(1j * before[1]) * moves.place[found.moves[-1], inside[0]]
        turn = math.remainder(before[1] + float(moves.yaw[found.moves[-1], inside[0]]) - goal.yaw, math.tau)
        assert found.gap == pytest.approx((abs(there - goal.place), abs(turn)))
        assert search.badness(found.gap) <= 1.0
        assert search.badness(search.nearest) <= search.badness(found.gap)


def test_starts_are_the_first_able_frame_of_every_stretch(graph: MotionGraph) -> None:
    place = Place((3.0, 4.0), 0.6)
    space = FreeSpace(hall(), HALF)
    states = start_states(graph, bodies_of(graph), space, place, way_settings())
    assert [state.frame for state in states] == list(range(0, graph.frames, 5))
    assert {(state.place, state.yaw) for state in states} == {(4.0 + 3.0j, 0.6)}
    assert start_states(graph, bodies_of(graph), space, place, way_settings(start_frame=7)) == [
        State(7, 4.0 + 3.0j, 0.6)
    ]
    still = build_graph([walker([(2.0, 0.0)], speed=0.0), walker([(3.0, 0.0)])])
    able = [
        state.frame for state in start_states(still, bodies_of(still), space, place, way_settings(start="standing"))
    ]
    assert able == list(range(0, 60, 5))
