"""From settings to a task that is done."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

from omegaconf import DictConfig, OmegaConf

from hopdiff.character import Character
from hopdiff.config import (
    build_character,
    build_exports,
    build_job,
    build_request,
    build_route,
    checked,
    config_folder,
    plain_settings,
    with_saved,
)
from hopdiff.io.genes_file import GenesFile, read_genes
from hopdiff.messages import choose
from hopdiff.tasks.body import body
from hopdiff.tasks.compare import compare
from hopdiff.tasks.edit import run_edit
from hopdiff.tasks.export import export, export_result, sources_of
from hopdiff.tasks.hopper import hopper
from hopdiff.tasks.job import threads
from hopdiff.tasks.navigate import NavigateSettings, navigate
from hopdiff.tasks.path import run_path
from hopdiff.tasks.replay import replay
from hopdiff.tasks.run import run
from hopdiff.types import HopdiffError

TASKS = ("run", "replay", "compare", "path", "edit", "navigate", "export", "hopper", "body")
MOTIONS = ("run", "replay", "path", "edit", "navigate")  # tasks whose folders hold a motion


def perform(config: DictConfig, folder: Path, command: Sequence[str]) -> bool:
    """Do the task of a config in a folder. command: the overrides typed by the user.

    Returns whether the user broke it off. Raises HopdiffError for whatever the user can put right.
    """
    task = choose("task.name", config.task.name, TASKS)
    exports = build_exports(config)
    if task == "export":
        settings = checked(config)
        export(sources_of(settings.run, settings.runs), exports, folder, plain_settings(config), list(command))
        return False
    if exports and task not in MOTIONS:
        raise HopdiffError(f"export has no effect with task={task}, which makes no motion.")
    interrupted = _performed(task, config, folder, command)
    if exports:
        export_result(folder, exports)
    return interrupted


def _performed(task: str, config: DictConfig, folder: Path, command: Sequence[str]) -> bool:
    """Any task but export; returns whether the user broke it off."""
    match task:
        case "compare":
            if (runs := checked(config).runs) is None:
                raise HopdiffError("task=compare needs runs=FOLDER, a folder with run folders in it.")
            compare(Path(runs), folder)
            return False
        case "replay":
            if config.genes_file is None:
                raise HopdiffError("task=replay needs genes_file=FILE, the genes.json of a run.")
            if "experiment" in (typed := typed_names(command)):
                raise HopdiffError(
                    "+experiment has no effect with task=replay: type single settings, as limp.amount=0.3."
                )
            genes = read_genes(Path(config.genes_file))
            job = build_job(with_saved(config, genes.settings, typed))
            original = original_body(config, genes)
            with threads(job.threads):
                replay(job, genes, original, folder, list(command))
            return False
        case "path":
            typed = typed_names(command)
            if "speed" in typed:
                raise HopdiffError("speed cannot be set with task=path: path.time and the length of the path give it.")
            if "path.points" in typed and "path.file" in typed:
                raise HopdiffError("path.points and path.file are both set: give the path by one of them.")
            route = build_route(config)
            OmegaConf.update(config, "speed", route.speed)
            path_job = build_job(config)
            with threads(path_job.threads):
                return run_path(path_job, route, folder, list(command))
        case "edit":
            request, how = build_request(config)
            settings = checked(config)
            with threads(settings.threads):
                clip = settings.clip or build_job(config)
                return run_edit(clip, request, how, plain_settings(config), folder, list(command))
        case "navigate":
            settings = checked(config)
            wish = NavigateSettings(settings.clips, settings.scene, settings.start, settings.goal)
            scenes = config_folder() / "scenes"
            with threads(settings.threads):
                navigate(wish, settings.graph, settings.way, scenes, plain_settings(config), folder, list(command))
            return False
        case "hopper":
            settings = checked(config)
            with threads(settings.threads):
                hopper(settings.hopper, settings.speed, plain_settings(config), folder, list(command))
            return False
        case "body":
            body(build_character(config), plain_settings(config), folder, list(command))
            return False
        case _:
            job = build_job(config)
            with threads(job.threads):
                return run(job, folder, list(command))


def original_body(config: DictConfig, genes: GenesFile) -> Character:
    """The body that genes were found for. Raises HopdiffError, naming the file."""
    saved = {name: value for name, value in genes.settings.items() if name == "character"}
    try:
        return build_character(with_saved(config, saved, ()))
    except HopdiffError as error:
        raise HopdiffError(f"genes_file {str(genes.path)!r}, of its saved settings: {error}") from error


def typed_names(overrides: Sequence[str]) -> list[str]:
    """The dotted names of the settings in overrides such as "speed=3", "+experiment=brisk", "~search"."""
    return [re.split("[=@:]", override.lstrip("+~"), maxsplit=1)[0] for override in overrides]
