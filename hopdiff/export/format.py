"""What a format of exported files is."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hopdiff.export.take import Take

# Path, the motions that go into the file, and its settings (`hopdiff.export.settings.ExportSettings`).
Writer = Callable[[Path, Sequence[Take], Any], None]


@dataclass(frozen=True)
class Format:
    """suffix: of its files, with the dot. write: see `Writer`. together: whether a file holds several motions;
    otherwise it is given one. axes: whether its joints may be turned in the rest pose. beside: suffixes of what it
    writes next to the file, under the same name. check: raises HopdiffError where these settings cannot be had on this
    machine, before any motion is made. others: endings that a file's name may have instead of `suffix`. review: raises
    HopdiffError where the motions cannot go into one file, before any is written, and returns sentences on them for the
    user. pictures: how many pictures a file has of its motions, if it has any. strides: whether its clips are single
    strides.
    """

    suffix: str
    write: Writer
    together: bool = False
    axes: bool = False
    beside: tuple[str, ...] = ()
    check: Callable[[Any], object] | None = None
    others: tuple[str, ...] = ()
    review: Callable[[Sequence[Take]], Sequence[str]] | None = None
    pictures: Callable[[Sequence[Take], Any], int] | None = None
    strides: bool = False
