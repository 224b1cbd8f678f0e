"""From settings to a task that is done."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from omegaconf import DictConfig

from hopdiff.doors import TASKS
from hopdiff.io.run_folder import is_complete, opened
from hopdiff.job import threads
from hopdiff.tasks.base import Task
from hopdiff.tasks.export import export_result
from hopdiff.tasks.results import write_record


def perform(config: DictConfig, folder: Path, command: Sequence[str], resume: bool = False) -> bool:
    """Do the task of a config in a folder. command: the overrides typed by the user.

    resume: a job of a sweep, which is skipped where its run is there already, whole. Returns whether the user broke
    it off. Raises HopdiffError for whatever the user can put right.
    """
    name = str(config.task.name)
    task: Task = TASKS.load(name, "task.name")
    call = task.call(config, folder, command)
    if resume and not call.settings.overwrite and is_complete(folder, call.plain):
        print(f"{folder.name}: complete already.", flush=True)
        return False
    with threads(call.settings.threads):
        work = task.build(call)
        with opened(folder, name, command, call.plain, call.settings.overwrite) as run:
            write_record(folder, call.plain, call.command)
            work(run)
            if call.exports and task.motion:
                export_result(folder, call.exports)
    return run.interrupted
