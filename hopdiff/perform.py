"""From settings to a task that is done."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import torch
from omegaconf import DictConfig

from hopdiff.config import build_job, check_numbers, checked, with_saved
from hopdiff.io.genes_file import read_genes
from hopdiff.messages import choose
from hopdiff.tasks.compare import compare
from hopdiff.tasks.replay import replay
from hopdiff.tasks.run import run
from hopdiff.types import HopdiffError

TASKS = ("run", "replay", "compare")


def perform(config: DictConfig, folder: Path, command: Sequence[str]) -> bool:
    """Do the task of a config in a folder. command: the overrides typed by the user.

    Returns whether the user broke it off. Raises HopdiffError for whatever the user can put right.
    """
    settings = checked(config)
    check_numbers(settings)
    with threads(settings.threads):
        match choose("task.name", settings.task.name, TASKS):
            case "compare":
                if settings.runs is None:
                    raise HopdiffError("task=compare needs runs=FOLDER, a folder with run folders in it.")
                compare(Path(settings.runs), folder)
            case "replay":
                if settings.genes_file is None:
                    raise HopdiffError("task=replay needs genes_file=FILE, the genes.json of a run.")
                file = read_genes(Path(settings.genes_file))
                replay(build_job(with_saved(config, file.settings, typed_names(command))), file, folder, list(command))
            case _:
                return run(build_job(config), folder, list(command))
    return False


def typed_names(overrides: Sequence[str]) -> list[str]:
    """The dotted names of the settings in overrides such as "speed=3", "+experiment=brisk", "~search"."""
    return [re.split("[=@:]", override.lstrip("+~"), maxsplit=1)[0] for override in overrides]


@contextmanager
def threads(count: int) -> Iterator[None]:
    """PyTorch with that many threads, and with as many as before afterwards."""
    before = torch.get_num_threads()
    torch.set_num_threads(count)
    try:
        yield
    finally:
        torch.set_num_threads(before)
