"""Run folders read back: what a run was asked for, how it ended, what it reached."""

from __future__ import annotations

import csv
import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hopdiff.io.files import read_json, read_text
from hopdiff.runs.settings import as_settings, flat_settings, typed_values
from hopdiff.types import HopdiffError

COMPARED = ("run", "replay", "path")  # tasks whose folders hold a run
STATUSES = ("running", "complete", "interrupted", "failed")
BROKEN = "broken"  # our word for a run with a file that is missing or damaged
NUMBERS = ("speed", "beta", "cost", "energy_rate", "energy_target")  # that no run can be compared without


class Series(NamedTuple):
    """What tells the runs of one line of a picture from those of another; sorted by place."""

    place: int
    name: str


NO_SERIES = Series(0, "")


@dataclass(frozen=True)
class RunRecord:
    """A run read back from its folder.

    label: its path below the folder of runs. metrics: what metrics.json holds, empty if there is none. history: columns
    "spent" and "best", empty for a replay, and until `with_history` has read them. status: one of STATUSES, or
    "broken"; sentence: what went wrong. notes: flags of status.json. typed: what was typed, by name. settings:
    config.yaml, flat; of a run without one (whole is False) what was typed.
    """

    label: str
    metrics: dict[str, Any]
    history: Mapping[str, Sequence[float] | NDArray[np.float64]] = field(default_factory=dict)
    folder: Path = Path()
    status: str = "complete"
    sentence: str | None = None
    notes: tuple[str, ...] = ()
    task: str = "run"
    typed: dict[str, Any] = field(default_factory=dict)
    settings: dict[str, Any] = field(default_factory=dict)
    whole: bool = True
    series: Series = NO_SERIES


@dataclass(frozen=True)
class Survey:
    """What lies below a folder. runs: in the order of the numbers in their names; foreign: folders by their task."""

    runs: list[RunRecord]
    foreign: dict[str, list[str]]


def survey(folder: Path) -> Survey:
    """Read all run folders at or below a folder; one that cannot be read is "broken", with a sentence.

    Raises HopdiffError if there is no such folder.
    """
    runs: list[RunRecord] = []
    foreign: dict[str, list[str]] = {}
    for path in _folders(folder, ("metrics.json", "status.json")):
        label = path.name if path == folder else path.relative_to(folder).as_posix()
        record = read_run(path, label)
        if record.task in COMPARED:
            runs.append(record)
        else:
            foreign.setdefault(record.task, []).append(label)
    return Survey(runs, foreign)


def find_runs(folder: Path) -> list[Path]:
    """All folders with the metrics of a motion at or below a folder, numbers in their names in order.

    Raises HopdiffError if there is no such folder, or no run in it.
    """
    # Not those of task=body and task=hopper.
    found = [path for path in _folders(folder, ("metrics.json",)) if not _aside(path)]
    if not found:
        raise HopdiffError(f"runs={folder} holds no run: no metrics.json was found in it or below it.")
    return found


def _folders(folder: Path, marks: tuple[str, ...]) -> list[Path]:
    if not folder.is_dir():
        raise HopdiffError(f"runs={folder} is not a folder.")
    found = []
    for place, below, files in os.walk(folder):
        below[:] = [name for name in below if not name.startswith(".")]
        if any(mark in files for mark in marks):
            found.append(Path(place))
    return sorted(found, key=_natural)


def _aside(folder: Path) -> bool:
    return any((folder / name).is_file() for name in ("body.csv", "frames.csv"))


def _natural(path: Path) -> list[tuple[int, str]]:
    """A key that sorts 10_b after 9_a."""
    return [(int(part), "") if part.isdecimal() else (-1, part) for part in re.split(r"(\d+)", str(path))]


def read_run(folder: Path, label: str | None = None) -> RunRecord:
    """Read status.json, config.yaml and metrics.json; never raises for what they hold, see RunRecord.status."""
    trouble: list[str] = []
    state = _table(folder / "status.json", trouble)
    metrics = _table(folder / "metrics.json", trouble)
    if state is None:  # of an older version, or damaged
        command = (_table(folder / "versions.json", []) or {}).get("command")
        state = {"status": "complete", "overrides": command}
    overrides = state.get("overrides")
    typed = typed_values(overrides if isinstance(overrides, list) else [])
    settings = _settings(folder / "config.yaml", trouble)
    task = state.get("task") or (settings or {}).get("task.name") or _guessed_task(folder, metrics)
    status, sentence = state.get("status"), state.get("sentence")
    if status not in STATUSES:
        trouble.append(f"{folder / 'status.json'}: {status!r} is no status of a run.")
    notes = state.get("notes")
    record = RunRecord(
        label=folder.name if label is None else label,
        metrics=metrics or {},
        folder=folder,
        status=str(status),
        sentence=None if sentence is None else str(sentence),
        notes=tuple(str(note["flag"]) for note in notes or () if isinstance(note, dict) and "flag" in note)
        if isinstance(notes, list)
        else (),
        task=str(task),
        typed=typed,
        settings=as_settings(typed) if settings is None else settings | _chosen_experiment(typed),
        whole=settings is not None,
    )
    if status in ("running", "failed"):  # which need not have written anything else
        return record
    trouble += _gaps(folder, metrics, settings)
    return replace(record, status=BROKEN, sentence=trouble[0]) if trouble else record


def _table(path: Path, trouble: list[str]) -> dict[str, Any] | None:
    """The content of a JSON file, None if there is none or it is damaged, which is put with the troubles."""
    if not path.is_file():
        return None
    try:
        content = read_json(path)
    except HopdiffError as error:
        trouble.append(str(error))
        return None
    if not isinstance(content, dict):
        trouble.append(f"{path} does not hold {'the metrics' if path.stem == 'metrics' else 'the status'} of a run.")
        return None
    return content


def _settings(path: Path, trouble: list[str]) -> dict[str, Any] | None:
    if not path.is_file():
        return None
    try:
        return flat_settings(read_text(path), str(path))
    except HopdiffError as error:
        trouble.append(str(error))
        return None


def _chosen_experiment(typed: Mapping[str, Any]) -> dict[str, Any]:
    """The experiment, which config.yaml does not tell: its settings are there, its name is not."""
    return {name: value for name, value in typed.items() if name == "experiment"}


def _guessed_task(folder: Path, metrics: Mapping[str, Any] | None) -> str:
    """The task of a folder that does not tell: some other, if its metrics are not those of a run."""
    return "run" if metrics is None or ({"cost", "search"} & set(metrics) and not _aside(folder)) else "unknown"


def _gaps(folder: Path, metrics: Mapping[str, Any] | None, settings: Mapping[str, Any] | None) -> list[str]:
    """What a finished run lacks, a sentence each."""
    path = folder / "metrics.json"
    if metrics is None:
        return [f"{path} is missing."]
    gaps = [f"{path} lacks {name!r}: not the metrics of a run." for name in (*NUMBERS, "search") if name not in metrics]
    gaps += [
        f"{path}: {name!r} must be a number, not {metrics[name]!r}."
        for name in NUMBERS
        if name in metrics and (isinstance(metrics[name], bool) or not isinstance(metrics[name], int | float))
    ]
    return gaps if settings is not None else [*gaps, f"{folder / 'config.yaml'} is missing."]


def with_history(record: RunRecord) -> RunRecord:
    """The run with its history.csv, if it came from a search; "broken" if that is damaged."""
    path = record.folder / "history.csv"
    if not path.is_file():
        return record
    try:
        return replace(record, history=_read_history(path))
    except HopdiffError as error:
        return replace(record, status=BROKEN, sentence=str(error))


def _read_history(path: Path) -> dict[str, NDArray[np.float64]]:
    header, *rows = [line for line in read_text(path).splitlines() if line] or [""]
    names = header.split(",")
    if not rows or not {"spent", "best"} <= set(names):
        raise HopdiffError(f"{path} is not the history of a search: it needs columns 'spent' and 'best', and a row.")
    try:
        if any(row.count(",") != len(names) - 1 for row in rows):
            raise ValueError(header)
        columns = np.loadtxt(rows, delimiter=",", ndmin=2, usecols=[names.index(name) for name in ("spent", "best")])
    except ValueError as error:
        raise HopdiffError(f"{path}, line {_wrong_line(rows, len(names))}: not {len(names)} numbers.") from error
    return {"spent": columns[:, 0], "best": columns[:, 1]}


def _wrong_line(rows: list[str], count: int) -> int:
    for number, row in enumerate(csv.reader(rows), start=2):
        try:
            if len([float(cell) for cell in row]) != count:
                return number
        except ValueError:
            return number
    return 2
