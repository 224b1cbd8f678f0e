"""Slices, planes, slopes, distances and curvature, drawn."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure

from experiments.landscape.measure import Curvature, Ends, Plane, Slopes, distance
from hopdiff.plots import style

FLOOR = 1e-5  # an excess below it is drawn at it
CEILING = 10.0


def lines_figure(title: str, names: Sequence[str], best: np.ndarray, at: np.ndarray, costs: np.ndarray) -> Figure:
    """Excess along each gene through the best run, a panel a gene; gaps are impossible runs."""
    columns = 8
    rows = math.ceil(len(names) / columns)
    figure = style.new_figure(15, 1.5 * rows + 1, title)
    low = np.nanmin(costs)
    panels = list(figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False).flat)
    for axes in panels[len(names) :]:
        axes.set_visible(False)
    for axes, name, place, grid, cost in zip(panels, names, best, at, costs, strict=False):
        style.tidy(axes).set_title(name.replace("_", " "), fontsize=7.5)
        shown = np.where(np.isfinite(cost), np.maximum((cost - low) / abs(low), FLOOR), np.nan)
        axes.plot(grid, shown, color=style.LEFT, linewidth=1.4)
        axes.fill_between(grid, FLOOR, CEILING, where=~np.isfinite(cost), color=style.FAINT, linewidth=0)
        axes.axvline(place, color=style.RIGHT, linewidth=0.9, linestyle=":")
        axes.set(yscale="log", ylim=(FLOOR, CEILING), xlim=(0, 1), xticks=[0, 0.5, 1])
        axes.tick_params(labelsize=7)
        axes.label_outer()
    figure.supxlabel("gene, over its box; dotted: the best run; grey: no possible run", fontsize=9)
    figure.supylabel("cost above the best, relative", fontsize=9)
    return figure


def planes_figure(found: Mapping[str, Plane], best: Mapping[str, float]) -> Figure:
    """Excess over the plane through three ends of descents."""
    figure = style.new_figure(
        4.4 * len(found) + 1.2, 4.6, "Cost over the plane through three ends of descents, clipped to the box"
    )
    panels = figure.subplots(1, len(found), squeeze=False)[0]
    image = None
    for axes, (title, plane) in zip(panels, found.items(), strict=True):
        style.tidy(axes, grid=False).set_title(title)
        axes.set_facecolor("white")
        excess = np.clip((plane.merit - best[title]) / abs(best[title]), 1e-3, 1e2)
        shown = np.ma.masked_invalid(excess)
        image = axes.pcolormesh(plane.x, plane.y, shown, norm=LogNorm(1e-3, 1e2), cmap="viridis", shading="nearest")
        impossible = np.isinf(plane.cost).astype(float)
        axes.contourf(plane.x, plane.y, impossible, levels=[0.5, 1.5], colors="none", hatches=["////"])
        for name, corner in zip("ABC", plane.corners, strict=True):
            axes.plot(*corner, "o", color="white", markeredgecolor=style.INK)
            axes.annotate(name, corner, (5, 5), textcoords="offset points", color="white", fontweight="bold")
        axes.set(xlabel="box widths, RMS over the genes", aspect="equal")
    figure.colorbar(image, ax=list(panels), label="merit above the best; hatched: impossible", shrink=0.9)
    return figure


def slopes_figure(found: Mapping[str, Mapping[str, Slopes]]) -> Figure:
    """How far gradients point away from central differences, a panel a problem."""
    figure = style.new_figure(
        4.4 * len(found) + 0.6, 4.2, "Gradient against central differences: share of points by 1 - cosine"
    )
    edges = np.geomspace(1e-14, 2.0, 43)
    for axes, (title, kinds) in zip(figure.subplots(1, len(found), squeeze=False)[0], found.items(), strict=True):
        style.tidy(axes).set_title(title)
        for colour, (name, slopes) in zip(style.SERIES, kinds.items(), strict=False):
            there = slopes.cosine[np.isfinite(slopes.cosine)]
            label = f"{name} ({len(there)} of {len(slopes.cosine)})"
            shares = np.full(len(there), 1 / max(len(slopes.cosine), 1))
            values = np.clip(1 - there, edges[0], None)
            axes.hist(values, edges, weights=shares, color=colour, alpha=0.55, label=label)
        axes.axvline(1.0, color=style.INK, linewidth=0.9, linestyle=":")
        axes.annotate("at right angles", (1.0, 0.98), (-3, 0), ("data", "axes fraction"), "offset points", rotation=90,
                      ha="right", va="top", fontsize=8)  # fmt: skip
        axes.set(xscale="log", xlabel="1 - cosine", ylabel="share of points")
        axes.set_ylim(0, 1.35 * max(axes.get_ylim()[1], 0.1))  # room for the names
        axes.legend(frameon=False, fontsize=8, loc="upper center")
    return figure


def ends_figure(found: Mapping[str, tuple[Ends, np.ndarray]]) -> Figure:
    """Where descents end: cost over the distance from the best, coloured by group."""
    figure = style.new_figure(4.4 * len(found) + 0.6, 4.2, "Ends of descents: cost over distance from the best end")
    for axes, (title, (ends, groups)) in zip(
        figure.subplots(1, len(found), squeeze=False)[0], found.items(), strict=True
    ):
        style.tidy(axes).set_title(title)
        good = np.isfinite(ends.cost)
        excess = np.maximum((ends.cost - ends.cost[0]) / abs(ends.cost[0]), FLOOR)
        away = distance(ends.genes, ends.genes[0])
        for near, marker, label in ((True, "o", "from about the start"), (False, "^", "from anywhere in the box")):
            shown = good & (ends.near == near)
            colours = [style.SERIES[group % len(style.SERIES)] for group in groups[shown[: len(groups)].nonzero()[0]]]
            axes.scatter(away[shown], excess[shown], c=colours, marker=marker, s=36, label=label, edgecolors="white")
        for level in (0.001, 0.01):
            axes.axhline(level, color=style.GROUND, linewidth=0.8, linestyle="--")
        axes.set(yscale="log", ylim=(FLOOR * 0.7, CEILING), xlabel="box widths, RMS over the genes")
        axes.set_ylabel("cost above the best, relative")
        axes.legend(frameon=False, fontsize=8, loc="lower right")
    return figure


def spectrum_figure(found: Mapping[str, Curvature], rise: float) -> Figure:
    """Eigenvalues of the Hessian at the best run, and how far its directions go at nearly equal cost."""
    figure = style.new_figure(11, 4.4, "Curvature at the best run, direction by direction")
    left, right = figure.subplots(1, 2)
    for colour, (title, curve) in zip(style.SERIES, found.items(), strict=False):
        number = np.arange(1, len(curve.values) + 1)
        positive = curve.values > 0
        left.plot(number[positive], curve.values[positive], "o-", color=colour, markersize=3, label=title)
        right.plot(number, np.maximum(curve.reach, 1e-5), "o-", color=colour, markersize=3, label=f"{title}, walked")
        right.plot(number, np.minimum(curve.told, 3.0), ":", color=colour, label="by its eigenvalue")
    style.tidy(left).set(yscale="log", xlabel="direction", ylabel="eigenvalue over cost, per box width squared")
    style.tidy(right).set(yscale="log", xlabel="direction", ylabel="box widths, RMS over the genes")
    right.set_title(f"how far the cost stays within {100 * rise:g} %")
    left.legend(frameon=False, fontsize=8)
    right.legend(frameon=False, fontsize=8)
    return figure
