"""The cost of a whole-body run as a sum of squares, which tells a search how it bends (`hopdiff.search.lm`)."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace

import torch
from torch import Tensor

from hopdiff.effort.limits import MARGINS, Excess
from hopdiff.effort.priced import Priced
from hopdiff.effort.settings import EffortSettings
from hopdiff.effort.terms import Asked, Effort, Muscles, largest_swing_knee, mid_stance_drop, touchdown_yaw
from hopdiff.numerics import DEGREE, GRAVITY
from hopdiff.objective import Term


def with_residuals(
    rows: Iterable[Term], settings: EffortSettings, muscles: Muscles, pace: float, asked: Asked, swing_knee: float
) -> list[Term]:
    """The rows of `hopdiff.effort.terms.terms_of`, all arguments as there, with the residuals of those that are sums or
    change sign; the others are squares of one number each."""
    wish = settings.human
    lean, drop, yaw = (DEGREE * x for x in (wish.trunk_lean_deg, wish.pelvis_drop_deg, wish.pelvis_yaw_deg))

    effort = Effort(settings, muscles)

    def size(run: Priced) -> Tensor:
        # rounded where the power changes its sign: the root of a kink has no slope there
        return torch.sqrt(effort.power(run) ** 2 + run.power_width**2)

    def work(run: Priced, sign: float) -> Tensor:
        return _root(run, 0.5 * (run.once("size", lambda: size(run)) + sign * effort.power(run)))

    def held(run: Priced, order: int) -> Tensor:
        pull = effort.pull(run)
        scale = run.once("scale", lambda: _root(run, effort.burden(run) * (GRAVITY * run.leg / pace)))
        return (pull.torque, pull.torque_rate * pace)[order] * scale

    def missed(run: Priced) -> Tensor:
        assert asked.external_work is not None
        return (run.external_work() / (asked.energy * asked.external_work) - 1.0).unsqueeze(-1)

    found: dict[str, Callable[[Priced], Tensor]] = {
        "positive_work": lambda r: work(r, 1.0),
        "negative_work": lambda r: work(r, -1.0),
        "torque": lambda r: held(r, 0),
        "torque_rate": lambda r: held(r, 1),
        "steady": lambda r: r.body.angles.chest[:, 2] / 0.1 * r.shares.sqrt(),
        "trunk_lean": lambda r: ((r.movement.genes["trunk_lean"] - lean) / 0.1).unsqueeze(-1),
        "pelvis_drop": lambda r: _even((mid_stance_drop(r) - drop) / 0.1),
        "pelvis_yaw": lambda r: _even((touchdown_yaw(r) - yaw) / 0.1),
        "swing_knee": lambda r: _even(torch.relu(swing_knee - largest_swing_knee(r)) / 0.3),
        "energy_match": missed,
    }
    return [replace(row, residuals=found.get(row.name)) for row in rows]


def penalty_residuals(found: list[Excess]) -> Tensor:
    """(P, R) whose squares sum to `hopdiff.effort.limits.penalty`."""
    roots = []
    for one in found:
        over = torch.relu(one.curves + MARGINS.get(one.status, 0.0)).reshape(
            one.curves.shape[0], -1, one.curves.shape[-1]
        )
        roots.append((_even(over) if one.weights is None else over * one.weights.sqrt().unsqueeze(1)).flatten(1))
    return torch.cat(roots, dim=-1)


def _root(run: Priced, values: Tensor) -> Tensor:
    """(P, S, 3, F) whose squares sum to `run.fine_per_way` of values (P, S, 3, F) of 0 or more."""
    found: Tensor = torch.sqrt(values * (run.fine.weights / (GRAVITY * run.way.unsqueeze(-1)))[:, None, None])
    return found


def _even(values: Tensor) -> Tensor:
    """(P, ..., K) the squares of which sum to the mean over K of the squares of values."""
    found: Tensor = values * float(values.shape[-1]) ** -0.5
    return found
