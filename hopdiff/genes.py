# No `from __future__ import annotations`: Hydra reads the types of the settings classes.
"""The gene table: every free number of a run, with its name, unit and range.

The table is data (`conf/genes/*.yaml`). A range end is a number, or a table from Froude speed v / sqrt(g l) to a
number, so that one table serves every speed and every leg length; between the entries it is linear, beyond them
constant. Searches see the unit box [0, 1]^G only. Three settings choose which entries become genes: `fixed` gives a
gene one value, `common_eta` puts one balance gain in the place of all of them (Kang 1999, section 3.3), and a limp
adds the genes of the lame leg.
"""

import itertools
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from typing import Any, NamedTuple

import torch
import yaml
from torch import Tensor

from hopdiff.doors import config_folder
from hopdiff.messages import near
from hopdiff.numerics import GRAVITY
from hopdiff.types import HopdiffError


@dataclass
class GeneSettings:
    """name: of the table. genes: gene name -> {sense, unit, low, high, ordinary}; sense: see `senses`.

    common_eta: all joints and axes answer the balance error with one gain, the gene `eta`. fixed: gene name -> the one
    value it has, in the unit of the table.
    """

    name: str = "default"
    common_eta: bool = False
    fixed: dict[str, float] = field(default_factory=dict)
    genes: dict[str, Any] = field(default_factory=dict)


# Unit in the table -> factor to what the physics uses (SI, rad), from the leg length [m]. pace is
# sqrt(l / g), m g / l a stiffness per mass.
_UNITS: dict[str, Callable[[float], float]] = {
    **{name: lambda leg: 1.0 for name in ("1", "rad/s2", "s", "m")},
    "deg": lambda leg: math.pi / 180.0,
    "leg": lambda leg: leg,
    "pace": lambda leg: math.sqrt(leg / GRAVITY),
    "m g / l": lambda leg: GRAVITY / leg,
}

# Froude speeds that the tables describe: from a slow jog to a sprint. Beyond, the nearest values hold.
FROUDE_RANGE = (0.4, 3.3)

# One gain for all joints and axes, which takes the place of the genes that begin so.
ETA = "eta"
ETAS_BEGIN = "eta_"

# A lame leg may have its own value of genes, called so; `lame_ease` is how much softer than the other it comes down.
LAME = "lame_"


@cache
def senses(table: str = "default") -> Mapping[str, tuple[float, float]]:
    """The genes of one of our tables (conf/genes/), each with the open interval outside of which it makes no sense.

    They are what a model reads: a table of the user's own has no others, and may not reach beyond them.
    """
    rows = yaml.safe_load((config_folder() / "genes" / f"{table}.yaml").read_text(encoding="utf-8"))["genes"]
    return {name: (float(row["sense"][0]), float(row["sense"][1])) for name, row in rows.items()}


def always_there(known: Iterable[str]) -> tuple[str, ...]:
    """Those genes that every run has: all but the common gain and those of a lame leg."""
    return tuple(name for name in known if name != ETA and not name.startswith(LAME))


@dataclass(frozen=True)
class GeneTable:
    """Genes at one speed of one body.

    names, units: G strings. low, high, ordinary: (G,) in table units; `ordinary` is everyday running, but for the
    fixed genes, whose low, high and ordinary are one. scale: (G,) from table units to what the physics uses.
    everyday: gene name -> (1,) in SI units and rad, the everyday run that calibrates the energy unit: whatever is
    fixed, it is the same, and it does not limp. senses: gene name -> the open interval in which it makes sense, in
    table units.
    """

    name: str
    names: tuple[str, ...]
    units: tuple[str, ...]
    low: Tensor
    high: Tensor
    ordinary: Tensor
    scale: Tensor
    everyday: dict[str, Tensor] = field(default_factory=dict)
    senses: Mapping[str, tuple[float, float]] = field(default_factory=senses)

    @classmethod
    def build(
        cls,
        settings: Any,
        leg_length: float,
        speed: float,
        dtype: torch.dtype = torch.float64,
        device: torch.device | str = "cpu",
        limping: bool = False,
        known: Mapping[str, tuple[float, float]] | None = None,
    ) -> "GeneTable":
        """Table at a speed [m/s] for a leg length [m]. limping: whether the genes of a lame leg belong to it.

        known: the genes of a model and the open interval in which each makes sense; None: those of conf/genes/default.
        Tables that know the gene `eta` have balance gains, and genes of a lame leg.

        Raises HopdiffError, naming the gene, for an unknown or missing gene, an unknown unit, a range that is empty
        or reaches to where the gene makes no sense (alpha at 1/2, a duty factor of 1/2, ...), an ordinary value
        outside its range, or a fixed value that makes no sense or belongs to no gene.
        """
        froude = froude_speed(speed, leg_length)
        where = f"gene table {settings.name!r}"
        sense = senses() if known is None else known
        gains = ETA in sense
        if settings.common_eta and not gains:
            raise HopdiffError("genes.common_eta has no effect here: this model has no balance gains.")
        needed = always_there(sense)
        lame = [name for name in sense if name.startswith(LAME)] if limping else []
        for name in (*needed, *([ETA] if settings.common_eta else []), *lame):
            if name not in settings.genes:
                raise HopdiffError(f"{where}: the gene {name!r} is missing.")
        rows = {name: _row(name, entry, froude, where, sense) for name, entry in settings.genes.items()}
        names = [name for name in rows if not gains or _wanted(name, settings.common_eta, limping)]
        everyday = {name: rows[name].ordinary * rows[name].scale(leg_length) for name in needed}
        for name, value in settings.fixed.items():
            _check_fixed(name, value, names, rows, settings.common_eta, sense)
            rows[name] = _Row(rows[name].unit, value, value, value)
        table = [(row.low, row.high, row.ordinary, row.scale(leg_length)) for row in map(rows.__getitem__, names)]
        low, high, ordinary, scale = torch.tensor(table, dtype=torch.float64).to(device, dtype).T.contiguous()
        return cls(
            name=settings.name,
            names=tuple(names),
            units=tuple(rows[name].unit for name in names),
            low=low,
            high=high,
            ordinary=ordinary,
            scale=scale,
            everyday={name: torch.tensor([value], dtype=dtype, device=device) for name, value in everyday.items()},
            senses=sense,
        )

    @property
    def dimension(self) -> int:
        return len(self.names)

    @property
    def free(self) -> Tensor:
        """(G,) 1 for the genes that can vary, 0 for the fixed ones."""
        return (self.high > self.low).to(self.low)

    def to_physical(self, unit: Tensor) -> Tensor:
        """Unit box (..., G) to table units (..., G)."""
        return self.low + unit * (self.high - self.low)

    def to_unit(self, physical: Tensor) -> Tensor:
        """Table units (..., G) to the unit box; a gene with an empty range goes to 0."""
        span = self.high - self.low
        return torch.where(span > 0, (physical - self.low) / span.clamp_min(1e-30), torch.zeros_like(physical))

    def values(self, unit: Tensor) -> Tensor:
        """Unit box (..., G) to SI units and rad (..., G), in the order of the names."""
        return self.to_physical(unit) * self.scale

    def decode(self, unit: Tensor) -> dict[str, Tensor]:
        """Unit box (P, G) to what the physics uses: gene name -> (P,) in SI units and rad."""
        values = dict(zip(self.names, self.values(unit).unbind(-1), strict=True))
        if ETA in values:
            common = values.pop(ETA)
            values |= dict.fromkeys((name for name in self.senses if name.startswith(ETAS_BEGIN)), common)
        return values


class _Row(NamedTuple):
    """An entry of the table at one speed, in table units."""

    unit: str
    low: float
    high: float
    ordinary: float

    def scale(self, leg_length: float) -> float:
        """Factor from table units to SI units and rad."""
        return _UNITS[self.unit](leg_length)


def _row(name: str, entry: Any, froude: float, where: str, senses: Mapping[str, tuple[float, float]]) -> _Row:
    if name not in senses:
        raise HopdiffError(f"{where}: unknown gene {name!r}; known are {', '.join(senses)}.")
    if not isinstance(entry, Mapping):
        raise HopdiffError(f"{where}: gene {name!r} must be a table of unit, low, high and ordinary, not {entry!r}.")
    # Where everyday running is not known, but where a search begins, the entry is called so.
    usual = "start" if "start" in entry else "ordinary"
    stray = [key for key in entry if key not in ("sense", "unit", "low", "high", usual)]
    if stray:
        raise HopdiffError(f"{where}: gene {name!r} has an unknown entry {stray[0]!r}.")
    unit = str(entry.get("unit"))
    if unit not in _UNITS:
        raise HopdiffError(f"{where}: unknown unit {unit!r} of gene {name!r}; known are {', '.join(_UNITS)}.")
    low, high, ordinary = (
        at_froude(entry.get(key), froude, f"{where}, {name}.{key}") for key in ("low", "high", usual)
    )
    least, most = senses[name]
    if not least < low <= high < most:
        raise HopdiffError(
            f"{where}: the range of {name!r} must satisfy {least:g} < low <= high < {most:g} [{unit}],"
            f" not [{low:g}, {high:g}]."
        )
    if not low <= ordinary <= high:
        raise HopdiffError(f"{where}: the {usual} {name!r} of {ordinary:g} lies outside [{low:g}, {high:g}].")
    return _Row(unit, low, high, ordinary)


def _wanted(name: str, common_eta: bool, limping: bool) -> bool:
    """Whether an entry of the table is a gene of this run."""
    if name.startswith(LAME):
        return limping
    return not (name.startswith(ETAS_BEGIN) if common_eta else name == ETA)


def _check_fixed(
    name: str,
    value: float,
    names: Sequence[str],
    rows: Mapping[str, _Row],
    common_eta: bool,
    senses: Mapping[str, tuple[float, float]],
) -> None:
    """Raises HopdiffError if a fixed value belongs to no gene of this run or makes no sense."""
    where = f"genes.fixed.{name}"
    if name not in rows:
        raise HopdiffError(f"{where}: there is no gene {name!r} in the gene table.{near(name, names)}")
    if name == ETA and not common_eta:
        raise HopdiffError(f"{where} needs genes.common_eta=true: otherwise every joint has a gain of its own.")
    if name.startswith(ETAS_BEGIN) and common_eta:
        raise HopdiffError(f"{where} has no effect with genes.common_eta=true: fix genes.fixed.eta.")
    if name not in names:
        raise HopdiffError(f"{where} is a gene of the lame leg and needs limp.amount above 0.")
    least, most = senses[name]
    if not least < value < most:
        raise HopdiffError(f"{where} must lie between {least:g} and {most:g} [{rows[name].unit}], not {value:g}.")


def froude_speed(speed: float, leg_length: float) -> float:
    """Speed over the speed sqrt(g l) of a body with legs of length l [m]."""
    return speed / math.sqrt(GRAVITY * leg_length)


def at_froude(entry: Any, froude: float, where: str) -> float:
    """A number, or the value at a Froude speed of a table {froude: number}. Raises HopdiffError, naming `where`."""
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
