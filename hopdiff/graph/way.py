"""A walk from one place to another in a scene: found in a motion graph, then edited to start and end exactly.

As Kim & Lee (2021), section 4.2, do it: the search ends near the goal and the edit of the path closes the gap. What
is checked against the walls is the path as it will be, blends and edit included.
"""

from __future__ import annotations

import math
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import islice

import numpy as np
import torch
from numpy.typing import NDArray

from hopdiff.editing.root_path import RootPath, root_path, with_root_path
from hopdiff.editing.targets import Constraint, EditedPath
from hopdiff.editing.targets import edit_path as default_edit
from hopdiff.geometry.clip import Clip
from hopdiff.graph.blend import Piece, assemble
from hopdiff.graph.graph import MotionGraph
from hopdiff.graph.moves import Moves
from hopdiff.graph.scene import Place, Scene
from hopdiff.graph.sections import Finder, cut_way, pieces_of, start_states
from hopdiff.graph.settings import WaySettings
from hopdiff.graph.space import FreeSpace
from hopdiff.graph.way_search import Allowance, Found
from hopdiff.types import HopdiffError

EditPath = Callable[[RootPath, Sequence[Constraint], float], EditedPath]

EXACT_PLACE = 1e-3  # m by which an edited walk may miss its ends
EXACT_YAW = math.radians(0.1)
PINS = 12  # frames that an edit is bound at where it ran into a wall, at most
PUSHED = 0.1  # m by which such a frame is moved from its place before the edit, at most
HASTE = 1.3  # by which the fastest step and turn of an edited walk may exceed those of the clips and of the walk before
LAST, ALIKE = 3, 3  # of ways that differ in their last 3 moves only, 3 are tried


@dataclass(frozen=True, eq=False)
class Way:
    """clip: the finished walk. pieces: of the graph. graph_clip, graph_path: the walk as the graph gives it, blended
    but not edited. path: of the finished walk. waypoints: (K, 2) points that the way was cut at [m]. numbers: for
    metrics.json."""

    clip: Clip
    pieces: tuple[Piece, ...]
    graph_clip: Clip
    graph_path: RootPath
    path: RootPath
    waypoints: NDArray[np.float64]
    numbers: dict[str, float]


def find_way(
    graph: MotionGraph,
    scene: Scene,
    start: Place,
    goal: Place,
    settings: WaySettings,
    edit_path: EditPath = default_edit,
) -> Way:
    """A walk from one place and heading to another that keeps the body's half width off everything.

    edit_path: takes a path, the constraints of its first and last frame, and the time between frames [s].
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
    length = space.grid.length(ways, start.position)
    if not math.isfinite(length):
        raise HopdiffError(
            f"no way leads from the start {list(start.position)} to the goal {list(goal.position)} "
            f"for a body {2 * settings.half_width:g} m wide."
        )
    finder = Finder(graph, space, goal, ways, settings, Allowance(begun + settings.seconds))
    states = start_states(graph, start, settings)
    tried = 0
    for legs in _cuts(max(1, math.ceil(length / settings.leg))):
        points = cut_way(space, ways, start, length, legs)
        for chain in islice(_unlike(finder.chains(states, points)), settings.tries):
            tried += 1
            way = _finished(graph, finder.moves, space, chain, start, goal, edit_path)
            if way is not None:
                return _with_numbers(way, space, goal, chain, points, begun, finder.budget.expansions, tried)
            if finder.budget.over:
                break
        if finder.exhausted or finder.budget.over:
            break
    seconds = time.perf_counter() - begun
    if not tried:
        raise HopdiffError(finder.failure(seconds))
    raise HopdiffError(
        f"no way to the goal was found in {seconds:.1f} s: {tried} walks come near it, but none can be bent without "
        f"haste to start and end exactly and keep {settings.half_width:g} m off everything (a smaller way.radius, or "
        f"more way.tries or way.seconds, may help)."
    )


def _cuts(fewest: int) -> list[int]:
    """Into how many legs to cut a way, one try after the other: more and more, and a long way at last not at all."""
    return [*range(fewest, 2 * fewest + 2), *([1] if fewest > 1 else [])]


def _unlike(chains: Iterator[tuple[Found, ...]]) -> Iterator[tuple[Found, ...]]:
    """At most a few of those that differ in their last moves only: where one cannot be bent, they seldom can."""
    met: Counter[tuple[int, ...]] = Counter()
    for chain in chains:
        moves = tuple(move for found in chain for move in found.moves)
        met[moves[:-LAST]] += 1
        if met[moves[:-LAST]] <= ALIKE:
            yield chain


def _finished(
    graph: MotionGraph,
    moves: Moves,
    space: FreeSpace,
    chain: Sequence[Found],
    start: Place,
    goal: Place,
    edit_path: EditPath,
) -> Way | None:
    """The walk of a chain of legs, edited to start and end exactly; None if it runs into something or rushes then.

    Where the edited path comes too near to a wall, the frame that is worst is bound to its place before the edit, or
    the clear one next to that, and the path is edited again.
    """
    pieces, frames = pieces_of(moves, chain)
    whole = assemble(graph, pieces)
    clip = replace(
        whole,
        root_position=whole.root_position[:frames],
        rotations=whole.rotations[:frames],
        offsets=None if whole.offsets is None else whole.offsets[:frames],
    )
    before = root_path(clip)
    if before.frames < 3:
        return None
    ends = [
        Constraint(0, start.position, start.heading),
        Constraint(before.frames - 1, goal.position, goal.heading),
    ]
    pins: list[Constraint] = []
    while True:
        after = edit_path(before, [*ends, *pins], clip.frame_time).path
        if not (_exact(after, start, goal) and _calm(before, after, graph)):
            return None
        if space.clear(after.place):
            break
        worst = int(np.argmin(space.depth(after.place.numpy())))
        own = (float(before.place[worst, 0]), float(before.place[worst, 1]))
        spot = space.nearest(own)
        taken = {0, before.frames - 1, *(pin.frame for pin in pins)}
        if len(pins) >= PINS or worst in taken or math.dist(own, spot) > PUSHED:
            return None
        pins.append(Constraint(worst, spot))
    numbers = {"pins": float(len(pins))}
    points = np.empty((0, 2))
    return Way(with_root_path(clip, before, after), tuple(pieces), clip, before, after, points, numbers)


def _exact(path: RootPath, start: Place, goal: Place) -> bool:
    offs = (_off(path, 0, start), _off(path, -1, goal))
    return all(off <= EXACT_PLACE and turn <= EXACT_YAW for off, turn in offs)


def _calm(before: RootPath, after: RootPath, graph: MotionGraph) -> bool:
    """Whether an edited walk is about as quick as the clips or it was before: a short walk bent far would dash or
    spin."""
    inside = np.ones(graph.frames - 1, dtype=bool)
    inside[graph.first[1:-1] - 1] = False
    step, turn = float(np.abs(np.diff(graph.ground))[inside].max()), float(np.abs(np.diff(graph.yaw))[inside].max())
    own, made = _fastest(before), _fastest(after)
    return made[0] <= HASTE * max(step, own[0]) and made[1] <= HASTE * max(turn, own[1])


def _fastest(path: RootPath) -> tuple[float, float]:
    """Largest step [m] and turn [rad] from frame to frame."""
    return float(path.place.diff(dim=0).norm(dim=-1).max()), float(path.yaw.diff().abs().max())


def _off(path: RootPath, frame: int, place: Place) -> tuple[float, float]:
    """How far a frame is from a place [m] and its heading [rad]."""
    turn = abs(math.remainder(float(path.yaw[frame]) - place.heading, math.tau))
    return math.dist(path.place[frame].tolist(), place.position), turn


def _with_numbers(
    way: Way,
    space: FreeSpace,
    goal: Place,
    chain: Sequence[Found],
    points: Sequence[Place],
    begun: float,
    expansions: int,
    tries: int,
) -> Way:
    (gap, gap_yaw), (error, error_yaw) = (_off(path, -1, goal) for path in (way.graph_path, way.path))
    numbers = {
        "seconds": time.perf_counter() - begun,
        "expansions": expansions,
        "legs": len(chain),
        "tries": tries,
        "pins": way.numbers["pins"],
        "pieces": len(way.pieces),
        "start_frame": chain[0].start.frame,
        "frames": way.clip.frames,
        "duration": way.clip.duration,
        "gap": gap,
        "gap_deg": math.degrees(gap_yaw),
        "end_error": error,
        "end_error_deg": math.degrees(error_yaw),
        "length_before": _length(way.graph_path),
        "length": _length(way.path),
        "clearance_before": space.clearance(way.graph_path.place),
        "clearance": space.clearance(way.path.place),
    }
    waypoints = np.array([point.position for point in points]).reshape(-1, 2)
    return replace(way, numbers=numbers, waypoints=waypoints)


def _length(path: RootPath) -> float:
    return float(torch.linalg.vector_norm(path.place.diff(dim=0), dim=-1).sum())
