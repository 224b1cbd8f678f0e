"""The promises of the default search, each as a bar that a run passes or fails."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from statistics import median

Row = dict[str, float]

HUMAN_CONTACT = {3.0: 0.280, 4.5: 0.212, 6.0: 0.168}  # s; sources in humans.csv

# What briskness must do, and the sign of it.
TRENDS = {"contact_time": -1, "flight_share": 1, "com_oscillation": 1, "arm_swing_deg": 1}


@dataclass(frozen=True)
class Bar:
    """text: what is promised. asked: whether of this run. met: whether it keeps it. shown: the column to look at."""

    text: str
    asked: Callable[[Row], bool]
    met: Callable[[Row], bool]
    shown: str


def energy_error(row: Row) -> float:
    """Distance of the energy rate from its target, as a share of the target; infinite at beta 0."""
    gap = abs(row["energy_rate"] - row["energy_target"])
    return gap / row["energy_target"] if row["energy_target"] else float("inf")


def _core(row: Row) -> bool:
    return 0.2 <= row["beta"] <= 0.8


def _anywhere(row: Row) -> bool:
    return True


def _human(row: Row) -> bool:
    return row["beta"] == 0.2 and row["speed"] in HUMAN_CONTACT


BARS = (
    Bar("energy within 2 % of its target (beta .2 to .8)", _core, lambda r: energy_error(r) <= 0.02, "energy_error"),
    Bar("speed exact to 1e-9", _anywhere, lambda r: abs(r["travel"] / r["speed"] - 1) <= 1e-9, "travel"),
    Bar("stance foot drifts at most 1 mm", _anywhere, lambda r: r["stance_foot_drift"] <= 1e-3, "stance_foot_drift"),
    Bar("no foot deeper than 1 mm", _anywhere, lambda r: r["min_foot_clearance"] >= -1e-3, "min_foot_clearance"),
    Bar("loop closes to 1e-4 rad and m", _anywhere, lambda r: r["loop_error"] <= 1e-4, "loop_error"),
    Bar("joints within limits", _anywhere, lambda r: r["joint_limit_excess_deg"] <= 0, "joint_limit_excess_deg"),
    Bar(
        "ordinary run: contact within 35 % of human",
        _human,
        lambda r: abs(r["contact_time"] / HUMAN_CONTACT[r["speed"]] - 1) <= 0.35,
        "contact_time",
    ),
    Bar("ordinary run: flight share .2 to .6", _human, lambda r: 0.2 <= r["flight_share"] <= 0.6, "flight_share"),
    Bar("ordinary run: bounce 4 to 13 cm", _human, lambda r: 0.04 <= r["com_oscillation"] <= 0.13, "com_oscillation"),
    Bar(
        "ordinary run: knee in stance at most 80 deg",
        _human,
        lambda r: r["knee_stance_max_deg"] <= 80,
        "knee_stance_max_deg",
    ),
)


def per_pair(rows: Sequence[Row]) -> dict[tuple[float, float], list[Row]]:
    """The runs (one a seed) of every (speed, beta), in order."""
    keys = sorted({(row["speed"], row["beta"]) for row in rows})
    return {key: [row for row in rows if (row["speed"], row["beta"]) == key] for key in keys}


def trend_breaks(rows: Sequence[Row]) -> tuple[int, list[str]]:
    """How many neighbouring betas were compared (median over the seeds), and those that go the wrong way."""
    pairs = per_pair(rows)
    compared, breaks = 0, []
    for speed in sorted({speed for speed, _ in pairs}):
        betas = [beta for v, beta in pairs if v == speed]
        for name, sign in TRENDS.items():
            values = {beta: median(row[name] for row in pairs[speed, beta]) for beta in betas}
            for low, high in pairwise(betas):
                compared += 1
                if sign * (values[high] - values[low]) <= 0:
                    change = f"{values[low]:.4g} to {values[high]:.4g}"
                    breaks.append(f"{speed:g} m/s: {name} from beta {low:g} to {high:g} goes {change}")
    return compared, breaks
