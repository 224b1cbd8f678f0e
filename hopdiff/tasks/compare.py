"""task=compare: lay the runs below a folder over each other."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from hopdiff.io.events import write_events
from hopdiff.io.record import prepare_folder, write_table
from hopdiff.types import HopdiffError

COLUMNS = (
    "speed",
    "beta",
    "search",
    "model",
    "seed",
    "cost",
    "energy_rate",
    "energy_target",
    "gamma",
    "contact_time",
    "flight_time",
    "step_frequency",
    "com_oscillation",
    "evaluations",
    "gradient_evaluations",
    "wall_seconds",
)


def find_runs(folder: Path) -> list[Path]:
    """All run folders at or below a folder, in the order of their settings' names.

    Raises HopdiffError if there is no such folder, or no run in it.
    """
    if not folder.is_dir():
        raise HopdiffError(f"runs={folder} is not a folder.")
    found = sorted((path.parent for path in folder.rglob("metrics.json")), key=_natural)
    if not found:
        raise HopdiffError(f"runs={folder} holds no run: no metrics.json was found in it or below it.")
    return found
