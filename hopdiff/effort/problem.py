"""A whole-body run as an optimisation problem: genes in, movement and cost out."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property
from typing import Any, NamedTuple

import torch
from torch import Tensor

from hopdiff.character import Character
from hopdiff.doors import TERMS
from hopdiff.effort.priced import Priced
from hopdiff.effort.pricing import Bill, Numbers, Pricing
from hopdiff.effort.settings import EffortSettings
from hopdiff.effort.terms import ORDINARY_BETA
from hopdiff.genes import GeneTable, at_froude, froude_speed
from hopdiff.kernels.choose import OFF, chosen
from hopdiff.kernels.pieces import Told
from hopdiff.motion import Motion
from hopdiff.numerics import gradient_of_each
from hopdiff.objective import Term, with_brought
from hopdiff.search.base import Eval, joined
from hopdiff.search.gradient import Gradient
from hopdiff.search.loop import Budget, run_search
from hopdiff.types import HopdiffError, Status, check_asked
from hopdiff.whole_body.anchor import Anchor
from hopdiff.whole_body.dynamics import dynamics
from hopdiff.whole_body.finish import stride_motion
from hopdiff.whole_body.gait import BodyGait
from hopdiff.whole_body.model import BESIDE_ROUNDS, BodyModel

CHUNK = 64  # candidates priced at once: more are slower, and need memory
LOST = 0.05  # m and rad of the last round beyond which a candidate's cost says nothing
LEAST_BUDGET = 1000  # evaluations for the run of least cost that the energy is told in
SPREAD, NEAR = 0.1, 0.04  # of where searches begin, in box widths: about the table's start, about the least run


class Least(NamedTuple):
    """The run of least cost. genes: (G,) in the unit box, None where only its numbers were given."""

    external_work: float
    contact_time: float
    genes: Tensor | None


_found: dict[Any, Least] = {}  # runs of least cost by what they depend on: sweeps over beta need them again and again


class BodyProblem:
    """One body, one speed, one briskness. Implements `hopdiff.search.base.Problem`.

    Raises HopdiffError if speed is not positive and finite, beta not in [0, 1), a setting of the costs makes no sense,
    or no run of least cost is found. given: terms on top of those that the settings weigh.
    """

    starts = 2  # descents side by side that a search should begin with
    screen = 18  # points that they are taken from
    restarts = 1  # descents that must have been in vain before a search is over

    def __init__(
        self,
        character: Character,
        table: GeneTable,
        model: BodyModel,
        settings: EffortSettings,
        speed: float,
        beta: float,
        given: Sequence[Term] = (),
        compiling: str = OFF,
    ) -> None:
        check_asked(speed, beta)
        _check(settings)
        self.compiling = compiling
        self.given = tuple(given)
        self.character, self.table, self.model, self.settings = character, table, model, settings
        self.speed, self.beta = float(speed), float(beta)
        self.start, self.spread = table.to_unit(table.ordinary), SPREAD
        knee = math.radians(at_froude(settings.human.swing_knee_deg, self.froude, "costs.human.swing_knee_deg"))
        numbers = Numbers.of(settings, character.leg_length, knee, self.beta, table.low)
        foreign = bool(given or settings.extra)
        told = Told.of(table.names, model, numbers, self.speed)
        self.kernels, self.word = chosen(compiling, told, table.values(self.start.unsqueeze(0)), foreign)
        self.least: Least | None = None
        if beta != ORDINARY_BETA:
            self.least = self._least()
            if self.least.genes is not None:
                self.start, self.spread = self.least.genes, NEAR
            work, contact = self.least.external_work, self.least.contact_time
            numbers = numbers._replace(asked=numbers.asked._replace(external_work=work, contact_time=contact))
            if self.kernels is not None:
                self.kernels = replace(self.kernels, told=Told.of(table.names, model, numbers, self.speed))
        brought = [TERMS.load(name) for name in settings.extra if name in TERMS.brought]
        rows = with_brought(numbers.terms(), brought, settings.extra, "body", given, vars(settings))
        self.pricing = Pricing.of(numbers, rows)

    @property
    def dimension(self) -> int:
        return self.table.dimension

    @property
    def dtype(self) -> torch.dtype:
        return self.table.low.dtype

    @property
    def device(self) -> torch.device:
        return self.table.low.device

    @property
    def froude(self) -> float:
        """Speed over the speed sqrt(g l) of the body."""
        return froude_speed(self.speed, self.character.leg_length)

    @property
    def shortest_stride(self) -> float:
        """Duration of the shortest stride that the gene table allows [s]."""
        return 2.0 * float(self.table.decode(torch.zeros_like(self.table.low))["step_time"])

    @property
    def terms(self) -> list[Term]:
        """The rows of the cost."""
        return self.pricing.terms

    @cached_property
    def anchor(self) -> Anchor | None:
        """The solved movement at the start of searches, beside which others are found."""
        genes, speed = self.table.decode(self.start.unsqueeze(0)), self.start.new_tensor([self.speed])
        return self.model.anchor(genes, speed, None if self.kernels is None else self.kernels.rounds)

    def _least(self) -> Least:
        """The run of least cost: given by the settings, or searched for, the same way whatever the user's search is."""
        given = self.settings.least
        if given.external_work is not None and given.contact_time is not None:
            return Least(given.external_work, given.contact_time, None)
        layout, table = self.model.layout, self.table
        body = (layout.masses, layout.centres, layout.inertias, layout.offsets, layout.heel, layout.ball, layout.toe)
        tensors = (table.low, table.high, table.ordinary, *body)
        key = (
            *(tensor.detach().cpu().double().numpy().tobytes() for tensor in tensors),
            self.speed,
            repr(self.settings),
            self.given,
            (self.model.plan, self.model.rounds, self.model.adjoint_rounds, self.model.lame, self.model.amount),
            (str(self.dtype), str(self.device), torch.get_num_threads(), self.kernels is None),
        )
        if key not in _found:
            plain = BodyProblem(
                self.character, table, self.model, self.settings, self.speed, ORDINARY_BETA, self.given, self.compiling
            )
            search = Gradient(tolerance=2e-5)
            try:
                result = run_search(plain, search, Budget(LEAST_BUDGET), torch.Generator().manual_seed(0))
            except HopdiffError as error:
                raise HopdiffError(
                    f"no run of least cost was found at speed={self.speed:g} for character {self.character.name!r},"
                    f" which the energy of beta={self.beta:g} is told in: {error}"
                ) from error
            if result.interrupted:
                raise KeyboardInterrupt
            run = plain.run(result.best_genes.unsqueeze(0), with_grad=False)
            _found[key] = Least(float(run.external_work()), float(run.contact_times().mean()), result.best_genes)
        return _found[key]

    def run(self, genes: Tensor, with_grad: bool, start: Tensor | None = None) -> Priced:
        """The solved movements of candidates (P, G) of the unit box. start: (P, K), see `BodyModel.solved`."""
        speed = torch.full((genes.shape[0],), self.speed, dtype=genes.dtype, device=genes.device)
        movement, body, moved = self.model.solved(self.table.decode(genes), speed, with_grad, self.anchor, start)
        return Priced(movement, body, dynamics(movement, body), moved)

    def solved(self, genes: Tensor) -> Priced:
        """The same, solved to rounding."""
        speed = torch.full((genes.shape[0],), self.speed, dtype=genes.dtype, device=genes.device)
        with torch.no_grad():
            movement, body, moved = self.model.exact(self.table.decode(genes), speed, self.anchor)
            return Priced(movement, body, dynamics(movement, body), moved)

    def _priced(
        self, genes: Tensor, with_grad: bool, with_residuals: bool = False, start: Tensor | None = None
    ) -> Bill:
        """What candidates cost, by compiled kernels where there are some."""
        if self.kernels is not None and self.anchor is not None:
            rounds = self.model.rounds if start is None else BESIDE_ROUNDS
            adjoint_rounds = self.model.adjoint_rounds if with_grad else 0
            return self.kernels.price(self.table.values(genes), self.anchor, rounds, adjoint_rounds, start)
        return self.pricing.price(self.run(genes, with_grad, start), with_residuals)

    def _beside(self, genes: Tensor, group: int) -> Tensor | None:
        """Where candidates (P, G) begin to be solved that come in groups: the first of each is solved alone."""
        if self.anchor is None:
            return None
        values = self.table.values(genes)
        first = values[::group]
        if self.kernels is None:
            speed = torch.full_like(first[:, 0], self.speed)
            movement = self.model.movement(self.table.decode(genes[::group]), speed)
            solved = movement.solve(self.model.rounds, guide=self.anchor)[0]
        else:
            solved = self.kernels.solve(first, self.anchor, self.model.rounds)[0]
        solved, first = (x.repeat_interleave(group, dim=0) for x in (solved, first))
        return self.anchor.beside(solved, values - first)

    def evaluate(self, genes: Tensor, with_grad: bool) -> Eval:
        """Price candidates (P, G) of the unit box; `with_grad` adds the gradient of the merit."""
        return joined([self._evaluated(part, with_grad) for part in genes.detach().split(CHUNK)])

    def residuals(self, genes: Tensor) -> Eval:
        """The same without gradient, but with residuals: of the terms one after the other, and of the penalty."""
        return joined([self._with_residuals(part, None) for part in genes.detach().split(CHUNK)])

    def residuals_about(self, genes: Tensor, group: int) -> Eval:
        """The same of candidates in groups: one, and `group` - 1 so close to it that they tell how it changes."""
        size = max(CHUNK // group, 1) * group
        with torch.no_grad():
            parts = genes.detach().split(size)
            return joined([self._with_residuals(part, self._beside(part, group)) for part in parts])

    def _evaluated(self, genes: Tensor, with_grad: bool) -> Eval:
        if with_grad:
            genes = genes.clone().requires_grad_(True)
        with torch.set_grad_enabled(with_grad):
            bill = self._priced(genes, with_grad)
            computable = torch.isfinite(bill.merit) & (bill.moved < LOST)
            gradient = None
            if with_grad:
                gradient, sound = gradient_of_each(torch.where(computable, bill.merit, 0.0), genes)
                computable = computable & sound
        return _told(bill, computable, gradient)

    def _with_residuals(self, genes: Tensor, start: Tensor | None) -> Eval:
        with torch.no_grad():
            bill = self._priced(genes, with_grad=False, with_residuals=True, start=start)
        return _told(bill, torch.isfinite(bill.merit) & (bill.moved < LOST))._replace(residuals=bill.residuals)

    def gait(self, genes: Tensor) -> BodyGait:
        """The endless runs of candidates (P, G) of the unit box, to be sampled in time."""
        speed = torch.full((genes.shape[0],), self.speed, dtype=genes.dtype, device=genes.device)
        return self.model.gait(self.table.decode(genes), speed, self.anchor)

    def motion(self, genes: Tensor, fps: float) -> Motion:
        """One stride of a candidate (G,) at about `fps` frames/s: the nearest rate with a whole number of frames."""
        with torch.no_grad():
            return stride_motion(self.gait(genes.unsqueeze(0)), fps)

    def told(self, settings: dict[str, Any]) -> dict[str, Any]:
        """Settings of the costs with the numbers of the least run put in, so that a replay need not search for it."""
        if self.least is None:
            return settings
        least = {"external_work": self.least.external_work, "contact_time": self.least.contact_time}
        return {**settings, "least": least}


def _told(bill: Bill, computable: Tensor, gradient: Tensor | None = None) -> Eval:
    merit = torch.where(computable, bill.merit.detach(), torch.inf)
    cost = torch.where(bill.status == int(Status.OK), merit, torch.inf)
    return Eval(cost, gradient, merit, {name: value.detach() for name, value in bill.terms.items()}, bill.status)


def _check(settings: EffortSettings) -> None:
    """Raises HopdiffError, naming the setting, for a number that makes no sense."""
    limits, human = settings.limits, settings.human
    for owner, where in ((settings, "costs"), (limits, "costs.limits"), (human, "costs.human")):
        for name, value in vars(owner).items():
            if isinstance(value, float) and not math.isfinite(value):
                raise HopdiffError(f"{where}.{name} must be a finite number, not {value}.")
    weights = ("positive_work", "negative_work", "torque", "torque_rate", "steady", "energy", "contact_cap")
    for name in weights:
        if getattr(settings, name) < 0:
            raise HopdiffError(f"costs.{name} must be a number of 0 or more, not {getattr(settings, name):g}.")
    if not 0.0 <= settings.transfer <= 1.0:
        raise HopdiffError(f"costs.transfer must lie between 0 and 1, not {settings.transfer:g}.")
    if not 0.0 < settings.scale <= 2.0:
        raise HopdiffError(f"costs.scale must lie above 0 and not above 2, not {settings.scale:g}.")
    for owner, where in ((human, "costs.human"), (limits, "costs.limits"), (settings, "costs")):
        for name in ("trunk_lean", "pelvis_drop", "pelvis_yaw", "arm_swing", "swing_knee", "weight", "ankle_stiffness"):
            if getattr(owner, name, 0.0) < 0:
                raise HopdiffError(f"{where}.{name} must be a number of 0 or more, not {getattr(owner, name):g}.")
    least = settings.least
    for name, given in vars(least).items():
        if given is not None and not (math.isfinite(given) and given > 0):
            raise HopdiffError(f"costs.least.{name} must be a number above 0, not {given}.")
    if (least.external_work is None) != (least.contact_time is None):
        raise HopdiffError("costs.least needs both external_work and contact_time, or neither.")
    for name, low, high in (
        ("friction", 0.05, 5.0),
        ("clearance", 0.0, 0.5),
        ("apart", -0.5, 0.5),
        ("flight_time", 0.0, 5.0),
        ("reach", 0.5, 1.0),
    ):
        if not low <= (value := getattr(limits, name)) <= high:
            raise HopdiffError(f"costs.limits.{name} must lie between {low:g} and {high:g}, not {value:g}.")
    for name in ("knee_deg", "ankle_deg", "hip_deg", "elbow_deg"):
        ends = getattr(limits, name)
        if len(ends) != 2 or not ends[0] < ends[1]:
            raise HopdiffError(f"costs.limits.{name} must be [low, high] with low < high, not {list(ends)}.")
