# No `from __future__ import annotations`: OmegaConf reads the types of the settings classes.
"""task=compare: lay the runs below a folder over each other."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hopdiff.io.events import write_events
from hopdiff.io.record import prepare_folder, write_table
from hopdiff.plots.compare import RunRecord, compare_figures, read_run
from hopdiff.plots.save import save_figure
from hopdiff.plots.scaled import can_scale, scaled_convergence_figure
from hopdiff.tasks.base import Call, Task, Work
from hopdiff.tasks.results import shown
from hopdiff.types import HopdiffError

# The printed table: heading, metric, format. The file holds every metric.
COLUMNS = (
    ("speed", "speed", ".2f"),
    ("beta", "beta", ".2f"),
    ("search", "search", ""),
    ("model", "model", ""),
    ("costs", "costs", ""),
    ("character", "character", ""),
    ("genes", "genes", ""),
    ("seed", "seed", ""),
    ("cost", "cost", ".4f"),
    ("eval", "eval", ".4f"),
    ("gamma", "gamma", ".3f"),
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
    """Raises HopdiffError if no folder is given."""
    runs = call.own.runs
    if runs is None:
        raise HopdiffError("task=compare needs runs=FOLDER, a folder with run folders in it.")
    find_runs(Path(runs))
    return lambda folder: compare(Path(runs), folder.path)


def compare(runs: Path, folder: Path) -> None:
    """Draw and tabulate all runs below `runs`; writes into `folder` and prints the table.

    Raises HopdiffError if there is no run, a run cannot be read, or the folder cannot be written.
    """
    found = find_runs(runs)
    records = [read_run(path) for path in found]
    prepare_folder(folder)
    names = [str(path.relative_to(runs)) if path != runs else path.name for path in found]
    write_comparison(folder / "compare.csv", names, records)
    pictures = {}
    figures = compare_figures(records)
    if can_scale(records):
        figures["scaled"] = scaled_convergence_figure(records)
    for name, figure in figures.items():
        pictures[name] = folder / f"{name}.png"
        save_figure(figure, pictures[name])
    write_events(folder, pictures=pictures)
    print(as_text([[heading for heading, _, _ in COLUMNS], *(_row(record.metrics) for record in records)]))
    print(f"\n{len(records)} runs; files: {shown(folder)}", flush=True)


def find_runs(folder: Path) -> list[Path]:
    """All run folders at or below a folder, numbers in their names in order.

    Raises HopdiffError if there is no such folder, or no run in it.
    """
    if not folder.is_dir():
        raise HopdiffError(f"runs={folder} is not a folder.")
    found = sorted((path.parent for path in folder.rglob("metrics.json") if not _aside(path)), key=_natural)
    if not found:
        raise HopdiffError(f"runs={folder} holds no run: no metrics.json was found in it or below it.")
    return found


def _aside(metrics: Path) -> bool:
    """Whether these are the metrics of task=body or task=hopper, which are no runs."""
    return any(metrics.with_name(name).is_file() for name in ("body.csv", "frames.csv"))


def write_comparison(path: Path, names: Sequence[str], records: Sequence[RunRecord]) -> None:
    """A CSV file with a row a run and a column a metric; a metric that a run lacks is left empty."""
    metrics = list(dict.fromkeys(name for record in records for name in record.metrics))
    rows = ([name, *(record.metrics.get(m) for m in metrics)] for name, record in zip(names, records, strict=True))
    write_table(path, ["run", *metrics], rows)


def as_text(rows: Sequence[Sequence[str]]) -> str:
    """Columns side by side, numbers to the right."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return "\n".join("  ".join(cell.rjust(width) for cell, width in zip(row, widths, strict=True)) for row in rows)


def _row(metrics: dict[str, Any]) -> list[str]:
    return [format(metrics[key], form) if metrics.get(key) is not None else "-" for _, key, form in COLUMNS]


def _natural(path: Path) -> list[tuple[int, str]]:
    """A key that sorts 10_b after 9_a."""
    return [(int(part), "") if part.isdigit() else (-1, part) for part in re.split(r"(\d+)", str(path))]


TASK = Task(build, CompareTask)
