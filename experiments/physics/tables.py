"""The tables of results.md."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

from experiments.physics.bars import BARS
from experiments.report import markdown

Row = dict[str, str | float]
Column = tuple[
    str, str, Callable[[float], str], Callable[[list[float]], float]
]  # heading, figure, form, worst of seeds


def _form(digits: str) -> Callable[[float], str]:
    def text(value: float) -> str:
        if not math.isfinite(value):
            return "**none**"
        return f"{value:.0f}" if abs(value) >= 100 else format(value, digits)

    return text


def _worst(values: list[float]) -> float:
    """The largest; NaN if any is."""
    return math.nan if any(math.isnan(value) for value in values) else max(values)


def _least(values: list[float]) -> float:
    return math.nan if any(math.isnan(value) for value in values) else min(values)


LEFT_OVER: tuple[Column, ...] = (
    ("flight: force rms BW", "flight_force_rms_bw", _form(".2g"), _worst),
    ("max", "flight_force_max_bw", _form(".2g"), _worst),
    ("moment rms Nm", "flight_moment_rms_nm", _form(".2g"), _worst),
    ("max", "flight_moment_max_nm", _form(".2g"), _worst),
    ("drift of angular momentum kg m²/s", "spin_drift_max", _form(".2g"), _worst),
    ("stance: force rms BW", "stance_force_rms_bw", _form(".2g"), _worst),
    ("max", "stance_force_max_bw", _form(".2g"), _worst),
    ("moment rms Nm", "stance_moment_rms_nm", _form(".2g"), _worst),
    ("max", "stance_moment_max_nm", _form(".2g"), _worst),
    ("moment that a point of contact cannot give, rms Nm", "point_moment_rms_nm", _form(".3g"), _worst),
    ("kick m/s", "kick", _form(".2g"), _worst),
    ("jump mm", "jump_mm", _form(".2g"), _worst),
    ("kick kg m²/s", "spin_kick", _form(".2g"), _worst),
)
GROUND: tuple[Column, ...] = (
    ("vertical force least BW", "vertical_min_bw", _form(".3f"), _least),
    ("pulls, share", "pulling_share", _form(".3f"), _worst),
    ("peak BW", "vertical_peak_bw", _form(".2f"), _worst),
    ("mean off the weight BW", "mean_vertical_off_bw", _form(".2g"), _worst),
    ("mean level force BW", "mean_horizontal_bw", _form(".2g"), _worst),
    ("friction", "friction", _form(".2f"), _worst),
    ("CoP outside mm", "cop_excess_mm", _form(".2g"), _worst),
    ("beside mm", "cop_aside_mm", _form(".2g"), _worst),
    ("off the ground mm", "cop_height_mm", _form(".2g"), _worst),
    ("slip mm", "slip_mm", _form(".2g"), _worst),
    ("fastest mm/s", "slip_speed_mm_s", _form(".3g"), _worst),
    ("stance: deepest mm", "stance_depth_mm", _form(".2g"), _worst),
    ("highest mm", "stance_gap_mm", _form(".2g"), _worst),
    ("swing: deepest mm", "swing_depth_mm", _form(".2g"), _worst),
    ("toe tip: deepest mm", "toe_depth_mm", _form(".2g"), _worst),
)
FILE: tuple[Column, ...] = (
    ("frames/s", "frame_rate", _form(".1f"), _worst),
    ("mass kg", "mass", _form(".2f"), _worst),
    ("flight share", "flight_share", _form(".2f"), _worst),
    ("frames judged in flight", "flight_frames", _form(".0f"), _least),
    ("in stance", "stance_frames", _form(".0f"), _least),
    ("joints off mm", "joints_off_mm", _form(".1g"), _worst),
    ("COM off mm", "com_off_mm", _form(".1g"), _worst),
    ("seam mm", "seam_mm", _form(".1g"), _worst),
)
CAPTURED: tuple[Column, ...] = (*FILE[:5], *LEFT_OVER[:5], GROUND[0], GROUND[1], GROUND[2])


def verdicts(rows: Sequence[Row]) -> str:
    """How many runs of each model keep each bar; a dash where nobody knows."""
    models = list(dict.fromkeys(str(row["model"]) for row in rows))
    table = []
    for bar in BARS:
        cells = []
        for model in models:
            known = [numbers(row) for row in rows if row["model"] == model and bar.column in row]
            kept = sum(bar.met(row) for row in known)
            text = f"{kept} of {len(known)}" if kept == len(known) else f"**{kept} of {len(known)}**"
            cells.append(text if known else "-")
        table.append((bar.text, *cells))
    return markdown(("bar", *models), table)


def misses(rows: Sequence[Row]) -> str:
    """A line for every run and bar that it does not keep."""
    lines = [
        f"- {label(row)}: {bar.text}: {numbers(row)[bar.column]:.3g}"
        for row in rows
        for bar in BARS
        if bar.asked(numbers(row)) and not bar.met(numbers(row))
    ]
    return "\n".join(lines) + "\n" if lines else "None.\n"


def table(rows: Sequence[Row], columns: Sequence[Column]) -> str:
    """Rows by run, the worst of the seeds; columns of which nothing is known are left out."""
    groups = _groups(rows)
    known = [column for column in columns if any(column[1] in row for group in groups.values() for row in group)]
    lines = []
    for name, group in groups.items():
        cells = []
        for _, figure, form, worst in known:
            values = [row[figure] for row in group if figure in row]
            cells.append(form(worst(values)) if values else "-")
        lines.append((name, *cells))
    return markdown(("run", *(heading for heading, *_ in known)), lines)


def by_axis(rows: Sequence[Row]) -> str:
    """What is left over, axis by axis: root mean square / maximum, the worst of the seeds."""
    names = [(what, axis, unit) for what, unit in (("force", "BW"), ("moment", "Nm")) for axis in "xyz"]
    lines = []
    for run, group in _groups(rows).items():
        for phase in ("flight", "stance"):
            cells = []
            for what, axis, unit in names:
                figures = [f"{phase}_{what}_{axis}_{kind}_{unit.lower()}" for kind in ("rms", "max")]
                values = [[row[figure] for row in group if figure in row] for figure in figures]
                cells.append(" / ".join(_form(".2g")(_worst(found)) for found in values) if all(values) else "-")
            lines.append((f"{run}, {phase}", *cells))
    return markdown(("run", *(f"{what} {axis} {unit}" for what, axis, unit in names)), lines)


def _groups(rows: Sequence[Row]) -> dict[str, list[dict[str, float]]]:
    """The figures of the runs that differ in their seed only, by what they are called."""
    groups: dict[str, list[dict[str, float]]] = {}
    for row in rows:
        groups.setdefault(label(row, seed=False), []).append(numbers(row))
    return groups


def label(row: Row, seed: bool = True) -> str:
    """What a run is called in a table."""
    if "speed" not in row:
        return str(row["run"])
    asked = f"{row['model']} {row['speed']:g} m/s, beta {row['beta']:g}"
    return f"{asked}, seed {row['seed']:g}" if seed else asked


def numbers(row: Row) -> dict[str, float]:
    """The figures of a row."""
    return {name: value for name, value in row.items() if not isinstance(value, str)}
