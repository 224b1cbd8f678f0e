"""The runs of this study: those that it makes, those of folders, and captured clips; each as one row of numbers."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any

import yaml

import hopdiff
from experiments.realism.measure import Measured, Row, measured, measured_clip
from experiments.realism.people import compared
from experiments.realism.recording import Array
from hopdiff.types import HopdiffError

FPS = 240.0  # frames/s of the runs that are made here, so that contacts are known to a few ms
CLIPS = ("run_cmu_16_35", "run_turn_left90_cmu_16_42")  # of a folder of captured clips, those that run
MODEL = "body"
CAPTURED = "captured"  # in the place of the costs of a captured clip
UNKNOWN = float("nan")


@dataclass(frozen=True)
class Entry:
    """One stride.

    costs: name of the settings that a run was judged by, and of the model unless that is MODEL. row: its numbers, with
    the asked_speed, beta and seed of a run (NaN of a clip) and the distances from people's curves. curves: (N,) [deg]
    by name.
    """

    name: str
    costs: str
    row: Row
    curves: dict[str, Array]


def made(
    costs: Sequence[str],
    speeds: Sequence[float],
    betas: Sequence[float],
    seeds: Sequence[int],
    keep: Path,
    processes: int,
    more: dict[str, Any],
) -> tuple[list[Entry], list[str]]:
    """Runs searched for now and kept below a folder, and what went wrong with the others."""
    asked = [(*run, keep, more) for run in product(costs, speeds, betas, seeds)]
    results = []
    with ProcessPoolExecutor(processes) as pool:
        for run, result in zip(asked, pool.map(make, *zip(*asked, strict=True)), strict=True):
            print(f"costs={run[0]} {run[1]:g} m/s beta {run[2]:g} seed {run[3]}: {_told(result)}", flush=True)
            results.append(result)
    entries = [one for one in results if isinstance(one, Entry)]
    return entries, [one for one in results if isinstance(one, str)]


def make(costs: str, speed: float, beta: float, seed: int, keep: Path, more: dict[str, Any]) -> Entry | str:
    """One run, or in one sentence why there is none."""
    label = f"{speed:g}_{beta:g}_{seed}"
    try:
        run = hopdiff.generate(speed, beta, seed=seed, fps=FPS, settings=(f"costs={costs}",), **more)
        files = hopdiff.save(run, keep / costs / label, "npz", settings=("exports.npz.joints=full",))
        return entry(measured(files[0]), label, costs)
    except (HopdiffError, ValueError) as error:
        return f"costs={costs}, {speed:g} m/s, beta {beta:g}, seed {seed}: {error}"


def found(folder: Path) -> tuple[list[Entry], list[str]]:
    """Runs in archives anywhere below a folder, one a folder (motion.npz if it is there), and what is wrong with
    others."""
    archives: dict[Path, Path] = {}
    for path in sorted(folder.rglob("*.npz"), key=lambda path: (path.name != "motion.npz", path)):
        archives.setdefault(path.parent, path)
    entries, failures = [], []
    for path in sorted(archives.values()):
        try:
            entries.append(entry(measured(path), path.parent.name, costs_of(path, folder)))
        except (ValueError, KeyError) as error:
            failures.append(f"{path.relative_to(folder)}: {error}")
    return entries, failures


def costs_of(path: Path, folder: Path) -> str:
    """Name of the costs of a run: as its config.yaml says, else the first folder on the way to it."""
    config = path.parent / "config.yaml"
    if config.is_file():
        return str(yaml.safe_load(config.read_text(encoding="utf-8"))["costs"]["name"])
    inside = path.relative_to(folder).parts
    return inside[0] if len(inside) > 1 else folder.name


def captured(folder: Path | None) -> tuple[list[Entry], list[str]]:
    """The strides of the captured runs of a folder, and why others are missing."""
    if folder is None:
        return [], ["Captured clips are left out: --clips names no folder."]
    entries, missing = [], []
    for name in CLIPS:
        path = folder / f"{name}.bvh"
        if not path.is_file():
            missing.append(f"{name} is left out: the folder of clips has no such file.")
            continue
        strides, left_out = measured_clip(path)
        entries += [entry(stride, stride.name, CAPTURED) for stride in strides]
        missing += left_out or ([] if strides else [f"{name} is left out: it holds no whole stride."])
    return entries, missing


def entry(stride: Measured, name: str, costs: str) -> Entry:
    """The row of a stride: what was measured, what was asked for, and how far its curves are from people's."""
    about = {
        "asked_speed": stride.about.get("speed"),
        "beta": stride.about.get("beta"),
        "seed": stride.about.get("seed"),
        "energy_rate": stride.about.get("energy_rate"),
    }
    row = {key: UNKNOWN if value is None else float(value) for key, value in about.items()}
    speed = stride.row["speed"] if costs == CAPTURED else row["asked_speed"]
    if (model := stride.about.get("model", MODEL)) != MODEL:
        costs = f"{costs} model={model}"
    return Entry(name, costs, row | stride.row | compared(stride.curves, speed), stride.curves)


def by_costs(entries: Sequence[Entry]) -> Iterator[tuple[str, list[Entry]]]:
    """Runs that were judged alike, in the order in which their costs turn up; captured clips left out."""
    for costs in dict.fromkeys(one.costs for one in entries if one.costs != CAPTURED):
        yield costs, [one for one in entries if one.costs == costs]


def _told(result: Entry | str) -> str:
    if isinstance(result, str):
        return "failed"
    return f"contact {result.row['contact_time']:.3f} s, knee RMSE {result.row['rmse_knee']:.1f} deg"
