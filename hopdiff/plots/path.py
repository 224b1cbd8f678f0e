"""A run along a path: from above, and as many figures on the ground seen obliquely, as in Kang (1999), figure 5.6."""

from __future__ import annotations

import math

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.figure import Figure
from matplotlib.ticker import MultipleLocator
from numpy.typing import ArrayLike

from hopdiff.motion import SIDES, Motion
from hopdiff.plots import style
from hopdiff.plots.body import Body
from hopdiff.plots.poses import sample
from hopdiff.plots.scene import (
    FOOT,
    Footprint,
    draw_seen,
    footprints,
    ground_points,
    ground_track,
    shadow,
    side_camera,
    spacing,
)
from hopdiff.plots.view import Array, Camera

ELEVATION = math.radians(30.0)  # of the oblique view
_LONGEST = 8.0  # inches of the longer side of a plan
_MARGIN = 0.6  # metres of ground around everything, at least
_SHORTEST_PRINT = 0.11  # inches
_MOST = 48  # figures in an oblique view, unless told
_WIDTH = 13.0  # inches of an oblique view
_ROOM = 0.75  # inches around it, for the numbers on the ground
_COM = style.SERIES[2]  # as in the other pictures
_WANTED = style.SERIES[6]


def path_figure(motion: Motion, points: ArrayLike, curve: ArrayLike | None = None, title: str = "") -> Figure:
    """The run from above, z up the page and x to its left, as the runner sees left and right; equal scales.

    points: (K, 2) the user's points [x, z] in metres. curve: (L, 2) points close together on the path through them,
    which the feet follow while the hips lean into the turns. title: instead of distance, time and speed; the distance
    is that of the curve, or of the hips without one.
    """
    path = ground_points(curve)
    crosses = np.asarray(points, dtype=float).reshape(-1, 2)
    root = motion.clip.root_position.detach().cpu().double().numpy()
    com = motion.com.detach().cpu().double().numpy()
    prints = footprints(motion)
    ground = np.concatenate(
        [crosses, path[:, [0, 2]], root[:, [0, 2]], com[:, [0, 2]], *(step.place[None, [0, 2]] for step in prints)]
    )
    low, high = _window(ground)
    wide, tall = high - low
    scale = _LONGEST / max(wide, tall)  # inches in a metre
    figure = style.new_figure(max(5.5, scale * wide + 1.2), scale * tall + 1.8, title or _caption(motion, path))
    axes = style.tidy(figure.add_subplot())
    axes.set(xlim=(high[0], low[0]), ylim=(low[1], high[1]), aspect="equal")
    axes.set_xlabel("x, to the left [m]")
    axes.set_ylabel("z [m]")
    step = spacing(max(wide, tall))
    axes.xaxis.set_major_locator(MultipleLocator(step))
    axes.yaxis.set_major_locator(MultipleLocator(step))

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


def oblique_figure(motion: Motion, count: int | None = None, curve: ArrayLike | None = None, title: str = "") -> Figure:
    """Figures of the runner along the path, seen obliquely from above, the far ones behind the near ones.

    count: of figures, at even times; without it one in the middle of every stance and flight, or of every third,
    fifth, ... of them on a long way. curve: (L, 2) points [x, z] close together on the path, drawn on the ground
    instead of the track of the hips [m]. title: instead of distance, time and speed.
    """
    camera = side_camera(motion, ELEVATION)
    body = Body(motion.clip.skeleton)
    times = motion.times.detach().cpu().double().numpy()
    at = _moments(motion) if count is None else np.linspace(times[0], times[-1], max(1, count))
    poses = sample(times, body.points(motion.clip), at)
    prints = footprints(motion)
    path = ground_points(curve)
    track = path if len(path) else ground_track(motion)[0]
    flat = poses * np.array([1.0, 0.0, 1.0])
    ground = np.concatenate([flat.reshape(-1, 3), track, *(step.outline() for step in prints)])[:, [0, 2]]
    step = max(1.0, spacing(float(np.ptp(ground, axis=0).max()), 30))
    low = step * np.floor((ground.min(axis=0) - 0.2) / step)
    high = step * np.ceil((ground.max(axis=0) + 0.2) / step)

    seen = np.concatenate([camera.project(poses).reshape(-1, 3), camera.project(_corners(low, high))])[:, :2]
    room = _ROOM * float(np.ptp(seen[:, 0])) / (_WIDTH - 2 * _ROOM)
    left, bottom = seen.min(axis=0) - room
    right, top = seen.max(axis=0) + np.array([room, 0.3 * room])
    head = 0.45  # inches
    height = _WIDTH * (top - bottom) / (right - left)
    figure = style.new_figure(_WIDTH, height + head, layout=None)
    line = 1 - 0.5 * head / (height + head)
    figure.text(
        0.02, line, title or _caption(motion, path), va="center", fontsize=13, fontweight="bold", color=style.INK
    )
    note = f"seen from {math.degrees(ELEVATION):.0f} degrees above; grid {step:g} m"
    figure.text(0.98, line, note, ha="right", va="center", fontsize=9, color=style.GROUND)
    axes = figure.add_axes((0.0, 0.0, 1.0, height / (height + head)))
    axes.set(xlim=(left, right), ylim=(bottom, top))
    axes.axis("off")
    _floor(axes, camera, low, high, step)
    axes.plot(*camera.project(track)[:, :2].T, color=style.GROUND, linewidth=1.6, zorder=2)
    _prints(axes, camera, prints, _larger(_WIDTH / (right - left)))
    _shadows(axes, camera, poses)
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


def _window(ground: Array) -> tuple[Array, Array]:
    """Corners (2,) of a window [m] around points (N, 2), neither too narrow nor too flat."""
    low, high = ground.min(axis=0), ground.max(axis=0)
    size = (high - low) + 2 * np.maximum(_MARGIN, 0.04 * (high - low).max())
    size = np.maximum(size, np.array([0.4, 0.35]) * size[::-1])
    middle = (low + high) / 2
    return middle - size / 2, middle + size / 2


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


def _moments(motion: Motion) -> Array:
    middles = np.array([0.5 * (phase.start + phase.end) for phase in motion.phases])
    # Every odd one: stances and flights take turns, and so do the sides.
    return middles[:: math.ceil(len(middles) / _MOST) | 1]


def _corners(low: Array, high: Array) -> Array:
    return np.array([(x, 0.0, z) for x in (low[0], high[0]) for z in (low[1], high[1])])


def _floor(axes: Axes, camera: Camera, low: Array, high: Array, step: float) -> None:
    """The ground: a pale sheet with lines every `step` metres, numbered along the two edges near the viewer."""
    corners = camera.project(_corners(low, high)[[0, 1, 3, 2]])[:, :2]
    axes.add_collection(PolyCollection([corners], facecolors="#F7F8FA", zorder=0.5), autolim=False)
    lines = []
    for axis, other in ((0, 1), (1, 0)):
        near, far = _edges(camera, low, high, other)
        first, _ = _edges(camera, low, high, axis)
        out = camera.project(np.eye(3)[2 * other] * np.sign(near - far))[:2]
        out /= np.hypot(*out)
        ticks = np.arange(low[axis], high[axis] + 0.5 * step, step)
        every = spacing(float(np.ptp(ticks)), 12)
        texts = [((low[axis] + high[axis]) / 2, f"{'xz'[axis]} [m]", 30.0 + 10.0 * abs(out[0]))]
        for tick in ticks:
            ends = np.zeros((2, 3))
            ends[:, 2 * axis] = tick
            ends[:, 2 * other] = low[other], high[other]
            lines.append(camera.project(ends)[:, :2])
            if math.isclose(tick / every, round(tick / every), abs_tol=1e-6) and tick != first:
                texts.append((tick, f"{tick:g}", 13.0))
        for value, text, away in texts:
            place = np.zeros(3)
            place[[2 * axis, 2 * other]] = value, near
            axes.annotate(
                text,
                tuple(camera.project(place)[:2]),
                tuple(away * out),
                textcoords="offset points",
                ha="center",
                va="center",
                fontsize=9,
                color=style.GROUND,
            )
    axes.add_collection(LineCollection(lines, colors=style.FAINT, linewidths=0.8, zorder=1), autolim=False)


def _edges(camera: Camera, low: Array, high: Array, axis: int) -> tuple[float, float]:
    """The nearer and the farther end of the ground along x (axis 0) or z (1) [m]."""
    near = camera.nearness(np.eye(3)[2 * axis]) > 0
    return (high[axis], low[axis]) if near else (low[axis], high[axis])


def _prints(axes: Axes, camera: Camera, prints: list[Footprint], larger: float) -> None:
    outlines = [camera.project(step.outline(larger))[:, :2] for step in prints]
    colours = [style.SIDE_COLOURS[step.side] for step in prints]
    axes.add_collection(PolyCollection(outlines, facecolors=colours, linewidths=0, zorder=2.5), autolim=False)


def _shadows(axes: Axes, camera: Camera, poses: Array) -> None:
    outlines = [camera.project(shadow(pose))[:, :2] for pose in poses]
    axes.add_collection(PolyCollection(outlines, facecolors="#DDE0E7", linewidths=0, zorder=1.5), autolim=False)
