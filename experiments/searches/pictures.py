"""How the searches come down, and how soon they hit their targets."""

from __future__ import annotations

import math

import numpy as np
from matplotlib.figure import Figure

from experiments.searches.analysis import Clock, Study, priced, seconds
from experiments.searches.bench import Case
from hopdiff.plots import style

FLOOR = 1e-4  # an excess below it is drawn at it


def ecdf_figure(study: Study, price: float) -> Figure:
    """Share of all targets hit, over three clocks."""
    figure = style.new_figure(
        13, 4.6, "Share of targets reached (all problems, seeds, targets 100 to 0.1 % above the best known cost)"
    )
    clocks = {
        f"evaluations, a gradient as {price:.1f} more": priced(price),
        "evaluations, a gradient as 1 more": priced(1.0),
        "seconds of one core": seconds,
    }
    for axes, (label, clock) in zip(figure.subplots(1, 3, sharey=True), clocks.items(), strict=True):
        style.tidy(axes)
        for colour, search in zip(style.SERIES, study.searches, strict=False):
            when, share = study.ecdf(search, clock)
            end = max(clock(trace.points[-1]) for trace in study.of(search))
            axes.step([*when, end], [*share, share[-1] if share else 0.0], where="post", color=colour, label=search)
        axes.set(xscale="log", xlabel=label, ylim=(0, 1.02))
    figure.axes[0].set_ylabel("share of targets reached")
    figure.legend(*figure.axes[0].get_legend_handles_labels(), loc="outside right center", frameon=False)
    return figure


def convergence_figure(study: Study, price: float) -> Figure:
    """Median and quartiles over the seeds of the excess over the best known cost, a panel a problem."""
    columns = 3
    rows = math.ceil(len(study.best) / columns)
    figure = style.new_figure(
        12, 3.2 * rows + 0.8, "Excess over the best known cost, median and quartiles over the seeds"
    )
    panels = list(figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False).flat)
    clock = priced(price)
    for axes in panels[len(study.best) :]:
        axes.set_visible(False)
    for axes, case in zip(panels, study.best, strict=False):
        style.tidy(axes).set_title(str(case))
        for colour, search in zip(style.SERIES, study.searches, strict=False):
            grid, curves = _curves(study, search, case, clock)
            low, middle, high = np.percentile(curves, [25, 50, 75], axis=0)
            axes.fill_between(grid, low, high, color=colour, alpha=0.2, linewidth=0)
            axes.plot(grid, middle, color=colour, linewidth=1.6, label=search)
        axes.set(xscale="log", yscale="log", ylim=(FLOOR * 0.8, 3.0))
    for axes in figure.axes:
        axes.label_outer()
    figure.supxlabel(f"evaluations, a gradient as {price:.1f} more")
    figure.supylabel("excess over the best known cost")
    figure.legend(*figure.axes[0].get_legend_handles_labels(), loc="outside right center", frameon=False)
    return figure


def _curves(study: Study, search: str, case: Case, clock: Clock) -> tuple[np.ndarray, np.ndarray]:
    """A common grid of the clock (M,), and the excess of every seed there (S, M)."""
    traces = study.of(search, case)
    end = min(clock(trace.points[-1]) for trace in traces)
    grid = np.geomspace(max(clock(trace.points[0]) for trace in traces), end, 160)
    curves = []
    for trace in traces:
        times = np.array([clock(point) for point in trace.points])
        best = np.array([study.excess(case, point.best) for point in trace.points])
        curves.append(best[np.searchsorted(times, grid * (1 + 1e-12), side="right") - 1])
    return grid, np.clip(np.array(curves), FLOOR, None)
