"""From settings to a task that is done."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

from omegaconf import DictConfig

from hopdiff.config import build_job, checked, with_saved
from hopdiff.io.genes_file import read_genes
from hopdiff.messages import choose
from hopdiff.tasks.compare import compare
from hopdiff.tasks.job import threads
from hopdiff.tasks.replay import replay
from hopdiff.tasks.run import run
from hopdiff.types import HopdiffError

TASKS = ("run", "replay", "compare")


def perform(config: DictConfig, folder: Path, command: Sequence[str]) -> bool:
    """Do the task of a config in a folder. command: the overrides typed by the user.

    Returns whether the user broke it off. Raises HopdiffError for whatever the user can put right.
    """
    match choose("task.name", config.task.name, TASKS):
        case "compare":
            if (runs := checked(config).runs) is None:
                raise HopdiffError("task=compare needs runs=FOLDER, a folder with run folders in it.")
            compare(Path(runs), folder)
            return False
        case "replay":
            if config.genes_file is None:
                raise HopdiffError("task=replay needs genes_file=FILE, the genes.json of a run.")
            genes = read_genes(Path(config.genes_file))
            job = build_job(with_saved(config, genes.settings, typed_names(command)))
            with threads(job.threads):
                replay(job, genes, folder, list(command))
            return False
        case _:
            job = build_job(config)
            with threads(job.threads):
                return run(job, folder, list(command))


def typed_names(overrides: Sequence[str]) -> list[str]:
    """The dotted names of the settings in overrides such as "speed=3", "+experiment=brisk", "~search"."""
    return [re.split("[=@:]", override.lstrip("+~"), maxsplit=1)[0] for override in overrides]
