"""The hopper from the side, in true proportions, as Kang (1999) draws it in figures 3.4, 3.5 and 3.7."""

from __future__ import annotations

from textwrap import wrap
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator

from hopdiff.motion import SIDES
from hopdiff.physics.hopping import Hopping
from hopdiff.plots import style

_LEGS = (0.4, 1.25)  # inches that a leg is drawn long
_WIDTHS = (9.0, 18.0, 40.0)  # inches: at least, at most for the longer leg, at most whatever the leg
_HIGHEST = 9.0  # inches of the tallest drawing
_SIDE, _HEAD, _LINE, _FEET = 0.6, 0.8, 0.2, 0.6  # inches beside, above (with lines of the note) and below
_LETTERS = 13  # of the note in an inch
_SPACING = 0.2  # leg lengths between neighbouring figures
_TICKS = 1.8  # in an inch
_MARGIN = 0.25  # leg lengths before the first and beyond the last figure, and above the highest
_PATH = style.SERIES[2]
_ONE_LEG = {True: style.RIGHT, False: style.LEFT}  # by whether it stands


def hopper_figure(done: Hopping, leg_length: float, title: str, note: str = "") -> Figure:
    """Stick figures at an even rate along the whole way, the path of HIP, the footprints and a scale of metres.

    leg_length: rest length [m]. note: a line below the title. Of one leg, stance and flight differ in colour; of
    two, left and right, and the one that carries is drawn stronger.
    """
    hip, feet, knees = done.hip.numpy(), done.feet.numpy(), done.knees.numpy()
    points = np.concatenate((hip[:, None], feet, knees), axis=1)
    low, high = points[..., 0].min() - _MARGIN * leg_length, points[..., 0].max() + _MARGIN * leg_length
    bottom, top = min(0.0, points[..., 1].min() - 0.02 * leg_length), points[..., 1].max() + _MARGIN * leg_length
    fitting = leg_length * (_WIDTHS[1] - 2 * _SIDE) / (high - low)
    scale = min(
        float(np.clip(fitting, *_LEGS)) / leg_length,
        _HIGHEST / (top - bottom),
        (_WIDTHS[2] - 2 * _SIDE) / (high - low),
    )
    width = max(_WIDTHS[0], scale * (high - low) + 2 * _SIDE)
    lines = wrap(note, int(_LETTERS * (width - 2 * _SIDE)))
    head = _HEAD + _LINE * len(lines)
    height = scale * (top - bottom) + head + _FEET

    figure = style.new_figure(width, height, layout=None)
    place = (0.5 * (width - scale * (high - low)) / width, _FEET / height)
    axes = figure.add_axes((*place, scale * (high - low) / width, scale * (top - bottom) / height))
    axes.set(xlim=(low, high), ylim=(bottom, top))
    rows = [(title, 12.0, "bold"), *((line, 10.0, "normal") for line in lines)]
    for i, (text, size, weight) in enumerate(rows):
        y = 1 - (0.25 + (_LINE * i + 0.05 if i else 0.0)) / height
        figure.text(_SIDE / width, y, text, va="center", fontsize=size, fontweight=weight, color=style.INK)

    shown = _regular(done, leg_length)
    if feet.shape[1] == 1:
        _draw_one_leg(axes, done, shown)
    else:
        _draw_two_legs(axes, done, shown)
    axes.plot(hip[:, 0], hip[:, 1], color=_PATH, linewidth=1.6, zorder=6)
    mark = float(np.clip(9.0 * scale * leg_length, 3.0, 8.0))
    axes.plot(hip[shown, 0], hip[shown, 1], "o", color=style.INK, markersize=0.45 * mark, markeredgewidth=0, zorder=7)
    _mark_changes(axes, done, mark)
    _ground(axes, done, mark)
    for axis, size in ((axes.xaxis, high - low), (axes.yaxis, top - bottom)):
        axis.set_major_locator(MaxNLocator(max(3, int(_TICKS * scale * size)), steps=(1, 2, 5, 10)))
    _legend(figure, done, _SIDE / width, 1 - (head - 0.2) / height)
    return figure


def _regular(done: Hopping, leg_length: float) -> list[int]:
    """Frames to draw: every n-th, and the last."""
    last = len(done.hip) - 1
    poses = float(done.hip[last, 0] - done.hip[0, 0]) / (_SPACING * leg_length)
    return sorted({*range(0, last, max(1, round(last / max(poses, 1.0)))), last})


def _leg_lines(done: Hopping, frames: list[int], leg: int) -> list[np.ndarray]:
    """HIP, knee, foot (3, 2) of a leg on some frames."""
    return [np.stack((done.hip[i].numpy(), done.knees[i, leg].numpy(), done.feet[i, leg].numpy())) for i in frames]


def _draw_one_leg(axes: Axes, done: Hopping, shown: list[int]) -> None:
    for standing, colour in _ONE_LEG.items():
        frames = [i for i in shown if bool(done.in_flight[i]) is not standing]
        ink, width = (colour, 1.6) if standing else (style.pale(colour, 0.3), 1.1)
        axes.add_collection(
            LineCollection(_leg_lines(done, frames, 0), colors=ink, linewidths=width, zorder=3 + standing)
        )


def _draw_two_legs(axes: Axes, done: Hopping, shown: list[int]) -> None:
    for leg, side in enumerate(SIDES):
        for standing in (False, True):
            frames = [i for i in shown if (not done.in_flight[i] and int(done.carrier[i]) == leg) is standing]
            colour = style.SIDE_COLOURS[side]
            ink, width = (colour, 1.9) if standing else (style.pale(colour, 0.4), 1.0)
            lines = _leg_lines(done, frames, leg)
            axes.add_collection(LineCollection(lines, colors=ink, linewidths=width, zorder=3 + standing + 0.1 * leg))


def _mark_changes(axes: Axes, done: Hopping, size: float) -> None:
    """Where HIP is at every touchdown and take-off. size: of the marks, in points."""
    flying = done.in_flight.numpy()
    hip = done.hip.numpy()
    takeoffs = np.nonzero(~flying[:-1] & flying[1:])[0] + 1
    touchdowns = np.concatenate(([0], np.nonzero(flying[:-1] & ~flying[1:])[0] + 1))
    for frames, marker in ((touchdowns, "v"), (takeoffs, "^")):
        axes.plot(
            hip[frames, 0], hip[frames, 1], marker, color=_PATH, markersize=size, markeredgecolor="white", zorder=8
        )


def _ground(axes: Axes, done: Hopping, size: float) -> None:
    """The ground, the footprints, and metres along the way. size: of the footprints, in points."""
    axes.spines[["top", "left", "right", "bottom"]].set_visible(False)
    axes.plot(axes.get_xlim(), (0, 0), color=style.GROUND, linewidth=2.0, clip_on=False, zorder=2)
    for k in range(int(done.hop.max()) + 1):
        # The first frame of a hop stands on the foot that carries it.
        i = int((done.hop == k).nonzero()[0])
        leg = int(done.carrier[i])
        colour = style.SIDE_COLOURS[SIDES[leg]] if done.feet.shape[1] == 2 else _ONE_LEG[True]
        spot = float(done.feet[i, leg, 0])
        axes.plot(spot, 0, "o", markersize=0.8 * size, color=colour, markeredgecolor="white", clip_on=False, zorder=9)
    axes.spines["left"].set(visible=True, color=style.GROUND, bounds=(0.0, axes.get_ylim()[1]))
    axes.set_ylabel("height [m]", fontsize=9, color=style.INK)
    axes.set_facecolor("none")
    axes.tick_params(colors=style.INK, labelsize=9, length=6, direction="out")
    axes.set_xlabel("along the way [m]", fontsize=9, color=style.INK)


def _legend(figure: Figure, done: Hopping, x: float, y: float) -> None:
    if done.feet.shape[1] == 1:
        legs = [Line2D([], [], color=_ONE_LEG[True], linewidth=2, label="stance")]
        legs += [Line2D([], [], color=style.pale(_ONE_LEG[False], 0.3), linewidth=1.3, label="flight")]
    else:
        legs = [
            Line2D([], [], color=style.SIDE_COLOURS[side], linewidth=2, label=f"{side}, strong while it carries")
            for side in SIDES
        ]
    marks: dict[str, Any] = {"color": _PATH, "markeredgecolor": "white", "markersize": 8, "linestyle": "none"}
    figure.legend(
        handles=[
            *legs,
            Line2D([], [], color=_PATH, linewidth=1.6, label="path of HIP"),
            Line2D([], [], marker="v", label="touchdown", **marks),
            Line2D([], [], marker="^", label="take-off", **marks),
        ],
        loc="center left",
        bbox_to_anchor=(x, y),
        ncols=5,
        frameon=False,
        fontsize=9,
        borderpad=0.0,
        borderaxespad=0.0,
        columnspacing=1.5,
    )
