"""Reading the points of a path from a CSV or SVG file."""

from __future__ import annotations

import csv
import io
import math
from pathlib import Path
from xml.etree.ElementTree import ParseError

import numpy as np
from numpy.typing import NDArray
from svgelements import SVG, Shape
from svgelements import Path as SvgPath

from hopdiff.io.files import read_text
from hopdiff.types import HopdiffError

Array = NDArray[np.float64]

SVG_POINTS = 100  # samples along a drawn path, at least
PER_SEGMENT = 16  # and on each of its pieces
LARGEST = 20_000_000  # characters of an SVG file


def read_points(path: Path, scale: float = 1.0) -> Array:
    """The points (K, 2) of a path, x to the left and z forward [m]. scale: metres a unit of the file.

    A CSV file has columns x and z, with or without a line that names them; any of comma, semicolon and tab
    separates, empty lines and lines that start with # are left out. An SVG file holds one path (or line, polyline,
    polygon, circle, ellipse, rectangle): up the page is forward and left is left, and the path starts at the origin.
    Raises HopdiffError, naming the file and the line, if there is no such file or it does not hold that.
    """
    match path.suffix.lower():
        case ".csv":
            points = _read_csv(path)
        case ".svg":
            points = _read_svg(path)
        case _:
            raise HopdiffError(f"path.file {str(path)!r} must be a .csv or an .svg file.")
    return points * scale


def _read_csv(path: Path) -> Array:
    where = f"path.file {str(path)!r}"
    lines = [
        (number, line)
        for number, line in enumerate(_text(path).splitlines(), start=1)
        if line.strip() and not line.lstrip().startswith("#")
    ]
    if not lines:
        raise HopdiffError(f"{where} is empty.")
    separator = next((mark for mark in ";\t" if mark in lines[0][1]), ",")
    rows = [(number, next(csv.reader([line], delimiter=separator))) for number, line in lines]
    first = [cell.strip().lower() for cell in rows[0][1]]
    columns = (0, 1)
    if not all(_is_number(cell) for cell in first):
        if "x" not in first or "z" not in first:
            raise HopdiffError(f"{where}, line {rows[0][0]}: the columns must be named x and z.")
        columns, rows = (first.index("x"), first.index("z")), rows[1:]
    points = []
    for number, cells in rows:
        values = [cells[column] if column < len(cells) else "" for column in columns]
        if not all(_is_number(cell) for cell in values):
            raise HopdiffError(f"{where}, line {number}: x and z must be two finite numbers.")
        points.append([float(cell) for cell in values])
    if len(points) < 2:
        raise HopdiffError(f"{where} holds {len(points)} point{'s' * (len(points) != 1)}; a path needs at least two.")
    return np.array(points)


def _text(path: Path) -> str:
    try:
        return read_text(path)
    except HopdiffError as error:
        raise HopdiffError(f"path.file: {error}") from error


def _is_number(cell: str) -> bool:
    try:
        return math.isfinite(float(cell))
    except ValueError:
        return False


def _read_svg(path: Path) -> Array:
    where = f"path.file {str(path)!r}"
    text = _text(path)
    if not text.strip():
        raise HopdiffError(f"{where} is empty.")
    # Entities can make a small file endless; a drawing has no use for them.
    if len(text) > LARGEST or "<!ENTITY" in text:
        raise HopdiffError(f"{where} is too large or holds entities: save it as a plain SVG.")
    try:
        drawing = SVG.parse(io.StringIO(text))
        shapes = [SvgPath(shape) for shape in drawing.elements() if isinstance(shape, Shape)]
        drawn = [shape for shape in shapes if shape.length(error=1e-3) > 0]
    except ParseError as error:
        raise HopdiffError(f"{where}, line {error.position[0]}: not an SVG file.") from error
    except (ValueError, TypeError, ZeroDivisionError, IndexError, KeyError, AttributeError, RecursionError) as error:
        raise HopdiffError(f"{where} cannot be read as an SVG drawing: {error}.") from error
    if len(drawn) != 1:
        raise HopdiffError(f"{where} must hold one path, not {len(drawn)}.")
    if len(list(drawn[0].as_subpaths())) != 1:
        raise HopdiffError(f"{where}: the path must be one line, not several pieces.")
    count = max(SVG_POINTS, PER_SEGMENT * len(drawn[0]))
    found = np.asarray(drawn[0].npoint(np.linspace(0.0, 1.0, count + 1)), dtype=np.float64)
    if not np.isfinite(found).all():
        raise HopdiffError(f"{where}: the path holds a number that is not finite.")
    moved: Array = -(found - found[0])
    return moved
