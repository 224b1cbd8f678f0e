"""Which runs are replicates of one another, and what the groups are called."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cache
from math import inf
from statistics import fmean, median
from typing import Any

from hopdiff.runs.folders import RunRecord, Series
from hopdiff.runs.settings import CHOICES, Differences

Problem = tuple[float, float]

# Settings that make no groups, and all below them. What is left does: also threads, device and dtype, which the time of
# a search and the last digits of its result depend on.
IDLE = (
    "seed",  # what replicates
    *("speed", "beta"),  # the problem, which is told apart from the series
    *("pictures", "animation", "fps", "exports", "retarget"),  # what is written of a run
    *("task.label", "overwrite"),  # and where to
    "experiment",  # a name for settings that count by themselves
    # Of other tasks than those that are compared.
    *("run", "runs", "clip", "clips", "target", "constraints", "edit", "scene", "start", "goal", "way", "graph"),
    "hopper",
)
OF_PATHS = ("path",)
OF_REPLAYS = ("genes_file",)
OF_SEARCHES = ("search", "budget")
LONGEST = 32  # characters of a value in a name


@dataclass(frozen=True)
class Groups:
    """Runs with their series.

    told: the settings that the series differ in, in the order in which names tell them. values: of each series by its
    name, their values, without those that it has not got, as the population of search=gradient.
    """

    told: tuple[str, ...]
    records: list[RunRecord]
    values: dict[str, dict[str, Any]]


def grouped(records: Sequence[RunRecord]) -> Groups:
    """Give every run its series: runs of one series differ in nothing but speed, beta and seed.

    A setting that follows from what a name tells already is not told, unless it was typed: genes=body beside
    model=body, say.
    """
    acting = [_acting(record) for record in records]
    # What a replay has not got is no value of its own: it had no budget, and no search.
    whole = [record.whole and not _replayed(record) for record in records]
    differences = Differences(acting, [record.typed for record in records], whole)
    names = differences.names()
    choices = [f"{choice}.name" for choice in CHOICES]
    told: list[str] = []
    classes: list[tuple[Any, ...]] = [() for _ in records]
    for name in (name for name in choices if name in names):
        classes = _split(name, acting, classes, differences.typed(name), told)
    # What merely follows from speed and beta is no difference of series.
    classes = [(*key, problem_of(record)) for key, record in zip(classes, records, strict=True)]
    for name in (name for name in names if name not in choices):
        classes = _split(name, acting, classes, differences.typed(name), told)
    keys = [tuple(settings.get(name) for name in told) for settings in acting]
    varying = {name: _varying(differences, name) for name in told}
    titles: dict[tuple[Any, ...], str] = {}
    values: dict[str, dict[str, Any]] = {}
    for i, key in sorted(enumerate(keys), key=lambda pair: [_rank(value) for value in pair[1]]):
        if key not in titles:
            title = _title(acting[i], [name for name in told if i in varying[name]])
            count = sum(known == title or known.startswith(f"{title} (") for known in titles.values())
            titles[key] = f"{title} ({count + 1})" if count else title
            values[titles[key]] = {name: acting[i][name] for name in told if name in acting[i]}
    series = {key: Series(place, title) for place, (key, title) in enumerate(titles.items())}
    named = [replace(record, series=series[key]) for record, key in zip(records, keys, strict=True)]
    return Groups(tuple(told), named, values)


def _acting(record: RunRecord) -> dict[str, Any]:
    """The settings of a run that can change it."""
    replay, path = _replayed(record), record.task == "path"
    settings = {name: value for name, value in record.settings.items() if _acts(name, replay, path)}
    searched = "replay" if replay else settings.get("search.name", record.metrics.get("search"))
    # A run is a run, whether it was searched for or replayed; one along a path is something else.
    return settings | {"search.name": searched, "task.name": "path" if path else "run"}


def _replayed(record: RunRecord) -> bool:
    return record.task == "replay" or record.metrics.get("search") == "none"


@cache
def _acts(name: str, replay: bool, path: bool) -> bool:
    idle = [*IDLE, *(() if path else OF_PATHS), *(OF_SEARCHES if replay else OF_REPLAYS)]
    return not any(name == top or name.startswith(f"{top}.") for top in idle)


def _split(
    name: str, acting: Sequence[dict[str, Any]], classes: list[tuple[Any, ...]], typed: bool, told: list[str]
) -> list[tuple[Any, ...]]:
    """The classes of runs told apart by one more setting, which is put with the told ones if that does tell."""
    finer = [(*key, settings.get(name)) for key, settings in zip(classes, acting, strict=True)]
    if typed or len(set(finer)) > len(set(classes)):
        told.append(name)
        return finer
    return classes


def _varying(differences: Differences, name: str) -> set[int]:
    """The places of the runs whose names tell a setting: not where it is not, or just comes with a choice."""
    group = name.split(".")[0]
    having = {i for i, settings in enumerate(differences.runs) if name in settings}
    if group not in CHOICES or name == f"{group}.name":
        return having
    classes = differences.by_choice(group).values()
    return having & {i for same in classes if differences.several(name, same) for i in same}


def _title(settings: dict[str, Any], names: Sequence[str]) -> str:
    """The search, and whatever else tells a series from others: "ga, search.population 20"."""
    parts = [shown(settings["search.name"])]
    for name in names:
        if name != "search.name":
            value = shown(settings.get(name))
            parts.append(value if name.endswith(".name") and name.count(".") == 1 else f"{name} {value}")
    return ", ".join(parts)


def shown(value: Any) -> str:
    """A value of a setting as one types it, of at most 32 letters."""
    if value is None or isinstance(value, bool):
        return str(value).lower().replace("none", "null")
    if isinstance(value, float):
        return f"{value:g}" if float(f"{value:g}") == value else repr(value)
    text = str(value)
    if len(text) <= LONGEST:
        return text
    # Of a file the end tells most.
    return f"…{text[1 - LONGEST :]}" if "/" in text else f"{text[: LONGEST - 1]}…"


def _rank(value: Any) -> tuple[int, float, str]:
    """A key that sorts numbers by size, and before words."""
    if isinstance(value, int | float):
        return 0, float(value), ""
    return 1, 0.0, "" if value is None else str(value)


def complete(records: Iterable[RunRecord]) -> list[RunRecord]:
    """The runs whose search came to its end: a median over others would mix budgets."""
    return [record for record in records if record.status == "complete"]


def by_problem(records: Iterable[RunRecord]) -> dict[Problem, dict[str, list[RunRecord]]]:
    """Runs by speed and beta, and then by series, both in order."""
    groups: dict[Problem, dict[str, list[RunRecord]]] = {}
    for record in sorted(records, key=lambda record: (problem_of(record), record.series)):
        groups.setdefault(problem_of(record), {}).setdefault(record.series.name, []).append(record)
    return groups


def median_cost(records: Iterable[RunRecord]) -> float:
    return float(median(record.metrics["cost"] for record in records))


@dataclass(frozen=True)
class Standing:
    """How a series does beside the others. problems: speeds and betas that it was run at. first: those among them where
    its median cost is the least. place: mean place in the order of median costs, 0 the first and 1 the last; infinite
    without a finished run."""

    problems: int
    first: int
    place: float


def standings(records: Sequence[RunRecord]) -> dict[str, Standing]:
    """How each series of runs does, in their order."""
    places = defaultdict(list)
    for groups in by_problem(complete(records)).values():
        order = sorted(groups, key=lambda name: median_cost(groups[name]))
        for place, name in enumerate(order):
            places[name].append(place / max(1, len(order) - 1))
    return {
        name: Standing(len(found), found.count(0.0), fmean(found)) if (found := places[name]) else Standing(0, 0, inf)
        for name in names_of(records)
    }


def names_of(records: Iterable[RunRecord]) -> list[str]:
    """The series of runs, in their order."""
    return [series.name for series in sorted({record.series for record in records})]


def problem_of(record: RunRecord) -> Problem:
    """Speed [m/s] and beta of a run."""
    return record.metrics["speed"], record.metrics["beta"]


def problem_name(problem: Problem) -> str:
    return f"{problem[0]:g} m/s, beta {problem[1]:g}"
