# No `from __future__ import annotations`: OmegaConf reads the types of the settings classes.
"""task=compare: lay the runs below a folder over each other."""

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from statistics import median
from typing import Any

from hopdiff.io.record import prepare_folder, write_table
from hopdiff.messages import plural, say
from hopdiff.runs.folders import BROKEN, RunRecord, Survey, survey, with_history
from hopdiff.runs.groups import Groups, complete, grouped, problem_of, shown, standings
from hopdiff.runs.settings import CHOICES
from hopdiff.runs.table import rows_of
from hopdiff.tasks.base import Call, Task, Work
from hopdiff.types import HopdiffError

DRAWN = ("complete", "interrupted")
SILENT = ("compare",)  # foreign folders that nobody would miss
MOST_LINES = 40  # of the printed table
MOST_REASONS = 10
MOST_NAMES = 5  # of folders in a sentence
# The printed table: heading, metric, format; each the median of a group. The file holds every metric of every run.
COLUMNS = (
    ("energy", "energy_rate", ".3f"),
    ("target", "energy_target", ".3f"),
    ("contact", "contact_time", ".3f"),
    ("flight", "flight_time", ".3f"),
    ("steps/s", "step_frequency", ".2f"),
    ("seconds", "wall_seconds", ".1f"),
)


@dataclass
class CompareTask:
    """runs: the folder with run folders below it."""

    runs: str | None


def build(call: Call) -> Work:
    """Read the runs. Raises HopdiffError if no folder is given, or there is none."""
    runs = call.own.runs
    if runs is None:
        raise HopdiffError("task=compare needs runs=FOLDER, a folder with run folders in it.")
    found = survey(Path(runs))
    _check_drawn(runs, found, found.runs)
    return lambda folder: compare(Path(runs), folder.path, found)


def compare(runs: Path, folder: Path, found: Survey | None = None) -> None:
    """Draw and tabulate all runs below `runs`; writes into `folder` and prints a table of their groups.

    found: what lies below `runs`, where that is known already.

    Runs that failed, or cannot be read, have a row in comparison.csv and are drawn nowhere. Interrupted searches are
    hollow dots in the summary and count in no median or curve: they had less to spend than the others.
    Raises HopdiffError if no run is left, or the folder cannot be written.
    """
    found = found or survey(runs)
    records = [with_history(record) if record.status in DRAWN else record for record in found.runs]
    drawn = [record for record in records if record.status in DRAWN]
    _check_drawn(runs, found, records)
    told = left_out(found, records)
    groups = grouped(drawn)
    prepare_folder(folder)
    rows = rows_of(records)
    write_table(folder / "comparison.csv", list(rows[0]), [list(row.values()) for row in rows])
    # What draws and writes events takes most of a second to load, which a sweep should not wait for at its start.
    pictures = import_module("hopdiff.tasks.compare_pictures")
    # TensorBoard takes its columns from one folder for all that it shows, which should be these runs and no others.
    beside = folder.resolve().is_relative_to(runs.resolve())
    notes = pictures.draw(folder, groups.records, varied_words(drawn) if beside else {})
    say("\n".join(group_lines(groups)))
    for note in [*cautions(groups), *notes, *flags(drawn), *(f"Left out: {phrase}." for phrase in told)]:
        say(note)
    count = len({(problem_of(record), record.series) for record in groups.records})
    place = folder.relative_to(Path.cwd()) if folder.is_relative_to(Path.cwd()) else folder
    say(f"{plural(len(drawn), 'run')} in {plural(count, 'group')}; files: {place}")


def _check_drawn(runs: str | Path, found: Survey, records: Sequence[RunRecord]) -> None:
    if not any(record.status in DRAWN for record in records):
        told = "; ".join(left_out(found, records)) or "there is no run folder in it"
        raise HopdiffError(f"runs={runs} holds no run that can be compared: {told}.")


def left_out(found: Survey, records: Iterable[RunRecord]) -> list[str]:
    """Why folders are not compared, a phrase for every reason with the first of their names."""
    reasons: dict[str, list[str]] = {}
    for record in records:
        if record.status == "failed":
            reasons.setdefault(f"failed ({_bare(record.sentence) or 'no reason told'})", []).append(record.label)
        elif record.status == "running":
            reasons.setdefault("still running, or ended from outside", []).append(record.label)
        elif record.status == BROKEN:
            reasons.setdefault(_bare(record.sentence), [])  # which names the file
    for task, labels in found.foreign.items():
        if task not in SILENT:
            reasons[f"no run, but task={task}"] = labels
    told = [f"{_named(labels)}: {reason}" if labels else reason for reason, labels in reasons.items()]
    if (more := len(told) - MOST_REASONS) > 0:
        told[MOST_REASONS:] = [f"and {more} more, see comparison.csv"]
    return told


def _bare(sentence: str | None) -> str:
    return (sentence or "").rstrip(".")


def _named(labels: Sequence[str]) -> str:
    more = len(labels) - MOST_NAMES
    return ", ".join(labels[:MOST_NAMES]) + (f" and {more} more" if more > 0 else "")


def flags(records: Iterable[RunRecord]) -> list[str]:
    """The notes that runs bear, a sentence each."""
    noted: dict[str, list[str]] = {}
    for record in records:
        for note in record.notes:
            noted.setdefault(note, []).append(record.label)
    return [f"Noted: {note} in {_named(labels)}." for note, labels in noted.items()]


def varied_words(records: Sequence[RunRecord]) -> dict[str, list[Any]]:
    """What was typed and differs among runs, with its values: "search" is ["ga", "gradient"]."""
    names = dict.fromkeys(name for record in records for name in record.typed)
    values = {name: list(dict.fromkeys(r.typed[name] for r in records if name in r.typed)) for name in names}
    absent = {name for name in names if any(name not in record.typed for record in records)}
    return {name: found for name, found in values.items() if len(found) > 1 or name in absent}


def group_lines(groups: Groups) -> list[str]:
    """The table of the groups, a line each: what differs first, then how many runs, cost, and medians.

    Of more groups than anybody reads it is a table of the series, and how they do at all speeds and betas.
    """
    parts: dict[Any, list[RunRecord]] = {}
    for record in groups.records:
        parts.setdefault((problem_of(record), record.series), []).append(record)
    if len(parts) > MOST_LINES and len({problem for problem, _ in parts}) > 1:
        return [_same(groups), *_series_table(groups), f"{len(parts)} groups are not listed: see comparison.csv."]
    lines = [_line(runs, groups) for runs in parts.values()]
    lines.sort(key=lambda line: (line["speed"], line["beta"], not line["runs"], line["median cost"]))
    columns = _columns(lines, groups.told)
    return [_same(groups), *_table(columns, lines)]


def _series_table(groups: Groups) -> list[str]:
    count = Counter(record.series.name for record in complete(groups.records))
    columns = {**dict.fromkeys(groups.told, ""), "runs": "d", "problems": "d", "best at": "d", "mean place": ".2f"}
    lines = [
        {
            **_values(groups, name),
            "runs": count[name],
            "problems": known.problems,
            "best at": known.first,
            "mean place": known.place if known.problems else None,
        }
        for name, known in sorted(standings(groups.records).items(), key=lambda item: item[1].place)
    ]
    note = "Problems are speeds and betas; mean place by median cost among the series of a problem, 0 first, 1 last."
    return [*_table(columns, lines), note]


def _table(columns: Mapping[str, str], lines: Sequence[Mapping[str, Any]]) -> list[str]:
    """Text with a heading. columns: name in a line -> format."""
    heading = [name.removesuffix(".name") if name.count(".") == 1 else name for name in columns]
    rows = [[_cell(line[name], form) for name, form in columns.items()] for line in lines[:MOST_LINES]]
    more = len(lines) - MOST_LINES
    return [as_text([heading, *rows]), *([f"and {more} more: see comparison.csv."] if more > 0 else [])]


def _values(groups: Groups, series: str) -> dict[str, str]:
    """The settings that a series is told by, as one types them."""
    known = groups.values[series]
    return {name: shown(known[name]) if name in known else "-" for name in groups.told}


def _line(runs: Sequence[RunRecord], groups: Groups) -> dict[str, Any]:
    finished = complete(runs)
    costs = [record.metrics["cost"] for record in finished or runs]
    first = runs[0]
    return {
        "speed": first.metrics["speed"],
        "beta": first.metrics["beta"],
        **_values(groups, first.series.name),
        "runs": len(finished),
        "interrupted": len(runs) - len(finished),
        "median cost": median(costs),
        "best": min(costs),
        "worst": max(costs),
        **{heading: _median(finished or runs, metric) for heading, metric, _ in COLUMNS},
    }


def _median(runs: Sequence[RunRecord], metric: str) -> float | None:
    values = [record.metrics[metric] for record in runs if isinstance(record.metrics.get(metric), int | float)]
    return median(values) if values else None


def _columns(lines: Sequence[Mapping[str, Any]], told: Sequence[str]) -> dict[str, str]:
    """The columns that say something, with their formats."""
    columns = {name: "g" for name in ("speed", "beta") if len({line[name] for line in lines}) > 1}
    columns |= dict.fromkeys(told, "")
    if any(line["runs"] > 1 for line in lines):
        columns |= {"runs": "d", "median cost": ".4f", "best": ".4f", "worst": ".4f"}
    else:
        columns |= {"median cost": ".4f"}
    if any(line["interrupted"] for line in lines):
        columns |= {"interrupted": "d"}
    return columns | {heading: form for heading, _, form in COLUMNS}


def _cell(value: Any, form: str) -> str:
    return "-" if value is None else format(value, form)


def _same(groups: Groups) -> str:
    """What all runs have in common, of what one would ask for first."""
    speeds, betas = ({problem_of(record)[i] for record in groups.records} for i in (0, 1))
    parts = [f"{speed:g} m/s" for speed in speeds if len(speeds) == 1]
    parts += [f"beta {beta:g}" for beta in betas if len(betas) == 1]
    for choice in CHOICES:
        values = {record.settings.get(f"{choice}.name") for record in groups.records}
        if choice != "task" and f"{choice}.name" not in groups.told and len(values) == 1 and None not in values:
            parts.append(f"{choice} {values.pop()}")
    return f"All: {', '.join(parts)}." if parts else "Nothing is the same in all."


def cautions(groups: Groups) -> list[str]:
    """What a reader of the costs has to know."""
    other = [name for name in groups.told if name.split(".")[0] in ("costs", "model")]
    return [f"Costs compare only where {' and '.join(other)} are the same."] if other else []


def as_text(rows: Sequence[Sequence[str]]) -> str:
    """Columns side by side, numbers to the right."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return "\n".join("  ".join(cell.rjust(width) for cell, width in zip(row, widths, strict=True)) for row in rows)


TASK = Task(build, CompareTask)
