"""Several runs laid over each other: how their searches went, what came out."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, MaxNLocator, NullLocator

from hopdiff.plots import style
from hopdiff.plots.briskness import style_figure
from hopdiff.plots.series import (
    COLOURS,
    MOST_BANDS,
    colours_of,
    held,
    least_width,
    legend_below,
    legend_height,
    spread,
)
from hopdiff.runs.folders import RunRecord
from hopdiff.runs.groups import (
    Problem,
    by_problem,
    complete,
    median_cost,
    names_of,
    problem_name,
    problem_of,
    standings,
)

MOST_SERIES = len(COLOURS)
MOST_PROBLEMS = 12
MOST_ROWS = 72  # of the summary
MOST_POINTS = 500  # of a curve: many runs of gradient searches have hardly a point in common


@dataclass(frozen=True)
class Chosen:
    """The runs that are drawn. problems: those with a panel or rows of their own. sentences: what was left out."""

    records: list[RunRecord]
    problems: list[Problem]
    sentences: list[str]


def choose(records: Sequence[RunRecord]) -> Chosen:
    """As many series and problems as can be told apart: the best series by median cost, and problems over the whole
    range of them."""
    sentences = []
    names = names_of(records)
    if len(names) > MOST_SERIES:
        known = standings(records)
        best = sorted(names, key=lambda name: known[name].place)[:MOST_SERIES]
        sentences.append(
            f"Pictures show the {MOST_SERIES} best of {len(names)} series, by their place in median cost at each speed"
            " and beta."
        )
        records = [record for record in records if record.series.name in best]
    problems = sorted({problem_of(record) for record in records})
    room = max(1, min(MOST_PROBLEMS, MOST_ROWS // len(names_of(records))))
    if (count := len(problems)) > room:
        problems = spread(problems, room)
        sentences.append(f"Pictures of single speeds and betas show {room} of {count}, spread over all of them.")
    return Chosen(list(records), problems, sentences)


def compare_figures(chosen: Chosen) -> dict[str, Figure]:
    """Overlays by name: "convergence" if a search is among the runs, "summary", and "style" for several betas."""
    shown = [record for record in chosen.records if problem_of(record) in chosen.problems]
    figures = {"summary": summary_figure(shown)}
    if any(record.history for record in complete(shown)):
        figures["convergence"] = convergence_overlay(shown)
    if len({record.metrics["beta"] for record in complete(chosen.records)}) > 1:
        figures["style"] = style_figure(chosen.records)
    return figures


def convergence_overlay(records: Sequence[RunRecord]) -> Figure:
    """Best cost against what was spent, a panel for every speed and beta, a colour for every series.

    Several runs of one series make a line for their median and a band from the least to the greatest. Interrupted
    searches are left out.
    """
    panels_of = by_problem([record for record in complete(records) if len(record.history)])
    present = {name for groups in panels_of.values() for name in groups}
    colours = {name: colour for name, colour in colours_of(records).items() if name in present}
    columns = min(3 if len(panels_of) <= 9 else 4, len(panels_of))
    rows = math.ceil(len(panels_of) / columns)
    width = max(4.2 * columns + 0.8, least_width(list(colours)))
    height = 3.0 * rows + 1.0 + legend_height(list(colours), width)
    figure = style.new_figure(width, height, "Best cost against evaluations")
    panels = list(figure.subplots(rows, columns, squeeze=False).flat)
    for axes, (problem, groups) in zip(panels, panels_of.items(), strict=False):
        for label, group in groups.items():
            _curve(axes, group, colours[label], label, len(groups) <= MOST_BANDS)
        _scale_cost(axes, [record for group in groups.values() for record in group])
        axes.set_title(problem_name(problem))
        style.tidy(axes)
    for axes in panels[: len(panels_of) : columns]:
        axes.set_ylabel("best cost so far")
    for axes in panels[max(0, len(panels_of) - columns) : len(panels_of)]:
        axes.set_xlabel("evaluations (a gradient counts as several)")
    for axes in panels[len(panels_of) :]:
        axes.axis("off")
    legend_below(figure, {name: {"color": colour} for name, colour in colours.items()})
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
    axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 1.5, 2.0, 3.0, 5.0, 7.0)))
    axes.yaxis.set_major_formatter("{x:g}")
    axes.yaxis.set_minor_locator(NullLocator())


def _curve(axes: Axes, group: Sequence[RunRecord], colour: str, label: str, band: bool) -> None:
    grid = np.unique(np.concatenate([record.history["spent"] for record in group]))
    if len(grid) > MOST_POINTS:
        grid = grid[np.linspace(0, len(grid) - 1, MOST_POINTS).round().astype(int)]
    curves = np.array([held(grid, record.history["spent"], record.history["best"]) for record in group])
    known = np.isfinite(curves).all(axis=0)
    middle = np.median(curves[:, known], axis=0)
    # A best value holds until a better one is found.
    # A search of one step, as that of the ordinary genes, has no line.
    dot = "o" if known.sum() == 1 else ""
    axes.plot(grid[known], middle, marker=dot, color=colour, linewidth=1.8, label=label, drawstyle="steps-post")
    if band and len(group) > 1:
        low, high = curves[:, known].min(axis=0), curves[:, known].max(axis=0)
        axes.fill_between(grid[known], low, high, color=colour, alpha=0.18, linewidth=0, step="post")


def summary_figure(records: Sequence[RunRecord]) -> Figure:
    """Final numbers: a row for every series, the least median cost first, below its speed and beta.

    A dot is a run, a bar the median of several; hollow dots are interrupted searches, which no median counts. Costs of
    different speeds or betas are never pooled: they are not of one kind.
    """
    problems = by_problem(records)
    colours = colours_of(records)
    rows: list[tuple[str, list[RunRecord]]] = []  # name and runs; without runs it is the heading of a problem
    for problem, groups in problems.items():
        if len(problems) > 1:
            rows.append((problem_name(problem), []))
        rows += sorted(groups.items(), key=lambda item: _order(item[1]))
    title = "Results" if len(problems) > 1 else f"Results at {problem_name(next(iter(problems)))}"
    if any(record.status != "complete" for record in records):
        title += " (hollow: interrupted)"
    measured = [(label, value) for label, value in _RESULTS if _finite(records, value)]
    width = 2.7 * len(measured) + min(4.0, least_width([name for name, _ in rows]))
    figure = style.new_figure(width, 1.3 + 0.27 * len(rows), title)
    panels = figure.subplots(1, len(measured), sharey=True, squeeze=False)[0]
    for axes, (label, value) in zip(panels, measured, strict=True):
        for place, (name, runs) in enumerate(rows):
            _dots(axes, place, runs, value, colours.get(name, style.INK))
        _scale(axes, _finite(records, value))
        if label == _ENERGY[0]:
            axes.axvline(0.0, color=style.GROUND, linewidth=1.0, zorder=1)
        axes.set_xlabel(label)
        style.tidy(axes)
    panels[0].set_yticks(range(len(rows)), [name for name, _ in rows])
    for tick, (_, runs) in zip(panels[0].get_yticklabels(), rows, strict=True):
        tick.set_fontweight("normal" if runs else "bold")
    panels[0].set_ylim(len(rows) - 0.4, -0.6)
    return figure


def _order(runs: Sequence[RunRecord]) -> tuple[bool, float]:
    """Rows without a finished run stand below the others."""
    finished = complete(runs)
    return not finished, median_cost(finished or runs)


def _finite(records: Sequence[RunRecord], value: Callable[[dict[str, Any]], float | None]) -> list[float]:
    found = np.array([value(record.metrics) for record in records], dtype=float)
    return [float(number) for number in found[np.isfinite(found)]]


def _dots(
    axes: Axes, place: int, runs: Sequence[RunRecord], value: Callable[[dict[str, Any]], float | None], colour: str
) -> None:
    finished = _finite(complete(runs), value)
    others = _finite([record for record in runs if record.status != "complete"], value)
    if finished:
        axes.plot(finished, [place] * len(finished), "o", color=colour, alpha=0.55, markeredgewidth=0)
    if others:
        axes.plot(others, [place] * len(others), "o", color=colour, alpha=0.8, markerfacecolor="none")
    if len(finished) > 1:
        axes.plot([np.median(finished)] * 2, [place - 0.35, place + 0.35], color=colour, linewidth=2.5)


def _scale(axes: Axes, values: Sequence[float]) -> None:
    if min(values) > 0 and max(values) > 10.0 * min(values):
        axes.set_xscale("log")
        axes.xaxis.set_major_locator(LogLocator(subs=(1.0, 3.0) if max(values) < 100.0 * min(values) else (1.0,)))
        axes.xaxis.set_major_formatter("{x:g}")
        axes.xaxis.set_minor_locator(NullLocator())
    else:
        axes.xaxis.set_major_locator(MaxNLocator(4))


def energy_error(metrics: dict[str, Any]) -> float:
    """How far the energy is from its target [%]; nan where the target is 0."""
    target = metrics["energy_target"]
    return 100.0 * (metrics["energy_rate"] / target - 1.0) if target else math.nan


_Result = tuple[str, Callable[[dict[str, Any]], float | None]]
_ENERGY: _Result = ("energy error [%]", energy_error)
_RESULTS: tuple[_Result, ...] = (
    ("final cost", lambda metrics: metrics["cost"]),
    ("eval of Kang (1999)", lambda metrics: metrics.get("eval")),
    _ENERGY,
    ("time of the search [s]", lambda metrics: metrics.get("wall_seconds")),
)
