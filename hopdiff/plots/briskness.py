"""What briskness does to several runs."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from hopdiff.plots import style
from hopdiff.plots.series import (
    COLOURS,
    colours_of,
    complete,
    least_width,
    legend_below,
    legend_height,
    names_of,
    spread,
)
from hopdiff.runs.folders import RunRecord

MEASURES = (
    ("contact_time", "contact time [s]"),
    ("flight_share", "flight share of a step"),
    ("com_oscillation", "bounce of the centre of mass [m]"),
    ("arm_swing_deg", "arm swing [deg]"),
)
MOST_SPEEDS = 6


def style_figure(records: Sequence[RunRecord]) -> Figure:
    """How contact, flight, bounce and arms change with beta: the median of each series' runs, with all in its band.

    Of one series a panel for each number and a line for each speed; of several a row for each number, a column for each
    speed (of more than six those spread over all), and a line for each series. Interrupted searches are left out.
    """
    finished = complete(records)
    speeds = sorted({record.metrics["speed"] for record in finished})
    if len(names_of(records)) == 1:
        return _of_one(finished, spread(speeds, len(COLOURS)))
    drawn = spread(speeds, MOST_SPEEDS)
    colours = colours_of(records)
    width = max(3.2 * len(drawn) + 1.2, 6.0, least_width(list(colours)))
    title = "What briskness does" + (f" ({len(drawn)} of {len(speeds)} speeds)" if drawn != speeds else "")
    figure = style.new_figure(width, 2.1 * len(MEASURES) + 0.9 + legend_height(list(colours), width), title)
    panels = figure.subplots(len(MEASURES), len(drawn), sharex=True, sharey="row", squeeze=False)
    for row, (measure, label) in zip(panels, MEASURES, strict=True):
        for axes, speed in zip(row, drawn, strict=True):
            here = [record for record in finished if record.metrics["speed"] == speed]
            for name, colour in colours.items():
                _line(axes, [record for record in here if record.series.name == name], measure, colour, name)
            style.tidy(axes)
        row[0].set_ylabel(label.replace(" of the centre of mass", "").replace(" of a step", ""))
    for axes, speed in zip(panels[0], drawn, strict=True):
        axes.set_title(f"{speed:g} m/s")
    for axes in panels[-1]:
        axes.set_xlabel("beta")
    legend_below(figure, {name: {"color": colour} for name, colour in colours.items()}, marker="o")
    return figure


def _of_one(records: Sequence[RunRecord], speeds: Sequence[float]) -> Figure:
    colours = {f"{speed:g} m/s": COLOURS[i] for i, speed in enumerate(speeds)}
    figure = style.new_figure(10.0, 6.6 + legend_height(list(colours), 10.0), "What briskness does")
    for axes, (measure, label) in zip(figure.subplots(2, 2).flat, MEASURES, strict=True):
        for speed, (name, colour) in zip(speeds, colours.items(), strict=True):
            here = [record for record in records if record.metrics["speed"] == speed]
            _line(axes, here, measure, colour, name)
        axes.set_xlabel("beta")
        axes.set_ylabel(label)
        style.tidy(axes)
    legend_below(figure, {name: {"color": colour} for name, colour in colours.items()}, marker="o")
    return figure


def _line(axes: Axes, records: Sequence[RunRecord], measure: str, colour: str, label: str) -> None:
    """The median over the runs at each beta, and the band from the least to the greatest."""
    groups = defaultdict(list)
    for record in records:
        if record.metrics.get(measure) is not None:
            groups[record.metrics["beta"]].append(record.metrics[measure])
    betas = sorted(groups)
    if not betas:
        return
    axes.plot(betas, [np.median(groups[beta]) for beta in betas], "o-", color=colour, label=label, markersize=4)
    if any(len(values) > 1 for values in groups.values()):
        low, high = ([find(groups[beta]) for beta in betas] for find in (min, max))
        axes.fill_between(betas, low, high, color=colour, alpha=0.15, linewidth=0)
