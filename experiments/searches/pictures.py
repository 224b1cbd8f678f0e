"""How the methods come down, and how soon they hit their targets."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from experiments.searches.analysis import Clock, Study, priced
from experiments.searches.methods import own, takes_gradients
from experiments.searches.report import clocks_of
from hopdiff.plots import style

FLOOR = 1e-5  # an excess below it is drawn at it
COLUMNS = 4


def looks(study: Study) -> dict[str, dict[str, Any]]:
    """Colour and dashes by method: peers are dashed, and of both kinds those with gradients are thicker."""
    found: dict[str, dict[str, Any]] = {}
    for at, method in enumerate(sorted(study.methods, key=lambda m: not own(m))):
        before = sum(own(m) == own(method) for m in list(found))
        dashes = ("-", "-.") if own(method) else ("--", ":")
        found[method] = {
            "color": style.SERIES[before % len(style.SERIES)],
            "linestyle": dashes[before // len(style.SERIES) % 2],
            "linewidth": 2.0 if takes_gradients(method) else 1.2,
            "zorder": 2 + at / 100,
        }
    return {method: found[method] for method in study.methods}


def ecdf_figure(study: Study, price: float) -> Figure:
    """Share of all (problem, target) pairs reached, over three clocks, with simulated restarts."""
    what = f"{len(study.best)} problem{'s' * (len(study.best) > 1)}"
    figure = style.new_figure(
        14,
        5.2,
        f"Share of targets reached ({what}, targets 100 to 0.01 % above the best known cost)",
    )
    drawn = looks(study)
    for axes, (label, clock) in zip(figure.subplots(1, 3, sharey=True), clocks_of(price).items(), strict=True):
        style.tidy(axes)
        longest = max(study.end(method, clock) for method in drawn)
        for method, look in drawn.items():
            when, share = study.ecdf(method, clock)
            end = study.end(method, clock)
            edge = [10 * longest], [share[-1] if len(share) else 0.0]
            axes.step([*when, *edge[0]], [*share, *edge[1]], where="post", label=method, **look)
            height = share[np.searchsorted(when, end, side="right") - 1] if len(when) and when[0] <= end else 0.0
            axes.plot([end], [height], "x", color=look["color"], markersize=7, markeredgewidth=1.8)
        axes.set(xscale="log", xlabel=label, ylim=(0, 1.02), xlim=(None, 10 * longest))
    figure.axes[0].set_ylabel("share of targets reached; a cross ends the longest run")
    handles = figure.axes[0].get_legend_handles_labels()
    figure.legend(*handles, loc="outside right center", frameon=False, handlelength=3.5)
    return figure


def convergence_figure(study: Study, price: float) -> Figure:
    """Median over the seeds of the excess over the best known cost, with quartiles, a panel a problem."""
    columns = min(COLUMNS, len(study.best))
    rows = math.ceil(len(study.best) / columns)
    figure = style.new_figure(
        max(8.0, 3.3 * columns + 3),
        max(4.2, 2.7 * rows + 1),
        "Excess over the best known cost, median and quartiles over the seeds",
    )
    panels = list(figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False).flat)
    clock, drawn = priced(price), looks(study)
    for axes in panels[len(study.best) :]:
        axes.set_visible(False)
    for axes, case in zip(panels, study.best, strict=False):
        style.tidy(axes).set_title(str(case).removeprefix(f"{case.model}, "), fontsize=9)
        for method, look in drawn.items():
            if not study.of(method, case):
                continue
            grid, curves = _curves(study, method, case, clock)
            low, middle, high = np.quantile(curves, [0.25, 0.5, 0.75], axis=0, method="nearest")
            shown = np.isfinite(high)
            axes.fill_between(grid[shown], low[shown], high[shown], color=look["color"], alpha=0.12, linewidth=0)
            axes.plot(grid, np.where(np.isfinite(middle), middle, np.nan), label=method, **look)
        axes.set(xscale="log", yscale="log", ylim=(FLOOR * 0.8, 3.0))
    for axes in figure.axes:
        axes.label_outer()
    figure.supxlabel(f"evaluations, a gradient as {price:.1f} more")
    figure.supylabel("excess over the best known cost")
    handles = figure.axes[0].get_legend_handles_labels()
    figure.legend(*handles, loc="outside right center", frameon=False, handlelength=3.5)
    return figure


def _curves(study: Study, method: str, case: Any, clock: Clock) -> tuple[np.ndarray, np.ndarray]:
    """A common grid of the clock (M,), and the excess of every seed there (S, M), inf before its first batch."""
    traces = study.of(method, case)
    ends = [clock(trace.points[-1]) for trace in traces]
    grid = np.geomspace(max(1.0, min(clock(trace.points[0]) for trace in traces)), max(ends), 160)
    curves = []
    for trace in traces:
        times = np.array([clock(point) for point in trace.points])
        best = np.array([math.inf, *(study.excess(case, point.best) for point in trace.points)])
        curves.append(best[np.searchsorted(times, grid * (1 + 1e-12), side="right")])
    return grid, np.clip(np.array(curves), FLOOR, None)
