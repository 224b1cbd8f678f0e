"""Takes into files of every kind."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from hopdiff.export.prepare import named, prepared
from hopdiff.export.settings import ExportSettings
from hopdiff.export.take import Take
from hopdiff.types import HopdiffError

TOLD_BY = {"search": "", "model": "", "character": "", "genes": "", "seed": "seed"}  # numbers that differ in sweeps


def write_exports(
    takes: Sequence[Take], exports: Mapping[str, ExportSettings], folder: Path
) -> list[tuple[Path, Take]]:
    """Write takes in every wanted form; returns the files, each with the first motion in it.

    exports: checked settings by name. GLB, FBX and HTML files, sprite sheets, events and blend spaces hold all takes;
    of the other kinds there is a file for each. All motions are made before the first file is written. Raises
    HopdiffError, naming the setting, for what a motion does not allow, for two files of one name, or a file that cannot
    be written.
    """
    jobs: list[tuple[str, Path, list[Take], ExportSettings]] = []
    for name, settings in exports.items():
        try:
            ready = named([prepared(take, settings) for take in takes], settings)
        except HopdiffError as error:
            raise HopdiffError(f"exports.{name}: {error}") from error
        whole = folder / settings.file_name(name)
        if settings.format.together or len(takes) == 1:
            jobs.append((name, whole, ready, settings))
        else:
            jobs += [(name, whole.with_stem(f"{whole.stem}_{plain(take.name)}"), [take], settings) for take in ready]
    different([one.name for _, path, _, settings in jobs for one in _all_of(path, settings)])
    for name, path, ready, settings in jobs:
        try:
            settings.format.write(path, ready, settings)
        except HopdiffError as error:
            raise HopdiffError(f"exports.{name}: {error}") from error
    return [(one, ready[0]) for _, path, ready, settings in jobs for one in _all_of(path, settings)]


def _all_of(path: Path, settings: ExportSettings) -> list[Path]:
    """A file and what is written beside it."""
    return [path, *(path.with_suffix(suffix) for suffix in settings.format.beside)]


def different(files: Sequence[str]) -> None:
    """Raises HopdiffError for two files of one name."""
    for file in files:
        if files.count(file) > 1:
            raise HopdiffError(f"two exports are called {file!r}: set exports.NAME.file of one of them.")


def distinct(takes: Sequence[Take]) -> list[Take]:
    """The takes with names that tell them apart: those of one name get what else differs between them, or numbers."""
    found = []
    for take in takes:
        same = [other for other in takes if other.name == take.name]
        told = [entry for entry in TOLD_BY if len({str(other.numbers.get(entry)) for other in same}) > 1]
        words = [f"{TOLD_BY[entry]}{take.numbers[entry]}" for entry in told if take.numbers.get(entry) is not None]
        found.append(replace(take, name="_".join([take.name, *words])))
    names = [take.name for take in found]
    return [
        replace(take, name=f"{take.name}_{names[: k + 1].count(take.name)}") if names.count(take.name) > 1 else take
        for k, take in enumerate(found)
    ]


def plain(name: str) -> str:
    """A name as a part of a file's name."""
    return re.sub(r"[^\w.+-]+", "_", name).strip("_.") or "motion"
