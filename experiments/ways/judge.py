"""What a walk in a BVH file does in a scene: read, posed and measured here, with nothing of hopdiff."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra

from experiments.bvh_reading import read
from experiments.ways.scenes import Pair, floor_of

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Walk:
    """names: of N joints and end sites. places: (T, N, 3) [m]. forward: (T, 2) x and z of where the root's z axis
    points. frame_time: [s]."""

    names: list[str]
    places: Floats
    forward: Floats
    frame_time: float


def read_walk(path: Path, unit: float) -> Walk:
    """A BVH file, posed. unit: metres of one unit of the file. Raises ValueError, naming it, if it cannot be read."""
    bvh = read(path)
    places, turns = bvh.forward()
    ends = [places[:, joint] + turns[:, joint] @ offset for joint, offset in bvh.ends.items()]
    places = np.concatenate((places, np.array(ends).reshape(-1, len(places), 3).swapaxes(0, 1)), axis=1)
    names = [*bvh.names, *(f"{bvh.names[joint]} end" for joint in bvh.ends)]
    # The turn about y that is nearest to the root's.
    root = turns[:, 0]
    yaw = np.arctan2(root[:, 0, 2] - root[:, 2, 0], root[:, 0, 0] + root[:, 2, 2])
    return Walk(names, unit * places, np.stack((np.sin(yaw), np.cos(yaw)), axis=-1), bvh.frame_time)


@dataclass(frozen=True)
class Verdict:
    """length: of the root's way over the ground [m]. off: of root at start and goal, the larger [m]; off_deg: of the
    heading. depth: of the deepest joint inside a wall or furniture [m]; deepest: its name. inside: share of the frames
    with a joint inside. fastest: largest step of the root [m/s]."""

    length: float
    off: float
    off_deg: float
    depth: float
    deepest: str
    inside: float
    fastest: float


def judge(walk: Walk, data: Mapping[str, Any], pair: Pair) -> Verdict:
    """All joints and end sites of all frames against all that is no free floor, of any height."""
    floor = floor_of(data)
    ground = walk.places[:, :, [0, 2]]
    flat = ground.reshape(-1, 2)
    shapely.prepare(floor)
    beyond = ~shapely.contains_xy(floor, flat)
    depth: Floats = np.zeros(len(flat))
    depth[beyond] = shapely.distance(floor, shapely.points(flat[beyond]))
    depth = depth.reshape(ground.shape[:2])
    root = ground[:, 0]
    off, turn = [], []
    for frame, (x, z, heading) in ((0, pair.start), (-1, pair.goal)):
        off.append(math.hypot(root[frame, 0] - x, root[frame, 1] - z))
        faces = math.degrees(math.atan2(walk.forward[frame, 0], walk.forward[frame, 1]))
        turn.append(abs(math.remainder(faces - heading, 360.0)))
    steps = np.hypot(*np.diff(root, axis=0).T)
    return Verdict(
        float(steps.sum()),
        max(off),
        max(turn),
        float(depth.max()),
        walk.names[int(depth.max(axis=0).argmax())],
        float((depth.max(axis=1) > 0).mean()),
        float(steps.max() / walk.frame_time),
    )


class Shortest:
    """The shortest ways in a scene for a body of a half width [m], over the corners that it can go round."""

    def __init__(self, data: Mapping[str, Any], half_width: float) -> None:
        self.free = floor_of(data).buffer(-half_width, quad_segs=4)
        # Places are given to the millimetre, corners are rounded by few straight pieces.
        self.near = self.free.buffer(0.005)
        shapely.prepare(self.near)
        self.corners = np.array([corner for ring in self._rings() for corner in _inner(ring)]).reshape(-1, 2)
        count = len(self.corners)
        a, b = np.triu_indices(count, 1)
        self.edges = self._seen(self.corners[a], self.corners[b], a, b)

    def _rings(self) -> list[Floats]:
        oriented = [shapely.geometry.polygon.orient(part) for part in shapely.get_parts(self.free)]
        return [shapely.get_coordinates(ring)[:-1] for part in oriented for ring in (part.exterior, *part.interiors)]

    def _seen(self, start: Floats, end: Floats, a: NDArray[Any], b: NDArray[Any]) -> list[tuple[Any, Any, Any]]:
        """Those of the lines between points that stay on free floor: numbers of both ends and length."""
        lines = shapely.linestrings(np.stack((start, end), axis=1))
        clear = shapely.covers(self.near, lines)
        return [(a[clear], b[clear], shapely.length(lines[clear]))]

    def length(self, start: tuple[float, float], goal: tuple[float, float]) -> float:
        """[m]; infinite if there is no way."""
        ends = np.array([start, goal])
        count = len(self.corners)
        rows = list(self.edges)
        for k, end in enumerate(ends):
            other = np.vstack((self.corners, ends[:k]))
            numbers = np.append(np.arange(count), count + np.arange(k)).astype(int)
            rows += self._seen(np.tile(end, (len(other), 1)), other, np.full(len(other), count + k), numbers)
        a, b, length = (np.concatenate(column) for column in zip(*rows, strict=True))
        # Points on each other would count as not joined.
        graph = coo_array((np.maximum(length, 1e-9), (a, b)), shape=(count + 2, count + 2)).tocsr()
        return float(dijkstra(graph, directed=False, indices=count)[count + 1])


def _inner(ring: Floats) -> list[Floats]:
    """The corners of a ring, floor to its left, that a shortest way may bend round: those that turn to the right."""
    found = []
    for before, (here, after) in zip(np.roll(ring, 1, axis=0), pairwise([*ring, ring[0]]), strict=True):
        first, second = here - before, after - here
        if first[0] * second[1] - first[1] * second[0] < -1e-9:
            found.append(here)
    return found
