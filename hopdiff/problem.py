"""A run as an optimisation problem: genes in, motion and cost out."""

from __future__ import annotations

import math
from collections.abc import Sequence

import torch
from torch import Tensor
from torch.nn import functional

from hopdiff import costs, limits
from hopdiff.character import Character
from hopdiff.costs import Calibration, CostSettings, Judged
from hopdiff.doors import TERMS
from hopdiff.genes import GeneTable, froude_speed
from hopdiff.messages import choose
from hopdiff.models.base import Model
from hopdiff.models.gait import Gait, stride_motion
from hopdiff.models.trajectory import Trajectory
from hopdiff.motion import Motion
from hopdiff.numerics import gradient_of_each
from hopdiff.objective import Term, priced, residuals_of, with_brought
from hopdiff.search.base import Eval, joined
from hopdiff.types import HopdiffError, Status, check_asked

CHUNK = 256  # candidates priced at once: more are hardly faster, and need memory


class RunProblem:
    """One body, one speed, one briskness. Implements `hopdiff.search.base.Problem`.

    Raises HopdiffError if speed is not positive and finite, beta not in [0, 1), or the ordinary run of this body
    at this speed is not possible (then nothing calibrates the energy unit). given: terms on top of those that the
    settings weigh.
    """

    starts = 1  # descents side by side that a search should begin with: from nearly anywhere they end in one place
    screen = 64  # points that they are taken from
    restarts = 1  # descents that must have been in vain before a search is over

    def __init__(
        self,
        character: Character,
        table: GeneTable,
        model: Model,
        settings: CostSettings,
        speed: float,
        beta: float,
        given: Sequence[Term] = (),
    ) -> None:
        check_asked(speed, beta)
        choose("costs.gamma", settings.gamma, costs.GAMMAS)
        self.character = character
        self.table = table
        self.model = model
        self.settings = settings
        self.speed = float(speed)
        self.beta = float(beta)
        self.ordinary_genes = table.to_unit(table.ordinary)
        self.ordinary = self._measure_ordinary()
        rows = costs.terms_of(settings, self.ordinary, self.ordinary_genes, table.free, self.beta)
        brought = [TERMS.load(name) for name in settings.extra if name in TERMS.brought]
        self.terms = with_brought(rows, brought, settings.extra, "hopper", given, vars(settings))

    @property
    def dimension(self) -> int:
        return self.table.dimension

    @property
    def start(self) -> Tensor:
        """The everyday run with the fixed genes put in (G,); `hopdiff.search.ordinary` prices no other."""
        return self.ordinary_genes

    @property
    def dtype(self) -> torch.dtype:
        return self.table.low.dtype

    @property
    def device(self) -> torch.device:
        return self.table.low.device

    def _measure_ordinary(self) -> Calibration:
        with torch.no_grad():
            # The everyday run, whatever genes are fixed: the unit of energy must not depend on them.
            trajectory = self.model.sound.trajectory(self.table.everyday, self.table.low.new_tensor([self.speed]))
            raw = float(costs.energy_rate_raw(trajectory, self.character))
            if not (bool(trajectory.solved) and math.isfinite(raw)):
                raise HopdiffError(
                    f"no ordinary run exists at speed={self.speed:g} for character {self.character.name!r};"
                    f" Froude speed {self.froude:.2f} lies outside of what the gene table describes."
                )
            return Calibration(
                raw / costs.ORDINARY_TARGET,
                float(trajectory.contact_time),
                float(trajectory.flight_time),
                float(costs.com_bounce(trajectory)),
                float(costs.arm_swing(trajectory)),
            )

    @property
    def froude(self) -> float:
        """Speed over the speed sqrt(g l) of the body."""
        return froude_speed(self.speed, self.character.leg_length)

    @property
    def shortest_stride(self) -> float:
        """Duration of the shortest stride that the gene table allows [s]."""
        low, high = (
            self.table.decode(edge.unsqueeze(0)) for edge in (self.table.low * 0.0, self.table.low * 0.0 + 1.0)
        )
        way = 2.0 * float(low["leg_extension"] * torch.sin(low["touchdown_angle"])) * self.character.leg_length
        # A stiffness says nothing of the flight by itself.
        return way / self.speed / float(high.get("duty_factor", 0.5))

    def trajectory(self, genes: Tensor) -> Trajectory:
        """One step of every candidate; genes (P, G) in the unit box."""
        speed = torch.full((genes.shape[0],), self.speed, dtype=genes.dtype, device=genes.device)
        return self.model.trajectory(self.table.decode(genes), speed)

    def price(self, genes: Tensor, trajectory: Trajectory) -> tuple[Tensor, dict[str, Tensor], Tensor]:
        """Merit (cost with the constraint penalty) (P,), its terms, and the status (P,)."""
        return self._priced(self._judged(genes, trajectory))[:3]

    def _judged(self, genes: Tensor, trajectory: Trajectory) -> Judged:
        gamma = costs.connectivity(trajectory, self.settings.gamma, self.settings.gamma_guard)
        raw = costs.energy_rate_raw(trajectory, self.character)
        return Judged(genes, trajectory, gamma, raw / self.ordinary.energy_unit)

    def _priced(self, judged: Judged) -> tuple[Tensor, dict[str, Tensor], Tensor, dict[Status, Tensor]]:
        """What `price` tells, and how far each constraint is broken."""
        s, trajectory = self.settings, judged.trajectory
        terms = priced(self.terms, judged, len(judged.genes))
        excess = limits.excesses(trajectory, self.character, s.limits)
        if s.limits.penalty > 0:
            terms["penalty"] = limits.penalty(excess, s.limits)
        merit = torch.stack(list(terms.values())).sum(0)
        status = limits.status_of(excess, trajectory.solved)
        finite = torch.isfinite(merit)
        status = torch.where(finite, status, torch.full_like(status, int(Status.NOT_FINITE)))
        raw = judged.energy * self.ordinary.energy_unit
        terms = {"gamma": judged.gamma, "energy": judged.energy, "energy_raw": raw, **terms}
        return merit, terms, status, excess

    def evaluate(self, genes: Tensor, with_grad: bool) -> Eval:
        """Price candidates (P, G) of the unit box; `with_grad` adds the gradient of the merit."""
        return joined([self._evaluated(part, with_grad) for part in genes.detach().split(CHUNK)])

    def residuals(self, genes: Tensor) -> Eval:
        """The same without gradient, but with residuals: of the terms one after the other, and of the penalty."""
        parts, roots = zip(*(self._with_roots(part) for part in genes.detach().split(CHUNK)), strict=True)
        columns = [_rows(term) for term in zip(*roots, strict=True)]
        return joined(parts)._replace(residuals=torch.cat(columns, dim=-1))

    def _evaluated(self, genes: Tensor, with_grad: bool) -> Eval:
        if with_grad:
            genes = genes.clone().requires_grad_(True)
        with torch.set_grad_enabled(with_grad):
            judged = self._judged(genes, self.trajectory(genes))
            merit, terms, status, _ = self._priced(judged)
            gradient = gradient_of_each(torch.where(torch.isfinite(merit), merit, 0.0), genes)[0] if with_grad else None
        return self._told(merit.detach(), {k: v.detach() for k, v in terms.items()}, status, gradient)

    def _with_roots(self, genes: Tensor) -> tuple[Eval, list[Tensor]]:
        """What `evaluate` tells, and residuals (P, R) of every term and of the penalty."""
        with torch.no_grad():
            judged = self._judged(genes, self.trajectory(genes))
            merit, terms, status, excess = self._priced(judged)
            roots = [*residuals_of(self.terms, judged, terms), limits.penalty_roots(excess, self.settings.limits)]
        return self._told(merit, terms, status), roots

    def _told(self, merit: Tensor, terms: dict[str, Tensor], status: Tensor, gradient: Tensor | None = None) -> Eval:
        """A candidate whose stance is not solved has no merit; one that breaks a constraint has no cost."""
        computable = torch.isfinite(merit) & (status != int(Status.STANCE_UNSOLVED))
        if self.settings.limits.penalty == 0:
            # Without a penalty nothing leads back from what is impossible: it is removed for gradients too.
            computable = status == int(Status.OK)
        merit = torch.where(computable, merit, torch.inf)
        cost = torch.where(status == int(Status.OK), merit, torch.inf)
        if gradient is not None:
            gradient = torch.where(computable.unsqueeze(-1), gradient, 0.0)
        return Eval(cost, gradient, merit, terms, status)

    def gait(self, genes: Tensor) -> Gait:
        """The endless runs of candidates (P, G) of the unit box, to be sampled in time."""
        speed = torch.full((genes.shape[0],), self.speed, dtype=genes.dtype, device=genes.device)
        with torch.no_grad():
            return self.model.gait(self.table.decode(genes), speed)

    def motion(self, genes: Tensor, fps: float) -> Motion:
        """One stride of a candidate (G,) at about `fps` frames/s: the nearest rate with a whole number of frames."""
        with torch.no_grad():
            return stride_motion(self.gait(genes.unsqueeze(0)), fps)


def _rows(parts: Sequence[Tensor]) -> Tensor:
    """Residuals (P_i, R_i) of one term, one part after the other; a part whose frames end sooner is filled with 0."""
    longest = max(part.shape[-1] for part in parts)
    return torch.cat([functional.pad(part, (0, longest - part.shape[-1])) for part in parts])
