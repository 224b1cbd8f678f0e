"""Several runs laid over each other."""

from __future__ import annotations

import csv
import math
from collections import defaultdict
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import LogLocator, MaxNLocator, NullLocator

from hopdiff.io.files import read_json, read_text
from hopdiff.plots import style
from hopdiff.types import HopdiffError

_NUMBERS = ("speed", "beta", "cost", "energy_rate", "energy_target")
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
    """Read metrics.json and, if the run came from a search, history.csv.

    Raises HopdiffError, naming the file, if the folder does not hold a whole run.
    """
    path = folder / "metrics.json"
    metrics = read_json(path)
    if not isinstance(metrics, dict):
        raise HopdiffError(f"{path} does not hold the metrics of a run.")
    for name in (*_NUMBERS, "search"):
        if name not in metrics:
            raise HopdiffError(f"{path} lacks {name!r}: not the metrics of a run.")
    for name in _NUMBERS:
        if isinstance(metrics[name], bool) or not isinstance(metrics[name], int | float):
            raise HopdiffError(f"{path}: {name!r} must be a number, not {metrics[name]!r}.")
    table = folder / "history.csv"
    return RunRecord(folder.name, metrics, _read_history(table) if table.is_file() else {})


def _read_history(path: Path) -> dict[str, list[float]]:
    header, *rows = list(csv.reader(read_text(path).splitlines())) or [[]]
    if not rows or not {"spent", "best"} <= set(header):
        raise HopdiffError(f"{path} is not the history of a search: it needs columns 'spent' and 'best', and a row.")
    history: dict[str, list[float]] = {name: [] for name in header}
    for number, row in enumerate(rows, start=2):
        try:
            for name, cell in zip(header, row, strict=True):
                history[name].append(float(cell))
        except ValueError as error:
            raise HopdiffError(f"{path}, line {number}: not {len(header)} numbers.") from error
    return history


def compare_figures(records: Sequence[RunRecord]) -> dict[str, Figure]:
    """Overlays by name: "convergence" if a search is among the runs, "summary", and "style" for several betas."""
    figures = {"summary": summary_figure(records)}
    if any(record.history for record in records):
        figures["convergence"] = convergence_overlay(records)
    if len({record.metrics["beta"] for record in records}) > 1:
        figures["style"] = style_figure(records)
    return figures


def convergence_overlay(records: Sequence[RunRecord]) -> Figure:
    """Best cost against what was spent, a panel for every speed and beta, a colour for every series (see `series`).

    Several runs of one series make a line for their median and a band from the least to the greatest.
    """
    searched = [record for record in records if record.history]
    problems = sorted({problem_of(record) for record in searched})
    name = series(records)
    columns = min(3, len(problems))
    rows = math.ceil(len(problems) / columns)
    figure = style.new_figure(4.2 * columns + 0.8, 3.0 * rows + 1.3, "Best cost against evaluations")
    panels = list(figure.subplots(rows, columns, squeeze=False).flat)
    colours = colours_of(map(name, searched))
    for axes, problem in zip(panels, problems, strict=False):
        groups = defaultdict(list)
        for record in searched:
            if problem_of(record) == problem:
                groups[name(record)].append(record)
        for label, group in sorted(groups.items()):
            _band(axes, group, colours[label], label)
        _scale_cost(axes, [record for group in groups.values() for record in group])
        axes.set_title(problem_name(problem))
        style.tidy(axes)
    for axes in panels[max(0, len(problems) - columns) : len(problems)]:
        axes.set_xlabel("evaluations (a gradient counts as several)")
    for axes in panels[len(problems) :]:
        axes.axis("off")
    handles = [Line2D([], [], color=colour, linewidth=1.8) for colour in colours.values()]
    figure.legend(handles, list(colours), loc="outside lower center", ncols=min(6, len(handles)), frameon=False)
    return figure


def _scale_cost(axes: Axes, group: Sequence[RunRecord]) -> None:
    """A logarithmic scale that leaves the height to where the searches differ: at the end, not at the start."""
    best = [[value for value in record.history["best"] if math.isfinite(value)] for record in group]
    low = min((min(values) for values in best if values), default=0.0)
    if low <= 0:
        return
    worst_end = max(values[-1] for values in best if values)
    first = max(values[0] for values in best if values)
    axes.set_yscale("log")
    axes.set_ylim(0.9 * low, 1.1 * min(first, max(8.0 * low, 1.5 * worst_end)))
    axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axes.yaxis.set_major_formatter("{x:g}")
    axes.yaxis.set_minor_locator(NullLocator())


def _band(axes: Axes, group: Sequence[RunRecord], colour: str, label: str) -> None:
    grid = np.unique(np.concatenate([record.history["spent"] for record in group]))
    curves = np.array([held(grid, record.history["spent"], record.history["best"]) for record in group])
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


def held(grid: np.ndarray, spent: Sequence[float] | np.ndarray, best: Sequence[float] | np.ndarray) -> np.ndarray:
    """The best value so far at every point of the grid; infinite before the first."""
    place = np.searchsorted(spent, grid, side="right") - 1
    return np.where(place >= 0, np.asarray(best)[np.maximum(place, 0)], np.inf)


def summary_figure(records: Sequence[RunRecord]) -> Figure:
    """Final numbers: a row for every series of every speed and beta, a dot a run, a bar the median.

    Costs of different speeds or betas are never pooled: they are not of one kind.
    """
    name = series(records)
    groups = defaultdict(list)
    for record in records:
        groups[problem_of(record), name(record)].append(record.metrics)
    keys = sorted(groups)
    # Half a row of air between one speed and beta and the next.
    places = np.cumsum([0.0] + [1.0 if a[0] == b[0] else 1.5 for a, b in pairwise(keys)])
    figure = style.new_figure(12.0, 1.3 + 0.3 * (float(places[-1]) + 1.0), "Results by search")
    panels = figure.subplots(1, len(_RESULTS), sharey=True)
    colours = colours_of(map(name, records))
    for axes, (label, value) in zip(panels, _RESULTS, strict=True):
        for place, key in zip(places, keys, strict=True):
            found = np.array([value(metrics) for metrics in groups[key]], dtype=float)
            found = found[np.isfinite(found)]
            if len(found) > 0:
                axes.plot(found, np.full(len(found), place), "o", color=colours[key[1]], alpha=0.55, markeredgewidth=0)
                axes.plot([np.median(found)] * 2, [place - 0.35, place + 0.35], color=colours[key[1]], linewidth=2.5)
        axes.set_xlabel(label)
        axes.xaxis.set_major_locator(MaxNLocator(4))
        style.tidy(axes)
    panels[0].set_yticks(places, [f"{problem_name(problem)}: {label}" for problem, label in keys])
    panels[0].set_ylim(places[-1] + 0.7, -0.7)
    panels[_RESULTS.index(_ENERGY)].axvline(0.0, color=style.GROUND, linewidth=1.0, zorder=1)
    return figure


def style_figure(records: Sequence[RunRecord]) -> Figure:
    """How contact, flight, bounce and arms change with beta, a line for every speed (mean over its runs)."""
    figure = style.new_figure(10.0, 7.0, "What briskness does")
    speeds = sorted({record.metrics["speed"] for record in records})
    for axes, (name, label) in zip(figure.subplots(2, 2).flat, _STYLE, strict=True):
        for i, speed in enumerate(speeds):
            groups = defaultdict(list)
            for record in records:
                if record.metrics["speed"] == speed and record.metrics.get(name) is not None:
                    groups[record.metrics["beta"]].append(record.metrics[name])
            betas = sorted(groups)
            colour = style.SERIES[i % len(style.SERIES)]
            axes.plot(betas, [np.mean(groups[b]) for b in betas], "o-", color=colour, label=f"{speed:g} m/s")
        axes.set_xlabel("beta")
        axes.set_ylabel(label)
        style.tidy(axes)
    handles, labels = figure.axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=min(6, len(labels)), frameon=False)
    return figure


def _energy_error(metrics: dict[str, Any]) -> float:
    target = metrics["energy_target"]
    return 100.0 * (metrics["energy_rate"] / target - 1.0) if target else math.nan


_Result = tuple[str, Callable[[dict[str, Any]], float | None]]
_ENERGY: _Result = ("energy error [%]", _energy_error)
_RESULTS: tuple[_Result, ...] = (
    ("final cost", lambda metrics: metrics["cost"]),
    ("eval of Kang (1999)", lambda metrics: metrics.get("eval")),
    _ENERGY,
    ("time of the search [s]", lambda metrics: metrics.get("wall_seconds")),
)


def series(records: Sequence[RunRecord]) -> Callable[[RunRecord], str]:
    """What the line of a run is called: its search, and whichever of model, costs, body and genes tell runs apart."""
    told = ("model", "costs", "character", "genes")
    names = [name for name in told if len({_choice(record, name) for record in records}) > 1]
    return lambda record: ", ".join([str(record.metrics["search"]), *(_choice(record, name) for name in names)])


def _choice(record: RunRecord, name: str) -> str:
    return str(record.metrics.get(name, "default"))


def problem_of(record: RunRecord) -> tuple[float, float]:
    """Speed and beta of a run."""
    return record.metrics["speed"], record.metrics["beta"]


def problem_name(problem: tuple[float, float]) -> str:
    return f"{problem[0]:g} m/s, beta {problem[1]:g}"


def colours_of(names: Iterable[str]) -> dict[str, str]:
    """A colour for every different name."""
    return {name: style.SERIES[i % len(style.SERIES)] for i, name in enumerate(sorted(set(names)))}
