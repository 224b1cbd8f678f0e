"""A whole-body run as an optimisation problem: genes in, movement and cost out."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cached_property
from typing import Any, NamedTuple

import torch
from torch import Tensor

from hopdiff.character import Character
from hopdiff.doors import TERMS
from hopdiff.effort.limits import Excess, excesses, penalty, status_of
from hopdiff.effort.priced import Priced
from hopdiff.effort.residuals import penalty_residuals, with_residuals
from hopdiff.effort.settings import EffortSettings
from hopdiff.effort.terms import ORDINARY_BETA, Asked, Muscles, energy_rate, energy_ratio, terms_of
from hopdiff.genes import GeneTable, at_froude, froude_speed
from hopdiff.motion import Motion
from hopdiff.numerics import GRAVITY, gradient_of_each
from hopdiff.objective import Term, priced, residuals_of, with_brought
from hopdiff.search.base import Eval, joined
from hopdiff.search.gradient import Gradient
from hopdiff.search.loop import Budget, run_search
from hopdiff.types import HopdiffError, Status, check_asked
from hopdiff.whole_body.anchor import Anchor
from hopdiff.whole_body.dynamics import dynamics
from hopdiff.whole_body.finish import stride_motion
from hopdiff.whole_body.gait import BodyGait
from hopdiff.whole_body.model import BodyModel

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
    ) -> None:
        check_asked(speed, beta)
        _check(settings)
        self.given = tuple(given)
        self.character, self.table, self.model, self.settings = character, table, model, settings
        self.speed, self.beta = float(speed), float(beta)
        self.muscles = Muscles.of(settings, character.leg_length, table.low)
        self.pace = math.sqrt(character.leg_length / GRAVITY)
        self.start, self.spread = table.to_unit(table.ordinary), SPREAD
        self.swing_knee = math.radians(
            at_froude(settings.human.swing_knee_deg, self.froude, "costs.human.swing_knee_deg")
        )
        self.least: Least | None = None
        if beta != ORDINARY_BETA:
            self.least = self._least()
            if self.least.genes is not None:
                self.start, self.spread = self.least.genes, NEAR
        asked = Asked(energy_ratio(beta, settings.scale), None, None)
        if self.least is not None:
            asked = asked._replace(external_work=self.least.external_work, contact_time=self.least.contact_time)
        given_to = (settings, self.muscles, self.pace, asked, self.swing_knee)
        rows = with_residuals(terms_of(*given_to), *given_to)
        brought = [TERMS.load(name) for name in settings.extra if name in TERMS.brought]
        rows = with_brought(rows, brought, settings.extra, "body", given, vars(settings))
        self.terms = [row for row in rows if row.weight != 0.0]

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

    @cached_property
    def anchor(self) -> Anchor | None:
        """The solved movement at the start of searches, beside which others are found."""
        return self.model.anchor(self.table.decode(self.start.unsqueeze(0)), self.start.new_tensor([self.speed]))

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
            (str(self.dtype), str(self.device), torch.get_num_threads()),
        )
        if key not in _found:
            plain = BodyProblem(self.character, table, self.model, self.settings, self.speed, ORDINARY_BETA, self.given)
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

    def run(self, genes: Tensor, with_grad: bool) -> Priced:
        """The solved movements of candidates (P, G) of the unit box."""
        speed = torch.full((genes.shape[0],), self.speed, dtype=genes.dtype, device=genes.device)
        movement, body, moved = self.model.solved(self.table.decode(genes), speed, with_grad, self.anchor)
        return Priced(movement, body, dynamics(movement, body), moved)

    def solved(self, genes: Tensor) -> Priced:
        """The same, solved to rounding."""
        speed = torch.full((genes.shape[0],), self.speed, dtype=genes.dtype, device=genes.device)
        with torch.no_grad():
            movement, body, moved = self.model.exact(self.table.decode(genes), speed, self.anchor)
            return Priced(movement, body, dynamics(movement, body), moved)

    def energy(self, run: Priced) -> Tensor:
        """E_r (P,): what the target beta / (1 - beta) is held against."""
        if self.least is None:
            return torch.full_like(run.moved, ORDINARY_BETA / (1.0 - ORDINARY_BETA))
        return energy_rate(run.external_work() / self.least.external_work, self.settings.scale)

    def price(self, run: Priced) -> tuple[Tensor, dict[str, Tensor], Tensor]:
        """Merit (P,), its terms with their weights, and the status (P,)."""
        return self._priced(run, excesses(run, self.settings.limits))

    def _priced(self, run: Priced, over: list[Excess]) -> tuple[Tensor, dict[str, Tensor], Tensor]:
        terms = priced(self.terms, run, len(run.moved))
        terms["penalty"] = self.settings.limits.weight * penalty(over)
        merit = torch.stack(list(terms.values())).sum(0)
        status = status_of(over, run.moved)
        status = torch.where(torch.isfinite(merit), status, torch.full_like(status, int(Status.NOT_FINITE)))
        return merit, {"energy": self.energy(run), **terms}, status

    def evaluate(self, genes: Tensor, with_grad: bool) -> Eval:
        """Price candidates (P, G) of the unit box; `with_grad` adds the gradient of the merit."""
        return joined([self._evaluated(part, with_grad) for part in genes.detach().split(CHUNK)])

    def residuals(self, genes: Tensor) -> Eval:
        """The same without gradient, but with residuals: of the terms one after the other, and of the penalty."""
        return joined([self._with_residuals(part) for part in genes.detach().split(CHUNK)])

    def _evaluated(self, genes: Tensor, with_grad: bool) -> Eval:
        if with_grad:
            genes = genes.clone().requires_grad_(True)
        with torch.set_grad_enabled(with_grad):
            run = self.run(genes, with_grad)
            merit, terms, status = self.price(run)
            computable = torch.isfinite(merit) & (run.moved < LOST)
            gradient = None
            if with_grad:
                gradient, sound = gradient_of_each(torch.where(computable, merit, 0.0), genes)
                computable = computable & sound
        return _told(merit, computable, {k: v.detach() for k, v in terms.items()}, status, gradient)

    def _with_residuals(self, genes: Tensor) -> Eval:
        with torch.no_grad():
            run = self.run(genes, with_grad=False)
            over = excesses(run, self.settings.limits)
            merit, terms, status = self._priced(run, over)
            penalties = math.sqrt(self.settings.limits.weight) * penalty_residuals(over)
            residuals = torch.cat([*residuals_of(self.terms, run, terms), penalties], dim=-1)
        found = _told(merit, torch.isfinite(merit) & (run.moved < LOST), terms, status)
        return found._replace(residuals=residuals)

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


def _told(
    merit: Tensor, computable: Tensor, terms: dict[str, Tensor], status: Tensor, gradient: Tensor | None = None
) -> Eval:
    merit = torch.where(computable, merit.detach(), torch.inf)
    cost = torch.where(status == int(Status.OK), merit, torch.inf)
    return Eval(cost, gradient, merit, terms, status)


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
