"""The runs below a folder as one table."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from hopdiff.runs.folders import RunRecord, survey
from hopdiff.runs.settings import Differences
from hopdiff.types import HopdiffError

LEADING = ("run", "status", "sentence", "notes")


def run_rows(folder: Path) -> list[dict[str, Any]]:
    """One row a run at or below a folder. Raises HopdiffError if there is no such folder, or no run in it."""
    runs = survey(folder).runs
    if not runs:
        raise HopdiffError(f"{folder} holds no run: no metrics.json and no status.json of one was found.")
    return rows_of(runs)


def rows_of(records: Sequence[RunRecord]) -> list[dict[str, Any]]:
    """One row a run, all with the same columns: run, status, sentence, notes, settings that differ, seed, metrics.

    notes: the flags, with blanks between them. What a run lacks is None.
    """
    settings = [name for name in differing(records) if name != "seed"]
    metrics = dict.fromkeys(name for record in records for name in record.metrics)
    columns = dict.fromkeys([*LEADING, *settings, "seed", *metrics])
    rows = []
    for record in records:
        known = {"run": record.label, "status": record.status, "sentence": record.sentence}
        known["notes"] = " ".join(record.notes)
        # A run that failed has no metrics, but settings of the same names: speed, beta, seed.
        told = {name: record.settings[name] for name in columns if name in record.settings}
        rows.append({**columns, **told, **record.metrics, **known})
    return rows


def differing(records: Sequence[RunRecord]) -> list[str]:
    """The settings that differ among runs, in the order of config.yaml."""
    return Differences(
        [record.settings for record in records],
        [record.typed for record in records],
        [record.whole for record in records],
    ).names()
