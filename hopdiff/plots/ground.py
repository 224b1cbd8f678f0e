"""The ground of a picture: maps from above, sheets seen obliquely with a numbered grid, and what lies on them."""

from __future__ import annotations

import math

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.figure import Figure
from matplotlib.ticker import MultipleLocator
from numpy.typing import ArrayLike

from hopdiff.plots import style
from hopdiff.plots.relief import lying
from hopdiff.plots.view import Array, Camera
from hopdiff.terrain.ground import Ground

ELEVATION = math.radians(30.0)  # of oblique views
WIDTH = 13.0  # inches of an oblique view
LONGEST = 8.0  # inches of the longer side of a map
BESIDE = math.radians(-100.0)  # where a camera stands around someone who looks ahead: right of him, a little behind
FLAT = np.array([1.0, 0.0, 1.0])
_MARGIN = 0.6  # metres of ground around everything on a map, at least
_NUMBERS, _NUMBERS_ACROSS = 14, 5  # on the long side of a map, and on a short one, about
_ROOM = 0.75  # inches around an oblique view, for the numbers on the ground
_HEAD = 0.45  # inches for its title
_SHADOW = 0.2  # radius [m]


def on_ground(forward: Array, left: Array, heading: float | Array) -> Array:
    """Steps (..., 3) on the ground for someone who looks along `heading` [rad]."""
    x = forward * np.sin(heading) + left * np.cos(heading)
    z = forward * np.cos(heading) - left * np.sin(heading)
    return np.stack((x, np.zeros_like(x), z), axis=-1)


def ground_points(points: ArrayLike | None) -> Array:
    """Points [x, z] (L, 2) as points (L, 3) on the ground [m]; none without them."""
    flat = np.asarray([] if points is None else points, dtype=float).reshape(-1, 2)
    return np.stack((flat[:, 0], np.zeros(len(flat)), flat[:, 1]), axis=-1)


def shadow(pose: Array, ground: Ground | None = None) -> Array:
    """A disc (K, 3) on the ground below the root of a pose: it tells standing from flying."""
    angle = np.linspace(0, 2 * np.pi, 24, endpoint=False)
    disc = np.stack((np.cos(angle), np.zeros_like(angle), np.sin(angle)), axis=1)
    return lying(pose[0] * FLAT + _SHADOW * disc, ground)


def draw_shadows(
    axes: Axes,
    camera: Camera,
    poses: Array,
    colour: str = "#DDE0E7",
    order: float = 1.5,
    ground: Ground | None = None,
) -> None:
    """The shadows of poses (K, N, 3) whose first point is the root."""
    outlines = [camera.project(shadow(pose, ground))[:, :2] for pose in poses]
    axes.add_collection(PolyCollection(outlines, facecolors=colour, linewidths=0, zorder=order), autolim=False)


def camera_beside(track: Array, heading: float, elevation: float, turn: float = BESIDE) -> Camera:
    """A fixed camera above a way (T, 3) over the ground, placed by where it gets farthest from its start.

    heading: taken instead where the way goes nowhere [rad]. turn: where the camera stands around someone who looks
    there; by default to the right of him and a little behind, so that the way goes to the right.
    """
    chord = track - track[0]
    far = chord[np.argmax(np.hypot(chord[:, 0], chord[:, 2]))]
    main = math.atan2(far[0], far[2]) if np.any(far) else heading
    return Camera(main + turn, elevation)


def spacing(extent: float, most: int = 10) -> float:
    """Metres between grid lines, a round number, so that at most about `most` of them lie in an extent [m]."""
    return next((step for step in (0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0) if extent / step <= most), 100.0)


def map_window(ground: Array) -> tuple[Array, Array]:
    """Corners (2,) of a window [m] around points (N, 2), neither too narrow nor too flat."""
    low, high = ground.min(axis=0), ground.max(axis=0)
    size = (high - low) + 2 * np.maximum(_MARGIN, 0.04 * (high - low).max())
    size = np.maximum(size, np.array([0.4, 0.35]) * size[::-1])
    middle = (low + high) / 2
    return middle - size / 2, middle + size / 2


def map_axes(axes: Axes, low: Array, high: Array) -> None:
    """Make axes a map of a window: z up the page, x to its left, as a runner sees left and right; equal scales."""
    style.tidy(axes)
    axes.set(xlim=(high[0], low[0]), ylim=(low[1], high[1]), aspect="equal")
    axes.set_xlabel("x, to the left [m]")
    axes.set_ylabel("z [m]")
    sizes = [float(size) for size in high - low]
    step = spacing(max(sizes), _NUMBERS)
    for axis, size in zip((axes.xaxis, axes.yaxis), sizes, strict=True):
        # A narrow map has numbers on its short side too.
        axis.set_major_locator(MultipleLocator(min(step, spacing(size, _NUMBERS_ACROSS))))


def oblique_page(camera: Camera, poses: Array, ground: Array, title: str) -> tuple[Figure, Axes, float]:
    """A page with the ground seen obliquely, its grid numbered, large enough for all poses.

    poses: (..., 3) points that have to be on the page [m]. ground: (N, 2) x and z that the sheet has to cover [m].
    Returns the figure, its axes, whose units are metres in the picture, and how many inches a metre is.
    """
    step = max(1.0, spacing(float(np.ptp(ground, axis=0).max()), 30))
    low = step * np.floor((ground.min(axis=0) - 0.2) / step)
    high = step * np.ceil((ground.max(axis=0) + 0.2) / step)
    seen = np.concatenate([camera.project(poses).reshape(-1, 3), camera.project(_corners(low, high))])[:, :2]
    room = _ROOM * float(np.ptp(seen[:, 0])) / (WIDTH - 2 * _ROOM)
    left, bottom = seen.min(axis=0) - room
    right, top = seen.max(axis=0) + np.array([room, 0.3 * room])
    scale = WIDTH / (right - left)
    height = scale * (top - bottom)
    figure = style.new_figure(WIDTH, height + _HEAD, layout=None)
    line = 1 - 0.5 * _HEAD / (height + _HEAD)
    figure.text(0.02, line, title, va="center", fontsize=13, fontweight="bold", color=style.INK)
    note = f"seen from {math.degrees(camera.elevation):.0f} degrees above; grid {step:g} m"
    figure.text(0.98, line, note, ha="right", va="center", fontsize=9, color=style.GROUND)
    axes = figure.add_axes((0.0, 0.0, 1.0, height / (height + _HEAD)))
    axes.set(xlim=(left, right), ylim=(bottom, top))
    axes.axis("off")
    _floor(axes, camera, low, high, step)
    return figure, axes, float(scale)


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
