"""A* (Hart et al. 1968) through a motion graph over frame, place and heading, around the walls of a scene."""

from __future__ import annotations

import heapq
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hopdiff.graph.body import Body
from hopdiff.graph.graph import Complexes, Floats, Ints
from hopdiff.graph.moves import Moves, stretches
from hopdiff.graph.search_nodes import End, Nodes
from hopdiff.graph.settings import WaySettings
from hopdiff.graph.space import FreeSpace, Geodesic

PLACE_CELL = 0.15  # m; states in one cell and of one stretch of a clip count as one
YAW_CELL = math.radians(15.0)
NOWHERE = (math.inf, math.inf)
SOONER = 1e-9  # s by which a state must be reached sooner than another of its cell to be looked at
GAP_COST = 1.0  # s; what gaps as large as they may be count, one of place and one of heading
BEND_COST = 0.3  # s; what a bend by a radian counts for
PATIENCE = 4000  # nodes that are expanded after a first way to the goal was met, at most, until the best one is taken
BATCH = 64  # nodes that are expanded together


@dataclass(frozen=True)
class State:
    """A body in a frame of the graph. place: z + i x [m]. yaw: [rad]."""

    frame: int
    place: complex
    yaw: float


@dataclass(frozen=True)
class Goal:
    """place: z + i x [m]. yaw: [rad]. last: whether it is the end of the way, which may lie inside a move, and not a
    point on the way, from which it goes on."""

    place: complex
    yaw: float
    last: bool


@dataclass(frozen=True)
class Found:
    """start: the state that it begins with. moves: their numbers. frames: that pass, which may end inside the last
    move. state: where all moves end. gap: to the goal [m, rad]."""

    start: State
    moves: tuple[int, ...]
    frames: int
    state: State
    gap: tuple[float, float]


@dataclass
class Allowance:
    """Work that may be done, and that was, in steps of searches: nodes whose moves are made. No time is looked at, so
    that a busy machine finds what a free one does."""

    most: int
    expansions: int = 0

    @property
    def over(self) -> bool:
        return self.expansions >= self.most


class WaySearch:
    """One search, from states to a goal; iterate `ways_from` for ways, the best ones first.

    ends: (N,) frames that the way may end in. body: of every frame of the graph, to be kept out of walls; None for the
    root alone. crowd: states that one place and heading holds, at most, whatever the body does there; None for any
    number. Afterwards `nearest` is the gap of the state that came nearest to the goal [m, rad], `exhausted` says
    whether everything that can be reached was looked at, and `crowded` whether states were left out.
    """

    def __init__(
        self,
        moves: Moves,
        space: FreeSpace,
        ways: Geodesic,
        goal: Goal,
        ends: NDArray[np.bool_],
        settings: WaySettings,
        budget: Allowance,
        body: Body | None = None,
        crowd: int | None = None,
    ) -> None:
        self.moves, self.space, self.ways, self.goal, self.ends = moves, space, ways, goal, ends
        self.settings, self.budget, self.body, self.crowd = settings, budget, body, crowd
        self.grid = space.grid
        self.radius, self.angle = settings.radius, math.radians(settings.angle_deg)
        self.nearest = NOWHERE
        self.steepest = math.inf  # ways that are told of
        self.exhausted = self.crowded = False
        self.expansions = 0
        self._stretch = stretches(moves.graph)[1]
        self._cost = moves.frames * moves.graph.frame_time + settings.blend_cost * (moves.transition >= 0)
        self._cost += BEND_COST * np.abs(moves.bend)
        self._turns = round(2.0 * math.pi / YAW_CELL)
        self._wide, self._long = (int(count * self.grid.cell / PLACE_CELL) + 2 for count in self.grid.shape)
        self._spots = self._wide * self._long * self._turns
        self._nodes = Nodes()
        self._best: dict[int, float] = {}  # time gone until a cell was reached first
        self._held: dict[int, int] = {}  # states at a place and heading
        self._queue: list[tuple[float, int]] = []  # of nodes
        self._finds: list[tuple[float, int]] = []  # of ends
        self._ends: list[End] = []

    def badness(self, gap: tuple[float, float]) -> float:
        """A gap to the goal as a share of what may be left."""
        return max(gap[0] / self.radius, gap[1] / self.angle)

    def steepness(self, found: Found) -> float:
        """How much of a gap a found way leaves to each of its frames."""
        return self.badness(found.gap) / found.frames

    def ways_from(self, starts: Sequence[State]) -> Iterator[Found]:
        """Ways to the goal, in the order in which the search meets them.

        Each round expands the best nodes together; that is many times quicker than one by one, and the order in which
        cells are closed differs little.
        """
        frame = np.array([state.frame for state in starts])
        place, yaw = np.array([state.place for state in starts]), np.array([state.yaw for state in starts])
        nothing = np.full(len(frame), -1)
        self._push(frame, place, yaw, np.zeros(len(frame)), nothing, nothing)
        met = math.inf
        while True:
            spent = self.budget.over
            if self._finds:
                met = min(met, self.expansions)
                best = not self._queue or self._finds[0][0] <= self._queue[0][0]
                if best or spent or self.expansions - met >= PATIENCE:
                    _, number = heapq.heappop(self._finds)
                    found = self._chain(self._ends[number])
                    if self.steepness(found) <= self.steepest:
                        yield found
                    continue
            if spent or not self._queue:
                self.exhausted = not (self._queue or self.crowded)
                return
            self._expand(self._next())

    def _next(self) -> Ints:
        """The best nodes in the queue, those left out whose cell was reached sooner since."""
        batch: list[int] = []
        while self._queue and len(batch) < BATCH:
            _, node = heapq.heappop(self._queue)
            if self._nodes.gone[node] <= self._best[int(self._nodes.key[node])]:
                batch.append(node)
        self.expansions += len(batch)
        self.budget.expansions += len(batch)
        return np.array(batch, dtype=np.int64)

    def _expand(self, nodes: Ints) -> None:
        """Make all moves from some nodes."""
        moves, known = self.moves, self._nodes
        frame, place, yaw, gone = known.frame[nodes], known.place[nodes], known.yaw[nodes], known.gone[nodes]
        low = moves.first[frame]
        count = moves.first[frame + 1] - low
        owner = np.repeat(np.arange(len(nodes)), count)
        move = np.arange(len(owner)) + np.repeat(low - np.cumsum(count) + count, count)
        places = place[owner, None] + np.exp(1j * yaw[owner])[:, None] * moves.place[move]
        x, z = self.grid.index(places)
        clear = self.grid.free[x, z].all(axis=1)
        owner, move, places = owner[clear], move[clear], places[clear]
        if self.body is not None and len(owner):
            fits = self._fits(self.body, move, places, yaw[owner])
            owner, move, places = owner[fits], move[fits], places[fits]
        near = self.ways.distance[self.grid.index(place)] <= self.radius + 2.0 * moves.farthest
        close = near[owner]
        self._look(nodes[owner[close]], yaw[owner[close]], move[close], places[close])
        self._push(
            moves.end[move],
            places[:, -1],
            yaw[owner] + moves.yaw[move, -1],
            gone[owner] + self._cost[move],
            nodes[owner],
            move,
        )

    def _fits(self, body: Body, move: Ints, places: Complexes, facing: Floats) -> NDArray[np.bool_]:
        """Which moves keep all of the body out of walls, at all of their places."""
        raster, part = self.space.raster, slice(None)
        shown, roots = self.moves.shown[move, part], places[:, part]
        row, column = np.nonzero(raster.at(roots) < body.reach[shown] + 2.0 * raster.cell)
        heading = facing[row] + self.moves.yaw[move, part][row, column]
        outline = roots[row, column, None] + np.exp(1j * heading)[:, None] * body.outline[shown[row, column]]
        touching = (raster.at(outline) <= raster.cell).any(axis=1)
        fits = np.ones(len(move), dtype=bool)
        fits[row[touching]] = False
        return fits

    def _look(self, nodes: Ints, facing: Floats, move: Ints, places: Complexes) -> None:
        """See which moves come near enough to the goal, and where they do so best. nodes: that they start from;
        facing: there."""
        if not len(nodes):
            return
        moves = self.moves
        part = slice(None) if self.goal.last else slice(-1, None)
        distance = np.abs(places[:, part] - self.goal.place)
        turn = facing[:, None] + moves.yaw[move, part] - self.goal.yaw
        turn = np.abs(turn - 2.0 * np.pi * np.round(turn / (2.0 * np.pi)))
        badness = np.maximum(distance / self.radius, turn / self.angle)
        badness[~self.ends[moves.shown[move, part]]] = np.inf
        badness[badness <= 1.0] = np.where(self._sees(places[:, part][badness <= 1.0]), badness[badness <= 1.0], np.inf)
        column = badness.argmin(axis=1)
        row = np.arange(len(nodes))
        badness, distance, turn = badness[row, column], distance[row, column], turn[row, column]
        passed = moves.passed[move, part][row, column]
        first = int(badness.argmin())
        if badness[first] < self.badness(self.nearest):
            self.nearest = (float(distance[first]), float(turn[first]))
        # What the edit will have to close counts as more than if it were walked, so that a little more search is spent
        # on smaller gaps. A point on the way need not be met.
        closing = GAP_COST * self.goal.last * (distance / self.radius + turn / self.angle)
        worth = self._nodes.gone[nodes] + passed * moves.graph.frame_time + closing
        for k in np.flatnonzero(badness <= 1.0).tolist():
            gap = (float(distance[k]), float(turn[k]))
            heapq.heappush(self._finds, (float(worth[k]), len(self._ends)))
            self._ends.append(End(int(nodes[k]), int(move[k]), int(passed[k]), gap, complex(places[k, -1])))

    def _sees(self, places: Complexes) -> NDArray[np.bool_]:
        """From which places (N,) the straight way to the goal is free; what is near behind a wall is not near."""
        share = np.linspace(0.0, 1.0, max(2, math.ceil(self.radius / self.grid.cell)))[:-1]
        line = places[:, None] + share * (self.goal.place - places[:, None])
        free: NDArray[np.bool_] = np.all(self.grid.free[self.grid.index(line)], axis=1)
        return free

    def _push(self, frame: Ints, place: Complexes, yaw: Floats, gone: Floats, parent: Ints, move: Ints) -> None:
        """Queue the states of these rows whose cell was not reached sooner."""
        left = self.ways.distance[self.grid.index(place)]
        key = self._keys(frame, place, yaw)
        # Of each cell the soonest; those from which the goal cannot be reached are left out.
        order = np.lexsort((gone, key))
        order = order[np.isfinite(left[order])]
        order = order[np.flatnonzero(np.diff(key[order], prepend=-1))]
        keep = self._kept(order.tolist(), key[order].tolist(), gone[order].tolist(), bool((parent >= 0).all()))
        if not keep:
            return
        off = yaw[keep] - self.goal.yaw
        off = np.maximum(0.0, np.abs(off - 2.0 * np.pi * np.round(off / (2.0 * np.pi))) - self.angle)
        way = np.maximum(0.0, left[keep] - self.radius) / self.moves.fastest
        turn = off / self.moves.quickest
        # Neither takes longer than the way to go really does; only more weight than 1 counts both.
        ahead = np.maximum(way, turn) + (self.settings.weight - 1.0) * (way + turn)
        value = gone[keep] + ahead
        number = self._nodes.add(frame[keep], place[keep], yaw[keep], gone[keep], parent[keep], move[keep], key[keep])
        self._best.update(zip(key[keep].tolist(), gone[keep].tolist(), strict=True))
        for entry in zip(value.tolist(), number.tolist(), strict=True):
            heapq.heappush(self._queue, entry)

    def _kept(self, rows: list[int], keys: list[int], times: list[float], limited: bool) -> list[int]:
        """The rows whose cell was not reached sooner, and whose place and heading are not full; limited: if that
        counts, as it does not where all begin."""
        best, held, spots = self._best, self._held, self._spots
        most = self.crowd if limited else None
        keep = []
        for row, key, when in zip(rows, keys, times, strict=True):
            before = best.get(key)
            if before is not None:
                if when < before - SOONER:
                    keep.append(row)
                continue
            if most is not None:
                spot = key % spots
                count = held.get(spot, 0)
                if count >= most:
                    self.crowded = True
                    continue
                held[spot] = count + 1
            keep.append(row)
        return keep

    def _chain(self, end: End) -> Found:
        """All moves up to an end."""
        moves, nodes, node = self.moves, self._nodes, end.node
        state = State(int(moves.end[end.move]), end.place, float(nodes.yaw[node] + moves.yaw[end.move, -1]))
        taken, frames = [end.move], end.passed
        while nodes.parent[node] >= 0:
            taken.append(int(nodes.move[node]))
            frames += int(moves.frames[taken[-1]])
            node = int(nodes.parent[node])
        start = State(int(nodes.frame[node]), complex(nodes.place[node]), float(nodes.yaw[node]))
        return Found(start, tuple(reversed(taken)), frames, state, end.gap)

    def _keys(self, frame: Ints, place: Complexes, yaw: Floats) -> Ints:
        """(N,) numbers of the cells that states lie in."""
        x = np.round((place.imag - self.grid.low[0]) / PLACE_CELL).astype(np.int64)
        z = np.round((place.real - self.grid.low[1]) / PLACE_CELL).astype(np.int64)
        turn = np.round(yaw / YAW_CELL).astype(np.int64) % self._turns
        found: Ints = ((self._stretch[frame] * self._wide + x) * self._long + z) * self._turns + turn
        return found
