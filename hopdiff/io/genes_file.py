"""The genes file: the numbers that make a run, and the settings they belong to."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from hopdiff.genes import LAME, GeneTable
from hopdiff.io.files import read_text, write_whole
from hopdiff.messages import near
from hopdiff.types import HopdiffError

VERSION = 1  # of the file's layout; files without one are older, and of the same layout
# How far outside its range a value may lie, relative to the range's ends: rounding, no more.
SLACK = 1e-6


@dataclass(frozen=True)
class GenesFile:
    """path: where it was read. settings: speed, beta, dtype, model, ... of the run. genes: name -> (value, unit)."""

    path: Path
    settings: dict[str, Any]
    genes: dict[str, tuple[float, str]]


def write_genes(path: Path, settings: Mapping[str, Any], genes: Mapping[str, float], units: Sequence[str]) -> None:
    """Write genes in the units of their table, in its order."""
    entries = {name: {"value": value, "unit": unit} for (name, value), unit in zip(genes.items(), units, strict=True)}
    write_whole(path, json.dumps({"version": VERSION, "settings": dict(settings), "genes": entries}, indent=2) + "\n")


def read_genes(path: Path) -> GenesFile:
    """Read a genes file.

    Raises HopdiffError if it cannot be read, is not JSON, has another layout or a later version, repeats a gene, or
    holds a value that is not a finite number.
    """
    where = f"genes_file {str(path)!r}"
    try:
        content = json.loads(read_text(path), object_pairs_hook=_without_repeats)
    except _RepeatedError as error:
        raise HopdiffError(f"{where} holds {str(error)!r} twice.") from error
    except json.JSONDecodeError as error:
        raise HopdiffError(f"{where} is not a JSON file: {error.msg} in line {error.lineno}.") from error
    except RecursionError as error:
        raise HopdiffError(f"{where} is nested too deeply to be a genes file.") from error
    except ValueError as error:
        raise HopdiffError(f"{where} holds a number of too many digits.") from error
    if not isinstance(content, dict) or not isinstance(content.get("genes"), dict):
        raise HopdiffError(f'{where} lacks its table of genes: {{"genes": {{name: {{"value": ..., "unit": ...}}}}}}.')
    version = content.get("version", VERSION)
    if isinstance(version, bool) or not isinstance(version, int) or not 1 <= version <= VERSION:
        raise HopdiffError(f"{where} has version {version!r}: this hopdiff reads versions up to {VERSION}.")
    settings = content.get("settings", {})
    if not isinstance(settings, dict):
        raise HopdiffError(f"{where}: its settings must be a table of names and values.")
    genes = {}
    for name, entry in content["genes"].items():
        value = entry.get("value") if isinstance(entry, dict) else entry
        if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
            raise HopdiffError(f"{where}: gene {name!r} must have a finite number for its value, not {value!r}.")
        genes[name] = (float(value), str(entry.get("unit", "")) if isinstance(entry, dict) else "")
    return GenesFile(path, settings, genes)


def unit_genes(file: GenesFile, table: GeneTable, strange: bool = False) -> Tensor:
    """The genes of a file as a point (G,) of the table's unit box.

    strange: whether they were found for another body or speed, whose ranges are others; then the point may lie
    outside the box, as long as every gene has a value that makes sense.
    Raises HopdiffError if a gene is missing, unknown, in another unit or outside its range.
    """
    where = f"genes_file {str(file.path)!r}"
    for name in table.names:
        if name not in file.genes:
            raise HopdiffError(f"{where} lacks the gene {name!r}.{_of_a_limp(name, 'no limp: set limp.amount=0')}")
    for name in file.genes:
        if name not in table.names:
            hint = _of_a_limp(name, "a limp: set limp.amount above 0") or near(name, table.names)
            raise HopdiffError(f"{where} has an unknown gene {name!r}.{hint}")
    for name, unit in zip(table.names, table.units, strict=True):
        if file.genes[name][1] not in ("", unit):
            raise HopdiffError(f"{where}: gene {name!r} must be in the unit {unit!r}, not {file.genes[name][1]!r}.")
    values = torch.tensor([file.genes[name][0] for name in table.names], dtype=torch.float64)
    low, high = table.low.detach().cpu().double(), table.high.detach().cpu().double()
    slack = SLACK * (low.abs() + high.abs())
    outside = (values < low - slack) | (values > high + slack)
    for index in outside.nonzero().flatten().tolist():
        name, unit, value = table.names[index], table.units[index], float(values[index])
        if low[index] == high[index]:
            raise HopdiffError(f"{where}: gene {name!r} is {value:g}, but fixed at {low[index]:g} [{unit}].")
        least, most = table.senses[name] if strange else (float(low[index]), float(high[index]))
        if not least <= value <= most:
            here = "" if strange else " at this speed"
            raise HopdiffError(
                f"{where}: gene {name!r} is {value:g}, outside its range of {least:g} to {most:g} [{unit}]{here}."
            )
    found = table.to_unit(values.to(table.low))
    return found if strange else found.clamp(0.0, 1.0)


def _of_a_limp(name: str, said: str) -> str:
    """A hint if the gene is one of the lame leg."""
    return f" The run has {said}." if name.startswith(LAME) else ""


class _RepeatedError(Exception):
    """A name comes twice in one JSON object."""


def _without_repeats(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    result: dict[str, Any] = {}
    for name, value in pairs:
        if name in result:
            raise _RepeatedError(name)
        result[name] = value
    return result
