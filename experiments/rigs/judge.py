"""What a character does in a file that hopdiff wrote, told by a reader that shares no code with it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from tests.export.skins import Played

LOOKS = 24  # frames of a stride
TRUNK = 0.15  # of the height that trunk and head are wide on either side, at least
GROWN = 0.03  # m from which on an edge that has grown is looked at


@dataclass(frozen=True)
class Seen:
    """sole: farthest that the lowest vertex is from the ground while a foot stands [m]. sunk: deepest in any frame [m].
    stretch: largest ratio of an edge to its length as stored, of those that grew by more than 3 cm; grown: by how much
    the edge did that grew most [m]. facing: from the way to where the character's front is [deg], seen from above.
    height: of the character [m]. shape: (V, 3) in the middle of a contact,
    edges: (E, 2) of it."""

    sole: float
    sunk: float
    stretch: float
    grown: float
    facing: float
    height: float
    shape: NDArray[np.float64]
    edges: NDArray[np.int64]


def seen(
    path: Path,
    name: str,
    times: NDArray[np.float64],
    contact: NDArray[np.bool_],
    way: Sequence[float],
    front: Sequence[float],
) -> Seen:
    """times: (T,) of the frames [s], contact: (T, 2), way: (x, z) where it goes. front: (x, z) where it faces as its
    nodes stand."""
    played = Played.of(path)
    frames = np.unique(np.linspace(0, len(times) - 1, LOOKS).round().astype(int))
    heights, stretch, most, soles, sunk, facing, scale, shape = [], [1.0], [0.0], [0.0], [0.0], [], None, None
    rest = np.concatenate(played.shape(played.worlds(None, 0.0)))
    middles = _middles(contact)
    for frame in sorted({*frames.tolist(), *middles}):
        shapes = played.shape(played.worlds(name, float(times[frame])))
        pairs = [(now[edges], at[edges]) for now, (at, edges, *_) in zip(shapes, played.skinned, strict=True)]
        now, before = (np.concatenate([_lengths(pair[k]) for pair in pairs]) for k in (0, 1))
        solid = before > 1e-9
        scale = float(np.median(now[solid] / before[solid])) if scale is None else scale
        grown = solid & (now - scale * before > GROWN)
        stretch.append(float((now[grown] / (scale * before[grown])).max(initial=1.0)))
        most.append(float((now - scale * before)[solid].max()))
        points = np.concatenate(shapes)
        lowest = float(points[:, 1].min())
        heights.append(float(np.ptp(points[:, 1])))
        sunk.append(-lowest)
        if contact[frame].any():
            soles.append(abs(lowest))
        if frame in middles:
            shape = points
            facing.append(_off(rest, points, front, way))
    assert shape is not None, "a run has contacts"
    return Seen(
        max(soles), max(sunk), max(stretch), max(most), float(np.median(facing)), max(heights), shape, _joined(played)
    )


def _joined(played: Played) -> NDArray[np.int64]:
    """(E, 2) edges of all parts of a body together."""
    firsts = np.cumsum([0, *(len(vertices) for vertices, *_ in played.skinned)])
    return np.concatenate([edges + first for (_, edges, *_), first in zip(played.skinned, firsts, strict=False)])


def _middles(contact: NDArray[np.bool_]) -> list[int]:
    """Frames in the middle of every contact of one foot alone."""
    found = []
    for k in range(2):
        alone = contact[:, k] & ~contact[:, 1 - k]
        edges = np.flatnonzero(np.diff(np.concatenate(([0], alone.astype(int), [0]))))
        found += [(first + last - 1) // 2 for first, last in edges.reshape(-1, 2).tolist()]
    return found


def _off(rest: NDArray[np.float64], now: NDArray[np.float64], front: Sequence[float], way: Sequence[float]) -> float:
    """Between the way and the front of trunk and head, turned as their vertices are best laid over those of the rest
    [deg]: Kabsch, Acta Cryst. A32, 922 (1976)."""
    height = float(np.ptp(rest[:, 1]))
    middle = np.abs(rest[:, 0] - np.median(rest[:, 0])) < TRUNK * height
    trunk = middle & (rest[:, 1] > rest[:, 1].min() + 0.5 * height)
    turn, _ = Rotation.align_vectors(now[trunk] - now[trunk].mean(axis=0), rest[trunk] - rest[trunk].mean(axis=0))
    line = turn.apply((front[0], 0.0, front[1]))[[0, 2]]
    cosine = float(line @ np.array(way)) / float(np.linalg.norm(line) * np.linalg.norm(way))
    return float(np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0))))


def _lengths(ends: NDArray[np.float64]) -> NDArray[np.float64]:
    """(E,) of edges (E, 2, 3)."""
    found: NDArray[np.float64] = np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1)
    return found
