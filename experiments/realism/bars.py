"""What a run must keep to pass for a person's, and what briskness must do."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from statistics import median

from experiments.realism.measure import Row
from experiments.realism.people import number

INFINITE = math.inf
Band = tuple[float, float]


@dataclass(frozen=True)
class Bar:
    """text: what is asked. column: the number asked about. band: least and greatest value at a speed [m/s]. scale,
    digits: how the number is shown."""

    text: str
    column: str
    band: Callable[[float], Band]
    scale: float = 1.0
    digits: int = 0

    def met(self, row: Row, speed: float) -> bool | None:
        """Whether a row keeps it; None if its number is not known."""
        if math.isnan(row[self.column]):
            return None
        least, most = self.band(speed)
        return least <= row[self.column] <= most

    def shown(self, value: float) -> str:
        return f"{self.scale * value:.{self.digits}f}"

    def limits(self, speed: float) -> str:
        """The band in words"""
        least, most = self.band(speed)
        if least == -INFINITE or most == INFINITE:
            return f"≤ {self.shown(most)}" if least == -INFINITE else f"≥ {self.shown(least)}"
        return f"{self.shown(least)} to {self.shown(most)}"


def near(name: str, share: float) -> Callable[[float], Band]:
    """Within a share of people's number"""
    return lambda speed: ((1 - share) * number(name, speed), (1 + share) * number(name, speed))


def about(name: str, distance: float) -> Callable[[float], Band]:
    """Within a distance of people's number"""
    return lambda speed: (number(name, speed) - distance, number(name, speed) + distance)


def span(least: float, most: float) -> Callable[[float], Band]:
    return lambda speed: (least, most)


BARS = (
    Bar("contact s, within 10 %", "contact_time", near("contact_time", 0.1), 1.0, 3),
    Bar("flight s, within 10 %", "flight_time", near("flight_time", 0.1), 1.0, 3),
    Bar("steps/s, within 10 %", "steps_per_second", near("steps_per_second", 0.1), 1.0, 2),
    Bar("bounce cm, within 20 %", "bounce", near("bounce", 0.2), 100.0, 1),
    Bar("peak force BW, within 10 %", "peak_force", near("peak_force", 0.1), 1.0, 2),
    Bar("knee at touchdown deg", "knee_touchdown", span(-INFINITE, 18.0)),
    Bar("knee in stance, most, deg", "knee_stance", span(38.0, 54.0)),
    Bar("knee at take-off deg", "knee_take_off", span(-INFINITE, 22.0)),
    Bar("knee in swing, most, deg", "knee_swing", about("knee_swing", 15.0)),
    *(
        bar
        for name, most in (("thigh", 6.0), ("knee", 6.0), ("ankle", 8.0), ("foot", 8.0))
        for bar in (
            Bar(f"{name} curve, RMSE deg", f"rmse_{name}", span(-INFINITE, most), 1.0, 1),
            Bar(f"{name} curve, r", f"r_{name}", span(0.95, INFINITE), 1.0, 3),
        )
    ),
    Bar("pelvis yaw, range deg", "pelvis_yaw_range", span(5.0, 21.0), 1.0, 1),
    Bar("landing side of the pelvis behind: yaw deg", "pelvis_yaw_touchdown", span(-INFINITE, 0.0), 1.0, 1),
    Bar("pelvis drop, range deg", "pelvis_drop_range", span(3.0, 15.0), 1.0, 1),
    Bar("swing side of the pelvis low: drop deg", "pelvis_drop", span(0.0, INFINITE), 1.0, 1),
    Bar("arms with the other leg, r", "arm_other_leg", span(0.5, INFINITE), 1.0, 2),
    Bar("arms against their own leg, r", "arm_same_leg", span(-INFINITE, -0.5), 1.0, 2),
)

# What the numbers must do from each beta to the next, and in which share of these steps.
KEPT_SHARE = 0.9
TOLERANCE = 0.01  # by which contacts may grow
TRENDS: dict[str, Callable[[float, float], bool]] = {
    "bounce": lambda low, high: high > low,
    "flight_share": lambda low, high: high > low,
    "contact_time": lambda low, high: high <= (1 + TOLERANCE) * low,
    "arm_swing": lambda low, high: high > low,
}
TREND_TEXTS = {
    "bounce": "bounce grows",
    "flight_share": "flight share grows",
    "contact_time": "contact grows by 1 % at most",
    "arm_swing": "arm swing grows",
}


def steps(rows: Sequence[Row], column: str) -> list[tuple[float, float, float, bool]]:
    """Every step from a beta to the next at a speed, medians over the seeds: speed, the two betas, whether the column
    does as it must."""
    found = []
    for speed in sorted({row["asked_speed"] for row in rows}):
        own = [row for row in rows if row["asked_speed"] == speed]
        betas = sorted({row["beta"] for row in own})
        for low, high in pairwise(betas):
            before, after = (median(row[column] for row in own if row["beta"] == beta) for beta in (low, high))
            found.append((speed, low, high, TRENDS[column](before, after)))
    return found
