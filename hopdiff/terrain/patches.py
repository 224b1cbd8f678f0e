"""Ground of patches that lie on each other: kerbs, platforms, ramps, carpets and pits."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import shapely
import torch
from numpy.typing import NDArray
from shapely import LineString, MultiPoint, Point, Polygon, STRtree
from torch import Tensor

from hopdiff.terrain.ground import HALF_WIDTH, Ground, direction, normal_of, points_of
from hopdiff.terrain.profile import BEND

Floats = NDArray[np.float64]

STEP = 0.01  # m; lower edges are no steps
NEAR = 1e-4  # m from an edge at which its sides are looked at
FARTHEST = 0.3  # m that a foot is moved; where it would be more, only a part of its sole must fit
SHARES = (1.0, 0.75, 0.5, 0.25)  # of the sole that must fit


@dataclass(frozen=True, eq=False)
class Patch:
    """outline: (K, 2) x and z of its corners [m]. plane: height at [0, 0] [m], and its change with x and with z."""

    outline: Floats
    plane: tuple[float, float, float]

    def at(self, places: Floats) -> Floats:
        """(...) its height, or that of its plane beside it, at places (..., 2) [m]."""
        level, x, z = self.plane
        return np.asarray(level + x * places[..., 0] + z * places[..., 1])


@dataclass(frozen=True, eq=False)
class Patches(Ground):
    """Patches on a floor at height 0; where they overlap, the later one is on top."""

    patches: Sequence[Patch]

    @property
    def stepped(self) -> bool:
        return bool(self.patches)

    def height(self, place: Tensor) -> Tensor:
        here = points_of(place).numpy()
        return torch.as_tensor(self._heights(here, self._top(here)))

    def normal(self, place: Tensor) -> Tensor:
        slopes = np.array([(0.0, 0.0), *(patch.plane[1:] for patch in self.patches)])
        return normal_of(torch.as_tensor(slopes[self._top(points_of(place).numpy())]))

    def height_over(self, place: Tensor, reach: float) -> Tensor:
        here = points_of(place).numpy()
        found = np.where(_inside(self._union.buffer(-reach), here), -math.inf, 0.0)
        for patch, seen in zip(self.patches, self._seen, strict=True):
            if seen.is_empty:
                continue
            steep = math.hypot(*patch.plane[1:])
            most = patch.at(patch.outline).max()
            high = np.minimum(patch.at(here) + steep * reach, most)
            # A circle of a buffer has straight pieces; a little more keeps it outside.
            found = np.where(_inside(seen.buffer(1.01 * reach), here), np.maximum(found, high), found)
        return torch.as_tensor(found)

    def footing(self, place: Tensor, heading: Tensor, ahead: float, behind: float) -> Tensor:
        here, along = points_of(place).numpy(), direction(heading).numpy()
        found = np.zeros_like(here)
        if not len(self.edges):
            return torch.as_tensor(found)
        for k, (point, way) in enumerate(zip(here, along, strict=True)):
            for share in SHARES:
                shift = self._shift(point, share * ahead * way, -share * behind * way)
                if np.hypot(*shift) <= FARTHEST:
                    found[k] = shift
                    break
        return torch.as_tensor(found)

    @cached_property
    def edges(self) -> Floats:
        """(E, 2, 2) both ends of the lines at which the ground has a step or a bend, x and z [m]."""
        if not self.patches:
            return np.zeros((0, 2, 2))
        # All outlines cut at each other, so that either side of a piece is one patch.
        lines = shapely.union_all([shapely.boundary(polygon) for polygon in self._polygons])
        pieces = [np.asarray(part.coords) for part in shapely.get_parts(lines)]
        ends = np.concatenate([np.stack((piece[:-1], piece[1:]), axis=1) for piece in pieces])
        along = ends[:, 1] - ends[:, 0]
        length = np.hypot(*along.T)
        ends, along = ends[length > 0.0], along[length > 0.0] / length[length > 0.0, None]
        aside = NEAR * np.stack((along[:, 1], -along[:, 0]), axis=-1)
        middle = ends.mean(axis=1)
        left, right = self._top(middle + aside), self._top(middle - aside)
        jump = np.abs(self._heights(ends, left[:, None]) - self._heights(ends, right[:, None])).max(axis=1)
        slopes = np.array([(0.0, 0.0), *(patch.plane[1:] for patch in self.patches)])
        bend = np.hypot(*(slopes[left] - slopes[right]).T)
        return np.asarray(ends[(jump > STEP) | (bend > BEND)])

    def _shift(self, point: Floats, toe: Floats, heel: Floats) -> Floats:
        """The least shift that brings a sole off all edges. toe, heel: of it, from its place."""
        middle, reach = point + 0.5 * (toe + heel), 0.5 * math.hypot(*(toe - heel)) + HALF_WIDTH
        # Where the foot may land if it is moved counts too.
        near = self._edge_tree.query(Point(middle).buffer(2.0 * (reach + FARTHEST)))
        # The places of a foot whose sole meets an edge: the edge spread by the sole, turned about.
        spread = [MultiPoint([end - tip for end in self.edges[k] for tip in (toe, heel)]).convex_hull for k in near]
        forbidden = shapely.union_all([one.buffer(HALF_WIDTH) for one in spread])
        here = Point(point)
        if not forbidden.contains(here):
            return np.zeros(2)
        nearest = shapely.shortest_line(forbidden.boundary, here)
        landing: Floats = np.asarray(nearest.coords)[0]
        return landing - point

    @cached_property
    def _edge_tree(self) -> STRtree:
        return STRtree([LineString(edge) for edge in self.edges])

    @cached_property
    def _polygons(self) -> list[Polygon]:
        return [Polygon(patch.outline) for patch in self.patches]

    @cached_property
    def _union(self) -> shapely.Geometry:
        return shapely.union_all(self._polygons)

    @cached_property
    def _seen(self) -> list[shapely.Geometry]:
        """Of each patch what no later one covers."""
        found: list[shapely.Geometry] = []
        covered: shapely.Geometry = Polygon()
        for polygon in reversed(self._polygons):
            found.append(shapely.difference(polygon, covered))
            covered = shapely.union(covered, polygon)
        return found[::-1]

    def _top(self, places: Floats) -> NDArray[np.int64]:
        """(...) number of the patch that is on top at places (..., 2), from 1; 0 for the floor."""
        found = np.zeros(places.shape[:-1], dtype=np.int64)
        for number, polygon in enumerate(self._polygons, start=1):
            found[_inside(polygon, places)] = number
        return found

    def _heights(self, places: Floats, top: NDArray[np.int64]) -> Floats:
        """(...) heights of patches by their numbers at places (..., 2) [m]."""
        planes = np.array([(0.0, 0.0, 0.0), *(patch.plane for patch in self.patches)])[top]
        return np.asarray(planes[..., 0] + planes[..., 1] * places[..., 0] + planes[..., 2] * places[..., 1])


def _inside(polygon: shapely.Geometry, places: Floats) -> NDArray[np.bool_]:
    """(...) whether places (..., 2) lie in a polygon or on its outline."""
    x, z = places[..., 0], places[..., 1]
    found = np.zeros(x.shape, dtype=bool)
    if polygon.is_empty:
        return found
    left, low, right, high = polygon.bounds
    near = (x >= left) & (x <= right) & (z >= low) & (z <= high)
    shapely.prepare(polygon)
    found[near] = shapely.intersects_xy(polygon, x[near], z[near])
    return found


def plane_through(corners: Sequence[Sequence[float]]) -> tuple[float, float, float]:
    """The plane of a patch through three corners [x, height, z] [m]. Raises ValueError if they lie on one line."""
    points = np.asarray(corners, dtype=np.float64)
    sides = points[1:, [0, 2]] - points[0, [0, 2]]
    if abs(np.linalg.det(sides)) <= 1e-9 * max(1e-9, float(np.abs(sides).max()) ** 2):
        raise ValueError("the three corners lie on one line")
    x, z = np.linalg.solve(sides, points[1:, 1] - points[0, 1])
    return float(points[0, 1] - x * points[0, 0] - z * points[0, 2]), float(x), float(z)
