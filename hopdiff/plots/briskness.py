"""What briskness does to several runs."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Collection, Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from hopdiff.plots import style
from hopdiff.plots.series import (
    COLOURS,
    MOST_BANDS,
    colours_of,
    least_width,
    legend_below,
    legend_height,
    spread,
)
from hopdiff.runs.folders import RunRecord
from hopdiff.runs.groups import complete, names_of

MEASURES = (
    ("contact_time", "contact time [s]"),
    ("flight_share", "flight share of a step"),
    ("com_oscillation", "bounce of the centre of mass [m]"),
    ("arm_swing_deg", "arm swing [deg]"),
)
MOST_SPEEDS = 6


def style_figure(records: Sequence[RunRecord]) -> Figure:
    """How contact, flight, bounce and arms change with beta: the median over the runs of each series, all in its band.

    A panel for each number with a line for each series, or for each speed where there is but one series. With several
    of both a row for each number, a column for each speed (of more than six those spread over all). Interrupted
    searches are left out.
    """
    finished = complete(records)
    by_speed = {
        speed: [record for record in finished if record.metrics["speed"] == speed]
        for speed in sorted({record.metrics["speed"] for record in finished})
    }
    if len(by_speed) == 1:
        return _panels(_by_series(finished), colours_of(records), f" at {next(iter(by_speed)):g} m/s")
    if len(names_of(finished)) > 1:
        return _columns(by_speed, colours_of(records))
    shown = spread(list(by_speed), len(COLOURS))
    lines = {f"{speed:g} m/s": by_speed[speed] for speed in shown}
    return _panels(lines, dict(zip(lines, COLOURS, strict=False)), _of(shown, by_speed))


def _by_series(records: Sequence[RunRecord]) -> dict[str, list[RunRecord]]:
    return {name: [record for record in records if record.series.name == name] for name in names_of(records)}


def _of(shown: Sequence[float], known: Collection[float]) -> str:
    return f" ({len(shown)} of {len(known)} speeds)" if len(shown) < len(known) else ""


def _panels(lines: Mapping[str, Sequence[RunRecord]], colours: Mapping[str, str], more: str) -> Figure:
    """A panel for each number. lines: the runs of each, by name."""
    names = list(lines)
    width = max(10.0, least_width(names))
    figure = style.new_figure(width, 6.6 + legend_height(names, width), f"What briskness does{more}")
    for axes, (measure, label) in zip(figure.subplots(2, 2).flat, MEASURES, strict=True):
        for name, records in lines.items():
            _line(axes, records, measure, colours[name], name, len(lines) <= MOST_BANDS)
        axes.set_xlabel("beta")
        axes.set_ylabel(label)
        style.tidy(axes)
    legend_below(figure, {name: {"color": colours[name]} for name in names}, marker="o")
    return figure


def _columns(by_speed: Mapping[float, Sequence[RunRecord]], colours: Mapping[str, str]) -> Figure:
    """A row for each number, a column for each speed."""
    shown = spread(list(by_speed), MOST_SPEEDS)
    names = names_of(record for speed in shown for record in by_speed[speed])
    width = max(3.2 * len(shown) + 1.2, least_width(names))
    height = 2.1 * len(MEASURES) + 0.9 + legend_height(names, width)
    figure = style.new_figure(width, height, f"What briskness does{_of(shown, by_speed)}")
    panels = figure.subplots(len(MEASURES), len(shown), sharex=True, sharey="row", squeeze=False)
    for row, (measure, label) in zip(panels, MEASURES, strict=True):
        for axes, speed in zip(row, shown, strict=True):
            lines = _by_series(by_speed[speed])
            for name, records in lines.items():
                _line(axes, records, measure, colours[name], name, len(lines) <= MOST_BANDS)
            style.tidy(axes)
        row[0].set_ylabel(label.replace(" of the centre of mass", "").replace(" of a step", ""))
    for axes, speed in zip(panels[0], shown, strict=True):
        axes.set_title(f"{speed:g} m/s")
    for axes in panels[-1]:
        axes.set_xlabel("beta")
    legend_below(figure, {name: {"color": colours[name]} for name in names}, marker="o")
    return figure


def _line(axes: Axes, records: Sequence[RunRecord], measure: str, colour: str, label: str, band: bool) -> None:
    """The median over the runs at each beta, and if asked for the band from the least to the greatest."""
    groups = defaultdict(list)
    for record in records:
        if record.metrics.get(measure) is not None:
            groups[record.metrics["beta"]].append(record.metrics[measure])
    betas = sorted(groups)
    if not betas:
        return
    axes.plot(betas, [np.median(groups[beta]) for beta in betas], "o-", color=colour, label=label, markersize=4)
    if band and any(len(values) > 1 for values in groups.values()):
        low, high = ([find(groups[beta]) for beta in betas] for find in (min, max))
        axes.fill_between(betas, low, high, color=colour, alpha=0.15, linewidth=0)
