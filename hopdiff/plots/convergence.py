"""How a search came to its result."""

from __future__ import annotations

import math
from collections.abc import Sequence

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullLocator

from hopdiff.plots import style
from hopdiff.search.loop import HistoryRow


def convergence_figure(history: Sequence[HistoryRow], title: str = "Search") -> Figure:
    """Best and median cost of every step, and gamma and energy of the best, against what had been spent by then.

    history: rows in order; values that are not finite leave a gap.
    """
    figure = style.new_figure(9.0, 6.5, title)
    upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=(3, 2))
    spent = [row.spent for row in history]
    best = [_or_gap(row.best) for row in history]
    _curve(upper, spent, [_or_gap(row.median) for row in history], "median of the step", style.GROUND)
    _curve(upper, spent, best, "best so far", style.SERIES[0])
    finite = [value for value in best if not math.isnan(value)]
    if finite and min(finite) > 0:
        upper.set_yscale("log")
        # The median of a young population is far off: the best deserves the height.
        upper.set_ylim(0.9 * min(finite), max(10 * min(finite), 1.5 * max(finite)))
        upper.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        upper.yaxis.set_major_formatter("{x:g}")
        upper.yaxis.set_minor_locator(NullLocator())
    upper.set_ylabel("cost")
    upper.legend(frameon=False, fontsize=9)
    _curve(lower, spent, [_or_gap(row.gamma) for row in history], "gamma", style.SERIES[1])
    _curve(lower, spent, [_or_gap(row.energy) for row in history], "energy rate, scaled", style.SERIES[2])
    lower.set_ylabel("of the best")
    lower.set_xlabel("evaluations (a gradient counts as several)")
    lower.legend(frameon=False, fontsize=9)
    for axes in (upper, lower):
        style.tidy(axes)
    return figure


def _curve(axes: Axes, x: Sequence[float], y: Sequence[float], label: str, colour: str) -> None:
    axes.plot(x, y, color=colour, linewidth=1.8, label=label, marker="o" if len(x) == 1 else None, markersize=4)


def _or_gap(value: float) -> float:
    return value if math.isfinite(value) else math.nan
