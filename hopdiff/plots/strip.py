"""The run as animators draw it: key poses side by side, and below them the same stride in place on the ground."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.patches import Polygon
from matplotlib.ticker import MultipleLocator

from hopdiff.motion import SIDES, Motion
from hopdiff.plots import style
from hopdiff.plots.body import Body
from hopdiff.plots.poses import Moment, contact_points, key_moments, sample
from hopdiff.plots.view import Array

_WIDTH = 15.0  # inches
_PATH = style.SERIES[2]  # of the centre of mass
_MARGIN = 0.25  # metres left and right of the outermost figure
_GAP = 0.08  # metres between neighbouring figures
_ABOVE = 0.08  # metres of paper over the highest head
_HEAD, _LABELS, _BELOW = 0.5, 0.85, 0.55  # inches for the title, under the poses and under the trace
_TRACE_HEIGHT = 4.4  # inches at most
_BESIDE = 0.75  # inches left of the trace, for its heights
_TRACE_RATE = 30.0  # stick figures a second in the lower picture


def strip_figure(motion: Motion, title: str = "") -> Figure:
    """Stick figures along one stride, seen from the runner's right, in true proportions.

    Above: ten key poses, spread by an equal extra gap where they would overlap. Below: legs and trunk where they
    are, with the path of the centre of mass and a scale of metres.
    """
    body = Body(motion.clip.skeleton)
    times = motion.times.detach().cpu().double().numpy()
    points = body.points(motion.clip)
    feet = motion.feet.detach().cpu().double().numpy()
    moments = key_moments(motion)
    figures = sample(times, points, [moment.time for moment in moments])
    shifts = _spread(figures)
    z = figures[..., 2] + shifts[:, None]
    low, high = z.min() - _MARGIN, z.max() + _MARGIN
    upper_top = figures[..., 1].max() + _ABOVE
    trace_low, trace_high = points[..., 2].min() - _MARGIN, points[..., 2].max() + _MARGIN
    trace_top = points[..., 1].max() + _ABOVE

    above = _WIDTH * upper_top / (high - low)  # inches, as all heights here
    # Inches in a metre.
    trace_scale = min(_TRACE_HEIGHT / trace_top, (_WIDTH - 2 * _BESIDE) / (trace_high - trace_low))
    middle, share = trace_scale * trace_top, trace_scale * (trace_high - trace_low) / _WIDTH
    height = _HEAD + above + _LABELS + middle + _BELOW
    figure = style.new_figure(_WIDTH, height, layout=None)
    line = 1 - 0.2 / height
    text = title or _caption(motion)
    figure.text(0.02, line, text, va="center", fontsize=13, fontweight="bold", color=style.INK)
    note = f"poses spread by {shifts[1]:.2f} m" if shifts[1] else "poses where they happen"
    figure.text(0.98, line, note, ha="right", va="center", fontsize=9, color=style.GROUND)
    _legend(figure, line)

    upper = figure.add_axes((0.0, (_BELOW + middle + _LABELS) / height, 1.0, above / height))
    _ground(upper, low, high, upper_top)
    for moment, pose, shift in zip(moments, figures, shifts, strict=True):
        draw_body(upper, body, pose, shift)
        _label(upper, moment, _centre(pose) + shift)
        if moment.carries:
            place = sample(times, feet[:, SIDES.index(moment.side)], [moment.time])[0]
            _contact_mark(upper, float(place[2]) + shift, moment.side)

    lower = figure.add_axes(((1 - share) / 2, _BELOW / height, share, middle / height))
    _trace(lower, motion, body, times, points)
    lower.set(xlim=(trace_low, trace_high), ylim=(0.0, trace_top))
    return figure


def draw_body(axes: Axes, body: Body, pose: Array, shift: float = 0.0) -> None:
    """Fill one figure into a side view. pose: (J + E, 3) [m]; shift: added along the way [m]."""
    for order, part in enumerate(body.parts(pose)):
        outline, fill, edge = part.outline + np.array([shift, 0.0]), FILL[part.side], EDGE[part.side]
        axes.add_patch(Polygon(outline, facecolor=fill, edgecolor=edge, linewidth=0.7, zorder=3 + 0.01 * order))


FILL = {"left": style.pale(style.LEFT, 0.45), "middle": style.BODY, "right": style.RIGHT}
# White sets limb off from limb; trunk, neck and head are one piece.
EDGE = {"left": "#FFFFFF", "middle": style.BODY, "right": "#FFFFFF"}


def _spread(figures: Array) -> Array:
    """An equal extra gap for every pose, just enough to keep all neighbours apart; 0 if they are."""
    z = figures[..., 2]
    lacking = z[:-1].max(axis=1) + _GAP - z[1:].min(axis=1)
    gap = max(0.0, float(lacking.max(initial=0.0)))
    return gap * np.arange(len(figures), dtype=np.float64)


def _centre(pose: Array) -> float:
    return float((pose[:, 2].min() + pose[:, 2].max()) / 2)


def _ground(axes: Axes, low: float, high: float, top: float) -> None:
    axes.set(xlim=(low, high), ylim=(0.0, top))
    axes.axis("off")
    axes.plot((low, high), (0, 0), color=style.GROUND, linewidth=2.0, clip_on=False, zorder=2)


def _contact_mark(axes: Axes, z: float, side: str) -> None:
    axes.plot(
        z, 0, marker="^", markersize=8, color=style.SIDE_COLOURS[side], clip_on=False, zorder=4, markeredgewidth=0
    )


def _label(axes: Axes, moment: Moment, z: float) -> None:
    colour = style.SIDE_COLOURS[moment.side]
    lines = (
        (moment.name, 0.30, 10.0, "bold", colour),
        (moment.side, 0.47, 9.0, "normal", colour),
        (f"{moment.time:.2f} s", 0.63, 8.5, "normal", style.GROUND),
    )
    for text, inches, size, weight, ink in lines:
        axes.annotate(
            text,
            (z, 0),
            (0, -72 * inches),
            textcoords="offset points",
            ha="center",
            va="center",
            fontsize=size,
            fontweight=weight,
            color=ink,
            annotation_clip=False,
        )


def _trace(axes: Axes, motion: Motion, body: Body, times: Array, points: Array) -> None:
    """Thin figures at an even rate, the path of the centre of mass, the footholds and a metre scale."""
    count = max(2, round((times[-1] - times[0]) * _TRACE_RATE) + 1)
    poses = sample(times, points, np.linspace(times[0], times[-1], count))
    # Without arms: over each other they would hide what the legs do.
    inks = (("left", style.pale(style.LEFT, 0.35), 1.2), ("middle", style.BODY, 1.4), ("right", style.RIGHT, 1.2))
    for order, (side, colour, width) in enumerate(inks):
        lines = [line for pose in poses for line in body.lines(pose, side, arms=False)]
        axes.add_collection(LineCollection(lines, colors=colour, linewidths=width, alpha=0.8, zorder=2 + order))
    com = motion.com.detach().cpu().double().numpy()
    axes.plot(com[:, 2], com[:, 1], color=_PATH, linewidth=2.2, zorder=6)
    axes.annotate(
        "centre of mass",
        (com[-1, 2], com[-1, 1]),
        (6, 0),
        textcoords="offset points",
        color=_PATH,
        fontsize=9,
        va="center",
    )
    for phase, place in contact_points(motion):
        _contact_mark(axes, float(place[2]), phase.side)
    axes.spines[["top", "right"]].set_visible(False)
    axes.spines["left"].set_color(style.GROUND)
    axes.spines["bottom"].set(color=style.GROUND, linewidth=2.0)
    axes.yaxis.set_major_locator(MultipleLocator(0.5))
    axes.set_ylabel("height [m]", fontsize=9, color=style.INK)
    axes.set_facecolor("none")
    axes.tick_params(colors=style.INK, labelsize=9, length=6, direction="out")
    axes.set_xlabel("along the way [m]", fontsize=9, color=style.INK)
    axes.xaxis.set_major_locator(MultipleLocator(0.5))


def _legend(figure: Figure, y: float) -> None:
    for x, side, text in ((0.42, "right", "right, near"), (0.52, "left", "left, far")):
        figure.text(x, y, "\u25a0", va="center", ha="right", fontsize=13, color=FILL[side])
        figure.text(x + 0.004, y, text, va="center", fontsize=9, color=style.INK)


def _caption(motion: Motion) -> str:
    stride = motion.times[-1] - motion.times[0]
    travel = motion.clip.root_position[-1, 2] - motion.clip.root_position[0, 2]
    return f"One stride at {float(travel / stride):.2f} m/s: {float(travel):.2f} m in {float(stride):.2f} s"
