"""Closed surfaces through elliptic rings, each bound to the joints that move it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PchipInterpolator

Floats = NDArray[np.float64]

AROUND = 20  # vertices of a ring
CAP = (0.35, 0.65, 0.9)  # of a radius; how far the rings of a rounded end have come to the tip
MOST_JOINTS = 4  # that a vertex follows


@dataclass(frozen=True)
class Ring:
    """An ellipse. centre (3,) [m]; across, deep: (3,) its half axes [m]; weights: share by joint, 1 in sum."""

    centre: Floats
    across: Floats
    deep: Floats
    weights: Mapping[int, float]

    @classmethod
    def around(cls, centre: Floats, way: Floats, radius: float, weights: Mapping[int, float]) -> Ring:
        """A circle across a way (3,); its deep axis points ahead, to +z, as far as that goes."""
        unit = way / np.linalg.norm(way)
        ahead = np.array([0.0, 0.0, 1.0]) if abs(unit[2]) < 0.8 else np.array([0.0, 1.0, 0.0])
        deep = ahead - (ahead @ unit) * unit
        deep = deep / np.linalg.norm(deep)
        return cls(np.asarray(centre, dtype=np.float64), radius * np.cross(unit, deep), radius * deep, weights)


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


def loft(rings: Sequence[Ring], start: float = 0.0, end: float = 0.0) -> Surface:
    """The closed surface through two rings or more. start, end: length of a rounded end beyond them [m]."""
    first, last = rings[1].centre - rings[0].centre, rings[-1].centre - rings[-2].centre
    whole = [*_cap(rings[0], -first, start)[::-1], *rings, *_cap(rings[-1], last, end)]
    angle = np.arange(AROUND) * (2.0 * np.pi / AROUND)
    circle = np.cos(angle)[:, None], np.sin(angle)[:, None]
    points = [ring.centre + circle[0] * ring.across + circle[1] * ring.deep for ring in whole]
    tips = [_tip(rings[0], -first, start), _tip(rings[-1], last, end)]
    vertices = np.concatenate([*points, np.stack(tips)])
    faces = _faces(len(whole))
    # Outwards, whichever way the rings were given.
    if _volume(vertices, faces) < 0.0:
        faces = faces[:, ::-1]
    bound = [ring.weights for ring in whole for _ in range(AROUND)] + [rings[0].weights, rings[-1].weights]
    joints, weights = _bound(bound)
    return Surface(vertices, _normals(vertices, faces), faces, joints, weights)


def ellipsoid(centre: Floats, axes: tuple[Floats, Floats, Floats], joint: int) -> Surface:
    """An ellipsoid that one joint moves. axes: its half axes (3,) [m], the first from pole to pole."""
    rings = []
    for angle in np.linspace(-1.25, 1.25, 9):
        share = float(np.cos(angle))
        rings.append(Ring(centre + np.sin(angle) * axes[0], share * axes[1], share * axes[2], {joint: 1.0}))
    rest = (1.0 - float(np.sin(1.25))) * float(np.linalg.norm(axes[0]))
    return loft(rings, rest, rest)


def _cap(ring: Ring, way: Floats, length: float) -> list[Ring]:
    if length <= 0.0:
        return []
    unit = way / np.linalg.norm(way)
    found = []
    for share in CAP:
        size = float(np.sqrt(1.0 - share**2))
        centre = ring.centre + share * length * unit
        found.append(Ring(centre, size * ring.across, size * ring.deep, ring.weights))
    return found


def _tip(ring: Ring, way: Floats, length: float) -> Floats:
    return ring.centre + max(length, 0.0) * way / np.linalg.norm(way)


def _faces(rings: int) -> NDArray[np.int64]:
    here = np.arange(AROUND)
    there = (here + 1) % AROUND
    faces = []
    for row in range(rings - 1):
        low, high = row * AROUND, (row + 1) * AROUND
        faces += [
            np.stack((low + here, low + there, high + there), axis=-1),
            np.stack((low + here, high + there, high + here), axis=-1),
        ]
    top, start, end = (rings - 1) * AROUND, rings * AROUND, rings * AROUND + 1
    faces += [
        np.stack((np.full(AROUND, start), there, here), axis=-1),
        np.stack((np.full(AROUND, end), top + here, top + there), axis=-1),
    ]
    return np.concatenate(faces)


def _volume(vertices: Floats, faces: NDArray[np.int64]) -> float:
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    return float((a * np.cross(b, c)).sum() / 6.0)


def _normals(vertices: Floats, faces: NDArray[np.int64]) -> Floats:
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    of_faces = np.cross(b - a, c - a)
    normals = np.zeros_like(vertices)
    for k in range(3):
        np.add.at(normals, faces[:, k], of_faces)
    unit: Floats = normals / np.linalg.norm(normals, axis=-1, keepdims=True).clip(1e-30)
    return unit


def _bound(bound: Sequence[Mapping[int, float]]) -> tuple[NDArray[np.int64], Floats]:
    joints, weights = np.zeros((len(bound), MOST_JOINTS), dtype=np.int64), np.zeros((len(bound), MOST_JOINTS))
    for row, shares in enumerate(bound):
        most = sorted(((share, joint) for joint, share in shares.items() if share > 1e-4), reverse=True)[:MOST_JOINTS]
        for k, (share, joint) in enumerate(most):
            joints[row, k], weights[row, k] = joint, share
    return joints, weights / weights.sum(axis=-1, keepdims=True)
