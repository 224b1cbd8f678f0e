"""Several runs laid over each other."""

from __future__ import annotations

import csv
import math
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from hopdiff.io.files import read_json, read_text
from hopdiff.plots import style
from hopdiff.types import HopdiffError

_NEEDED = ("speed", "beta", "search", "seed", "cost", "energy_rate", "energy_target")
_STYLE = (
    ("contact_time", "contact time [s]"),
    ("flight_share", "flight share of a step"),
    ("com_oscillation", "bounce of the centre of mass [m]"),
    ("arm_swing_deg", "arm swing [deg]"),
)


@dataclass(frozen=True)
class RunRecord:
    """A run read back from its folder. history: column -> values, empty for a replay."""

    label: str
    metrics: dict[str, Any]
    history: dict[str, list[float]]


def read_run(folder: Path) -> RunRecord:
    """Raises HopdiffError, naming the file, if the folder does not hold a whole run."""
    metrics = read_json(folder / "metrics.json")
    missing = [name for name in _NEEDED if not isinstance(metrics, dict) or name not in metrics]
    if missing:
        raise HopdiffError(f"{folder / 'metrics.json'} lacks {missing[0]!r}: not the metrics of a run.")
    history: dict[str, list[float]] = {}
    path = folder / "history.csv"
    if path.is_file():
        rows = list(csv.reader(read_text(path).splitlines()))
        try:
            columns = zip(*([float(cell) for cell in row] for row in rows[1:]), strict=True)
            history = dict(zip(rows[0], (list(column) for column in columns), strict=True))
            if not {"spent", "best"} <= history.keys():
                raise ValueError("lacks the columns that are drawn")
        except (ValueError, IndexError) as error:
            raise HopdiffError(f"{path} is not the history of a search.") from error
    return RunRecord(folder.name, metrics, history)


def compare_figures(records: Sequence[RunRecord]) -> dict[str, Figure]:
    """Overlays by name: "convergence" if a search is among the runs, "summary", and "style" for several betas."""
    figures = {"summary": summary_figure(records)}
    if any(record.history for record in records):
        figures["convergence"] = convergence_overlay(records)
    if len({record.metrics["beta"] for record in records}) > 1:
        figures["style"] = style_figure(records)
    return figures


def convergence_overlay(records: Sequence[RunRecord]) -> Figure:
    """Best cost against what was spent, a panel for every speed and beta, a colour for every search.

    Several runs of one search make a line for their median and a band from the least to the greatest.
    """
    searched = [record for record in records if record.history]
    problems = sorted({(r.metrics["speed"], r.metrics["beta"]) for r in searched})
    columns = min(3, len(problems))
    rows = math.ceil(len(problems) / columns)
    figure = style.new_figure(4.2 * columns + 0.6, 3.0 * rows + 0.9, "Best cost against evaluations")
    panels = list(figure.subplots(rows, columns, squeeze=False).flat)
    colours = _colours(searched)
    for axes, problem in zip(panels, problems, strict=False):
        groups = defaultdict(list)
        for record in searched:
            if (record.metrics["speed"], record.metrics["beta"]) == problem:
                groups[record.metrics["search"]].append(record)
        for search, group in sorted(groups.items()):
            _band(axes, group, colours[search], search)
        if axes.get_ylim()[0] > 0:
            axes.set_yscale("log")
        axes.set_title(f"{problem[0]:g} m/s, beta {problem[1]:g}")
        style.tidy(axes)
    for axes in panels[len(problems) :]:
        axes.axis("off")
    figure.supxlabel("evaluations (a gradient counts as several)", fontsize=10)
    handles = {
        label: line for axes in figure.axes for line, label in zip(*axes.get_legend_handles_labels(), strict=True)
    }
    figure.legend(handles.values(), handles.keys(), loc="outside upper right", ncols=len(handles), frameon=False)
    return figure


def _band(axes: Axes, group: Sequence[RunRecord], colour: str, label: str) -> None:
    grid = np.unique(np.concatenate([record.history["spent"] for record in group]))
    curves = np.array([_held(grid, record.history["spent"], record.history["best"]) for record in group])
    known = np.isfinite(curves).all(axis=0)
    axes.plot(grid[known], np.median(curves[:, known], axis=0), color=colour, linewidth=1.8, label=label)
    if len(group) > 1:
        axes.fill_between(
            grid[known],
            curves[:, known].min(axis=0),
            curves[:, known].max(axis=0),
            color=colour,
            alpha=0.18,
            linewidth=0,
        )


def _held(grid: np.ndarray, spent: Sequence[float], best: Sequence[float]) -> np.ndarray:
    """The best value so far at every point of the grid; infinite before the first."""
    place = np.searchsorted(spent, grid, side="right") - 1
    return np.where(place >= 0, np.asarray(best)[np.maximum(place, 0)], np.inf)


def summary_figure(records: Sequence[RunRecord]) -> Figure:
    """Final cost, energy error and time of every run, by search."""
    figure = style.new_figure(11.0, 4.0, "Results by search")
    panels = figure.subplots(1, 3)
    searches = sorted({str(record.metrics["search"]) for record in records})
    colours = _colours(records)
    values = (
        ("cost", lambda m: m["cost"]),
        ("energy error [%]", _energy_error),
        ("time [s]", lambda m: m.get("wall_seconds", math.nan)),
    )
    for axes, (label, value) in zip(panels, values, strict=True):
        for row, search in enumerate(searches):
            found = np.array([value(r.metrics) for r in records if str(r.metrics["search"]) == search], dtype=float)
            found = found[np.isfinite(found)]
            if len(found) == 0:
                continue
            spread = np.linspace(-0.18, 0.18, len(found)) if len(found) > 1 else np.zeros(1)
            axes.plot(found, row + spread, "o", color=colours[search], alpha=0.55, markersize=5, markeredgewidth=0)
            axes.plot([np.median(found)] * 2, [row - 0.3, row + 0.3], color=colours[search], linewidth=2.5)
        axes.set_yticks(range(len(searches)), searches)
        axes.set_ylim(len(searches) - 0.5, -0.5)
        axes.set_xlabel(label)
        style.tidy(axes)
    return figure


def style_figure(records: Sequence[RunRecord]) -> Figure:
    """How contact, flight, bounce and arms change with beta, a line for every speed (mean over its runs)."""
    figure = style.new_figure(10.0, 7.0, "What briskness does")
    speeds = sorted({record.metrics["speed"] for record in records})
    for axes, (name, label) in zip(figure.subplots(2, 2).flat, _STYLE, strict=True):
        for i, speed in enumerate(speeds):
            groups = defaultdict(list)
            for record in records:
                if record.metrics["speed"] == speed and name in record.metrics:
                    groups[record.metrics["beta"]].append(record.metrics[name])
            betas = sorted(groups)
            colour = style.SERIES[i % len(style.SERIES)]
            axes.plot(betas, [np.mean(groups[b]) for b in betas], "o-", color=colour, label=f"{speed:g} m/s")
        axes.set_xlabel("beta")
        axes.set_ylabel(label)
        style.tidy(axes)
    handles, labels = figure.axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=len(labels), frameon=False)
    return figure


def _energy_error(metrics: dict[str, Any]) -> float:
    target = metrics["energy_target"]
    return 100.0 * (metrics["energy_rate"] / target - 1.0) if target else math.nan


def _colours(records: Sequence[RunRecord]) -> dict[str, str]:
    names = sorted({str(record.metrics["search"]) for record in records})
    return {name: style.SERIES[i % len(style.SERIES)] for i, name in enumerate(names)}
