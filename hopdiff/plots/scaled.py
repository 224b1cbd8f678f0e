"""Convergence as in figure 5.7 of Kang (1999): the best value so far, scaled to (value - min) / (max - min)."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from hopdiff.plots import style
from hopdiff.plots.series import MOST_BANDS, colours_of, held, least_width, legend_below, legend_height, spread
from hopdiff.runs.folders import RunRecord
from hopdiff.runs.groups import Problem, complete, problem_name, problem_of

Group = dict[str, list[RunRecord]]

# The band holds the middle four fifths of the runs.
BAND = (0.1, 0.9)
POINTS = 400  # of a curve over evaluations
GENETIC = ("ga", "ga_thesis")  # the searches whose steps are generations
MOST_ROWS = 6


def can_scale(records: Sequence[RunRecord]) -> bool:
    """Whether a search with several seeds is among the runs: one run alone says nothing of a search."""
    return bool(_repeated(records))


def scaled_convergence_figure(records: Sequence[RunRecord]) -> Figure:
    """Scaled convergence of the searches that were run with several seeds; a row for every speed and beta, of more than
    six those spread over all.

    Left, if a genetic algorithm is among them: its generations as in the thesis, every run scaled by its own
    greatest and least best value. Right: all searches over what they spent, with one scale for all: 0 is the best of
    all runs, 1 the median of the first best values of `ga`, or else of `ga_thesis`, of random search, of all. Lines
    are medians, bands hold 80 % of the runs.
    """
    repeated = _repeated(records)
    drawn = spread(list(repeated), MOST_ROWS)
    problems = {problem: repeated[problem] for problem in drawn}
    present = {name for groups in problems.values() for name in groups}
    colours = {name: colour for name, colour in colours_of(records).items() if name in present}
    columns = 2 if any(_genetic(groups) for groups in problems.values()) else 1
    width = max(5.6 * columns + 0.4, least_width(list(colours)))
    height = 3.6 * len(problems) + 0.8 + legend_height(list(colours), width)
    title = "Best value so far, scaled: median, 10 to 90 % of runs"
    if len(drawn) < len(repeated):
        title += f" ({len(drawn)} of {len(repeated)} speeds and betas)"
    figure = style.new_figure(width, height, title)
    panels = figure.subplots(len(problems), columns, squeeze=False)
    for row, (problem, groups) in zip(panels, problems.items(), strict=True):
        if columns == 2:
            _generations(row[0], _genetic(groups), colours)
            row[0].set_title(f"{problem_name(problem)}: each run by its own scale")
        _searches(row[-1], groups, colours)
        row[-1].set_title(f"{problem_name(problem)}: all by one scale")
        for axes in row:
            axes.set_ylabel("(value - min) / (max - min)")
            style.tidy(axes)
    legend_below(figure, {name: {"color": colour} for name, colour in colours.items()})
    return figure


def _repeated(records: Sequence[RunRecord]) -> dict[Problem, Group]:
    """The runs of every series with several seeds, by speed and beta; no interrupted ones."""
    searched = [record for record in complete(records) if any(map(math.isfinite, record.history.get("best", [])))]
    problems: dict[Problem, Group] = defaultdict(lambda: defaultdict(list))
    for record in sorted(searched, key=lambda record: (problem_of(record), record.series)):
        problems[problem_of(record)][record.series.name].append(record)
    several = {
        problem: {label: runs for label, runs in groups.items() if _seeds(runs) > 1}
        for problem, groups in problems.items()
    }
    return {problem: groups for problem, groups in several.items() if groups}


def _seeds(runs: Sequence[RunRecord]) -> int:
    return len({record.metrics.get("seed") for record in runs})


def _genetic(groups: Group) -> Group:
    return {label: runs for label, runs in groups.items() if runs[0].metrics["search"] in GENETIC}


def _generations(axes: Axes, groups: Group, colours: dict[str, str]) -> None:
    """One row of a run's history is one generation."""
    for label, runs in groups.items():
        generations = np.arange(max(len(record.history["best"]) for record in runs))
        curves = []
        for record in runs:
            best = np.asarray(record.history["best"])
            known = _finite(record)
            span = known[0] - known[-1]
            # Before the first possible run there is nothing better than the first.
            scaled = (np.where(np.isfinite(best), best, known[0]) - known[-1]) / (span if span > 0 else 1.0)
            curves.append(held(generations, np.arange(len(best)), scaled))
        _band(axes, generations, np.array(curves), colours[label], len(groups) <= MOST_BANDS)
    axes.set_xlabel("generation")
    axes.set_ylim(-0.03, 1.05)


def _searches(axes: Axes, groups: Group, colours: dict[str, str]) -> None:
    low, high = _common_scale(groups)
    runs = [record for group in groups.values() for record in group]
    spent = np.linspace(1.0, max(record.history["spent"][-1] for record in runs), POINTS)
    for label, group in groups.items():
        curves = np.array([held(spent, record.history["spent"], record.history["best"]) for record in group])
        known = np.isfinite(curves).all(axis=0)
        _band(axes, spent[known], (curves[:, known] - low) / (high - low), colours[label], len(groups) <= MOST_BANDS)
    axes.set_xlabel("evaluations (a gradient counts as several)")
    axes.set_xlim(left=0.0)
    axes.set_ylim(-0.03, 1.05)


def _common_scale(groups: Group) -> tuple[float, float]:
    """The best value of all runs, and the median of the first ones."""
    runs = [record for group in groups.values() for record in group]
    first = {search: [r for r in runs if r.metrics["search"] == search] for search in (*GENETIC, "random")}
    begun = next((group for group in first.values() if group), runs)
    high = float(np.median([_finite(record)[0] for record in begun]))
    low = min(_finite(record)[-1] for record in runs)
    return low, high if high > low else low + 1.0


def _finite(record: RunRecord) -> list[float]:
    return [value for value in record.history["best"] if math.isfinite(value)]


def _band(axes: Axes, x: np.ndarray, curves: np.ndarray, colour: str, band: bool) -> None:
    axes.plot(x, np.median(curves, axis=0), color=colour, linewidth=1.8)
    if band:
        axes.fill_between(x, *np.quantile(curves, BAND, axis=0), color=colour, alpha=0.18, linewidth=0)
