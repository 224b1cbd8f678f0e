"""From settings to a task that is done."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from omegaconf import DictConfig

from hopdiff.choices import build_search
from hopdiff.config import checked
from hopdiff.doors import TASKS, load
from hopdiff.io.record import write_record
from hopdiff.io.run_folder import is_complete, opened
from hopdiff.job import threads
from hopdiff.messages import say


def perform(config: DictConfig, folder: Path, command: Sequence[str], resume: bool = False) -> bool:
    """Do the task of a config in a folder. command: the overrides typed by the user.

    resume: a job of a sweep, which is skipped where its run is there already, whole. Returns whether the user broke
    it off. Raises HopdiffError for whatever the user can put right.
    """
    # What is easily mistyped is found before what draws and exports is loaded, which takes longer than all of this.
    settings = checked(config)
    build_search(settings.search)
    task = TASKS.load(settings.task.name, "task.name")
    call = task.call(config, settings, folder, command)
    if resume and not settings.overwrite and is_complete(folder, call.plain):
        say(f"{folder.name}: complete already.")
        return False
    with threads(settings.threads):
        work = task.build(call)
        with opened(folder, settings.task.name, command, call.plain, settings.overwrite) as run:
            write_record(folder, call.plain, call.command)
            work(run)
            if call.exports and task.motion:
                load("hopdiff.tasks.export", "export_result")(run, call.exports)
    return run.interrupted
