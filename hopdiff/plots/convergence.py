"""How a search came to its result."""

from __future__ import annotations

import math
from collections.abc import Sequence

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter, NullLocator

from hopdiff.plots import style
from hopdiff.search.loop import HistoryRow

_LEAST_ENERGY = 0.2  # of the energy axis: what hardly changes shall look so
_LEAST_GAMMA = 0.5
_LEAST_RATIO = 3.0  # of the ends of the cost axis
_TICKS, _FINE_TICKS = (1.0, 2.0, 5.0), (1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 7.0)
_NARROW = 6.0  # ratio of its ends, up to which the cost axis gets the fine ticks
_FEW = 60  # steps, up to which the median of each gets a dot
_TARGET = style.SERIES[6]


def convergence_figure(history: Sequence[HistoryRow], title: str = "Search", target: float | None = None) -> Figure:
    """What the best run so far costs, its energy and, where the model knows it, its gamma, against what was spent.

    The best so far stays until a step ends with a better one, so its lines are stairs; they end in a dot. Grey dots
    are the medians of the costs of each step, and a triangle at the upper edge is one that lies beyond it.
    history: rows in order; values that are not finite leave a gap. target: the energy that beta asks for, dashed.
    """
    gammas = [_or_gap(row.gamma) for row in history]
    with_gamma = not all(map(math.isnan, gammas))
    ratios = (3, 2, 1.4) if with_gamma else (3, 2)
    figure = style.new_figure(9.0, 1.2 * sum(ratios) + 0.9, title)
    panels = list(figure.subplots(len(ratios), 1, sharex=True, height_ratios=ratios))
    spent = [row.spent for row in history]
    _costs(panels[0], spent, [_or_gap(row.best) for row in history], [_or_gap(row.median) for row in history])
    _energy(panels[1], spent, [_or_gap(row.energy) for row in history], target)
    if with_gamma:
        _stairs(panels[2], spent, gammas, "of the best", style.SERIES[1])
        _limits(panels[2], gammas, _LEAST_GAMMA)
        panels[2].set_ylabel("gamma of the best")
    panels[-1].set_xlabel("spent, in evaluations of one candidate (a gradient counts as several)")
    panels[-1].set_xlim(0.0, 1.02 * max(spent, default=1.0))
    for axes in panels:
        style.tidy(axes)
    figure.align_ylabels()
    return figure


def _costs(axes: Axes, spent: list[float], best: list[float], median: list[float]) -> None:
    finite = [value for value in best if not math.isnan(value)]
    few = len(spent) <= _FEW
    axes.plot(
        spent,
        median,
        "o" if few else "-",
        color=style.pale(style.GROUND, 0.2),
        markersize=4,
        linewidth=1.0,
        label="median of the step",
        zorder=2,
    )
    _stairs(axes, spent, best, "best so far", style.SERIES[0])
    if finite and min(finite) > 0:
        axes.set_yscale("log")
        # The median of a young population is far off: the best deserves the height.
        low, top = 0.9 * min(finite), max(_LEAST_RATIO * min(finite), 1.5 * max(finite))
        near = [value for value in median if value <= 3.0 * top]
        top = max([top, *(1.1 * value for value in near)])
        axes.set_ylim(low, top)
        axes.yaxis.set_major_locator(LogLocator(subs=_TICKS if top > _NARROW * low else _FINE_TICKS))
        axes.yaxis.set_major_formatter("{x:g}")
        axes.yaxis.set_minor_locator(NullLocator())
        axes.yaxis.set_minor_formatter(NullFormatter())
        beyond = [x for x, value in zip(spent, median, strict=True) if value > top]
        if beyond and few:
            place = axes.get_xaxis_transform()
            axes.plot(
                beyond,
                [0.985] * len(beyond),
                "^",
                color=style.GROUND,
                markersize=5,
                transform=place,
                label="median beyond the axis",
            )
    axes.set_ylabel("cost")
    axes.legend(frameon=False, fontsize=9, loc="upper right")


def _energy(axes: Axes, spent: list[float], energy: list[float], target: float | None) -> None:
    _stairs(axes, spent, energy, "of the best", style.SERIES[2])
    if target is not None:
        axes.axhline(
            target, color=_TARGET, linewidth=1.4, linestyle=(0, (5, 3)), label=f"asked for by beta: {target:.3f}"
        )
    _limits(axes, [*energy, *([] if target is None else [target])], _LEAST_ENERGY)
    axes.set_ylabel("energy per distance, scaled")
    axes.legend(frameon=False, fontsize=9, loc="best")


def _stairs(axes: Axes, x: list[float], y: list[float], label: str, colour: str) -> None:
    axes.plot(
        x, y, "-o", color=colour, linewidth=1.8, label=label, drawstyle="steps-post", markersize=5, markevery=[-1]
    )


def _limits(axes: Axes, values: list[float], least: float) -> None:
    known = [value for value in values if math.isfinite(value)]
    if known:
        axes.set_ylim(*style.widened(min(known), max(known), least))


def _or_gap(value: float) -> float:
    return value if math.isfinite(value) else math.nan
