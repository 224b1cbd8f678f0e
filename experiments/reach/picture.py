"""Contact, flight, bounce and arms over briskness, one line a speed."""

from __future__ import annotations

from collections.abc import Sequence
from statistics import median

from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.pyplot import get_cmap

from experiments.reach.bars import Row, per_pair
from hopdiff.plots import style

PANELS = {
    "contact_time": "contact time [s]",
    "flight_share": "flight share of a step",
    "com_oscillation": "bounce of the centre of mass [m]",
    "arm_swing_deg": "arm swing, RMS [deg]",
}


def trends_figure(rows: Sequence[Row], humans: Sequence[dict[str, str]]) -> Figure:
    """Median over the seeds, their range as a band; humans: rows of humans.csv, x measured, + estimated."""
    figure = style.new_figure(10, 7, "What briskness does to a run (at beta 0.2: x people, measured; + estimated)")
    pairs = per_pair(rows)
    speeds = sorted({speed for speed, _ in pairs})
    colours = get_cmap("viridis")
    norm = Normalize(min(speeds) - 0.5, max(speeds) + 1.0)
    for axes, (name, label) in zip(figure.subplots(2, 2).flat, PANELS.items(), strict=True):
        style.tidy(axes)
        for speed in speeds:
            betas = [beta for v, beta in pairs if v == speed]
            values = [[row[name] for row in pairs[speed, beta]] for beta in betas]
            colour = colours(norm(speed))
            axes.fill_between(betas, [min(v) for v in values], [max(v) for v in values], color=colour, alpha=0.18, lw=0)
            axes.plot(betas, [median(v) for v in values], "o-", ms=3.5, lw=1.5, color=colour, label=f"{speed:g} m/s")
        for human in humans:
            speed = float(human["speed"])
            if speed in speeds and (value := _human_value(human, name)) is not None:
                marker = "x" if human["measured"] == "yes" else "+"
                axes.plot(0.2, value, marker, ms=9, mew=2, color=colours(norm(speed)), zorder=5)
        axes.set(xlabel="beta", ylabel=label)
        axes.set_ylim(bottom=0)
    handles, labels = figure.axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside right center", frameon=False)
    return figure


def _human_value(human: dict[str, str], name: str) -> float | None:
    contact, flight = float(human["contact_time"]), float(human["flight_time"])
    derived = {"flight_share": flight / (contact + flight)}
    return derived.get(name, float(human[name]) if human.get(name) else None)
