"""The curves of runs over those of people, and what briskness does."""

from __future__ import annotations

from collections.abc import Sequence
from statistics import median

import numpy as np
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.pyplot import get_cmap

from experiments.realism.measure import CURVES
from experiments.realism.people import POINTS, SPEEDS, curve
from experiments.realism.runs import CAPTURED, Entry, by_costs
from experiments.realism.tables import ORDINARY
from hopdiff.plots import style

TITLES = {"thigh": "thigh [deg]", "knee": "knee flexion [deg]", "ankle": "ankle [deg]", "foot": "foot pitch [deg]"}
PANELS = {
    "bounce": "bounce of the centre of mass [m]",
    "flight_share": "flight share of a step",
    "contact_time": "contact time [s]",
    "arm_swing": "arm swing, range [deg]",
}
DASHES = ("-", "--", ":", "-.")  # one for each setting of the costs


def curves_figure(entries: Sequence[Entry]) -> Figure:
    """People in black, ordinary runs in a colour for each setting of the costs, captured strides at the speed of
    people's that is nearest to theirs in grey; left touchdown at 0 %."""
    figure = style.new_figure(11, 10, f"Ordinary runs (beta {ORDINARY:g}) over the mean stride of people")
    panels = figure.subplots(len(CURVES), len(SPEEDS), sharex=True, sharey="row", squeeze=False)
    percent = 100 * np.arange(POINTS + 1) / POINTS
    colours = dict(zip(dict.fromkeys(costs for costs, _ in by_costs(entries)), style.SERIES, strict=False))
    for column, speed in enumerate(SPEEDS):
        for line, name in enumerate(CURVES):
            axes = style.tidy(panels[line][column])
            for one in entries:
                if not len(one.curves[name]) or _panel(one) != speed:
                    continue
                values = one.curves[name][:: len(one.curves[name]) // POINTS]
                look = {"color": style.GROUND, "lw": 1.0, "ls": "--", "label": "captured strides"}
                if one.costs != CAPTURED:
                    look = {"color": colours[one.costs], "lw": 1.6, "label": f"costs={one.costs}"}
                axes.plot(percent, np.append(values, values[0]), **look)
            people = curve(name, speed)
            axes.plot(percent, np.append(people, people[0]), color="black", lw=2.2, label="people", zorder=3)
            if column == 0:
                axes.set_ylabel(TITLES[name])
        panels[0][column].set_title(f"{speed:g} m/s")
        panels[-1][column].set_xlabel("% of the stride")
    _legend(figure)
    return figure


def _panel(one: Entry) -> float | None:
    """Speed of the people that a stride is drawn over; None: of none."""
    if one.costs == CAPTURED:
        return min(SPEEDS, key=lambda speed: abs(speed - one.row["speed"]))
    return one.row["asked_speed"] if one.row["beta"] == ORDINARY else None


def briskness_figure(entries: Sequence[Entry]) -> Figure:
    """Medians over the seeds, one colour a speed, one kind of line for each setting of the costs."""
    figure = style.new_figure(10, 7.5, "What briskness does to a run")
    speeds = sorted({one.row["asked_speed"] for one in entries if one.costs != CAPTURED})
    colours = get_cmap("viridis")
    norm = Normalize(min(speeds, default=0.0) - 0.5, max(speeds, default=1.0) + 1.0)
    for axes, (name, label) in zip(figure.subplots(2, 2).flat, PANELS.items(), strict=True):
        style.tidy(axes)
        for dashes, (costs, own) in zip(DASHES, by_costs(entries), strict=False):
            for speed in speeds:
                rows = [one.row for one in own if one.row["asked_speed"] == speed]
                betas = sorted({row["beta"] for row in rows})
                values = [median(row[name] for row in rows if row["beta"] == beta) for beta in betas]
                label_line = f"{speed:g} m/s, costs={costs}"
                axes.plot(betas, values, f"o{dashes}", ms=3.5, lw=1.5, color=colours(norm(speed)), label=label_line)
        axes.set(xlabel="beta", ylabel=label)
        axes.set_ylim(bottom=0)
    _legend(figure)
    return figure


def _legend(figure: Figure) -> None:
    """Each label once, below the panels."""
    labelled = {}
    for axes in figure.axes:
        handles, labels = axes.get_legend_handles_labels()
        labelled |= dict(zip(labels, handles, strict=True))
    if labelled:
        figure.legend(labelled.values(), labelled.keys(), loc="outside lower center", ncols=4, frameon=False)
