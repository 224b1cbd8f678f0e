"""The runs that are exported, and every preset that they are exported with."""

from __future__ import annotations

import math
from dataclasses import fields, replace
from pathlib import Path

import yaml

from hopdiff.composing import compose
from hopdiff.config import build_job, checked, typed
from hopdiff.doors import config_folder
from hopdiff.export.settings import ExportSettings
from hopdiff.export.take import Take
from hopdiff.io.bvh import read_bvh
from hopdiff.job import find, search_run
from hopdiff.tasks.path import PathTask, route_of
from hopdiff.tasks.path import path_run as along

CAPTURED = ("run_cmu_16_35", "run_turn_left90_cmu_16_42")  # of a folder of captured clips, those that run
BVH_OPTIONS = {"y": ("-Z", "Y"), "z": ("Y", "Z")}  # up of a file -> what Blender's importer calls forward and up


def presets() -> dict[str, ExportSettings]:
    """The settings of every preset in conf/export/, by name."""
    known = {entry.name for entry in fields(ExportSettings)}
    found = {}
    for file in sorted((config_folder() / "export").glob("*.yaml")):
        values = yaml.safe_load(file.read_text(encoding="utf-8")) or {}
        # Later presets may hold more than what is written with one of these settings.
        found[file.stem] = ExportSettings(**{name: value for name, value in values.items() if name in known})
    return found


def own_runs(evaluations: int, path: bool = True) -> dict[str, Take]:
    """Runs of the smooth model by name: a jog, a brisk run, one along a path if wanted. evaluations: of each search."""
    found = {}
    for name, speed, beta in (("jog", 3.0, 0.2), ("brisk", 5.0, 0.7)):
        asked = ["model=smooth", f"speed={speed}", f"beta={beta}", f"budget.evaluations={evaluations}"]
        job = build_job(compose(asked))
        found[name] = replace(search_run(job).take(), name=name)
    if path:
        found["path"] = path_run(evaluations)
    return found


def path_run(evaluations: int) -> Take:
    """The run of +experiment=path model=smooth."""
    config = compose(["+experiment=path", "model=smooth", f"budget.evaluations={evaluations}"])
    route = route_of(checked(config), typed(config, PathTask))
    config.speed = route.speed
    job = build_job(config)
    return replace(along(job, route, find(job)).take(), name="path")


def captured_clips(folder: Path | None) -> dict[str, Take]:
    """The captured runs of a folder, by name; none without one."""
    if folder is None:
        return {}
    files = [folder / f"{name}.bvh" for name in CAPTURED]
    return {file.stem: Take.of_clip(file.stem, read_bvh(file).clip(), {}) for file in files if file.is_file()}


def lasting(take: Take, seconds: float) -> Take:
    """A loop laid end to end until it lasts some seconds; another motion as it is."""
    return take.repeated(math.ceil(seconds / take.clip.duration)) if take.loop else take


def cut(take: Take, frames: int) -> Take:
    """The first frames of a take, without what is known besides the clip."""
    clip = replace(
        take.clip,
        root_position=take.clip.root_position[:frames],
        rotations=take.clip.rotations[:frames],
        offsets=None if take.clip.offsets is None else take.clip.offsets[:frames],
    )
    return Take(take.name, clip, False)
