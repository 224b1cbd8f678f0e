"""BVH, in a unit, with an axis up and an order of Euler angles that can be chosen."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from hopdiff.export.format import Format
from hopdiff.export.settings import UNITS, ExportSettings
from hopdiff.export.take import Take
from hopdiff.io.bvh import write_bvh


def _write(path: Path, takes: Sequence[Take], settings: ExportSettings) -> None:
    write_bvh(path, takes[0].clip, settings.order, UNITS[settings.unit], settings.up)


FORMAT = Format(".bvh", _write)
