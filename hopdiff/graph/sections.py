"""Long ways leg by leg: where to cut them, and one search after the other."""

from __future__ import annotations

import cmath
import math
from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from hopdiff.graph.blend import Piece
from hopdiff.graph.graph import MotionGraph
from hopdiff.graph.moves import Moves, moves_of, standing, stretches
from hopdiff.graph.scene import Place
from hopdiff.graph.settings import WaySettings
from hopdiff.graph.space import FreeSpace, Geodesic
from hopdiff.graph.way_search import NOWHERE, Allowance, Found, Goal, State, WaySearch
from hopdiff.types import HopdiffError

LEG_TRIES = 6  # ways to a point on the way from which it is tried to go on
ASIDE = 0.5  # m that a point on the way is moved at most, to where there is more room
LOOK = 0.5  # m along the way before and after a point that tell where it heads there


class Finder:
    """Searches leg by leg, and goes back to another end of the leg before where one leads nowhere."""

    def __init__(
        self,
        graph: MotionGraph,
        space: FreeSpace,
        goal: Place,
        ways: Geodesic,
        settings: WaySettings,
        budget: Allowance,
    ) -> None:
        self.graph, self.space, self.goal, self.ways = graph, space, goal, ways
        self.settings, self.budget = settings, budget
        self.moves = moves_of(graph)
        self.everywhere = np.ones(graph.frames, dtype=bool)
        self.ends = _poses(graph, settings.end, "way.end")
        self.nearest = NOWHERE
        self.exhausted = False  # whether all walks to the goal itself were searched

    def chains(self, states: Sequence[State], points: Sequence[Place]) -> Iterator[tuple[Found, ...]]:
        """Ways from states over points to the goal: what was found for each leg."""
        goals = [*(_goal(point, last=False) for point in points), _goal(self.goal, last=True)]
        grids = [*(self.space.grid.geodesic(point.position) for point in points), self.ways]
        chain: list[Found] = []
        searches = [self._search(goals[0], grids[0])]
        legs = [self._ways(searches[0], states, len(goals) == 1)]
        while legs:
            found = next(legs[-1], None)
            if found is None:
                search = searches.pop()
                legs.pop()
                del chain[len(legs) - 1 if legs else 0 :]
                self.exhausted |= search.exhausted and len(goals) == 1
                self._note(search)
                continue
            if len(legs) == len(goals):
                yield (*chain, found)
                continue
            chain.append(found)
            k = len(legs)
            searches.append(self._search(goals[k], grids[k]))
            legs.append(self._ways(searches[-1], [found.state], k + 1 == len(goals)))

    def _search(self, goal: Goal, ways: Geodesic) -> WaySearch:
        ends = self.ends if goal.last else self.everywhere
        return WaySearch(self.moves, self.space.grid, ways, goal, ends, self.settings, self.budget)

    def _ways(self, search: WaySearch, states: Sequence[State], last: bool) -> Iterator[Found]:
        for k, found in enumerate(search.ways_from(states)):
            yield found
            if not last and k + 1 >= LEG_TRIES:
                return

    def _note(self, search: WaySearch) -> None:
        """Remember how near to the goal a search came."""
        if search.goal.last and search.badness(search.nearest) < search.badness(self.nearest):
            self.nearest = search.nearest

    def failure(self, seconds: float) -> str:
        """Why there is no way, in a sentence. seconds: that were spent."""
        metres, angle = self.nearest
        near = (
            f"it came within {metres:.2f} m and {math.degrees(angle):.0f} degrees"
            if math.isfinite(metres)
            else "it never came near it"
        )
        if self.budget.over:
            return f"no way to the goal was found in way.seconds={self.settings.seconds:g}: {near}."
        work = f"after {self.budget.expansions} steps and {seconds:.1f} s"
        if not self.exhausted:
            return f"no way to the goal was found {work}, with way.expansions={self.settings.expansions}: {near}."
        return f"the clips hold no walk to the goal: all that they can do was searched {work}, and {near}."


def start_states(graph: MotionGraph, start: Place, settings: WaySettings) -> list[State]:
    """The frames that a walk may start in, placed at the start."""
    if settings.start_frame is not None:
        if not 0 <= settings.start_frame < graph.frames:
            raise HopdiffError(f"way.start_frame must be from 0 to {graph.frames - 1}, not {settings.start_frame}.")
        frames = np.array([settings.start_frame])
    else:
        able = _poses(graph, settings.start, "way.start")
        _, number = stretches(graph)
        # The first of every stretch, if it will do; the others are much the same.
        frames = np.flatnonzero(able)
        frames = frames[np.unique(number[frames], return_index=True)[1]]
    place = complex(start.position[1], start.position[0])
    return [State(frame, place, start.heading) for frame in frames.tolist()]


def _poses(graph: MotionGraph, which: str, setting: str) -> NDArray[np.bool_]:
    """(N,) the frames that a walk may start or end in."""
    if which == "any":
        return np.ones(graph.frames, dtype=bool)
    able = standing(graph)
    if not able.any():
        raise HopdiffError(f"{setting}=standing: the body stands in no frame of the clips.")
    return able


def _goal(place: Place, last: bool) -> Goal:
    return Goal(complex(place.position[1], place.position[0]), place.heading, last)


def cut_way(space: FreeSpace, ways: Geodesic, start: Place, length: float, legs: int) -> list[Place]:
    """Places that cut the shortest way into legs of one length, each heading along it."""
    if legs < 2:
        return []
    line = space.grid.line(ways, start.position)
    arc = np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(line, axis=0).T))))
    if arc[-1] <= 0:
        return []
    points = []
    for at in arc[-1] * np.arange(1, legs) / legs:
        x, back_x, ahead_x = np.interp([at, at - LOOK, at + LOOK], arc, line[:, 0]).tolist()
        z, back_z, ahead_z = np.interp([at, at - LOOK, at + LOOK], arc, line[:, 1]).tolist()
        x, z = _roomy(space, x, z)
        points.append(Place((x, z), math.atan2(ahead_x - back_x, ahead_z - back_z)))
    return points


def _roomy(space: FreeSpace, x: float, z: float) -> tuple[float, float]:
    """A free point around another with more room about it: the shortest way cuts the corners."""
    grid = space.grid
    free = grid.place(np.flatnonzero(grid.free))
    off = np.hypot(*(free - np.array([x, z])).T)
    free, off = free[off <= ASIDE], off[off <= ASIDE]
    if not len(free):
        return x, z
    best = free[int(np.argmax(space.depth(free) - 0.3 * off))]
    return float(best[0]), float(best[1])


def pieces_of(moves: Moves, chain: Sequence[Found]) -> tuple[list[Piece], int]:
    """The pieces of the graph that a chain of legs shows, and the frames until it ends."""
    graph, start = moves.graph, chain[0].start
    turn = start.yaw - float(graph.yaw[start.frame])
    shift = start.place - cmath.exp(1j * turn) * complex(graph.ground[start.frame])
    frame, pieces = start.frame, []
    stop = start.frame + 1
    for move in (move for found in chain for move in found.moves):
        taken = int(moves.transition[move])
        if taken < 0:
            stop = int(moves.end[move]) + 1
            continue
        pieces.append(Piece(frame, int(graph.sources[taken]) + graph.window, turn, shift))
        shift = shift + cmath.exp(1j * turn) * complex(graph.shifts[taken])
        turn += float(graph.turns[taken])
        frame = int(graph.targets[taken])
        stop = int(moves.end[move]) + 1
    pieces.append(Piece(frame, stop, turn, shift))
    legs = [int(moves.frames[list(found.moves)].sum()) for found in chain[:-1]]
    return pieces, 1 + sum(legs) + chain[-1].frames
