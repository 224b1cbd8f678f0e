# No `from __future__ import annotations`: Hydra reads the types of the settings classes.
"""The gene table: every free number of a run, with its name, unit and range.

The table is data (`conf/genes/*.yaml`). A range end is a number, or a table from Froude speed v / sqrt(g l) to a
number, so that one table serves every speed and every leg length; between the entries it is linear, beyond them
constant. Searches see the unit box [0, 1]^G only.
"""

import itertools
import math
from dataclasses import dataclass, field
from typing import Any

import torch
from torch import Tensor

from hopdiff.numerics import GRAVITY
from hopdiff.types import HopdiffError


@dataclass
class GeneSettings:
    """name: of the table. genes: gene name -> {unit, low, high, ordinary}."""

    name: str = "default"
    genes: dict[str, Any] = field(default_factory=dict)


# Unit in the table -> factor to what the physics uses (SI, rad); lengths in leg lengths are scaled by the body.
_UNITS = {"1": 1.0, "rad/s2": 1.0, "deg": math.pi / 180.0, "s": 1.0, "m": 1.0, "leg": None}

# Names the model reads, and the open interval outside of which it makes no sense.
KNOWN_GENES: dict[str, tuple[float, float]] = {
    "touchdown_angle": (0.0, 90.0),
    "duty_factor": (0.0, 0.5),
    "leg_extension": (0.5, 0.9951),
    "step_width": (-1.0, 1.0),
    "swing_reach": (0.0, 120.0),
    "swing_angle_start": (-120.0, 60.0),
    "swing_knee_start": (0.0, 180.0),
    "swing_knee_middle": (0.0, 180.0),
    "swing_clearance_end": (-0.01, 0.9),
    "com_lead": (-1.0, 1.0),
    "pelvis_tilt": (-90.0, 90.0),
    "pelvis_roll": (-90.0, 90.0),
    "pelvis_yaw": (-90.0, 90.0),
    "trunk_yaw": (-90.0, 90.0),
    "neck_flex": (-90.0, 90.0),
    "arm_swing": (-180.0, 180.0),
    "arm_offset": (-180.0, 180.0),
    "arm_phase": (-180.0, 180.0),
    "arm_abduction": (-90.0, 180.0),
    "arm_inward": (-90.0, 180.0),
    "elbow_flexion": (-1.0, 180.0),
    "elbow_swing": (-180.0, 180.0),
    "eta_trunk_lean": (-1e3, 1e3),
    "eta_trunk_side": (-1e3, 1e3),
    "eta_neck_flex": (-1e3, 1e3),
    "eta_neck_side": (-1e3, 1e3),
    "eta_shoulder": (-1e3, 1e3),
    "eta_abduction": (-1e3, 1e3),
    "eta_elbow": (-1e3, 1e3),
}


@dataclass(frozen=True)
class GeneTable:
    """Genes at one speed of one body.

    names, units: G strings. low, high, ordinary: (G,) in table units; `ordinary` is everyday running, the point
    that calibrates the energy unit. scale: (G,) from table units to what the physics uses.
    """

    name: str
    names: tuple[str, ...]
    units: tuple[str, ...]
    low: Tensor
    high: Tensor
    ordinary: Tensor
    scale: Tensor

    @classmethod
    def build(
        cls,
        settings: Any,
        leg_length: float,
        speed: float,
        dtype: torch.dtype = torch.float64,
        device: torch.device | str = "cpu",
    ) -> "GeneTable":
        """Table at a speed [m/s] for a leg length [m].

        Raises HopdiffError, naming the gene, for an unknown or missing gene, an unknown unit, a range that is empty
        or reaches to where the gene makes no sense (alpha at 1/2, a duty factor of 1/2, ...), or an ordinary value
        outside its range.
        """
        froude = speed / math.sqrt(GRAVITY * leg_length)
        where = f"gene table {settings.name!r}"
        entries = dict(settings.genes)
        for name in KNOWN_GENES:
            if name not in entries:
                raise HopdiffError(f"{where}: the gene {name!r} is missing.")
        rows, units = [], []
        for name, entry in entries.items():
            if name not in KNOWN_GENES:
                raise HopdiffError(f"{where}: unknown gene {name!r}; known are {', '.join(KNOWN_GENES)}.")
            stray = [key for key in entry if key not in ("unit", "low", "high", "ordinary")]
            if stray:
                raise HopdiffError(f"{where}: gene {name!r} has an unknown entry {stray[0]!r}.")
            unit = str(entry.get("unit"))
            if unit not in _UNITS:
                raise HopdiffError(f"{where}: unknown unit {unit!r} of gene {name!r}; known are {', '.join(_UNITS)}.")
            low, high, ordinary = (
                _at_froude(entry.get(key), froude, f"{where}, {name}.{key}") for key in ("low", "high", "ordinary")
            )
            least, most = KNOWN_GENES[name]
            if not least < low <= high < most:
                raise HopdiffError(
                    f"{where}: the range of {name!r} must satisfy {least:g} < low <= high < {most:g} [{unit}],"
                    f" not [{low:g}, {high:g}]."
                )
            if not low <= ordinary <= high:
                raise HopdiffError(f"{where}: the ordinary {name!r} of {ordinary:g} lies outside [{low:g}, {high:g}].")
            factor = _UNITS[unit]
            rows.append((low, high, ordinary, leg_length if factor is None else factor))
            units.append(unit)
        columns = torch.tensor(rows, dtype=torch.float64).to(device, dtype).T.contiguous()
        return cls(settings.name, tuple(entries), tuple(units), *columns)

    @property
    def dimension(self) -> int:
        return len(self.names)

    def to_physical(self, unit: Tensor) -> Tensor:
        """Unit box (..., G) to table units (..., G)."""
        return self.low + unit * (self.high - self.low)

    def to_unit(self, physical: Tensor) -> Tensor:
        """Table units (..., G) to the unit box; a gene with an empty range goes to 0."""
        span = self.high - self.low
        return torch.where(span > 0, (physical - self.low) / span.clamp_min(1e-30), torch.zeros_like(physical))

    def decode(self, unit: Tensor) -> dict[str, Tensor]:
        """Unit box (P, G) to what the physics uses: gene name -> (P,) in SI units and rad."""
        values = self.to_physical(unit) * self.scale
        return dict(zip(self.names, values.unbind(-1), strict=True))


def _at_froude(entry: Any, froude: float, where: str) -> float:
    """A number, or the value at a Froude speed of a table {froude: number}."""
    if entry is None:
        raise HopdiffError(f"{where} is missing.")
    if hasattr(entry, "items"):
        points = sorted((_number(k, where), _number(v, where)) for k, v in entry.items())
        if not points:
            raise HopdiffError(f"{where} is an empty table.")
        if froude <= points[0][0]:
            return points[0][1]
        for (x0, y0), (x1, y1) in itertools.pairwise(points):
            if froude <= x1:
                return y0 + (y1 - y0) * (froude - x0) / (x1 - x0)
        return points[-1][1]
    return _number(entry, where)


def _number(value: Any, where: str) -> float:
    try:
        number = float(value)
    except (TypeError, ValueError):
        number = math.nan
    if not math.isfinite(number):
        raise HopdiffError(f"{where} must be a finite number, not {value!r}.")
    return number
