"""Closed surfaces through cross sections, and what moves them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PchipInterpolator

Floats = NDArray[np.float64]

CAP = (0.45, 0.8, 0.96)  # of a rounded end's length: where its rings are
MOST_JOINTS = 4  # that a vertex follows
LEAST = 1e-3  # share of a joint below which a vertex does not follow it


@dataclass(frozen=True, eq=False)
class Rings:
    """N cross sections, one after the other.

    Each is made of four quarters of superellipses about a centre (N, 3) [m]: across, deep (N, 3) are its unit axes,
    wide (N, 2) how far it reaches along `across` and against it, tall (N, 2) along `deep` and against it [m]. power
    (N, 2): exponents of the two halves along `deep` and against it; 2 is an ellipse, more is squarer.
    """

    centre: Floats
    across: Floats
    deep: Floats
    wide: Floats
    tall: Floats
    power: Floats

    @classmethod
    def straight(
        cls,
        centre: Floats,
        across: Floats,
        deep: Floats,
        wide: Floats,
        tall: Floats,
        power: tuple[float, float] = (2.0, 2.0),
    ) -> Rings:
        """Sections that are all turned the same way: across, deep (3,)."""
        count = len(centre)
        across, deep = np.tile(across, (count, 1)), np.tile(deep, (count, 1))
        return cls(centre, across, deep, wide, tall, np.tile(power, (count, 1)))


@dataclass(frozen=True, eq=False)
class Shape:
    """Triangles that nothing moves yet. vertices (V, 3) [m]; faces (F, 3); along (V,): number of the section that a
    vertex belongs to."""

    vertices: Floats
    faces: NDArray[np.int64]
    along: NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Surface:
    """Triangles. vertices, normals (V, 3) [m]; faces (F, 3); joints, weights (V, 4)."""

    vertices: Floats
    normals: Floats
    faces: NDArray[np.int64]
    joints: NDArray[np.int64]
    weights: Floats


def through(points: Floats) -> Callable[[float | Floats], Floats]:
    """A curve without corners or overshoot through rows of a place and values: place -> values (..., K)."""
    places, first = np.unique(points[:, 0], return_index=True)
    curve: Callable[[float | Floats], Floats] = PchipInterpolator(places, points[first, 1:])
    return curve


def eased(share: Floats) -> Floats:
    """From 0 to 1, level at both."""
    share = np.clip(share, 0.0, 1.0)
    found: Floats = share * share * (3.0 - 2.0 * share)
    return found


def around(count: int, crowded: float = 0.0) -> Floats:
    """(count,) angles of the vertices of a section [rad], alike on both sides of its `deep` axis; one lies on that.

    crowded: 0 evenly, towards 1 more and more of them ahead, about that axis.
    """
    even = 2.0 * np.pi * np.arange(count) / count
    found: Floats = even - crowded * np.sin(even) + 0.5 * np.pi
    return found


def loft(rings: Rings, angles: Floats, start: float = 0.0, end: float = 0.0, caps: Sequence[float] = CAP) -> Shape:
    """The closed surface through sections. angles: (A,) see `around`. start, end: length of a rounded end beyond the
    first and the last one [m]."""
    cos, sin = np.cos(angles), np.sin(angles)
    ahead = sin >= 0.0
    power = 2.0 / np.where(ahead, rings.power[:, :1], rings.power[:, 1:])
    x = np.sign(cos) * np.abs(cos) ** power * np.where(cos >= 0.0, rings.wide[:, :1], rings.wide[:, 1:])
    y = np.sign(sin) * np.abs(sin) ** power * np.where(ahead, rings.tall[:, :1], rings.tall[:, 1:])
    flat = x[..., None] * rings.across[:, None] + y[..., None] * rings.deep[:, None]
    first, last = rings.centre[0] - rings.centre[1], rings.centre[-1] - rings.centre[-2]
    first, last = first / np.linalg.norm(first), last / np.linalg.norm(last)
    centres, shapes, rows = [rings.centre], [flat], [np.arange(len(flat))]
    for ring, way, length in ((0, first, start), (-1, last, end)):
        if length <= 0.0:
            continue
        shares = np.array(caps)[:: -1 if ring == 0 else 1]
        size = np.sqrt(1.0 - shares**2)
        at = 0 if ring == 0 else len(centres)
        centres.insert(at, rings.centre[ring] + shares[:, None] * length * way)
        shapes.insert(at, size[:, None, None] * flat[ring])
        rows.insert(at, np.full(len(shares), ring % len(flat)))
    whole = (np.concatenate(centres)[:, None] + np.concatenate(shapes)).reshape(-1, 3)
    tips = np.stack((rings.centre[0] + max(start, 0.0) * first, rings.centre[-1] + max(end, 0.0) * last))
    vertices = np.concatenate((whole, tips))
    along = np.concatenate([np.concatenate(rows).repeat(len(angles)), [0, len(flat) - 1]])
    faces = _faces(sum(map(len, rows)), len(angles))
    # Outwards, whichever way the sections were given.
    return Shape(vertices, faces if volume(vertices, faces) > 0.0 else faces[:, ::-1], along)


def ball(centre: Floats, axes: tuple[Floats, Floats, Floats], count: int = 10, rows: int = 6) -> Shape:
    """An ellipsoid. axes: its half axes (3,) [m], the first from pole to pole."""
    angle = np.linspace(-1.1, 1.1, rows)
    lengths = [float(np.linalg.norm(axis)) for axis in axes]
    size = np.cos(angle)[:, None].repeat(2, axis=1)
    rings = Rings.straight(
        centre + np.sin(angle)[:, None] * axes[0],
        axes[1] / lengths[1],
        axes[2] / lengths[2],
        size * lengths[1],
        size * lengths[2],
    )
    rest = (1.0 - float(np.sin(1.1))) * lengths[0]
    return loft(rings, around(count), rest, rest, ())


def moved(shape: Shape, shares: Mapping[int, Floats]) -> Surface:
    """A shape that follows joints. shares: (V,) by joint, of any sum above 0; the four largest count."""
    names, table = (
        np.array(list(shares)),
        np.stack([np.broadcast_to(one, len(shape.vertices)) for one in shares.values()], -1),
    )
    most = np.argsort(-table, axis=-1, kind="stable")[:, :MOST_JOINTS]
    weights = np.take_along_axis(table, most, axis=-1)
    weights = np.where(weights < LEAST * table.sum(axis=-1, keepdims=True), 0.0, weights)
    joints = np.where(weights > 0.0, names[most], 0)
    lacking = MOST_JOINTS - most.shape[-1]
    if lacking > 0:
        weights, joints = (np.pad(one, ((0, 0), (0, lacking))) for one in (weights, joints))
    weights = weights / weights.sum(axis=-1, keepdims=True)
    return Surface(shape.vertices, normals(shape.vertices, shape.faces), shape.faces, joints, weights)


def joined(surfaces: Sequence[Surface]) -> Surface:
    """Several surfaces as one."""
    starts = np.cumsum([0, *(len(one.vertices) for one in surfaces)])
    return Surface(
        np.concatenate([one.vertices for one in surfaces]),
        np.concatenate([one.normals for one in surfaces]),
        np.concatenate([one.faces + start for one, start in zip(surfaces, starts, strict=False)]),
        np.concatenate([one.joints for one in surfaces]),
        np.concatenate([one.weights for one in surfaces]),
    )


def volume(vertices: Floats, faces: NDArray[np.int64]) -> float:
    """Inside a closed surface, positive if its faces look outwards [m^3]."""
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    return float((a * np.cross(b, c)).sum() / 6.0)


def normals(vertices: Floats, faces: NDArray[np.int64]) -> Floats:
    """(V, 3) unit normals, of the faces about a vertex by their areas."""
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    of_faces = np.cross(b - a, c - a)
    found = np.stack(
        [np.bincount(faces.ravel(), of_faces[:, axis].repeat(3), len(vertices)) for axis in range(3)], axis=-1
    )
    unit: Floats = found / np.linalg.norm(found, axis=-1, keepdims=True).clip(1e-30)
    return unit


def _faces(rings: int, count: int) -> NDArray[np.int64]:
    here = np.arange(count)
    there = (here + 1) % count
    low = count * np.arange(rings - 1)[:, None]
    quads = np.stack((low + here, low + there, low + count + there, low + count + here), axis=-1).reshape(-1, 4)
    top, start, end = (rings - 1) * count, rings * count, rings * count + 1
    return np.concatenate(
        (
            quads[:, [0, 1, 2]],
            quads[:, [0, 2, 3]],
            np.stack((np.full(count, start), there, here), axis=-1),
            np.stack((np.full(count, end), top + here, top + there), axis=-1),
        )
    )
