"""A clip of any skeleton as a strip: stick figures along the way over the ground, seen obliquely from above."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.patches import Circle
from matplotlib.patheffects import withStroke
from numpy.typing import ArrayLike, NDArray

from hopdiff.geometry.clip import Clip
from hopdiff.plots import style
from hopdiff.plots.ground import ELEVATION, FLAT, camera_beside, draw_shadows, ground_points, oblique_page
from hopdiff.plots.joints import Bones, points_of
from hopdiff.plots.relief import draw_relief, laid, relief_of
from hopdiff.plots.view import Array, Camera, numbers
from hopdiff.terrain.ground import Ground
from hopdiff.types import HopdiffError

Frames = NDArray[np.int64]

_MOST = 40  # figures, unless told
_FEWEST = 3
_APART = 0.42  # metres in the picture from a figure to the next, about
_OVERLAP = 0.85  # of the width of a figure, at least: runners are wider than walkers
_TRIED = 24  # figures whose width is looked at
_CROWDED = 0.035  # of the width of the picture, at least
_DEEP = 0.6  # metres up the page, where figures stand behind each other
_CLEAR = 0.65  # of these distances, for a figure to have room
_WINDING = 0.5  # of the figures of a way, if fewer have room
_MOVING = 0.25  # of the fastest pace: below it the body stands
_PACE = 0.2  # seconds over which the pace is taken
_LIMB = 0.028  # thickness in heights of the skeleton
_TRUNK, _FINGER = 1.3, 0.3  # in limbs
_THINNEST, _THICKEST = 1.3, 7.5  # points, of a limb
_EDGE = 0.8  # points of white on either side
_HEAD = 0.06  # radius in heights of the skeleton
_LAYER, _PALE_LAYER, _NEXT = 3.0, 2.4, 0.01  # z-order of the farthest figure, and steps to the next
_PALE = 0.72  # of white in the figures before the edit
_BRIEF = 0.2  # seconds between figures, below which times get two decimals
_LABEL_ROOM, _LABEL_DROP = 0.42, 0.17  # inches from one time to the next, and from the shadow down to it
_WANTED, _SEAM = style.SERIES[6], style.SERIES[4]


def sticks_figure(
    clip: Clip,
    sides: Sequence[str] | None = None,
    before: Clip | None = None,
    count: int | None = None,
    curve: ArrayLike | None = None,
    title: str = "",
    ground: Ground | None = None,
    seams: Sequence[int] = (),
) -> Figure:
    """Stick figures at even times, left limbs blue, right ones orange; near ones cover far ones.

    sides: "left", "right" or "middle" for each joint; None guesses them, see `Bones`. before: the clip before an edit,
    drawn pale behind, at the same times, or only its track where the way winds through its own ground. count: of
    figures; without it, as many as have room. curve: (L, 2) points [x, z] close together on a drawn curve [m].
    title: instead of way and time. ground: what the figures stand on, drawn along their way where it is not flat.
    seams: frames in which one clip goes over into another, marked on the way.
    Raises HopdiffError for a count below 1 and for sides that do not fit the joints.
    """
    if count is not None and count < 1:
        raise HopdiffError(f"a strip needs at least one figure, not {count}.")
    track = numbers(clip.root_position) * FLAT
    camera = camera_beside(track, 0.0, ELEVATION)
    ways = [track] if before is None else [track, numbers(before.root_position) * FLAT]
    apart = max(
        _APART,
        _CROWDED * float(np.ptp(camera.project(np.concatenate(ways))[:, 0])),
        _OVERLAP * _width(clip, camera),
    )
    room, winding = _room(camera.project(track)[:, :2], track, clip.frame_time, apart)
    frames = np.round(np.linspace(0.0, clip.frames - 1, min(count or room, clip.frames))).astype(np.int64)
    layers = [(_at(clip, frames), track, False)]
    if before is not None:
        # The same share of the way through, should the clips differ in length.
        same = np.round(frames / max(clip.frames - 1, 1) * (before.frames - 1)).astype(np.int64)
        layers.insert(0, (_at(before, same), ways[1], True))
    posed = [points_of(some) for some, _, _ in layers]
    line = laid(ground_points(curve), ground)
    pieces = relief_of(ground, track)
    everything = np.concatenate([(pose * FLAT).reshape(-1, 3) for pose in posed] + [way for _, way, _ in layers])
    tall = _height(posed[-1])
    reach = [points.reshape(-1, 3) + _HEAD * tall * np.array([0.0, 1.0, 0.0]) for points in posed]
    sheet = np.concatenate((everything, line))[:, [0, 2]]
    seen = np.concatenate((*reach, pieces.reshape(-1, 3)))
    figure, axes, scale = oblique_page(camera, seen, sheet, title or _caption(clip, track, frames))
    draw_relief(axes, camera, pieces)
    _legend(figure, before is not None, bool(seams))
    if len(line):
        axes.plot(*camera.project(line)[:, :2].T, color=_WANTED, linewidth=1.2, linestyle=(0, (5, 3)), zorder=2.2)
    for (some, way, faded), points in zip(layers, posed, strict=True):
        colour = style.pale(style.GROUND, 0.55) if faded else style.GROUND
        # What was before an edit went over flat ground.
        below = None if faded else ground
        drawn = camera.project(laid(way, below))[:, :2]
        axes.plot(*drawn.T, color=colour, linewidth=1.4, zorder=2.0 if faded else 2.1)
        if faded and winding:
            continue
        if seams and not faded:
            axes.plot(*drawn[list(seams)].T, "D", color=_SEAM, markersize=8.0, markeredgecolor="#FFFFFF", zorder=5.0)
        draw_shadows(axes, camera, points, "#EBEDF1" if faded else "#DDE0E7", 1.4 if faded else 1.5, below)
        bones = Bones(some.skeleton, sides)
        for order, number in enumerate(np.argsort(camera.nearness(points[:, 0]))):
            _draw_sticks(axes, bones, points[number], camera, scale, tall, faded, order)
    feet = laid(posed[-1][:, 0], ground)
    _times(axes, camera, feet, numbers(frames * clip.frame_time), scale)
    return figure


def _at(clip: Clip, frames: Frames) -> Clip:
    """Some frames of a clip."""
    offsets = None if clip.offsets is None else clip.offsets[frames]
    return replace(clip, root_position=clip.root_position[frames], rotations=clip.rotations[frames], offsets=offsets)


def _room(seen: Array, track: Array, frame_time: float, wanted: float) -> tuple[int, bool]:
    """How many figures have room on a track, and whether it keeps coming back to where they stand.

    seen: (T, 2) the track in the picture; track: (T, 3) on the ground [m]; wanted: from a figure to the next [m].
    """
    reach = max(1, min(round(_PACE / frame_time), len(track) - 1))
    pace = np.linalg.norm(track[reach:] - track[:-reach], axis=1) / (reach * frame_time)
    if not len(pace) or not pace.max() > 0:
        return min(_FEWEST, len(track)), False
    moving = pace[pace > _MOVING * pace.max()]
    # One figure after the other as the body moves on; where one stands already, no other has room.
    every = max(1, round(wanted / float(np.median(moving)) / frame_time))
    tried = seen[::every]
    kept = tried[:1]
    for place in tried[1:]:
        apart = (kept - place) / np.array([wanted, _DEEP])
        if (np.hypot(*apart.T) > _CLEAR).all():
            kept = np.concatenate((kept, place[None]))
    winding = len(kept) < _WINDING * len(moving) / every
    count = len(kept) // 2 if winding else len(kept)
    return min(max(count, _FEWEST), _MOST, len(track)), winding


def _width(clip: Clip, camera: Camera) -> float:
    """How wide a figure mostly is in the picture [m]."""
    frames = np.unique(np.linspace(0, clip.frames - 1, _TRIED).round().astype(np.int64))
    return float(np.median(np.ptp(camera.project(points_of(_at(clip, frames)))[..., 0], axis=1)))


def _height(points: Array) -> float:
    """Of the body as it mostly stands [m]; points: (K, N, 3)."""
    return float(np.median(np.ptp(points[..., 1], axis=1)))


def _draw_sticks(
    axes: Axes, bones: Bones, pose: Array, camera: Camera, scale: float, tall: float, faded: bool, order: int
) -> None:
    """One figure: chain by chain from the farthest to the nearest, each on a white line that sets it off, and a head.

    pose: (N, 3) [m]; scale: inches in a metre; tall: height of the skeleton [m]; order: of drawing.
    """
    flat, near = camera.project(pose)[:, :2], camera.nearness(pose)
    limb = float(np.clip(72 * scale * _LIMB * tall, _THINNEST, _THICKEST))
    inks = {side: style.pale(colour, _PALE) if faded else colour for side, colour in style.SIDE_COLOURS.items()}
    layer = (_PALE_LAYER if faded else _LAYER) + _NEXT * order
    radius = _HEAD * tall
    centre = np.zeros(2)
    if bones.head is not None:
        # The neck ends inside the head.
        centre = flat[bones.head.tip] = camera.project(bones.head.centre(pose, radius))[:2]
    lines, colours, widths = [], [], []
    for chain in sorted(bones.chains, key=lambda chain: float(near[list(chain.nodes)].mean())):
        width = limb * (_FINGER if chain.finger else _TRUNK if chain.side == "middle" else 1.0)
        lines += [flat[list(chain.nodes)]] * 2
        colours += ["#FFFFFF", inks[chain.side]]
        widths += [width if chain.finger else width + 2 * min(_EDGE, 0.4 * width), width]
    sticks = LineCollection(lines, colors=colours, linewidths=widths, capstyle="round", joinstyle="round", zorder=layer)
    axes.add_collection(sticks, autolim=False)
    if bones.head is not None:
        disc = Circle(
            (float(centre[0]), float(centre[1])),
            radius,
            facecolor=inks["middle"],
            edgecolor="#FFFFFF",
            linewidth=_EDGE,
            zorder=layer + 0.3 * _NEXT,
        )
        axes.add_artist(disc)


def _times(axes: Axes, camera: Camera, feet: Array, times: Array, scale: float) -> None:
    """When a figure stands at places (K, 3) on the ground, below its shadow; left out where it would lie on another."""
    shown: list[Array] = []
    digits = 2 if len(times) > 1 and times[1] - times[0] < _BRIEF else 1
    orders = np.argsort(np.argsort(camera.nearness(feet)))
    places = camera.project(feet)[:, :2]
    outline = [withStroke(linewidth=2.0, foreground="#FFFFFF")]
    for place, time, order in zip(places, times, orders, strict=True):
        if all(scale * np.hypot(*(place - other)) > _LABEL_ROOM for other in shown):
            shown.append(place)
            axes.annotate(
                f"{time:.{digits}f} s",
                (float(place[0]), float(place[1])),
                (0.0, -72 * _LABEL_DROP),
                textcoords="offset points",
                ha="center",
                va="center",
                fontsize=7.5,
                color=style.INK,
                path_effects=outline,
                zorder=_LAYER + _NEXT * (float(order) + 0.6),
            )


def _legend(figure: Figure, pale: bool, seams: bool) -> None:
    y = 1 - 0.225 / figure.get_figheight()
    entries = [(style.LEFT, "left"), (style.RIGHT, "right")]
    entries += [(style.pale(style.BODY, _PALE), "before the edit")] if pale else []
    entries += [(_SEAM, "seam")] if seams else []
    for place, (colour, text) in enumerate(entries):
        x = 0.5 + 0.06 * place + (0.05 if text == "seam" and pale else 0.0)
        figure.text(x, y, "\u25a0", va="center", ha="right", fontsize=13, color=colour)
        figure.text(x + 0.004, y, text, va="center", fontsize=9, color=style.INK)


def _caption(clip: Clip, track: Array, frames: Frames) -> str:
    way = float(np.linalg.norm(np.diff(track, axis=0), axis=1).sum())
    gap = clip.duration / max(len(frames) - 1, 1)
    return f"{way:.2f} m in {clip.duration:.2f} s, a figure every {gap:.2f} s"
