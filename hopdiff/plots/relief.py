"""Uneven ground in pictures: a sheet along the way in oblique views, lines of equal height on maps."""

from __future__ import annotations

import numpy as np
import torch
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from scipy.spatial import cKDTree

from hopdiff.plots import style
from hopdiff.plots.view import Array, Camera
from hopdiff.terrain.ground import Ground

BESIDE = 0.6  # metres of ground that are drawn to either side of a way
_MOST = 30_000  # pieces of ground in an oblique view
_FINEST, _COARSEST = 0.04, 0.5  # metres of a piece
_LIGHT = np.array([0.35, 0.85, 0.4])  # where the light comes from
_BRIGHT, _DARK = "#F1F3F7", "#A9B1C0"
_LEVELS = (0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0)  # metres between lines of equal height
_MOST_LEVELS = 12
_FINE = 240  # places along the longer side of a map


def laid(points: Array, ground: Ground | None) -> Array:
    """Points (..., 3) moved up or down onto the ground [m]; None is flat ground."""
    flat = np.asarray(points * np.array([1.0, 0.0, 1.0]))
    if ground is not None and not ground.flat:
        flat[..., 1] = ground.height(torch.as_tensor(flat[..., [0, 2]])).numpy()
    return flat


def lying(outline: Array, ground: Ground | None) -> Array:
    """A small outline (K, 3) on the ground below its middle, which does not hang over edges [m]."""
    flat = laid(outline, None)
    if ground is not None and not ground.flat:
        middle = flat.mean(axis=0)
        place = torch.as_tensor(middle[[0, 2]])
        normal = ground.normal(place).numpy()
        flat[:, 1] = float(ground.height(place)) - (flat - middle)[:, [0, 2]] @ normal[[0, 2]] / normal[1]
    return flat


def relief_of(ground: Ground | None, track: Array) -> Array:
    """Pieces (Q, 4, 3) of the ground about a way (T, 3), squares as seen from above [m]; none of flat ground."""
    if ground is None or ground.flat:
        return np.zeros((0, 4, 3))
    low, high = track[:, [0, 2]].min(axis=0) - BESIDE, track[:, [0, 2]].max(axis=0) + BESIDE
    way = float(np.linalg.norm(np.diff(track[:, [0, 2]], axis=0), axis=1).sum())
    area = min((2.0 * BESIDE) * (way + 2.0 * BESIDE), float(np.prod(high - low)))
    cell = float(np.clip(np.sqrt(area / _MOST), _FINEST, _COARSEST))
    x, z = (np.arange(a, b + cell, cell) for a, b in zip(low, high, strict=True))
    corners = np.stack(np.meshgrid(x, z, indexing="ij"), axis=-1)
    middles = 0.5 * (corners[:-1, :-1] + corners[1:, 1:])
    near = cKDTree(track[:, [0, 2]]).query(middles.reshape(-1, 2))[0].reshape(middles.shape[:2]) <= BESIDE
    around = (corners[:-1, :-1], corners[1:, :-1], corners[1:, 1:], corners[:-1, 1:])
    places = np.stack([some[near] for some in around], axis=1)
    return laid(np.stack((places[..., 0], np.zeros(places.shape[:2]), places[..., 1]), axis=-1), ground)


def draw_relief(axes: Axes, camera: Camera, pieces: Array) -> None:
    """Pieces of ground as `relief_of` gives them, near ones over far ones, darker where they are steep."""
    if not len(pieces):
        return
    normal = np.cross(pieces[:, 1] - pieces[:, 3], pieces[:, 2] - pieces[:, 0])
    normal *= np.sign(normal[:, [1]]) / np.linalg.norm(normal, axis=1, keepdims=True)
    bright = normal @ (_LIGHT / np.linalg.norm(_LIGHT))
    level = float(_LIGHT[1] / np.linalg.norm(_LIGHT))
    share = np.clip(0.25 + 1.4 * (level - bright), 0.0, 1.0)
    order = np.argsort(camera.nearness(pieces.mean(axis=1)))
    faces = [style.mix(_BRIGHT, _DARK, round(float(one), 2)) for one in share[order]]
    outlines = list(camera.project(pieces[order])[..., :2])
    # Edges of the same colour close the gaps between neighbours.
    sheet = PolyCollection(outlines, facecolors=faces, edgecolors=faces, linewidths=0.4, zorder=1.3, rasterized=True)
    axes.add_collection(sheet, autolim=False)


def draw_heights(axes: Axes, ground: Ground | None, low: Array, high: Array) -> None:
    """Lines of equal height on a map of a window, with their heights; nothing of flat ground."""
    if ground is None or ground.flat:
        return
    cell = float((high - low).max()) / _FINE
    x, z = (np.arange(a, b + cell, cell) for a, b in zip(low, high, strict=True))
    places = np.stack(np.meshgrid(x, z), axis=-1)
    heights = ground.height(torch.as_tensor(places)).numpy()
    bottom, top = float(heights.min()), float(heights.max())
    if top - bottom < 1e-6:
        return
    step = next((one for one in _LEVELS if (top - bottom) / one <= _MOST_LEVELS), (top - bottom) / _MOST_LEVELS)
    # A level at the height of even ground itself would wander; halves stand clear of the treads of most.
    levels = step * (np.arange(np.floor(bottom / step), np.ceil(top / step) + 1) + 0.5)
    axes.contourf(x, z, heights, 24, colors=_shades(24), zorder=0.4)
    inner = levels[(levels > bottom) & (levels < top)]
    if len(inner):
        lines = axes.contour(x, z, heights, inner, colors=style.pale(style.GROUND, 0.35), linewidths=0.7, zorder=1.1)
        axes.clabel(lines, fmt=lambda value: f"{value:.3g} m", fontsize=7, colors=style.GROUND)


def _shades(count: int) -> list[str]:
    return [style.mix("#FFFFFF", "#D5DAE4", k / (count - 1)) for k in range(count)]
