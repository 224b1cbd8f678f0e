"""How feet slide and how high they are, before an edit, after it, and after the clean-up."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import ArrayLike, NDArray
from torch import Tensor

from hopdiff.geometry.joint_names import side_of
from hopdiff.plots import style
from hopdiff.plots.view import Array, numbers
from hopdiff.types import HopdiffError

# Colours and widths of the stages; the first is drawn widest, so that it shows below the others.
STAGES = {
    "source": (style.pale(style.GROUND, 0.2), 3.0),
    "edited": (style.SERIES[3], 1.5),
    "cleaned": (style.SERIES[2], 1.5),
}
_OTHERS = ((style.SERIES[4], 1.5), (style.SERIES[6], 1.5), (style.SERIES[5], 1.5))
_FASTEST = 0.5  # m/s at the top of the panels, at least: slide is to be seen, a swinging foot leaves them
_OVER = 1.5  # times the largest mean in contact that the panels reach
_HIGHEST = 20.0  # cm
_LONG = 15.0  # seconds; of longer clips only what feet do on the ground is drawn
_WIDTH, _WIDEST, _PER_SECOND = 11.0, 24.0, 0.4  # inches
_SPEED, _HEIGHT, _REST = 1.35, 0.7, 1.3  # inches of a panel, of the one below it, and of what is around all
_SLOT = 1.35  # inches for a number over a panel


def feet_figure(
    times: Tensor | ArrayLike,
    names: Sequence[str],
    contact: Tensor | ArrayLike,
    speeds: Mapping[str, Tensor | ArrayLike],
    heights: Mapping[str, Tensor | ArrayLike],
    title: str = "",
) -> Figure:
    """Horizontal speed and height of points of the feet over time, a pair of panels for each point.

    times: (T,) [s]. names: P points; left ones are tinted blue, right ones orange. contact: (T, P) whether a point
    should stand still, shaded. speeds: by stage ("source", "edited", "cleaned", or others) (T, P) [m/s]. heights: by
    stage (T, P) [m]. Over each panel stands the mean speed in contact. Speeds above 0.5 m/s and far above this mean,
    and heights above 0.2 m, leave the panels; of clips longer than 15 s only contacts are drawn.
    Raises HopdiffError for arrays whose sizes do not fit each other.
    """
    at, touching = numbers(times), numbers(contact) > 0.5
    shape = (len(at), len(names))
    fast = {stage: numbers(values) for stage, values in speeds.items()}
    high = {stage: 100.0 * numbers(values) for stage, values in heights.items()}
    _check(shape, {"contact": touching, **{f"speeds of {stage}": values for stage, values in fast.items()}})
    _check(shape, {f"heights of {stage}": values for stage, values in high.items()})
    duration = float(at[-1] - at[0])
    whole = duration <= _LONG
    width = float(np.clip(_PER_SECOND * duration, _WIDTH, _WIDEST))
    height = (_SPEED + _HEIGHT + 0.35) * shape[1] + _REST
    figure = style.new_figure(width, height, title or "Feet: speed over the ground, and height")
    panels = figure.subplots(2 * shape[1], 1, sharex=True, squeeze=False, height_ratios=[_SPEED, _HEIGHT] * shape[1])
    stages = [*fast, *(stage for stage in high if stage not in fast)]
    inks = _inks(stages)
    for point, name in enumerate(names):
        touches = touching[:, point]
        spans = contact_spans(at, touches)
        pair = (
            (fast, _top({stage: values[:, point] for stage, values in fast.items()}, touches), "speed [m/s]"),
            (high, _HIGHEST, "height\n[cm]"),
        )
        for axes, (tracks, top, label) in zip(panels[2 * point : 2 * point + 2, 0], pair, strict=True):
            own = {stage: values[:, point] for stage, values in tracks.items()}
            style.tidy(axes)
            _shade(axes, spans, side_of(name))
            for stage, values in own.items():
                colour, thick = inks[stage]
                shown = values if whole else np.where(touches, values, np.nan)
                axes.plot(at, shown, color=colour, linewidth=thick if whole else 0.6 * thick, label=stage)
            axes.set(xlim=(at[0], at[-1]), ylim=(_bottom(own, touches), top), ylabel=label)
            if tracks is fast:
                axes.set_title(name, loc="left", fontsize=10, fontweight="bold", color=style.INK)
                _means(axes, own, touches, inks)
    panels[-1, 0].set_xlabel("time [s]")
    handles, labels = panels[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=len(labels), frameon=False, fontsize=9)
    return figure


def contact_spans(times: Array, touching: NDArray[np.bool_]) -> list[tuple[float, float]]:
    """From when to when a point touches the ground [s], half a frame before and after; times, touching: (T,)."""
    edges = np.diff(np.concatenate(([0], touching.astype(int), [0])))
    half = 0.5 * (times[-1] - times[0]) / max(len(times) - 1, 1)
    starts, ends = np.flatnonzero(edges > 0), np.flatnonzero(edges < 0) - 1
    return [(float(times[a] - half), float(times[b] + half)) for a, b in zip(starts, ends, strict=True)]


def _check(shape: tuple[int, int], arrays: Mapping[str, NDArray[np.generic]]) -> None:
    if shape[0] < 2 or shape[1] < 1:
        raise HopdiffError(f"a picture of feet needs at least 2 frames and 1 point, not {shape[0]} and {shape[1]}.")
    for name, values in arrays.items():
        if values.shape != shape:
            raise HopdiffError(
                f"{name} must be numbers of {shape[0]} frames and {shape[1]} points, not {values.shape}."
            )


def _inks(stages: Sequence[str]) -> dict[str, tuple[str, float]]:
    """Colour and width of each stage's line."""
    others = [stage for stage in stages if stage not in STAGES]
    return STAGES | {stage: _OTHERS[place % len(_OTHERS)] for place, stage in enumerate(others)}


def _shade(axes: Axes, spans: list[tuple[float, float]], side: str) -> None:
    colour = style.pale(style.SIDE_COLOURS[side], 0.88)
    pieces = [(start, end - start) for start, end in spans]
    # One collection: a long clip has hundreds of contacts.
    axes.broken_barh(pieces, (0, 1), transform=axes.get_xaxis_transform(), facecolors=colour, linewidth=0, zorder=0)


def _top(speeds: Mapping[str, Array], touching: NDArray[np.bool_]) -> float:
    """Where a panel of speeds ends above: over what feet in contact do on the average [m/s]."""
    means = [float(values[touching].mean()) for values in speeds.values()] if touching.any() else []
    return max([_FASTEST, *(_OVER * mean for mean in means)])


def _bottom(tracks: Mapping[str, Array], touching: NDArray[np.bool_]) -> float:
    """Where a panel ends below: at zero, or under the lowest that a point gets in contact."""
    lowest = min((float(values[touching].min()) for values in tracks.values() if touching.any()), default=0.0)
    return 0.0 if lowest >= 0.0 else lowest - 1.0


def _means(
    axes: Axes, speeds: Mapping[str, Array], touching: NDArray[np.bool_], inks: Mapping[str, tuple[str, float]]
) -> None:
    """Mean speed in contact of every stage, over the right end of its panel."""
    if not touching.any():
        texts = [("never in contact", style.GROUND)]
    else:
        texts = [(f"{stage} {values[touching].mean():.3f} m/s", inks[stage][0]) for stage, values in speeds.items()]
        texts.insert(0, ("mean in contact:", style.GROUND))
    for place, (text, colour) in enumerate(reversed(texts)):
        axes.annotate(
            text,
            (1.0, 1.0),
            (-72 * _SLOT * place, 4.0),
            xycoords="axes fraction",
            textcoords="offset points",
            ha="right",
            fontsize=9,
            color=style.mix(colour, "#000000", 0.25),
        )
