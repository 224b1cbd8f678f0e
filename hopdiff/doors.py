"""How things are found by their names: searches, tasks, exports, cost terms, bodies.

Our own are modules of their kind's package, called like the thing; those of other packages are entry points. Nothing is
imported before it is asked for, and nothing but these two can be named: no settings or genes file names code.
"""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from typing import Any

from hopdiff.messages import choose, one_line
from hopdiff.types import HopdiffError


@dataclass(frozen=True)
class Door:
    """One kind of thing. what: how messages call it. package: of our own, a module each, which hold it as `attribute`.

    points: group of entry points. listed: gives the names of our own.
    """

    what: str
    package: str
    attribute: str
    points: str
    listed: Callable[[Door], list[str]]

    @property
    def own(self) -> list[str]:
        """Names of what hopdiff brings itself."""
        return self.listed(self)

    @property
    def brought(self) -> dict[str, EntryPoint]:
        """What installed packages bring, by name; our own names stay ours."""
        return {point.name: point for point in entry_points(group=self.points) if point.name not in self.own}

    def names(self) -> list[str]:
        """All names."""
        return [*self.own, *sorted(self.brought)]

    def load(self, name: str, setting: str | None = None) -> Any:
        """What a name stands for. setting: that it was given in, for the message.

        Raises HopdiffError for an unknown name, or a thing of another package that cannot be imported.
        """
        choose(setting or self.what, name, self.names())
        if name in self.own:
            return load(f"{self.package}.{name}", self.attribute)
        return loaded(self.what, self.brought[name])


def loaded(what: str, point: EntryPoint) -> Any:
    """What an entry point stands for. Raises HopdiffError, naming its package, where it cannot be imported."""
    try:
        return point.load()
    except Exception as error:
        package = point.dist.name if point.dist is not None else point.value
        raise HopdiffError(
            f"the {what} {point.name!r} of the package {package} cannot be loaded: {type(error).__name__}:"
            f" {one_line(error)}."
        ) from error


def load(module: str, name: str) -> Any:
    """A name of one of our modules, imported now and not before."""
    return getattr(importlib.import_module(module), name)


@cache
def config_folder() -> Path:
    """The folder of the configuration files: inside an installed package, or beside it in a checkout."""
    package = Path(__file__).resolve().parent
    for folder in (package / "conf", package.parent / "conf"):
        if (folder / "config.yaml").is_file():
            return folder
    raise HopdiffError("This installation of hopdiff lacks its configuration folder conf/.")


def files_of(group: str) -> list[str]:
    """The names of the files of a group of conf/ that are chosen by name."""
    names = (path.stem for path in (config_folder() / group).glob("*.yaml"))
    return sorted(name for name in names if not name.startswith("of_"))


def _files(group: str) -> Callable[[Door], list[str]]:
    """Lists the files of a group of conf/."""

    return lambda door: files_of(group)


def _modules(door: Door) -> list[str]:
    """Lists the modules of the package, without importing them."""
    root = Path(__file__).resolve().parent.parent.joinpath(*door.package.split("."))
    return sorted(module.name for module in pkgutil.iter_modules([str(root)]))


SEARCHES = Door("search", "hopdiff.search", "SEARCH", "hopdiff.searches", _files("search"))
TASKS = Door("task", "hopdiff.tasks", "TASK", "hopdiff.tasks", _files("task"))
FORMATS = Door("kind of export", "hopdiff.export.formats", "FORMAT", "hopdiff.exports", _modules)
CHARACTERS = Door("character", "hopdiff", "", "hopdiff.characters", _files("character"))
TERMS = Door("cost term", "hopdiff", "", "hopdiff.cost_terms", lambda door: [])
