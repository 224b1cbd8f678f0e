"""Run folders made up for tests: what is read of them, without the motion."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import yaml

SETTINGS: dict[str, Any] = {
    "speed": 5.0,
    "beta": 0.2,
    "seed": 0,
    "fps": 60.0,
    "genes_file": None,
    "pictures": True,
    "budget": {"evaluations": 400, "target": None},
    "task": {"name": "run", "label": "run"},
    "model": {"name": "smooth", "step": 0.005},
    "search": {"name": "ga", "population": 100, "elites": 8},
    "character": {"name": "human", "proportions": {"legs": 1.0}},
    "costs": {"name": "default", "energy": 1.0},
    "genes": {"name": "default", "common_eta": False, "fixed": {}},
    "path": {"points": [], "time": None},
    "exports": {},
}


def with_values(values: Mapping[str, Any]) -> dict[str, Any]:
    """The whole settings of a run with some of them set by their dotted names."""
    settings = json.loads(json.dumps(SETTINGS))
    for name, value in values.items():
        place = settings
        *parents, last = name.split(".")
        for parent in parents:
            place = place.setdefault(parent, {})
        place[last] = value
    return settings


def metrics_of(settings: Mapping[str, Any], cost: float = 1.0) -> dict[str, Any]:
    asked = {name: settings[name] for name in ("speed", "beta", "seed")}
    reached = {"cost": cost, "energy_rate": 0.26, "energy_target": 0.25, "wall_seconds": 2.0, "contact_time": 0.2}
    return {**asked, **reached, "search": settings["search"]["name"], "model": settings["model"]["name"]}


def state(status: str = "complete", **more: Any) -> dict[str, Any]:
    task = {"version": 1, "status": status, "sentence": None, "task": "run", "overrides": [], "notes": []}
    return {**task, "started": "2026-01-01T00:00:00", "ended": "2026-01-01T00:01:00", **more}


def make_run(
    folder: Path,
    values: Mapping[str, Any] | None = None,
    cost: float = 1.0,
    best: tuple[float, ...] = (3.0, 2.0, 1.0),
    status: Mapping[str, Any] | None = None,
) -> Path:
    """A finished run of a search. values: settings by their dotted names; status: of status.json, None for no file."""
    folder.mkdir(parents=True)
    settings = with_values(values or {})
    (folder / "config.yaml").write_text(yaml.safe_dump(settings, sort_keys=False))
    (folder / "metrics.json").write_text(json.dumps(metrics_of(settings, cost)))
    rows = [f"{step},{100.0 * (step + 1)},{value}" for step, value in enumerate(best)]
    (folder / "history.csv").write_text("\n".join(["step,spent,best", *rows]) + "\n")
    if status is not None:
        (folder / "status.json").write_text(json.dumps(status))
    return folder


def make_failed(folder: Path, sentence: str = "No run.", words: tuple[str, ...] = ()) -> Path:
    """A job that failed before it wrote anything else."""
    folder.mkdir(parents=True)
    (folder / "status.json").write_text(json.dumps(state("failed", sentence=sentence, overrides=list(words))))
    return folder
