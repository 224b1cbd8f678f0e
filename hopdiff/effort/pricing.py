"""What a whole-body run costs, apart from how it was solved: its terms, its limits, its status."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import NamedTuple

import torch
from torch import Tensor

from hopdiff.effort.limits import excesses, penalty, status_of
from hopdiff.effort.priced import Priced
from hopdiff.effort.residuals import penalty_residuals, with_residuals
from hopdiff.effort.settings import EffortSettings
from hopdiff.effort.terms import ORDINARY_TARGET, Asked, Muscles, energy_rate, energy_ratio, terms_of
from hopdiff.numerics import GRAVITY, absent
from hopdiff.objective import Term, priced, residuals_of
from hopdiff.types import Status


class Numbers(NamedTuple):
    """Everything that our own terms are made of. pace: sqrt(l / g) [s]. swing_knee: wished for at this speed [rad]."""

    settings: EffortSettings
    muscles: Muscles
    pace: float
    asked: Asked
    swing_knee: float

    @classmethod
    def of(cls, settings: EffortSettings, leg: float, swing_knee: float, beta: float, like: Tensor) -> Numbers:
        """Of a leg of that length [m] and a briskness; nothing of a least run is known yet.

        Raises HopdiffError, naming the setting, for a strength that is missing or makes no sense.
        """
        muscles = Muscles.of(settings, leg, like)
        asked = Asked(energy_ratio(beta, settings.scale), None, None)
        return cls(settings, muscles, math.sqrt(leg / GRAVITY), asked, swing_knee)

    def terms(self) -> list[Term]:
        """The rows of the cost that these numbers make, with residuals."""
        return with_residuals(terms_of(*self), *self)


class Bill(NamedTuple):
    """What P candidates cost. merit: (P,). terms: by name (P,), with their weights. status: (P,). moved: (P,) by the
    last round of their solution. residuals: (P, R), of the terms one after the other and of the penalty, where asked
    for.
    """

    merit: Tensor
    terms: dict[str, Tensor]
    status: Tensor
    moved: Tensor
    residuals: Tensor | None = None


@dataclass(frozen=True, eq=False)
class Pricing:
    """terms: those of the numbers, and others."""

    numbers: Numbers
    terms: list[Term]

    @classmethod
    def of(cls, numbers: Numbers, terms: Iterable[Term]) -> Pricing:
        """Terms without weight are not worked out."""
        return cls(numbers, [row for row in terms if not absent(row.weight)])

    def energy(self, run: Priced) -> Tensor:
        """E_r (P,): what the target beta / (1 - beta) is held against."""
        least = self.numbers.asked.external_work
        if least is None:
            return torch.full_like(run.moved, ORDINARY_TARGET)
        return energy_rate(run.external_work() / least, self.numbers.settings.scale)

    def price(self, run: Priced, with_residuals: bool = False) -> Bill:
        """What candidates cost."""
        limits = self.numbers.settings.limits
        over = excesses(run, limits)
        terms = priced(self.terms, run, run.moved.shape[0])
        terms["penalty"] = limits.weight * penalty(over)
        merit = torch.stack(list(terms.values())).sum(0)
        status = status_of(over, run.moved)
        status = torch.where(torch.isfinite(merit), status, torch.full_like(status, int(Status.NOT_FINITE)))
        residuals = None
        if with_residuals:
            penalties = limits.weight**0.5 * penalty_residuals(over)
            residuals = torch.cat([*residuals_of(self.terms, run, terms), penalties], dim=-1)
        return Bill(merit, {"energy": self.energy(run), **terms}, status, run.moved, residuals)
