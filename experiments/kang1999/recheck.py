"""Rows of departures.csv measured again: they are made from random genes that a seed brings back."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from experiments.kang1999.variants import COLUMNS, VARIANTS, measured
from experiments.provenance import Recheck, compared
from experiments.report import read_table

ROWS = ("as it is", "`model.knee=joined`", "`genes=default`")  # of the printed model, the repaired one, the other genes


def recheck(folder: Path) -> Recheck:
    return compared(_pairs(folder))


def _pairs(folder: Path) -> Iterator[tuple[str, dict[str, float], dict[str, float]]]:
    for row in read_table(folder / "departures.csv"):
        variant = next(v for v in VARIANTS if v.name == row["variant"]) if row["variant"] in ROWS else None
        if variant is not None:
            yield row["variant"], {name: float(row[name]) for name in COLUMNS}, measured(variant, int(row["count"]))
