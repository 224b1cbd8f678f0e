"""The study in words and tables, and its rows in files."""

from __future__ import annotations

import csv
import math
from collections.abc import Sequence
from io import StringIO
from itertools import pairwise
from pathlib import Path

import numpy as np

from experiments.realism.bars import BARS, KEPT_SHARE, TREND_TEXTS, Bar, steps
from experiments.realism.measure import CURVES, Row
from experiments.realism.people import POINTS, SPEEDS, commented, curve, fit
from experiments.realism.runs import CAPTURED, Entry, by_costs
from experiments.report import markdown
from hopdiff.doors import config_folder
from hopdiff.io.files import write_whole

ORDINARY = 0.2  # beta of an ordinary run, at which runs are held against people
# What is shown without a bar: column, what it is, factor, digits.
SHOWN = (
    ("speed", "speed m/s", 1, 2),
    ("foot_touchdown", "foot pitch at touchdown deg", 1, 0),
    ("thorax_yaw_range", "thorax yaw, range deg", 1, 1),
    ("yaw_together", "thorax yaw with pelvis yaw, r", 1, 2),
    ("lean", "trunk lean deg", 1, 1),
    ("arm_swing", "arm swing, range deg", 1, 0),
    ("elbow_mean", "elbow, mean deg", 1, 0),
    ("elbow_range", "elbow, range deg", 1, 0),
    ("step_width", "step width cm", 100, 1),
    ("external_work", "positive work on the centre of mass, of m g distance", 1, 3),
    ("force_gap", "force against motion of the segments, RMS BW", 1, 4),
    ("place_gap", "joints off the stored ones mm", 1000, 3),
)
BRISK = (
    ("contact_time", "contact s", 1, 3),
    ("flight_share", "flight share", 1, 3),
    ("bounce", "bounce cm", 100, 1),
    ("arm_swing", "arm swing deg", 1, 0),
    ("energy_rate", "energy, by the run itself", 1, 3),
    ("external_work", "positive work / m g d", 1, 3),
    ("steps_per_second", "steps/s", 1, 2),
    ("peak_force", "peak force BW", 1, 2),
)
Column = tuple[str, float, list[Row]]  # heading, speed of the people [m/s], rows (one a seed)


def report(entries: Sequence[Entry], notes: Sequence[str], origin: Sequence[str]) -> str:
    """Markdown of the whole study. notes: what is missing. origin: commit and command."""
    lines = ["# Realism: finished runs against measured running\n", *[f"- {line}" for line in origin], ""]
    for costs, own in by_costs(entries):
        ordinary = [one for one in own if one.row["beta"] == ORDINARY]
        columns: list[Column] = [
            (f"{speed:g} m/s", speed, [one.row for one in ordinary if one.row["asked_speed"] == speed])
            for speed in SPEEDS
        ]
        columns = [column for column in columns if column[2]]
        lines += [f"## Against people: costs={costs}\n", made_with(costs, own, f"beta {ORDINARY:g}"), ""]
        lines += [*judged(columns)] if columns else [f"No run at beta {ORDINARY:g} and a speed of people's.", ""]
    clips = [one for one in entries if one.costs == CAPTURED]
    lines += ["## Single captured strides, measured alike\n"]
    if clips:
        lines += [
            "A person, not a run of a model. Numbers and curves to compare with are taken between people's three"
            " speeds, the nearest outside. The skeleton has zeros of its own (its knee is 10 deg more bent throughout),"
            " contacts are told from heights and speeds of the feet to about 25 ms, and forces are not known.\n",
            *judged([(f"{one.name}, {one.row['speed']:.1f} m/s", one.row["speed"], [one.row]) for one in clips]),
        ]
    for costs, own in by_costs(entries):
        lines += [f"## Briskness: costs={costs}\n", made_with(costs, own, "every beta"), "", *brisk(own)]
    if notes:
        lines += ["## Left out\n", *[f"- {note}" for note in notes], ""]
    lines += ["## Settings of the costs\n", *settings(entries), own_noise()]
    return "\n".join(lines)


def made_with(costs: str, own: Sequence[Entry], what: str) -> str:
    seeds = ", ".join(f"{seed:g}" for seed in sorted({one.row["seed"] for one in own}))
    return (
        f"Objective: `costs={costs}`, its terms and priors below; {what}, seeds {seeds}. What the model itself holds of"
        " people is listed in the README."
    )


def judged(columns: Sequence[Column]) -> list[str]:
    """Two tables: the bars, with the mean of the seeds, the band, and how many keep it; and what has no bar."""
    heading = ["", *[name for name, _, _ in columns]]
    rows = [[bar.text, *[verdict(bar, own, speed) for _, speed, own in columns]] for bar in BARS]
    kept, asked = zip(*[tally(own, speed) for _, speed, own in columns], strict=True)
    rows.append(["**kept**", *[f"**{k} of {n}**" for k, n in zip(kept, asked, strict=True)]])
    others = [
        [text, *[cell([row[column] for row in own], factor, digits) for _, _, own in columns]]
        for column, text, factor, digits in SHOWN
    ]
    return [markdown(heading, rows), markdown(heading, others)]


def verdict(bar: Bar, rows: Sequence[Row], speed: float) -> str:
    met = [bar.met(row, speed) for row in rows]
    if None in met:
        return "–"
    value = bar.shown(float(np.mean([row[bar.column] for row in rows])))
    word = "yes" if all(met) else "**no**" if not any(met) else f"**{sum(map(bool, met))} of {len(met)}**"
    return f"{value} ({bar.limits(speed)}) {word}"


def tally(rows: Sequence[Row], speed: float) -> tuple[int, int]:
    """How many of the bars all the rows keep, and of how many it is known."""
    met = [[bar.met(row, speed) for row in rows] for bar in BARS]
    known = [one for one in met if None not in one]
    return sum(all(one) for one in known), len(known)


def cell(values: Sequence[float], factor: float, digits: int) -> str:
    known = [value for value in values if math.isfinite(value)]
    return f"{factor * sum(known) / len(known):.{digits}f}" if known else "–"


def brisk(own: Sequence[Entry]) -> list[str]:
    """Numbers over speed and beta, the mean of the seeds, and the share of the steps of beta that go as they must."""
    rows = [one.row for one in own]
    pairs = sorted({(row["asked_speed"], row["beta"]) for row in rows})
    table = []
    for speed, beta in pairs:
        group = [row for row in rows if (row["asked_speed"], row["beta"]) == (speed, beta)]
        values = [cell([row[column] for row in group], factor, digits) for column, _, factor, digits in BRISK]
        table.append([f"{speed:g}", f"{beta:g}", *values])
    shares, wrong = [], []
    for column, text in TREND_TEXTS.items():
        every = steps(rows, column)
        good = sum(one[-1] for one in every)
        if every:
            word = "yes" if good >= KEPT_SHARE * len(every) else "**no**"
            shares.append([text, f"{good} of {len(every)}", f"{100 * good / len(every):.0f} %", word])
        wrong += [f"- {speed:g} m/s, beta {a:g} to {b:g}: not {text}" for speed, a, b, ok in every if not ok]
    heading = ("speed m/s", "beta", *[text for _, text, _, _ in BRISK])
    parts = [markdown(heading, table)]
    if shares:
        parts.append(markdown(("each step of beta", "kept", "share", f"at least {100 * KEPT_SHARE:.0f} %"), shares))
    return [*parts, *wrong, ""]


def settings(entries: Sequence[Entry]) -> list[str]:
    """The files of the costs as they are now."""
    lines = []
    for costs, _ in by_costs(entries):
        file = config_folder() / "costs" / f"{costs.partition(' ')[0]}.yaml"
        text = file.read_text(encoding="utf-8").strip() if file.is_file() else "# no such file any more"
        lines += [f"`costs={costs}`:\n", f"```yaml\n{text}\n```\n"]
    return lines


def own_noise() -> str:
    """How far people's own curves at one speed are from those at the next, by the same measure."""
    rows = [
        [f"{low:g} against {high:g} m/s", *[f"{fit(curve(name, low), curve(name, high))[0]:.1f}" for name in CURVES]]
        for low, high in pairwise(SPEEDS)
    ]
    text = "For comparison: people's mean curves at one speed held against those at the next, RMSE deg.\n\n"
    return text + markdown(("", *CURVES), rows)


def write_rows(folder: Path, entries: Sequence[Entry], origin: Sequence[str]) -> None:
    """runs.csv with every number, curves.csv with the curves at every 2 % of ordinary runs and captured strides."""
    names = list(entries[0].row) if entries else []
    rows = [[one.name, one.costs, *[_text(one.row[name]) for name in names]] for one in entries]
    _write(folder / "runs.csv", ["name", "costs", *names], rows, origin)
    points = [
        [number, 2 * point, *[f"{one.curves[name][point * len(one.curves[name]) // POINTS]:.2f}" for name in CURVES]]
        for number, one in enumerate(entries)
        if one.costs == CAPTURED or one.row["beta"] == ORDINARY
        for point in range(POINTS)
    ]
    _write(folder / "curves.csv", ["row", "percent", *CURVES], points, origin)


def read_rows(folder: Path) -> tuple[list[Entry], list[str]]:
    """The rows that `write_rows` wrote, and the commit and command that stand above them."""
    origin, rows = commented(folder / "runs.csv")
    _, points = commented(folder / "curves.csv")
    entries = []
    for number, row in enumerate(rows):
        name, costs = row.pop("name"), row.pop("costs")
        own = [point for point in points if int(point["row"]) == number]
        curves = {curve: np.array([float(point[curve]) for point in own]) for curve in CURVES}
        entries.append(Entry(name, costs, {key: float(value or "nan") for key, value in row.items()}, curves))
    return entries, origin


def _text(value: float) -> str:
    return format(value, ".6g") if math.isfinite(value) else ""


def _write(path: Path, heading: Sequence[str], rows: Sequence[Sequence[object]], origin: Sequence[str]) -> None:
    text = StringIO()
    text.writelines(f"# {line}\n" for line in origin)
    writer = csv.writer(text, lineterminator="\n")
    writer.writerows([heading, *rows])
    write_whole(path, text.getvalue())
