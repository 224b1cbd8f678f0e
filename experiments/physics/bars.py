"""What a run that obeys the laws of motion keeps, each as a bar that it passes or fails."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass


@dataclass(frozen=True)
class Bar:
    """text: what is asked. column: the figure it is about. limit: the largest that passes; if `least`, the smallest."""

    text: str
    column: str
    limit: float
    least: bool = False

    def asked(self, figures: Mapping[str, float]) -> bool:
        """Whether the figure is known of a run."""
        return self.column in figures

    def met(self, figures: Mapping[str, float]) -> bool:
        """Whether it keeps the bar; what is not a number does not."""
        value = figures[self.column]
        return value >= self.limit if self.least else value <= self.limit


BARS = (
    Bar("flight: force left at most 0.001 BW", "flight_force_max_bw", 1e-3),
    Bar("flight: moment left at most 0.5 Nm", "flight_moment_max_nm", 0.5),
    Bar("flight: angular momentum constant to 0.05 kg m²/s", "spin_drift_max", 0.05),
    Bar("stance: force left at most 0.001 BW", "stance_force_max_bw", 1e-3),
    Bar("stance: moment left at most 0.5 Nm", "stance_moment_max_nm", 0.5),
    Bar("touchdown, take-off: velocity unexplained at most 0.01 m/s", "kick", 0.01),
    Bar("touchdown, take-off: angular momentum unexplained at most 0.1 kg m²/s", "spin_kick", 0.1),
    Bar("touchdown, take-off: place unexplained at most 0.1 mm", "jump_mm", 0.1),
    Bar("loop closes to 0.1 mm", "seam_mm", 0.1),
    Bar("ground never pulls", "vertical_min_bw", -1e-6, least=True),
    Bar("no force on a foot in the air", "air_force_bw", 1e-6),
    Bar("mean vertical force is the weight to 0.001 BW", "mean_vertical_off_bw", 1e-3),
    Bar("friction needed at most 0.6", "friction", 0.6),
    Bar("centre of pressure at most 1 mm outside of the foot", "cop_excess_mm", 1.0),
    Bar("centre of pressure at most 1 mm off the ground", "cop_height_mm", 1.0),
    Bar("standing foot slips at most 1 mm", "slip_mm", 1.0),
    Bar("standing foot at most 1 mm under the ground", "stance_depth_mm", 1.0),
    Bar("swinging foot at most 1 mm under the ground", "swing_depth_mm", 1.0),
)
