"""A walk from one place to another in a scene: found in a motion graph, then edited to start and end exactly.

As Kim & Lee (2021), section 4.2, do it: the search ends near the goal and the edit of the path closes the gap. What
is checked against the walls is the whole body of the walk as it is written, blends, edit and feet included.
"""

from __future__ import annotations

import math
import time
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import islice

import numpy as np
from numpy.typing import NDArray

from hopdiff.editing.targets import edit_path as default_edit
from hopdiff.graph.body import DEPTH, Body, bodies_of, said_depth
from hopdiff.graph.finish import EditPath, Finished, Miss, finished, length_of, off
from hopdiff.graph.graph import MotionGraph
from hopdiff.graph.moves import Moves, bent, moves_of, standing, stretches
from hopdiff.graph.scene import Place, Scene
from hopdiff.graph.settings import WaySettings
from hopdiff.graph.space import FreeSpace
from hopdiff.graph.way_search import NOWHERE, Allowance, Found, Goal, State, WaySearch
from hopdiff.terrain.ground import Ground
from hopdiff.types import HopdiffError

ALIKE = {3: 3, 8: 6, 20: 12}  # of ways that differ in their last 3 moves only, 3 are tried, and so on
# One search after the other, until one finds a walk: whether clips are bent, the states that one place and heading
# holds, how much more the distance to go weighs, and the share of all steps that are done by its end. The first finds
# the shortest ways; more weight leads a long way sooner, and few states lead out of dead ends.
SEARCHES = (
    (False, None, 1.0, 0.15),
    (False, None, 1.5, 0.4),
    (False, 16, 1.5, 0.6),
    (True, None, 1.0, 0.7),
    (True, 16, 1.5, 0.85),
    (True, 5, 2.0, 1.0),
)
SMALLER = 0.9  # share of the steepness that could not be bent without haste, which the next walk may have at most


@dataclass(frozen=True, eq=False)
class Way(Finished):
    """numbers: for metrics.json."""

    numbers: dict[str, float]


def find_way(
    graph: MotionGraph,
    scene: Scene,
    start: Place,
    goal: Place,
    settings: WaySettings,
    edit_path: EditPath = default_edit,
    ground: Ground | None = None,
) -> Way:
    """A walk from one place and heading to another that keeps the body's half width off everything, and all joints out
    of walls and furniture of any height, but for a centimetre.

    edit_path: takes a path, the constraints of its first and last frame, and the time between frames [s].
    ground: what feet stand on, level if None.
    Raises HopdiffError, saying why, if there is no way: a place inside something, walls all around, or a search that
    found nothing, and then how near it came.
    """
    settings.check()
    begun = time.perf_counter()
    space = FreeSpace(scene, settings.half_width)
    for what, place in (("start", start), ("goal", goal)):
        space.check(what, place.position)
        if not math.isfinite(place.heading):
            raise HopdiffError(f"the {what}'s heading must be a finite number, not {place.heading:g}.")
    ways = space.grid.geodesic(goal.position)
    if not math.isfinite(space.grid.length(ways, start.position)):
        raise HopdiffError(
            f"no way leads from the start {list(start.position)} to the goal {list(goal.position)} "
            f"for a body {2 * settings.half_width:g} m wide."
        )
    moves, body = moves_of(graph), bodies_of(graph)
    states = start_states(graph, body, space, start, settings)
    ends = _that_fit(poses(graph, settings.end, "way.end"), body, space, "goal", goal)
    target = Goal(complex(goal.position[1], goal.position[0]), goal.heading, True)
    budget = Allowance(settings.expansions)
    nearest, tried, exhausted = NOWHERE, 0, {False: False, True: settings.bend == 0}
    for bends, crowd, more, share in SEARCHES:
        if exhausted[bends]:
            continue
        heavy = replace(settings, weight=more * settings.weight)
        budget.most = round(share * settings.expansions)
        able = bent(moves, math.radians(settings.bend)) if bends else moves
        search = WaySearch(able, space, ways, target, ends, heavy, budget, body, crowd)
        for found in islice(_unlike(search.ways_from(states)), settings.tries):
            tried += 1
            walk = finished(graph, able, space, found, start, goal, edit_path, ground)
            if isinstance(walk, Finished):
                numbers = _numbers(walk, able, space, goal, found, budget.expansions, tried)
                return Way(**vars(walk), numbers={"seconds": time.perf_counter() - begun, **numbers})
            if walk is Miss.HASTE:
                # As large a gap for as short a walk would not do better.
                search.steepest = min(search.steepest, SMALLER * search.steepness(found))
        if search.badness(search.nearest) < search.badness(nearest):
            nearest = search.nearest
        exhausted[bends] = search.exhausted
    raise HopdiffError(_failure(settings, budget, nearest, tried, all(exhausted.values())))


def _failure(
    settings: WaySettings, budget: Allowance, nearest: tuple[float, float], tried: int, exhausted: bool
) -> str:
    """Why there is no way, in a sentence."""
    work = f"after {budget.expansions} steps"
    if tried:
        walks = "1 walk comes near it, but it cannot" if tried == 1 else f"{tried} walks come near it, but none can"
        return (
            f"no way to the goal was found {work}: {walks} be bent without haste to start and end exactly and keep "
            f"{settings.half_width:g} m off everything and all joints out of walls (a smaller way.radius, or more "
            f"way.tries or way.expansions, may help)."
        )
    metres, angle = nearest
    near = (
        f"it came within {metres:.2f} m and {math.degrees(angle):.0f} degrees"
        if math.isfinite(metres)
        else "it never came near it"
    )
    if exhausted:
        return f"the clips hold no walk to the goal: all that they can do was searched {work}, and {near}."
    return f"no way to the goal was found {work}, with way.expansions={settings.expansions}: {near}."


def _unlike(ways: Iterator[Found]) -> Iterator[Found]:
    """At most a few of those that differ in their last moves only: where one cannot be bent, they seldom can."""
    met: Counter[tuple[int, tuple[int, ...]]] = Counter()
    for found in ways:
        families = {(last, (found.start.frame, *found.moves[:-last])): most for last, most in ALIKE.items()}
        if all(met[family] < most for family, most in families.items()):
            met.update(families.keys())
            yield found


def start_states(graph: MotionGraph, body: Body, space: FreeSpace, start: Place, settings: WaySettings) -> list[State]:
    """The frames that a walk may start in, placed at the start: those in which the body fits there."""
    if settings.start_frame is not None:
        if not 0 <= settings.start_frame < graph.frames:
            raise HopdiffError(f"way.start_frame must be from 0 to {graph.frames - 1}, not {settings.start_frame}.")
        able = np.arange(graph.frames) == settings.start_frame
    else:
        able = poses(graph, settings.start, "way.start")
    # The first of every stretch, if it will do; the others are much the same.
    frames = np.flatnonzero(_that_fit(able, body, space, "start", start))
    frames = frames[np.unique(stretches(graph)[1][frames], return_index=True)[1]]
    place = complex(start.position[1], start.position[0])
    return [State(frame, place, start.heading) for frame in frames.tolist()]


def poses(graph: MotionGraph, which: str, setting: str) -> NDArray[np.bool_]:
    """(N,) the frames that a walk may start or end in."""
    if which == "any":
        return np.ones(graph.frames, dtype=bool)
    able = standing(graph)
    if not able.any():
        raise HopdiffError(f"{setting}=standing: the body stands in no frame of the clips.")
    return able


def _that_fit(able: NDArray[np.bool_], body: Body, space: FreeSpace, what: str, place: Place) -> NDArray[np.bool_]:
    """Those of some frames (N,) in which the body fits at a place. Raises HopdiffError if there is none."""
    fit = able & (body.depth_at(space, place.position, place.heading) <= DEPTH)
    if not fit.any():
        own = Body(body.parts[able], body.names)
        raise HopdiffError(
            f"no pose of the clips that is asked for fits at the {what} {list(place.position)} with that heading: in "
            f"the best one {said_depth(own, space, place.position, place.heading)}."
        )
    return fit


def _numbers(
    walk: Finished, moves: Moves, space: FreeSpace, goal: Place, found: Found, expansions: int, tries: int
) -> dict[str, float]:
    (gap, gap_yaw), (error, error_yaw) = (off(path, -1, goal) for path in (walk.graph_path, walk.path))
    return {
        "expansions": expansions,
        "tries": tries,
        "pins": walk.pins,
        "bend_deg": math.degrees(float(np.abs(moves.bend[list(found.moves)]).sum())),
        "pieces": len(walk.pieces),
        "start_frame": found.start.frame,
        "frames": walk.clip.frames,
        "duration": walk.clip.duration,
        "gap": gap,
        "gap_deg": math.degrees(gap_yaw),
        "end_error": error,
        "end_error_deg": math.degrees(error_yaw),
        "length_before": length_of(walk.graph_path),
        "length": length_of(walk.path),
        "clearance_before": space.clearance(walk.graph_path.place),
        "clearance": space.clearance(walk.path.place),
    }
