"""What is compiled: the parts of an evaluation, each a function of tensors alone.

P candidates; values: (P, G) genes in SI units and rad; state: (P, K) of `hopdiff.whole_body.movement`; told: what a
round is told, see `Movement.round`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import torch
from torch import Tensor

from hopdiff.effort.priced import Priced
from hopdiff.effort.pricing import Numbers, Pricing
from hopdiff.effort.settings import LeastSettings
from hopdiff.whole_body.dynamics import dynamics
from hopdiff.whole_body.model import BodyModel
from hopdiff.whole_body.movement import Movement

NOTHING = 1e-300  # weight of a term that is worked out and does not count

Piece = Callable[..., tuple[Tensor, ...]]


class Told(NamedTuple):
    """Everything that an evaluation depends on besides the genes. names: of the genes. speed: [m/s]."""

    names: tuple[str, ...]
    model: BodyModel
    numbers: Numbers
    speed: float

    @classmethod
    def of(cls, names: tuple[str, ...], model: BodyModel, numbers: Numbers, speed: float) -> Told:
        """With what no equation reads left out, and with all terms: one kernel also serves where nothing is asked."""
        settings = replace(numbers.settings, name="", least=LeastSettings(None, None), strength={}, tendon={}, extra={})
        settings = replace(settings, human=replace(settings.human, swing_knee_deg=0.0))
        # How long a movement is solved for, and which leg is drawn as the lame one, is not in a kernel.
        model = replace(model, rounds=0, adjoint_rounds=0, lame="")
        asked = numbers.asked
        if asked.external_work is None:
            settings = replace(settings, energy=NOTHING, contact_cap=NOTHING)
            asked = asked._replace(external_work=1.0, contact_time=1.0)
        return cls(names, model, numbers._replace(settings=settings, asked=asked), float(speed))

    @property
    def asks(self) -> bool:
        """Whether the cost has the terms of what a run is asked for."""
        return self.numbers.settings.energy != NOTHING

    def terms(self) -> list[str]:
        """Names of what `slopes` and `roots` tell, in their order."""
        return ["energy", *(row.name for row in self._pricing().terms), "penalty"]

    def _pricing(self) -> Pricing:
        return Pricing.of(self.numbers, self.numbers.terms())

    def movement(self, values: Tensor) -> Movement:
        """The movements of P candidates, not solved."""
        speed = torch.as_tensor(self.speed, dtype=values.dtype).expand(values.shape[0])
        return self.model.movement(dict(zip(self.names, values.unbind(-1), strict=True)), speed)

    def _run(self, values: Tensor, state: Tensor, moved: Tensor) -> Priced:
        movement = self.movement(values)
        body = movement.body(state)
        return Priced(movement, body, dynamics(movement, body), moved)

    # -- the pieces --

    def round(self, values: Tensor, state: Tensor, told: Tensor) -> tuple[Tensor, ...]:
        """The next state (P, K)."""
        return (self.movement(values).round(state, told),)

    def pull(self, values: Tensor, state: Tensor, push: Tensor, told: Tensor) -> tuple[Tensor, ...]:
        """Gradients by state (P, K) and by values (P, G) of the next state times `push` (P, K)."""
        values, state = (x.detach().requires_grad_(True) for x in (values, state))
        return torch.autograd.grad(self.round(values, state, told), (state, values), (push,))

    def roots(self, values: Tensor, state: Tensor, moved: Tensor) -> tuple[Tensor, ...]:
        """Merit (P,), status (P,), terms (P, T) and residuals (P, R). moved: (P,) by the last round."""
        bill = self._pricing().price(self._run(values, state, moved), with_residuals=True)
        assert bill.residuals is not None
        return bill.merit, bill.status, torch.stack(list(bill.terms.values()), dim=-1), bill.residuals

    def slopes(self, values: Tensor, state: Tensor, moved: Tensor) -> tuple[Tensor, ...]:
        """Merit (P,), status (P,), terms (P, T) and the gradients of the merit by state (P, K) and by values (P, G)."""
        values, state = (x.detach().requires_grad_(True) for x in (values, state))
        bill = self._pricing().price(self._run(values, state, moved))
        slopes = torch.autograd.grad(bill.merit.sum(), (state, values))
        return bill.merit.detach(), bill.status, torch.stack(list(bill.terms.values()), dim=-1).detach(), *slopes
