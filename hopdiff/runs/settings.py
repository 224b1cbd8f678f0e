"""The settings of finished runs: read back flat from config.yaml, and which of them differ among several runs."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Mapping, Sequence
from functools import lru_cache
from typing import Any

import yaml

from hopdiff.types import HopdiffError

# Groups of settings that are chosen by name, in the order in which a reader wants to hear of them.
CHOICES = ("search", "model", "costs", "character", "genes", "task")
# Made from other settings, to name folders.
DERIVED = ("task.label",)
# Put into config.yaml by the run, which looks for the run of least cost first; settings only where they were typed.
FOUND = "costs.least."

_LOADER = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
_BLOCK = re.compile(r"^(?=[^\s\-#])", re.MULTILINE)
_WORD = re.compile(r"\+{0,2}([^=@:~+]+)(?:@[^=]*)?=(.*)", re.DOTALL)


def flat_settings(text: str, file: str) -> dict[str, Any]:
    """The settings of a config.yaml by their dotted names; lists are texts, as "[[0,0],[2,6]]".

    text: of the file; file: what errors call it. Raises HopdiffError if it is not YAML, or no table of settings.
    """
    settings: dict[str, Any] = {}
    try:
        # Runs of a sweep have most of their top-level blocks in common, and reading YAML is what takes the time.
        for block in _BLOCK.split(text):
            settings.update(_flat_block(block))
        if not settings:
            raise _NoTableError
    except (yaml.YAMLError, _NoTableError):
        try:
            settings = dict(_flat_block(text, whole=True))
        except yaml.MarkedYAMLError as error:
            line = f", line {error.problem_mark.line + 1}" if error.problem_mark else ""
            raise HopdiffError(f"{file}{line}: not YAML ({error.problem}).") from error
        except (yaml.YAMLError, _NoTableError) as error:
            raise HopdiffError(f"{file} does not hold the settings of a run.") from error
    return settings


class _NoTableError(Exception):
    """A part of a file that is no table."""


@lru_cache(maxsize=4096)
def _flat_block(text: str, whole: bool = False) -> tuple[tuple[str, Any], ...]:
    """Names and values of one top-level block of a file, or of a whole file."""
    content = yaml.load(text, _LOADER)
    if content is None and not whole:
        return ()
    if not isinstance(content, dict) or not (whole or len(content) == 1):
        raise _NoTableError
    return tuple(_flat(content, ""))


def _flat(content: Mapping[Any, Any], prefix: str) -> Iterable[tuple[str, Any]]:
    for key, value in content.items():
        if isinstance(value, dict):
            yield from _flat(value, f"{prefix}{key}.")
        else:
            yield f"{prefix}{key}", plain(value)


def plain(value: Any) -> Any:
    """A value that can be told apart and put into a table: lists and the like become texts."""
    if value is None or isinstance(value, bool | int | float | str):
        return value
    return json.dumps(value, separators=(",", ":"), default=str)


def typed_values(overrides: Iterable[Any]) -> dict[str, Any]:
    """What was typed, by name: "search=ga", "+experiment=brisk" are {"search": "ga", "experiment": "brisk"}."""
    values = {}
    for word in overrides:
        if found := _WORD.fullmatch(str(word)):
            name, text = found.groups()
            try:
                values[name] = plain(yaml.load(text, _LOADER))
            except yaml.YAMLError:
                values[name] = text
    return values


def as_settings(typed: Mapping[str, Any]) -> dict[str, Any]:
    """Typed values by the names that config.yaml has for them: "search" is "search.name"."""
    return {f"{name}.name" if name in CHOICES else name: value for name, value in typed.items()}


class Differences:
    """Which settings differ among runs.

    runs: settings of each run by dotted name; typed: what was typed for it; whole: whether all its settings are known,
    so that one which is not there counts as null.
    """

    def __init__(
        self, runs: Sequence[Mapping[str, Any]], typed: Sequence[Mapping[str, Any]], whole: Sequence[bool]
    ) -> None:
        self.runs, self.whole = runs, whole
        self._typed = {name for words in typed for name in words}

    def typed(self, name: str) -> bool:
        """Whether a setting was typed for any of the runs, by itself or with what it belongs to."""
        group, _, rest = name.partition(".")
        if group in self._typed and (group not in CHOICES or rest == "name"):
            return True
        parts = name.split(".")
        return any(".".join(parts[:count]) in self._typed for count in range(2, len(parts) + 1))

    def names(self) -> list[str]:
        """The settings that differ, in the order of config.yaml.

        Settings that come with a choice, as those of search=ga, count where they differ among runs of the same choice,
        or were typed: the others tell no more than the choice does.
        """
        known = dict.fromkeys(name for settings in self.runs for name in settings)
        return [name for name in known if self._counts(name) and self._differs(name)]

    def _counts(self, name: str) -> bool:
        return name not in DERIVED and not (name.startswith(FOUND) and not self.typed(name))

    def _differs(self, name: str) -> bool:
        group = name.split(".")[0]
        several = self.several(name, range(len(self.runs)))
        if not several or group not in CHOICES or name == f"{group}.name":
            return several
        if self.typed(name):
            having = [i for i, settings in enumerate(self.runs) if name in settings]
            return self.several(name, having)
        return any(self.several(name, same) for same in self.by_choice(group).values())

    def by_choice(self, group: str) -> dict[Any, list[int]]:
        """The places of the runs by what they chose of a group."""
        classes: dict[Any, list[int]] = {}
        for i, settings in enumerate(self.runs):
            classes.setdefault(settings.get(f"{group}.name"), []).append(i)
        return classes

    def several(self, name: str, places: Iterable[int]) -> bool:
        """Whether a setting has several values among some of the runs."""
        values = {self.runs[i].get(name) for i in places if self.whole[i] or name in self.runs[i]}
        return len(values) > 1
