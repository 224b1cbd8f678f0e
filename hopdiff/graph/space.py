"""Where a body may be in a scene, and how far it has to go around the walls."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import shapely
from numpy.typing import ArrayLike, NDArray
from scipy.ndimage import distance_transform_edt
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra
from shapely import LineString, MultiPolygon, Point, Polygon

from hopdiff.graph.scene import Scene
from hopdiff.types import HopdiffError

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]

CELL = 0.04  # m between the nodes of the grid, or more in a large scene
MOST_NODES = 250_000
FINE = 0.03  # m; side of the squares of a raster, or more in a large scene
MOST_SQUARES = 4_000_000
ROUNDING = 1e-9  # m
SPARE = 2e-3  # m more than the half width that a body is moved away from what it would touch
# One of each pair of opposite steps to the nodes around: straight, diagonal, and like a knight, so that a way along
# the grid is at most 3 % longer than the straight one.
STEPS = ((0, 1), (1, 0), (1, 1), (1, -1), (1, 2), (2, 1), (2, -1), (1, -2))


@dataclass(frozen=True, eq=False)
class Geodesic:
    """Ways to one goal. distance: (X, Z) length of the shortest way from each node, infinite without one [m].

    towards: (X * Z,) the next node on that way, negative at the goal and where there is none.
    """

    distance: Floats
    towards: NDArray[np.int64]


class FreeSpace:
    """The floor of a scene on which the middle of a body that is 2 * half_width wide [m] may be.

    Raises HopdiffError for a half width that is not 0 or more, or that leaves no floor.
    """

    def __init__(self, scene: Scene, half_width: float) -> None:
        if not (math.isfinite(half_width) and half_width >= 0):
            raise HopdiffError(f"way.half_width must be a number of metres of 0 or more, not {half_width:g}.")
        self.scene = scene
        self.half_width = half_width
        self.floor: Polygon | MultiPolygon = scene.free()
        self.edge = self.floor.boundary
        shapely.prepare(self.floor)
        shapely.prepare(self.edge)
        if self.floor.buffer(-half_width).is_empty:
            raise HopdiffError(f"scene {scene.name} has no floor for a body {2 * half_width:g} m wide.")

    def clearance(self, path: ArrayLike) -> float:
        """Least distance between a path (T, 2) and anything that is not free floor [m]; the depth, as a negative
        number, of what runs into it."""
        points = np.asarray(path, dtype=np.float64)
        line = LineString(points) if len(points) > 1 else Point(points[0])
        outside = line.difference(self.floor)
        if not outside.is_empty:
            return -float(max(self.floor.distance(Point(one)) for one in shapely.get_coordinates(outside)))
        return float(line.distance(self.edge))

    def clear(self, path: ArrayLike) -> bool:
        """Whether a body whose middle goes along a path (T, 2) [m] touches nothing."""
        return self.clearance(path) >= self.half_width - ROUNDING

    def depth(self, points: ArrayLike) -> Floats:
        """(N,) distance of points (N, 2) to the edge of the free floor, negative beyond it [m]."""
        found = shapely.points(np.asarray(points, dtype=np.float64))
        distance = shapely.distance(self.edge, found)
        depths: Floats = np.where(shapely.covers(self.floor, found), distance, -distance)
        return depths

    def way_out(self, points: Complexes) -> Complexes:
        """From points z + i x of any shape the shortest way to free floor, as complex numbers; 0 on it [m]."""
        flat = points.reshape(-1)
        out = np.zeros(flat.shape, dtype=np.complex128)
        beyond = np.flatnonzero(~shapely.contains_xy(self.floor, flat.imag, flat.real))
        if len(beyond):
            lines = shapely.shortest_line(shapely.points(flat[beyond].imag, flat[beyond].real), self.floor)
            ends = shapely.get_coordinates(lines).reshape(-1, 2, 2)
            step = ends[:, 1] - ends[:, 0]
            out[beyond] = step[:, 1] + 1j * step[:, 0]
        return out.reshape(points.shape)

    def nearest(self, point: tuple[float, float]) -> tuple[float, float]:
        """The point next to a point at which a body just touches nothing."""
        way = shapely.shortest_line(Point(point), self._inner)
        x, z = shapely.get_coordinates(way)[-1].tolist()
        return x, z

    @cached_property
    def _inner(self) -> Polygon | MultiPolygon:
        return self.floor.buffer(-self.half_width - SPARE)

    def check(self, what: str, point: tuple[float, float]) -> None:
        """Raise HopdiffError, naming what is in the way, if a body cannot be at a point."""
        here = f"the {what} [{point[0]:g}, {point[1]:g}]"
        if not all(map(math.isfinite, point)):
            raise HopdiffError(f"{here} must be two finite numbers.")
        spot = Point(point)
        names = {"walls": "wall", "furniture": "furniture"}
        things = [(f"{names[section]} {name!r}", shape) for (section, name), shape in self.scene.obstacles().items()]
        for name, shape in things:
            if shape.contains(spot):
                raise HopdiffError(f"{here} lies inside {name}.")
        floor = self.scene.floor()
        if not floor.covers(spot):
            raise HopdiffError(f"{here} lies inside a wall or outside the rooms, {floor.distance(spot):.2f} m off.")
        if self.clear([point]):
            return
        name, distance = min(
            [("a wall", floor.boundary.distance(spot)), *((name, shape.distance(spot)) for name, shape in things)],
            key=lambda one: one[1],
        )
        raise HopdiffError(
            f"{here} lies {distance:.2f} m from {name}, nearer than the body's half width of {self.half_width:g} m."
        )

    @cached_property
    def grid(self) -> Grid:
        """Where the middle of the body may be, as a raster."""
        return Grid(self)

    @cached_property
    def raster(self) -> Raster:
        """The free floor as a raster, for the rest of the body."""
        return Raster(self)


class Raster:
    """Fine squares of the scene. cell: their side [m]. room: (X, Z) distance of their middles to what is no free floor,
    0 on that [m]."""

    def __init__(self, space: FreeSpace) -> None:
        bounds = np.array(space.floor.bounds)
        self.cell = max(FINE, math.sqrt(float(np.prod(bounds[2:] - bounds[:2])) / MOST_SQUARES))
        self.low = bounds[:2] - 2 * self.cell
        self.shape = tuple((np.ceil((bounds[2:] - self.low) / self.cell) + 3).astype(int).tolist())
        x, z = (low + self.cell * np.arange(count) for low, count in zip(self.low, self.shape, strict=True))
        inside = shapely.contains_xy(space.floor, *np.meshgrid(x, z, indexing="ij"))
        self.room: Floats = self.cell * distance_transform_edt(inside)

    def at(self, place: Complexes) -> Floats:
        """Room around points z + i x of any shape [m]."""
        x = ((place.imag - self.low[0]) / self.cell + 0.5).astype(np.int64).clip(0, self.shape[0] - 1)
        z = ((place.real - self.low[1]) / self.cell + 0.5).astype(np.int64).clip(0, self.shape[1] - 1)
        found: Floats = self.room[x, z]
        return found


class Grid:
    """Nodes at equal distances: which are free, and the shortest ways along them.

    low: (2,) x and z of the first node. cell: distance between nodes [m]. free: (X, Z). A passage that is less than a
    cell wider than the body may count as closed.
    """

    def __init__(self, space: FreeSpace) -> None:
        bounds = np.array(space.floor.bounds)
        self.cell = max(CELL, math.sqrt(float(np.prod(bounds[2:] - bounds[:2])) / MOST_NODES))
        self.low = bounds[:2] - 2 * self.cell
        self.shape = tuple((np.ceil((bounds[2:] - self.low) / self.cell) + 3).astype(int).tolist())
        axes = [low + self.cell * np.arange(count) for low, count in zip(self.low, self.shape, strict=True)]
        nodes = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 2)
        self.free = self._free(space, nodes).reshape(self.shape)

    def _free(self, space: FreeSpace, nodes: Floats) -> NDArray[np.bool_]:
        inside: NDArray[np.bool_] = shapely.contains_xy(space.floor, nodes)
        near = shapely.dwithin(space.edge, shapely.points(nodes[inside]), space.half_width - ROUNDING)
        inside[inside] = ~near
        return inside

    def index(self, place: Complexes) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Nearest nodes of points z + i x; those outside get nodes of the margin, which are never free."""
        x = ((place.imag - self.low[0]) / self.cell + 0.5).astype(np.int64)
        z = ((place.real - self.low[1]) / self.cell + 0.5).astype(np.int64)
        return x.clip(0, self.shape[0] - 1), z.clip(0, self.shape[1] - 1)

    def place(self, node: NDArray[np.int64]) -> Floats:
        """(..., 2) x and z of nodes by number [m]."""
        return self.low + self.cell * np.stack(np.divmod(node, self.shape[1]), axis=-1)

    def nearest_free(self, point: tuple[float, float]) -> int:
        """The free node next to a point."""
        free = np.flatnonzero(self.free)
        return int(free[np.argmin(np.hypot(*(self.place(free) - np.array(point)).T))])

    @cached_property
    def _edges(self) -> coo_array:
        number = np.arange(self.free.size).reshape(self.shape)
        starts, ends, lengths = [], [], []
        for dx, dz in STEPS:
            here = (slice(0, self.shape[0] - dx), slice(max(0, -dz), self.shape[1] - max(0, dz)))
            there = (slice(dx, self.shape[0]), slice(max(0, dz), self.shape[1] + min(0, dz)))
            both = self.free[here] & self.free[there]
            starts.append(number[here][both])
            ends.append(number[there][both])
            lengths.append(np.full(len(starts[-1]), self.cell * math.hypot(dx, dz)))
        edges = coo_array(
            (np.concatenate(lengths), (np.concatenate(starts), np.concatenate(ends))),
            shape=(self.free.size, self.free.size),
        )
        return edges.tocsr()

    def geodesic(self, goal: tuple[float, float]) -> Geodesic:
        """The shortest ways along the grid to a goal (Dijkstra 1959)."""
        distance, towards = dijkstra(
            self._edges, directed=False, indices=self.nearest_free(goal), return_predecessors=True
        )
        return Geodesic(np.asarray(distance).reshape(self.shape), np.asarray(towards, dtype=np.int64))

    def line(self, ways: Geodesic, start: tuple[float, float]) -> Floats:
        """(K, 2) nodes of the shortest way from a start, which must have one, to the goal [m]."""
        nodes = [self.nearest_free(start)]
        while (following := int(ways.towards[nodes[-1]])) >= 0:
            nodes.append(following)
        return self.place(np.array(nodes))

    def length(self, ways: Geodesic, start: tuple[float, float]) -> float:
        """Of the shortest way from a start; infinite if there is none [m]."""
        return float(ways.distance.reshape(-1)[self.nearest_free(start)])
