"""The people that runs are held against, at three speeds: mean curves, numbers, and how near a curve comes to them."""

from __future__ import annotations

import csv
from functools import cache
from pathlib import Path

import numpy as np

from experiments.realism.measure import CURVES, Row, correlation
from experiments.realism.recording import Array

HERE = Path(__file__).parent
POINTS = 50  # of a curve of people.csv: every 2 % of the stride from touchdown
SHIFT = 0.06  # share of the stride by which a curve may be early or late
SPEEDS = (2.5, 3.5, 4.5)  # m/s


def commented(path: Path) -> tuple[list[str], list[dict[str, str]]]:
    """The lines of a CSV file that begin with #, without it, and its rows."""
    lines = path.read_text(encoding="utf-8").splitlines()
    comments = [line.removeprefix("#").strip() for line in lines if line.startswith("#")]
    return comments, list(csv.DictReader(line for line in lines if not line.startswith("#")))


@cache
def tables() -> tuple[dict[str, Array], dict[str, Array]]:
    """Curves by name (3, POINTS) [deg] and numbers by name (3,), both at SPEEDS."""
    _, points = commented(HERE / "people.csv")
    shape = (len(SPEEDS), POINTS)
    shapes = {name: np.array([float(row[name]) for row in points]).reshape(shape) for name in ("thigh", "knee", "foot")}
    shapes["ankle"] = shapes["foot"] - shapes["thigh"] + shapes["knee"]
    _, rows = commented(HERE / "people_numbers.csv")
    numbers = {row["quantity"]: np.array([float(row[f"at_{speed:g}"]) for speed in SPEEDS]) for row in rows}
    return shapes, numbers


def curve(name: str, speed: float) -> Array:
    """(POINTS,) [deg] of people at a speed [m/s], on a straight line between those measured, the nearest outside."""
    weights = [float(np.interp(speed, SPEEDS, unit)) for unit in np.eye(len(SPEEDS))]
    return np.asarray(weights) @ tables()[0][name]


def number(name: str, speed: float) -> float:
    """A number of people at a speed [m/s], in the same way"""
    return float(np.interp(speed, SPEEDS, tables()[1][name]))


def fit(values: Array, people: Array) -> tuple[float, float, float]:
    """How near a curve (a multiple of POINTS samples of a stride) comes to people's (POINTS,): root mean square of
    what is left of their difference without its mean, correlation, and the shift for which that is least [share of
    the stride, positive where the curve is late], none beyond SHIFT."""
    finer = len(values) // POINTS
    most = round(SHIFT * len(values))
    found = []
    for shift in range(-most, most + 1):
        difference = np.roll(values, -shift)[::finer] - people
        found.append((float(difference.std()), abs(shift), shift))
    error, _, shift = min(found)
    return error, correlation(np.roll(values, -shift)[::finer], people), shift / len(values)


def compared(curves: dict[str, Array], speed: float) -> Row:
    """For each curve rmse_NAME [deg], r_NAME, late_NAME [% of the stride] and above_NAME, how much greater its mean is
    than people's [deg]."""
    row: Row = {}
    for name in CURVES:
        people = curve(name, speed)
        error, r, shift = fit(curves[name], people)
        above = float(curves[name].mean() - people.mean())
        row |= {f"rmse_{name}": error, f"r_{name}": r, f"late_{name}": 100 * shift, f"above_{name}": above}
    return row
