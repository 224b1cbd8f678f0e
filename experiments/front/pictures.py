"""Fronts from three sides, and how soon they were known."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.figure import Figure

from experiments.front.objectives import TITLES
from hopdiff.plots import style

PAIRS = ((0, 1), (0, 2), (2, 1))
MARKS = ("o", "^", "s")


def fronts_figure(
    fronts: Mapping[str, np.ndarray],
    chosen: Mapping[str, np.ndarray],
    courses: Mapping[str, Sequence[tuple[int, int, float, float]]],
    price: float,
    title: str,
) -> Figure:
    """fronts: values (n, 3) by method. chosen: values (3,) of the runs of the table, by name. courses: of the
    hypervolume, see `population.course`."""
    figure = style.new_figure(15, 9, title)
    panels = figure.subplots(2, 3)
    drawn = {name: (style.SERIES[at], MARKS[at]) for at, name in enumerate(fronts)}
    for axes, (x, y) in zip(panels[0], PAIRS, strict=True):
        style.tidy(axes)
        for name, values in fronts.items():
            colour, mark = drawn[name]
            axes.scatter(
                values[:, x], values[:, y], s=14, color=colour, marker=mark, alpha=0.7, label=name, linewidth=0
            )
        for at, values in enumerate(chosen.values()):
            axes.plot(values[x], values[y], "*", color=style.INK, markersize=13, markeredgecolor="white")
            axes.annotate(str(at + 1), (values[x], values[y]), (7, 5), textcoords="offset points", fontweight="bold")
        axes.set(xlabel=TITLES[x], ylabel=TITLES[y], xscale="log" if x == 1 else "linear")
        axes.set_yscale("log" if y == 1 else "linear")
    clocks = (
        (f"evaluations, a gradient as {price:.1f} more", lambda row: row[0] + price * row[1]),
        ("seconds of one core", lambda row: row[2]),
    )
    for axes, (label, clock) in zip(panels[1], clocks, strict=False):
        style.tidy(axes)
        for name, rows in courses.items():
            axes.plot(
                [clock(row) for row in rows], [row[3] for row in rows], color=drawn[name][0], label=name, linewidth=2
            )
        axes.set(xscale="log", xlabel=label, ylabel="hypervolume of all that is known", ylim=(0, None))
    panels[1][2].axis("off")
    handles = panels[0][0].get_legend_handles_labels()
    panels[1][2].legend(*handles, loc="upper left", frameon=False, fontsize=11, markerscale=2)
    names = "\n".join(f"{at + 1}  {name.replace('_', ' ')}" for at, name in enumerate(chosen))
    panels[1][2].text(0.03, 0.55, f"Stars, the runs of the table:\n{names}", va="top", fontsize=11, color=style.INK)
    return figure
