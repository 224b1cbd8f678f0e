"""Takes into files of every kind."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from hopdiff.export.prepare import named, prepared
from hopdiff.export.settings import ExportSettings
from hopdiff.export.take import Take
from hopdiff.types import HopdiffError

TOLD_BY = {"search": "", "model": "", "character": "", "genes": "", "seed": "seed"}  # numbers that differ in sweeps


@dataclass(frozen=True, eq=False)
class Output:
    """A file that is about to be written. export: the name of its settings. takes: what goes into it, ready. notes:
    sentences for the user on them."""

    export: str
    path: Path
    takes: Sequence[Take]
    settings: ExportSettings
    notes: Sequence[str] = ()

    @property
    def files(self) -> list[Path]:
        """The file, and what is written beside it."""
        return [self.path, *(self.path.with_suffix(suffix) for suffix in self.settings.format.beside)]

    def write(self) -> None:
        """Raises HopdiffError, naming the setting, if it cannot be written."""
        try:
            self.settings.format.write(self.path, self.takes, self.settings)
        except HopdiffError as error:
            raise HopdiffError(f"exports.{self.export}: {error}") from error


def outputs(takes: Sequence[Take], exports: Mapping[str, ExportSettings], folder: Path) -> list[Output]:
    """All that takes are to be written as, made but not written.

    exports: checked settings by name. GLB, FBX and HTML files, sprite sheets, events and blend spaces hold all takes;
    of the other kinds there is a file for each. Raises HopdiffError, naming the setting, for what a motion does not
    allow, or for two files of one name.
    """
    found: list[Output] = []
    for name, settings in exports.items():
        try:
            ready = named([prepared(take, settings) for take in takes], settings)
            notes = settings.format.review(ready) if settings.format.review is not None else ()
        except HopdiffError as error:
            raise HopdiffError(f"exports.{name}: {error}") from error
        whole = folder / settings.file_name(name)
        if settings.format.together or len(takes) == 1:
            found.append(Output(name, whole, ready, settings, notes))
        else:
            lots = [(whole.with_stem(f"{whole.stem}_{plain(take.name)}"), take) for take in ready]
            found += [Output(name, path, [take], settings) for path, take in lots]
    different([path.name for one in found for path in one.files])
    return found


def write_exports(
    takes: Sequence[Take], exports: Mapping[str, ExportSettings], folder: Path
) -> list[tuple[Path, Output]]:
    """Write takes in every wanted form; returns the files, each with what it was made of.

    All motions are made before the first file is written. Raises HopdiffError as `outputs` does, or for a file that
    cannot be written.
    """
    return written(outputs(takes, exports, folder))


def written(found: Sequence[Output]) -> list[tuple[Path, Output]]:
    """Write what is ready; returns the files. Raises HopdiffError, naming the setting, for one that cannot be."""
    for one in found:
        one.write()
    return [(path, one) for one in found for path in one.files]


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
