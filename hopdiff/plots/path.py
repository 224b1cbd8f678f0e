"""A run along a path: from above, and as many figures on the ground seen obliquely, as in Kang (1999), figure 5.6."""

from __future__ import annotations

import math

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from numpy.typing import ArrayLike

from hopdiff.motion import SIDES, Motion
from hopdiff.plots import style
from hopdiff.plots.body import Body
from hopdiff.plots.ground import (
    ELEVATION,
    FLAT,
    LONGEST,
    draw_shadows,
    ground_points,
    map_axes,
    map_window,
    oblique_page,
)
from hopdiff.plots.poses import sample
from hopdiff.plots.relief import draw_heights, draw_relief, laid, lying, relief_of
from hopdiff.plots.scene import FOOT, Footprint, draw_seen, footprints, ground_track, side_camera
from hopdiff.plots.view import Array, Camera
from hopdiff.terrain.ground import Ground

_SHORTEST_PRINT = 0.11  # inches
_MOST = 48  # figures in an oblique view, unless told
_APART = 0.6  # heights of the body from one figure to the next, at least, unless told
_COM = style.SERIES[2]  # as in the other pictures
_WANTED = style.SERIES[6]


def path_figure(
    motion: Motion, points: ArrayLike, curve: ArrayLike | None = None, title: str = "", ground: Ground | None = None
) -> Figure:
    """The run from above, z up the page and x to its left, as the runner sees left and right; equal scales.

    points: (K, 2) the user's points [x, z] in metres. curve: (L, 2) points close together on the path through them,
    which the feet follow while the hips lean into the turns. title: instead of distance, time and speed; the distance
    is that of the curve, or of the hips without one. ground: its heights are drawn where it is not flat.
    """
    path = ground_points(curve)
    crosses = np.asarray(points, dtype=float).reshape(-1, 2)
    root = motion.clip.root_position.detach().cpu().double().numpy()
    com = motion.com.detach().cpu().double().numpy()
    prints = footprints(motion)
    drawn = np.concatenate(
        [crosses, path[:, [0, 2]], root[:, [0, 2]], com[:, [0, 2]], *(step.place[None, [0, 2]] for step in prints)]
    )
    low, high = map_window(drawn)
    wide, tall = high - low
    scale = LONGEST / max(wide, tall)  # inches in a metre
    figure = style.new_figure(max(5.5, scale * wide + 1.2), scale * tall + 1.8, title or _caption(motion, path))
    axes = figure.add_subplot()
    map_axes(axes, low, high)
    draw_heights(axes, ground, low, high)

    if len(path):
        axes.plot(path[:, 0], path[:, 2], color=_WANTED, linewidth=1.0, linestyle=(0, (5, 3)), zorder=2.5, label="path")
    axes.plot(root[:, 0], root[:, 2], color=style.pale(style.GROUND, 0.35), linewidth=2.6, zorder=2, label="hips")
    axes.plot(com[:, 0], com[:, 2], color=_COM, linewidth=0.9, zorder=3, label="centre of mass")
    larger = _larger(scale)
    for side in SIDES:
        outlines = [step.outline(larger)[:, [0, 2]] for step in prints if step.side == side]
        colour = style.SIDE_COLOURS[side]
        axes.add_collection(
            PolyCollection(outlines, facecolors=colour, linewidths=0, zorder=4, label=f"{side} foot"), autolim=False
        )
    _directions(axes, motion)
    axes.plot(*crosses.T, "x", color=_WANTED, markersize=6, markeredgewidth=1.4, zorder=5, label="points of the path")
    figure.legend(loc="outside lower center", ncols=3, frameon=False, fontsize=9)
    return figure


def oblique_figure(
    motion: Motion,
    count: int | None = None,
    curve: ArrayLike | None = None,
    title: str = "",
    ground: Ground | None = None,
) -> Figure:
    """Figures of the runner along the path, seen obliquely from above, the far ones behind the near ones.

    count: of figures, at even times; without it one in the middle of every stance and flight, or of every third,
    fifth, ... of them where they would stand in each other's way. curve: (L, 2) points [x, z] close together on the
    path, drawn on the ground instead of the track of the hips [m]. title: instead of distance, time and speed. ground:
    what the runner stands on, drawn along the way where it is not flat.
    """
    camera = side_camera(motion, ELEVATION)
    body = Body(motion.clip.skeleton)
    times = motion.times.detach().cpu().double().numpy()
    points = body.points(motion.clip)
    at = _moments(motion, points) if count is None else np.linspace(times[0], times[-1], max(1, count))
    poses = sample(times, points, at)
    prints = footprints(motion)
    path = ground_points(curve)
    track = path if len(path) else ground_track(motion)[0]
    flat = (poses * FLAT).reshape(-1, 3)
    sheet = np.concatenate([flat, track, *(step.outline() for step in prints)])[:, [0, 2]]
    pieces = relief_of(ground, track)
    seen = np.concatenate((poses.reshape(-1, 3), pieces.reshape(-1, 3)))
    figure, axes, scale = oblique_page(camera, seen, sheet, title or _caption(motion, path))
    draw_relief(axes, camera, pieces)
    axes.plot(*camera.project(laid(track, ground))[:, :2].T, color=style.GROUND, linewidth=1.6, zorder=2)
    _prints(axes, camera, [lying(step.outline(_larger(scale)), ground) for step in prints], prints)
    draw_shadows(axes, camera, poses, ground=ground)
    for order, pose in enumerate(poses[np.argsort(camera.nearness(poses[:, 0]))]):
        draw_seen(axes, body, pose, camera, order=3 + 0.01 * order)
    return figure


def _caption(motion: Motion, path: Array) -> str:
    track = path if len(path) else ground_track(motion)[0]
    way = float(np.linalg.norm(np.diff(track, axis=0), axis=1).sum())
    time = float(motion.times[-1] - motion.times[0])
    return f"{way:.1f} m in {time:.2f} s: {way / time:.2f} m/s"


def _larger(scale: float) -> float:
    """How much larger than life footprints are drawn, so that they can be seen; scale: inches in a metre."""
    return max(1.0, _SHORTEST_PRINT / (FOOT[0] * scale))


def _directions(axes: Axes, motion: Motion) -> None:
    """A dot where the run starts, and arrow heads that show which way it goes."""
    track, heading = ground_track(motion)
    way = np.concatenate(([0.0], np.cumsum(np.linalg.norm(np.diff(track, axis=0), axis=1))))
    for share in (0.22, 0.47, 0.72, 0.97):
        frame = int(np.searchsorted(way, share * way[-1]))
        turn = math.degrees(heading[frame])  # counter-clockwise from above, and so on the page
        x, z = track[frame, 0], track[frame, 2]
        axes.plot(x, z, marker=(3, 0, turn), markersize=9, color=style.INK, markeredgewidth=0, zorder=4.5)
    axes.plot(
        track[0, 0], track[0, 2], "o", markersize=8, color="white", markeredgecolor=style.INK, zorder=5, label="start"
    )


def _moments(motion: Motion, points: Array) -> Array:
    """Middles of phases [s], so far apart that figures leave each other room. points: (T, N, 3) of the body [m]."""
    middles = np.array([0.5 * (phase.start + phase.end) for phase in motion.phases])
    track, _ = ground_track(motion)
    way = float(np.linalg.norm(np.diff(track, axis=0), axis=1).sum())
    tall = float(np.ptp(points[..., 1], axis=1).max())
    most = min(_MOST, max(2, math.floor(way / (_APART * tall))))
    # Every odd one: stances and flights take turns, and so do the sides.
    return middles[:: math.ceil(len(middles) / most) | 1]


def _prints(axes: Axes, camera: Camera, outlines: list[Array], prints: list[Footprint]) -> None:
    """Outlines (K, 3) of footprints where they lie on the ground."""
    seen = [camera.project(outline)[:, :2] for outline in outlines]
    colours = [style.SIDE_COLOURS[step.side] for step in prints]
    axes.add_collection(PolyCollection(seen, facecolors=colours, linewidths=0, zorder=2.5), autolim=False)
