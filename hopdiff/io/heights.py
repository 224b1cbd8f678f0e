"""Reading heights on a grid from a PNG picture or a CSV table."""

from __future__ import annotations

import csv
import math
import warnings
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image, UnidentifiedImageError

from hopdiff.io.files import read_text
from hopdiff.types import HopdiffError

MOST = 16_000_000  # values of a grid
# Modes of grey pictures, and what white is in them.
WHITE = {"1": 1.0, "L": 255.0, "I;16": 65535.0, "I;16B": 65535.0, "I;16L": 65535.0, "I": 65535.0}


def read_heights(path: Path, setting: str) -> NDArray[np.float64]:
    """The heights (Z, X) of a map, rows from the smallest z and columns from the smallest x on.

    Seen from above, up the page is +z and left is +x, so that both directions of the file are turned about. Of a
    picture black is 0 and white 1; numbers of a table are as they stand. Commas, semicolons, tabs or spaces separate;
    empty lines and those that begin with # are left out.
    Raises HopdiffError, naming setting, file and line, for a file that cannot be read or does not hold that.
    """
    match path.suffix.lower():
        case ".png":
            found = _read_png(path, f"{setting} {str(path)!r}")
        case ".csv":
            found = _read_csv(path, setting)
        case _:
            raise HopdiffError(f"{setting} {str(path)!r} must be a .png or a .csv file.")
    if min(found.shape) < 2:
        rows, columns = found.shape
        raise HopdiffError(f"{setting} {str(path)!r} needs at least 2 by 2 values, not {rows} by {columns}.")
    return np.ascontiguousarray(found[::-1, ::-1])


def _read_png(path: Path, where: str) -> NDArray[np.float64]:
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", Image.DecompressionBombWarning)
            with Image.open(path, formats=("PNG",)) as picture:
                if picture.width * picture.height > MOST:
                    raise HopdiffError(f"{where} is too large: {MOST} pixels are the most.")
                if picture.mode not in WHITE:
                    raise HopdiffError(
                        f"{where} must be a grey picture of 8 or 16 bits, not one of mode {picture.mode}."
                    )
                return np.asarray(picture, dtype=np.float64) / WHITE[picture.mode]
    except UnidentifiedImageError as error:
        raise HopdiffError(f"{where} is no PNG picture.") from error
    except (Image.DecompressionBombError, Image.DecompressionBombWarning) as error:
        raise HopdiffError(f"{where} is too large: {MOST} pixels are the most.") from error
    except OSError as error:
        if error.filename is not None or error.strerror:
            raise HopdiffError(f"{where} cannot be read: {(error.strerror or str(error)).lower()}.") from error
        raise HopdiffError(f"{where} is a broken PNG picture ({error}).") from error
    except (SyntaxError, ValueError) as error:
        raise HopdiffError(f"{where} is a broken PNG picture ({error}).") from error


def _read_csv(path: Path, setting: str) -> NDArray[np.float64]:
    where = f"{setting} {str(path)!r}"
    try:
        text = read_text(path)
    except HopdiffError as error:
        raise HopdiffError(f"{setting}: {error}") from error
    lines = [
        (number, line.strip())
        for number, line in enumerate(text.splitlines(), start=1)
        if line.strip() and not line.lstrip().startswith("#")
    ]
    if not lines:
        raise HopdiffError(f"{where} is empty.")
    separator = next((mark for mark in ";\t," if mark in lines[0][1]), " ")
    rows: list[list[float]] = []
    for number, line in lines:
        row = [_number(cell) for cell in next(csv.reader([line], delimiter=separator, skipinitialspace=True))]
        if wrong := next((k for k, value in enumerate(row, start=1) if not math.isfinite(value)), 0):
            raise HopdiffError(f"{where}, line {number}: value {wrong} is not a finite number.")
        if rows and len(row) != len(rows[0]):
            raise HopdiffError(f"{where}, line {number}: {len(row)} values, and {len(rows[0])} in the first line.")
        rows.append(row)
        if len(rows) * len(row) > MOST:
            raise HopdiffError(f"{where} is too large: {MOST} values are the most.")
    return np.array(rows)


def _number(cell: str) -> float:
    """The number in a cell; not a number where there is none."""
    try:
        return float(cell)
    except ValueError:
        return math.nan
