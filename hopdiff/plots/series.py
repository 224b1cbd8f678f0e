"""What pictures of several runs share: colours and names of series, legends, best values held between steps."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, TypeVar

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from hopdiff.plots import style
from hopdiff.runs.folders import RunRecord
from hopdiff.runs.groups import names_of

# As many as can be told apart, and as many series as a picture shows.
COLOURS = (*style.SERIES, "#8C510A", "#7FA900", "#A50F15", "#8C92A0")
MOST_BANDS = 6  # more of them on one another are mud
T = TypeVar("T")
_LETTER = 0.077  # inches that a letter of a legend takes, in names of settings


def colours_of(records: Iterable[RunRecord]) -> dict[str, str]:
    """A colour for every series."""
    return {name: COLOURS[i % len(COLOURS)] for i, name in enumerate(names_of(records))}


def legend_columns(names: Sequence[str], width: float) -> int:
    """How many names fit side by side into a width [inches]."""
    longest = max(map(len, names), default=0)
    return max(1, min(len(names), int(width / (_LETTER * longest + 0.7))))


def legend_height(names: Sequence[str], width: float) -> float:
    """Height of the legend below a picture [inches]."""
    return 0.23 * math.ceil(len(names) / legend_columns(names, width)) + 0.15 if names else 0.0


def least_width(names: Sequence[str]) -> float:
    """What a picture with these names in its legend needs [inches]."""
    return _LETTER * max(map(len, names), default=0) + 1.0


def legend_below(figure: Figure, looks: Mapping[str, Mapping[str, Any]], marker: str = "") -> None:
    """A legend of lines under everything else. looks: how the line of each name is drawn."""
    handles = [Line2D([], [], linewidth=1.8, marker=marker, **look) for look in looks.values()]
    columns = legend_columns(list(looks), float(figure.get_figwidth()))
    figure.legend(handles, list(looks), loc="outside lower center", ncols=columns, frameon=False, fontsize=10)


def held(grid: np.ndarray, spent: Sequence[float] | np.ndarray, best: Sequence[float] | np.ndarray) -> np.ndarray:
    """The best value so far at every point of the grid; infinite before the first."""
    place = np.searchsorted(spent, grid, side="right") - 1
    return np.where(place >= 0, np.asarray(best)[np.maximum(place, 0)], np.inf)


def spread(values: Sequence[T], most: int) -> list[T]:
    """At most so many of several values in order, spread over all of them."""
    return [values[round(i)] for i in np.linspace(0, len(values) - 1, min(most, len(values)))]
