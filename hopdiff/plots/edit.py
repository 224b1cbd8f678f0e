"""An edited path beside its source: both from above, and how much their steps change (Kim & Lee 2021, figures 2-4)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import cKDTree

from hopdiff.editing.laplacian import laplacian
from hopdiff.editing.root_path import RootPath, steps_of
from hopdiff.editing.targets import Constraint
from hopdiff.plots import style
from hopdiff.plots.ground import LONGEST, ground_points, map_axes, map_window, on_ground
from hopdiff.plots.relief import draw_heights
from hopdiff.plots.view import Array, numbers
from hopdiff.terrain.ground import Ground
from hopdiff.types import HopdiffError

Mark = tuple[Constraint, tuple[Array, float | None]]  # a constraint, its place [m] and heading [rad]

BEFORE = style.GROUND
AFTER = style.SERIES[2]
WANTED = style.SERIES[6]
ABRUPT = "#D7263D"
_STEP = 1.0 / 30.0  # seconds, as in the paper
_TICKS = (0.25, 0.5, 1.0, 2.0, 5.0, 10.0)  # seconds between two marks of the heading
_TICK_ROOM = 0.13  # inches of way for a mark, so many seconds apart that it has them
_MOST_TICKS = 100
_TICK = 0.2  # inches of a mark
_ARROW = 0.45  # inches of the arrow of a wanted heading
_BAR = 0.4  # inches of the longest bar
_BAR_ROOM = 0.06  # inches of way for a bar
_MOST_BARS = 400
_WINDING = 5.0  # times the map's longer side; a longer way has no room for bars
_USUAL = 0.95  # share of the source's frames whose change counts as usual
_EVEN = 0.001  # m and rad by which |delta| of neighbours may always differ
_SMALL = 0.005  # m and rad; the longest bar stands for at least so much
_GLANCE = 0.1  # seconds before and after a frame that tell which way it goes
_MOVING = 0.1  # of the fastest pace: below it a direction says nothing
_TIMELINE = 1.9  # inches of the lower panel
_FEW_MARKS = 12  # of constraints; more are drawn smaller
_FEWEST = 5  # frames: four steps, of which two have two neighbours


@dataclass(frozen=True)
class _Bars:
    """lines: (K, 2, 2) from the way to the tips [m]. abrupt: (K,) which are red. longest: |delta| of the longest."""

    lines: Array
    abrupt: NDArray[np.bool_]
    longest: float


def edit_figure(
    before: RootPath,
    after: RootPath,
    constraints: Sequence[Constraint],
    frame_time: float,
    curve: ArrayLike | None = None,
    title: str = "",
    ground: Ground | None = None,
) -> Figure:
    """Both root paths from above, z up the page and x to its left, in equal scales; below, |delta| over time.

    Dots at even times, with short strokes to where the body faces. Bars on one side of the edited path are as long as
    |delta|, the norm of the differential coordinates of its steps in 1/30 s (m and rad together), whatever the frame
    rate; the legend tells the longest. Red ones stand out against a neighbour by more than 95 % of the source's do. A
    way that winds through its own ground has no room for bars: there, red is the path itself. A constraint is a cross,
    or a ring where only a heading is asked for, with an arrow along a wanted heading. curve: (L, 2) points [x, z] close
    together on a drawn curve [m]. title: instead of ways and time. ground: its heights are drawn where it is not flat.
    Raises HopdiffError for paths of fewer than 5 frames and constraints outside them.
    """
    _check(before, after, constraints)
    curve_line = ground_points(curve)[:, [0, 2]]
    marks = [(one, _mark(one, before, after)) for one in constraints]
    old, new = numbers(before.place), numbers(after.place)
    drawn = np.concatenate([old, new, curve_line, *(place[None] for _, (place, _) in marks)])
    inch = float(np.ptp(drawn, axis=0).max()) / LONGEST  # in metres, about
    every = max(1, min(round(_STEP / frame_time), (min(before.frames, after.frames) - 1) // (_FEWEST - 1)))
    deltas = {"before": delta_norm(before, every), "after": delta_norm(after, every)}
    abrupt = abrupt_steps(deltas["before"], deltas["after"])
    bars = _bars(new, old, deltas["after"], abrupt, every, frame_time, inch)
    low, high = map_window(np.concatenate((drawn, _tips(marks, _ARROW * inch), bars.lines[:, 1])))
    wide, tall = high - low
    scale = LONGEST / max(wide, tall)  # inches in a metre
    size = max(6.5, scale * wide + 1.2), scale * tall + 1.9 + _TIMELINE
    figure = style.new_figure(*size, title or _caption(before, after, frame_time))
    upper, lower = figure.subplots(2, 1, height_ratios=(scale * tall, _TIMELINE))
    map_axes(upper, low, high)
    draw_heights(upper, ground, low, high)

    if len(curve_line):
        dashes = (0, (5, 3))
        upper.plot(*curve_line.T, color=WANTED, linewidth=1.1, linestyle=dashes, zorder=2.5, label="drawn curve")
    upper.plot(*old.T, color=style.pale(BEFORE, 0.15), linewidth=1.8, zorder=2, label="before")
    upper.plot(*new.T, color=AFTER, linewidth=2.2, zorder=4, label="after")
    interval = _interval(new, frame_time, scale)
    for path, colour, order in ((before, BEFORE, 3.0), (after, style.mix(AFTER, "#000000", 0.5), 5.0)):
        _draw_headings(upper, path, interval / frame_time, _TICK / scale, colour, order)
    if len(bars.lines):
        _draw_bars(upper, bars)
    else:
        _draw_kinks(upper, new, abrupt, every)
    upper.plot(*new[0], "o", markersize=8, color="white", markeredgecolor=style.INK, zorder=6, label="start")
    _draw_constraints(upper, marks, scale)
    _timeline(lower, deltas, abrupt, every * frame_time, [frame_time * one.frame for one in constraints])
    note = f"a dot every {interval:g} s, with a stroke to where the body faces"
    upper.set_title(note, fontsize=9, color=style.GROUND)
    figure.legend(*upper.get_legend_handles_labels(), loc="outside lower center", ncols=3, frameon=False, fontsize=9)
    return figure


def delta_norm(path: RootPath, every: int = 1) -> Array:
    """Norm of the differential coordinates of the steps, m and rad together (Kim & Lee 2021, eq. 5-9).

    every: frames to a step. Returns S - 2 numbers for S steps: first and last have one neighbour and say something
    else.
    """
    coarse = RootPath(path.place[::every], path.yaw[::every])
    return numbers(laplacian(steps_of(coarse)).norm(dim=-1))[1:-1]


def abrupt_steps(before: Array, after: Array) -> NDArray[np.bool_]:
    """Which steps stand out: |delta| is larger than a neighbour's by more than is usual in the source.

    before, after: (S,) |delta| of both paths. Returns (S,) booleans. Differences below 1 mm or 0.06 degrees never do.
    """
    usual = max(float(np.quantile(np.abs(np.diff(before)), _USUAL)), _EVEN)
    rise = np.diff(after)
    return np.concatenate(([False], rise > usual)) | np.concatenate((rise < -usual, [False]))


def _check(before: RootPath, after: RootPath, constraints: Sequence[Constraint]) -> None:
    for name, path in (("source", before), ("edited path", after)):
        if path.frames < _FEWEST:
            raise HopdiffError(
                f"the picture of an edit needs at least {_FEWEST} frames, but the {name} has {path.frames}."
            )
    for one in constraints:
        if not 0 <= one.frame < min(before.frames, after.frames):
            last = min(before.frames, after.frames) - 1
            raise HopdiffError(f"frame {one.frame} lies outside the clip, whose frames are 0 to {last}.")


def _caption(before: RootPath, after: RootPath, frame_time: float) -> str:
    ways = (float(path.place.diff(dim=0).norm(dim=-1).sum()) for path in (before, after))
    old, new = ways
    return f"Root path: {old:.2f} m before, {new:.2f} m after the edit, {(after.frames - 1) * frame_time:.2f} s"


def _mark(one: Constraint, before: RootPath, after: RootPath) -> tuple[Array, float | None]:
    """Where a constraint is drawn (2,) [m], and the heading that it asks for, if it does [rad]."""
    place = numbers(after.place[one.frame] if one.place is None else one.place)
    return place, float(before.yaw[one.frame]) if one.keep and one.yaw is None else one.yaw


def _interval(place: Array, frame_time: float, scale: float) -> float:
    """Seconds between marks of the heading; scale: inches in a metre."""
    way = scale * float(np.hypot(*np.diff(place, axis=0).T).sum())
    duration = (len(place) - 1) * frame_time
    fits = (step for step in _TICKS if way * step / duration >= _TICK_ROOM and duration / step <= _MOST_TICKS)
    return next(fits, _TICKS[-1])


def _draw_headings(axes: Axes, path: RootPath, every: float, reach: float, colour: str, order: float) -> None:
    """Dots on the path, `every` so many frames, and strokes from them to where the body faces, `reach` metres long."""
    frames = np.arange(path.frames)
    at = np.arange(0.0, frames[-1] + 1e-6, every)
    x, z, yaw = (np.interp(at, frames, numbers(track)) for track in (*path.place.unbind(-1), path.yaw))
    start = np.stack((x, z), axis=-1)
    ends = start + on_ground(np.full(len(at), reach), np.zeros(len(at)), yaw)[:, [0, 2]]
    strokes = LineCollection(list(np.stack((start, ends), axis=1)), colors=colour, linewidths=1.5, zorder=order)
    axes.add_collection(strokes, autolim=False)
    axes.plot(x, z, "o", color=colour, markersize=3.6, markeredgewidth=0, zorder=order)


def _bars(
    place: Array, source: Array, delta: Array, abrupt: NDArray[np.bool_], every: int, frame_time: float, inch: float
) -> _Bars:
    """Bars for |delta| across the way, one for the largest of steps that are close together; none on a winding way.

    inch: in metres. They stand on the side where the source's way is farther off, so that neither way is buried.
    """
    way = float(np.hypot(*np.diff(place, axis=0).T).sum())
    if way > _WINDING * LONGEST * inch:
        return _Bars(np.zeros((0, 2, 2)), np.zeros(0, dtype=bool), 0.0)
    room = max(1, min(_MOST_BARS, int(way / inch / _BAR_ROOM))) if inch > 0 else 1
    starts = np.arange(0, len(delta), -(-len(delta) // room))
    tall = np.maximum.reduceat(delta, starts)
    # Of steps that share a bar it stands at the largest, where it is one's own.
    ends = [*starts[1:], len(delta)]
    tops = np.array([start + int(np.argmax(delta[start:end])) for start, end in zip(starts, ends, strict=True)])
    lengths = _BAR * inch * tall / max(float(tall.max()), _SMALL)
    at = every * (tops + 2)  # a bar stands where its step ends
    left = on_ground(np.zeros(len(at)), lengths, _direction(place, frame_time)[at])[:, [0, 2]]
    near = cKDTree(source)
    apart = [float(near.query(place[at] + sign * left)[0].mean()) for sign in (1.0, -1.0)]
    aside = -left if apart[1] > 1.01 * apart[0] else left
    red = np.maximum.reduceat(abrupt.astype(int), starts) > 0
    return _Bars(np.stack((place[at], place[at] + aside), axis=1), red, float(tall.max()))


def _draw_bars(axes: Axes, bars: _Bars) -> None:
    """The bars below both ways, the red ones over the others."""
    for chosen, colour, label, order in (
        (~bars.abrupt, style.pale(AFTER, 0.55), f"|δ|, as bars (longest {bars.longest:.2g})", 1.6),
        (bars.abrupt, ABRUPT, "|δ| changes most", 1.8),
    ):
        if chosen.any():
            lines = LineCollection(list(bars.lines[chosen]), colors=colour, linewidths=1.1, zorder=order, label=label)
            axes.add_collection(lines, autolim=False)


def _draw_kinks(axes: Axes, place: Array, abrupt: NDArray[np.bool_], every: int) -> None:
    """The pieces of a winding way at which |delta| changes most, in red on the way itself."""
    steps = np.flatnonzero(abrupt) + 1
    if len(steps):
        pairs = np.stack((place[every * steps], place[every * (steps + 1)]), axis=1)
        lines = LineCollection(list(pairs), colors=ABRUPT, linewidths=3.0, zorder=4.2, label="|δ| changes most")
        axes.add_collection(lines, autolim=False)


def _direction(place: Array, frame_time: float) -> Array:
    """(T,) where the way goes [rad]; where the body stands, as it went or will go."""
    frames = np.arange(len(place))
    reach = max(1, round(_GLANCE / frame_time))
    moved = place[np.minimum(frames + reach, frames[-1])] - place[np.maximum(frames - reach, 0)]
    pace = np.hypot(*moved.T)
    going = pace > _MOVING * pace.max()
    if not going.any():
        return np.zeros(len(place))
    found: Array = np.interp(frames, frames[going], np.unwrap(np.arctan2(moved[going, 0], moved[going, 1])))
    return found


def _draw_constraints(axes: Axes, marks: list[Mark], scale: float) -> None:
    size, reach = (9.0, _ARROW) if len(marks) <= _FEW_MARKS else (4.5, 0.5 * _ARROW)
    kinds = (
        ("wanted place", "x", [place for one, (place, _) in marks if one.place is not None]),
        ("wanted heading", "o", [place for one, (place, yaw) in marks if one.place is None and yaw is not None]),
    )
    for label, marker, places in kinds:
        if places:
            x, z = np.stack(places).T
            (line,) = axes.plot(x, z, marker, color=WANTED, markersize=size, zorder=7, label=label)
            line.set(markerfacecolor="none", markeredgewidth=0.2 * size)
    turned = [(one, (place, yaw)) for one, (place, yaw) in marks if yaw is not None]
    for (_, (place, _)), tip in zip(turned, _tips(turned, reach / scale), strict=True):
        arrow = {"arrowstyle": "-|>", "color": WANTED, "linewidth": 0.17 * size, "shrinkA": 0.0, "shrinkB": 0.0}
        axes.annotate("", tuple(tip), tuple(place), arrowprops=arrow, zorder=7, annotation_clip=False)


def _tips(marks: Sequence[Mark], reach: float) -> Array:
    """(K, 2) where arrows of a length [m] end, of the constraints that ask for a heading."""
    turned = [place + reach * np.array([np.sin(yaw), np.cos(yaw)]) for _, (place, yaw) in marks if yaw is not None]
    return np.array(turned).reshape(-1, 2)


def _timeline(
    axes: Axes, deltas: dict[str, Array], abrupt: NDArray[np.bool_], step: float, wanted: list[float]
) -> None:
    """|delta| of both paths over time. step: seconds; wanted: times of the constraints [s]."""
    style.tidy(axes)
    crowded = len(abrupt) > _MOST_BARS
    for name, colour, width in (("before", BEFORE, 2.4), ("after", AFTER, 1.2)):
        times = step * np.arange(2, len(deltas[name]) + 2)
        axes.plot(times, deltas[name], color=colour, linewidth=0.4 * width if crowded else width, label=name)
    at = np.flatnonzero(abrupt)
    axes.plot(step * (at + 2), deltas["after"][at], ".", color=ABRUPT, markersize=3 if crowded else 6, label="abrupt")
    for time in wanted if len(wanted) <= _FEW_MARKS else []:
        axes.axvline(time, color=WANTED, linewidth=1.0, linestyle=(0, (2, 2)), zorder=1)
    axes.set(
        xlim=(0.0, step * (len(abrupt) + 2.5)), xlabel="time [s]", ylabel=f"|δ| of {1000 * step:.0f} ms steps [m, rad]"
    )
    axes.set_ylim(bottom=0.0)
