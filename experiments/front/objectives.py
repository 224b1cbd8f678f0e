"""Three things that a run may be good at, as cost terms, and the count of what it takes to find out."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from time import process_time

import numpy as np
import torch
from torch import Tensor

from hopdiff.composing import compose
from hopdiff.config import build_job
from hopdiff.effort.priced import Priced
from hopdiff.effort.problem import BodyProblem
from hopdiff.job import Job
from hopdiff.numerics import GRAVITY
from hopdiff.objective import Term
from hopdiff.search.base import Eval

NAMES = ("muscle_work", "torque_rates", "peak_force")
TITLES = (
    "muscle work, as priced [body weights x way]",
    "torque rate [of the strengths, squared]",
    "peak ground force [body weights]",
)
SHARPNESS = 60.0  # per body weight, of the soft maximum of the ground force
SOFT = 0.02  # of the normalised objectives, over which the largest passes into the next
# Every other term is off; the limits of what is possible stay. beta .2 asks for no energy.
ALONE = tuple(f"costs.{name}=0" for name in ("positive_work", "negative_work", "torque", "torque_rate", "steady"))


class Objectives:
    """Energy, smoothness and peak force of P candidates, and one number of them by which a descent may go down.

    effort: rows of costs=effort by name. muscle_work: its positive and negative work at its prices. torque_rates: the
    integral of the squared rates of muscle torques over strength, as costs.torque_rate weighs it. peak_force: softly
    the largest ground force on a foot. weights: (P, 3) of the candidates priced next, whose scalar is `scalar`; None:
    their plain sum.
    """

    def __init__(self, effort: Mapping[str, Term]) -> None:
        self.effort = effort
        self.weights: Tensor | None = None
        self.ideal, self.span = torch.zeros(3, dtype=torch.float64), torch.ones(3, dtype=torch.float64)
        self._last: tuple[Priced, Tensor] | None = None

    def terms(self) -> tuple[Term, ...]:
        """Rows whose sum is the scalar; the first three are the objectives themselves."""
        single = [Term(name, 1.0, lambda run, at=at: self.values(run)[:, at]) for at, name in enumerate(NAMES)]
        return (*single, Term("scalar_less_sum", 1.0, lambda run: self._scalar_less_sum(run)))

    def values(self, run: Priced) -> Tensor:
        """(P, 3)."""
        if self._last is None or self._last[0] is not run:
            self._last = run, self._values(run)
        return self._last[1]

    def _values(self, run: Priced) -> Tensor:
        up, down, rate = (self.effort[name] for name in ("positive_work", "negative_work", "torque_rate"))
        work = up.weight * up.value(run) + down.weight * down.value(run)
        force = (run.finer(run.body.carried.force).norm(dim=2) / GRAVITY).flatten(1)
        peak = torch.logsumexp(SHARPNESS * force, dim=1) / SHARPNESS
        return torch.stack([work, rate.value(run), peak], dim=1)

    def scalar(self, values: Tensor, weights: Tensor) -> Tensor:
        """(P,) of values (P, 3): softly the largest weighted excess over the ideal, which reaches every part of a front
        where a weighted sum only reaches its convex ones (Bowman 1976; soft: Lin et al. 2024)."""
        excess = weights * (values - self.ideal) / self.span
        return SOFT * torch.logsumexp(excess / SOFT, dim=1)

    def _scalar_less_sum(self, run: Priced) -> Tensor:
        values = self.values(run)
        if self.weights is None:
            return torch.zeros_like(values[:, 0])
        return self.scalar(values, self.weights) - values.sum(1)


def build(character: str, speed: float) -> tuple[Job, Objectives]:
    """The problem of model=body without any cost but the three."""
    words = ["model=body", "costs=effort", f"character={character}", f"speed={speed}", "beta=0.2"]
    objectives = Objectives({term.name: term for term in build_job(compose(words)).problem.terms})
    return build_job(compose([*words, *ALONE]), terms=objectives.terms()), objectives


@dataclass
class Batch:
    """What one batch brought. values: (n, 3) of its possible runs, genes: (n, G). Counts and seconds run from the start
    of a method."""

    evaluations: int
    gradient_evaluations: int
    seconds: float
    values: np.ndarray
    genes: np.ndarray


class Counted:
    """The problem, with a record of every possible run that was priced and of what that took."""

    def __init__(self, job: Job, objectives: Objectives) -> None:
        assert isinstance(job.problem, BodyProblem)
        self.problem, self.objectives = job.problem, objectives
        self.batches: list[Batch] = []
        self.evaluations = self.gradient_evaluations = 0
        self.started = process_time()

    def evaluate(self, points: np.ndarray, weights: np.ndarray | None) -> Eval:
        """Price points (P, G), P at most 64; with gradient of their scalar where weights (P, 3) are given."""
        genes = torch.from_numpy(np.array(points)).clamp(0.0, 1.0).to(self.problem.dtype)
        with_grad = weights is not None
        self.objectives.weights = torch.from_numpy(weights).to(self.problem.dtype) if weights is not None else None
        found = self.problem.evaluate(genes, with_grad)
        self.evaluations += len(genes)
        self.gradient_evaluations += len(genes) * with_grad
        values, possible = objectives_of(found), found.cost.isfinite().numpy()
        self.batches.append(
            Batch(
                self.evaluations,
                self.gradient_evaluations,
                process_time() - self.started,
                values[possible],
                genes.double().numpy()[possible],
            )
        )
        return found

    def possible(self) -> tuple[np.ndarray, np.ndarray]:
        """Values (n, 3) and genes (n, G) of all possible runs so far."""
        return tuple(np.concatenate([getattr(b, name) for b in self.batches]) for name in ("values", "genes"))  # type: ignore[return-value]


def objectives_of(found: Eval) -> np.ndarray:
    """(P, 3)."""
    return torch.stack([found.terms[name] for name in NAMES], dim=1).double().numpy()
