"""model=thesis with and without what departs from print, on the same random genes."""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor

from hopdiff import costs
from hopdiff.composing import compose
from hopdiff.config import build_job
from hopdiff.models.trajectory import LEG_CHANNELS, Trajectory
from hopdiff.problem import RunProblem
from hopdiff.search.base import Eval
from hopdiff.types import Status

ASKED = ("model=thesis", "speed=5", "beta=0.5")


class Variant(NamedTuple):
    """name: of a row. words: settings on top of ASKED."""

    name: str
    words: tuple[str, ...] = ()


VARIANTS = (
    Variant("as it is"),
    Variant("`model.knee=flexion`", ("model.knee=flexion",)),
    Variant("`model.knee=joined`", ("model.knee=joined",)),
    Variant("`model.impulse=true`", ("model.impulse=true",)),
    Variant("`model.impulse=true model.step=0.0025`", ("model.impulse=true", "model.step=0.0025")),
    Variant("`model.step=0.01`", ("model.step=0.01",)),
    Variant("`model.step=0.0025`", ("model.step=0.0025",)),
    Variant("`genes.fixed.com_lead=0.044`", ("genes.fixed.com_lead=0.044",)),
    Variant("`costs.gamma=printed`", ("costs.gamma=printed",)),
    Variant("`costs.gamma=smooth`", ("costs.gamma=smooth",)),
    Variant("`genes=default`", ("genes=default",)),
    Variant("`costs=default`", ("costs=default",)),
)

# Of a row; the numbers are medians over the candidates that are possible.
COLUMNS = ("possible", "gamma", "energy_raw", "energy", "eval", "contact_time", "flight_time")


def problem_of(*words: str) -> RunProblem:
    problem = build_job(compose([*ASKED, *words])).problem
    assert isinstance(problem, RunProblem)
    return problem


def draws(problem: RunProblem, count: int, seed: int = 0) -> Tensor:
    """(count, G) points of the unit box."""
    generator = torch.Generator().manual_seed(seed)
    return torch.rand(count, problem.dimension, generator=generator, dtype=torch.float64)


def measured(variant: Variant, count: int) -> dict[str, float]:
    """The numbers of a row, by the names of COLUMNS; `possible` is a share."""
    problem = problem_of(*variant.words)
    genes = draws(problem, count)
    found, steps = problem.evaluate(genes, False), problem.trajectory(genes)
    possible = found.status == int(Status.OK)
    values = {**found.terms, "contact_time": steps.contact_time, "flight_time": steps.flight_time}
    return {"possible": float(possible.double().mean())} | {
        name: float(values[name][possible].median()) for name in COLUMNS[1:]
    }


class Take(NamedTuple):
    """Rates on both sides of take-off (P, C) of all joint channels, from the possible of some candidates.

    last, before: the last rate of stance and what it predicts a frame later; after: the first of flight [rad/s].
    change: of the last rate [rad/s^2]. duration: of the flight (P,) [s].
    """

    last: Tensor
    change: Tensor
    before: Tensor
    after: Tensor
    duration: Tensor


def take_offs(problem: RunProblem, steps: Trajectory) -> Take:
    """Of P possible candidates, each of whose steps has a take-off."""
    h = problem.model.step  # type: ignore[attr-defined]
    rates = torch.diff(steps.angles, dim=1) / h
    frames = (steps.contact_time / h).round().long()

    def at(index: Tensor) -> Tensor:
        return rates.gather(1, index[:, None, None].expand(-1, 1, rates.shape[-1]))[:, 0]

    last, earlier = at(frames - 2), at(frames - 3)
    return Take(last, (last - earlier) / h, 2.0 * last - earlier, at(frames), steps.flight_time)


def shares(take: Take, guard: float) -> Tensor:
    """What each channel (P, C) adds to gamma of the form "ratio"."""
    a, b = take.after, take.before
    return (a - b) ** 2 / (torch.minimum(a**2, b**2) + guard**2)


class Connection:
    """gamma alone as a problem: how well can a run connect? Implements `hopdiff.search.base.Problem`."""

    def __init__(self, problem: RunProblem) -> None:
        self.problem = problem
        self.dimension, self.dtype, self.device = problem.dimension, problem.dtype, problem.device

    def evaluate(self, genes: Tensor, with_grad: bool) -> Eval:
        found = self.problem.evaluate(genes, False)
        gamma = costs.connectivity(self.problem.trajectory(genes), "ratio", self.problem.settings.gamma_guard)
        cost = gamma.where(found.status == int(Status.OK), torch.inf)
        return Eval(cost, None, cost, found.terms, found.status)


LEGS = ("carrying thigh", "active thigh", "carrying knee", "active knee")
assert len(LEGS) == LEG_CHANNELS
