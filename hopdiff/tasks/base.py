"""What a task is: one verb of the command line, with settings of its own."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

from omegaconf import DictConfig

from hopdiff.config import Config, build_job, check_names, plain_settings, typed
from hopdiff.export.request import Exports
from hopdiff.io.run_folder import RunFolder
from hopdiff.job import Job
from hopdiff.plots.encoders import check_film
from hopdiff.types import HopdiffError


@dataclass
class NoSettings:
    """Of a task that asks for nothing besides what all tasks share."""


@dataclass(frozen=True)
class Call:
    """What a task is called with. config: the composed settings. own: those of the task, checked for their types.

    folder: where it shall write. command: the overrides typed by the user. exports: what export=[...] asks for.
    """

    config: DictConfig
    settings: Config
    own: Any
    folder: Path
    command: list[str]
    exports: Exports

    @cached_property
    def plain(self) -> dict[str, Any]:
        """The whole configuration as plain data."""
        return plain_settings(self.config)

    def job(self) -> Job:
        """What a search or a replay needs, checked. Raises HopdiffError, naming the setting."""
        return build_job(self.config, settings=self.settings)


Work = Callable[[RunFolder], None]


@dataclass(frozen=True)
class Task:
    """One verb. build: checks all that can be checked, reads what is to be read, and returns the work; nothing is
    written before. The work writes into its folder, tells the user, and marks the folder if it was broken off.

    settings: class of its own settings, whose fields are top-level names; their defaults stand in conf/task/NAME.yaml,
    or, of a task of another package, in `defaults`. motion: whether its folder holds a motion that export=[...] can
    write. exports: whether it takes export=[...] although it makes no motion.
    """

    build: Callable[[Call], Work]
    settings: type = NoSettings
    motion: bool = False
    exports: bool = False
    defaults: dict[str, Any] = field(default_factory=dict)

    def call(self, config: DictConfig, settings: Config, folder: Path, command: Sequence[str]) -> Call:
        """The call of a composed config. settings: those that all tasks share, checked.

        Raises HopdiffError, naming the setting, for what cannot be.
        """
        check_names(config, Config, self.settings)
        check_film(settings.animation, settings.pictures)
        exports = Exports.build(settings.exports, settings.retarget)
        if exports and not (self.motion or self.exports):
            raise HopdiffError(f"export has no effect with task={settings.task.name}, which makes no motion.")
        return Call(config, settings, typed(config, self.settings), folder, list(command), exports)
