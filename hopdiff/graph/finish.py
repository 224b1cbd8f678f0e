"""From moves that a search found to the finished walk: put together, bent to start and end exactly, feet put right.

A walk is finished only when no joint or end site of it is deeper than a centimetre in a wall or furniture, in any
frame, as it is written.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from enum import Enum

import numpy as np
import torch

from hopdiff.editing.leg_joints import find_legs
from hopdiff.editing.root_path import RootPath, path_of, root_path, steps_of, with_root_path
from hopdiff.editing.targets import Constraint, EditedPath
from hopdiff.feet.contacts import Contacts, find_contacts
from hopdiff.feet.planting import Planted, clean_feet
from hopdiff.geometry.clip import Clip
from hopdiff.graph.blend import Piece, assemble
from hopdiff.graph.body import body_of, groups, hits
from hopdiff.graph.distance import as_complex
from hopdiff.graph.graph import Complexes, Floats, MotionGraph
from hopdiff.graph.moves import Moves
from hopdiff.graph.scene import Place
from hopdiff.graph.space import SPARE, FreeSpace
from hopdiff.graph.way_search import Found
from hopdiff.terrain.ground import Ground

EditPath = Callable[[RootPath, Sequence[Constraint], float], EditedPath]

EXACT_PLACE = 1e-3  # m by which an edited walk may miss its ends
EXACT_YAW = math.radians(0.1)
ROUNDS = 12  # of pushing a walk off what it runs into
PUSHED = 0.15  # m by which a frame is pushed, at most
FURTHER = 1.2  # of what is needed; the frames beside the one that is pushed follow by less
APART = 0.25  # s between frames that are pushed, at least
HELD = 3.0  # s between frames that a long walk is held at where it was found, so that its end alone is bent
BENT = 4.0  # m of way before the goal that are bent to meet it
SOFT = 7  # frames over which bends begin and end
HASTE = 1.3  # by which the fastest step and turn of an edited walk may exceed those of the clips and of the walk before


class Miss(Enum):
    """Why a walk cannot be finished: it runs into something, or would have to dash or spin to meet its ends."""

    WALL = "wall"
    HASTE = "haste"


@dataclass(frozen=True, eq=False)
class Finished:
    """clip: the walk as it is written. pieces: of the graph. graph_clip, graph_path: as the graph gives it, blended but
    not edited. edited_clip, path: on its edited path, before its feet are put right. contacts: of the feet, planted:
    how they were put right, None if the legs are not found. pins: frames that were pushed off walls."""

    clip: Clip
    pieces: tuple[Piece, ...]
    graph_clip: Clip
    graph_path: RootPath
    edited_clip: Clip
    path: RootPath
    contacts: Contacts | None
    planted: Planted | None
    pins: int


def pieces_of(moves: Moves, found: Found) -> tuple[list[Piece], int]:
    """The pieces of the graph that a found way shows, and the frames until it ends."""
    graph, start = moves.graph, found.start
    turn = start.yaw - float(graph.yaw[start.frame])
    shift = start.place - cmath.exp(1j * turn) * complex(graph.ground[start.frame])
    frame, pieces = start.frame, []
    stop = start.frame + 1
    for move in found.moves:
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
    return pieces, 1 + found.frames


def finished(
    graph: MotionGraph,
    moves: Moves,
    space: FreeSpace,
    found: Found,
    start: Place,
    goal: Place,
    edit_path: EditPath,
    ground: Ground | None = None,
) -> Finished | Miss:
    """The walk of a found way, edited to start and end exactly, or why that cannot be. ground: what it goes over.

    Where a joint or the middle of the body comes too near to a wall, the frame that is worst is pushed off it, and the
    path is edited again.
    """
    pieces, frames = pieces_of(moves, found)
    source = _first(assemble(graph, pieces), frames)
    own = root_path(source)
    if own.frames < 3:
        return Miss.HASTE
    before = _bent(own, moves, found)
    clip = source if before is own else with_root_path(source, own, before)
    legs = find_legs(clip.skeleton)
    contacts = find_contacts(source, legs) if legs else None
    body = body_of(clip)
    pins = _Pins(before, space, start, goal, clip.frame_time)
    for _ in range(ROUNDS):
        after = edit_path(before, pins.constraints(), clip.frame_time).path
        if not (_exact(after, start, goal) and _calm(before, after, graph)):
            if not pins.held:
                return Miss.WALL if pins.count else Miss.HASTE
            # All of the walk may be bent then.
            pins.held = []
            continue
        push = hits(space, as_complex(after.place).numpy(), body.placed(after))
        if not push.any():
            edited = with_root_path(clip, before, after)
            clean, planted = edited, None
            if contacts is not None:
                planted = clean_feet(source, edited, contacts, ground, still=True)
                clean = planted.clip
                path = root_path(clean)
                push = hits(space, as_complex(path.place).numpy(), body_of(clean).placed(path))
            if not push.any():
                return Finished(clean, tuple(pieces), clip, before, edited, after, contacts, planted, pins.count)
        if not pins.add(after, push):
            return Miss.WALL
    return Miss.WALL


def _bent(path: RootPath, moves: Moves, found: Found) -> RootPath:
    """The path of the clips, bent as the search bent its moves; softly, over some frames."""
    taken = list(found.moves)
    if not moves.bend[taken].any():
        return path
    frames = moves.frames[taken]
    kernel = np.full(SOFT, 1.0 / SOFT)

    def spread(values: Floats) -> torch.Tensor:
        padded = np.pad(np.repeat(values, frames), SOFT // 2, mode="edge")
        return torch.from_numpy(np.convolve(padded, kernel, "valid")[: path.frames - 1])

    steps = steps_of(path).clone()
    steps[:, :2] *= spread(moves.share[taken])[:, None]
    steps[:, 2] += spread(moves.bend[taken] / frames)
    return path_of(steps, path.place[0], path.yaw[0])


def _first(clip: Clip, frames: int) -> Clip:
    return replace(
        clip,
        root_position=clip.root_position[:frames],
        rotations=clip.rotations[:frames],
        offsets=None if clip.offsets is None else clip.offsets[:frames],
    )


class _Pins:
    """What an edit is bound by: both ends, frames of a long walk that are held where they were, and frames that are
    pushed off walls."""

    def __init__(self, before: RootPath, space: FreeSpace, start: Place, goal: Place, frame_time: float) -> None:
        last = before.frames - 1
        self.space, self.apart = space, max(1, round(APART / frame_time))
        self.ends = [Constraint(0, start.position, start.heading), Constraint(last, goal.position, goal.heading)]
        self.own = as_complex(before.place).numpy()
        way = np.cumsum(np.abs(np.diff(self.own, prepend=self.own[0])))
        step = max(1, round(HELD / frame_time))
        self.held = [frame for frame in range(step, last, step) if way[frame] < way[-1] - BENT]
        self.pushed: dict[int, complex] = {}  # where they are now
        self.moved: dict[int, float] = {}  # how far they were pushed in all

    @property
    def count(self) -> int:
        return len(self.pushed)

    def constraints(self) -> list[Constraint]:
        free = [k for k in self.held if all(abs(k - other) >= self.apart for other in self.pushed)]
        places = {**{k: self.own[k] for k in free}, **self.pushed}
        return [*self.ends, *(Constraint(k, (place.imag, place.real)) for k, place in sorted(places.items()))]

    def add(self, path: RootPath, push: Complexes) -> bool:
        """Push the worst frame of every stretch that runs into something; whether that could be done."""
        places = as_complex(path.place).numpy()
        for stretch in groups(np.flatnonzero(push), self.apart):
            worst = int(stretch[np.abs(push[stretch]).argmax()])
            near = min(self.pushed, key=lambda frame: abs(frame - worst), default=None)
            frame = worst if near is None or abs(near - worst) >= self.apart else near
            if not 0 < frame < len(places) - 1:
                return False
            there = places[frame] + FURTHER * push[worst] + SPARE * push[worst] / abs(push[worst])
            spot = (float(there.imag), float(there.real))
            if float(self.space.depth([spot])[0]) < self.space.half_width:
                spot = self.space.nearest(spot)
            there = complex(spot[1], spot[0])
            self.moved[frame] = self.moved.get(frame, 0.0) + abs(there - places[frame])
            # Back to where it was before the edit is no way too far.
            if min(self.moved[frame], abs(there - self.own[frame])) > PUSHED:
                return False
            self.pushed[frame] = there
        return True


def _exact(path: RootPath, start: Place, goal: Place) -> bool:
    offs = (off(path, 0, start), off(path, -1, goal))
    return all(miss <= EXACT_PLACE and turn <= EXACT_YAW for miss, turn in offs)


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


def off(path: RootPath, frame: int, place: Place) -> tuple[float, float]:
    """How far a frame is from a place [m] and its heading [rad]."""
    turn = abs(math.remainder(float(path.yaw[frame]) - place.heading, math.tau))
    return math.dist(path.place[frame].tolist(), place.position), turn


def length_of(path: RootPath) -> float:
    """Of a path over the ground [m]."""
    return float(torch.linalg.vector_norm(path.place.diff(dim=0), dim=-1).sum())
