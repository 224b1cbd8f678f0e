# No `from __future__ import annotations`: Hydra reads the types of the settings classes.
"""What a run is judged by: the terms of the objective, one function each; constraints are in `hopdiff.limits`.

`eval`, connectivity gamma and energy rate E_r follow Kang (1999), equations (12) to (14).
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import torch
from torch import Tensor

from hopdiff.character import Character
from hopdiff.models.trajectory import JOINT_CHANNELS, LEG_CHANNELS, Trajectory
from hopdiff.numerics import GRAVITY, safe_sqrt
from hopdiff.objective import Term

ORDINARY_BETA = 0.2  # the thesis calls this briskness an ordinary run (figure 5.4)
ORDINARY_TARGET = ORDINARY_BETA / (1.0 - ORDINARY_BETA)
LEAST_DEMAND = 0.1  # weight of the energy target at beta 0, where it cannot be met, relative to beta >= 0.2
GAMMAS = ("smooth", "ratio", "printed")
CALMEST = 0.5  # share of the ordinary target down to which the style follows beta


@dataclass
class StyleSettings:
    """How a run departs from ordinary running as the energy target grows.

    Each quantity q of the run is asked to be q_ordinary * (target / ordinary target) ** exponent, the mean forward
    lean of the trunk to be trunk_lean_deg at every briskness.
    """

    weight: float
    contact_time: float
    flight_time: float
    bounce: float
    arm_swing: float
    trunk_lean_deg: float
    trunk_lean_weight: float


@dataclass
class LimitSettings:
    """Constraints. A candidate that breaks one is not a possible run.

    penalty: of the smooth one that gradients see from `margin` inside every limit on; at 0 there is none, and what is
    impossible has no merit either.
    """

    leg_force_bw: float
    knee_stance_deg: float
    reach: float
    foot_below_ground_mm: float
    flight_time_s: float
    sway_stiffness: float
    penalty: float
    margin: float


@dataclass
class CostSettings:
    """gamma: form of the connectivity, a name of GAMMAS, see `connectivity`.

    Defaults stand in conf/costs/. extra: weights of terms that have no setting of their own.
    The other numbers are weights; `energy_match` and `leg_force` and `ordinary` come on top of eval.
    """

    name: str
    gamma: str
    gamma_guard: float
    energy_match: float
    leg_force: float
    ordinary: float
    style: StyleSettings
    limits: LimitSettings
    extra: dict[str, float]


class Calibration(NamedTuple):
    """What everyday running of one body at one speed measures; calibrates energy and style."""

    energy_unit: float
    contact_time: float
    flight_time: float
    bounce: float
    arm_swing: float


class Judged(NamedTuple):
    """P candidates as the terms see them. genes: (P, G) of the unit box. gamma, energy: (P,) of equation (12), the
    energy rate in the unit of the everyday run.
    """

    genes: Tensor
    trajectory: Trajectory
    gamma: Tensor
    energy: Tensor


def terms_of(settings: CostSettings, ordinary: Calibration, everyday: Tensor, free: Tensor, beta: float) -> list[Term]:
    """The rows of the cost. everyday: (G,) genes of everyday running. free: (G,) 1 where a gene can vary.

    A new term is one more row here; its weight may be `settings.extra.get(NAME, DEFAULT)`, which costs.NAME sets.
    """
    style, gamma = settings.style, (settings.gamma, settings.gamma_guard)
    lean = math.radians(style.trunk_lean_deg)
    return [
        _row("eval", 1.0, lambda j: evaluation(j.gamma, j.energy, beta), "paper", lambda j: eval_roots(j, gamma, beta)),
        _row(
            "energy_match",
            settings.energy_match,
            lambda j: energy_mismatch(j.energy, beta),
            "energy",
            lambda j: (demand(beta) ** 0.5 * energy_miss(j.energy, beta)).unsqueeze(-1),
        ),
        _row(
            "leg_force",
            settings.leg_force * (1.0 - beta),
            lambda j: leg_effort(j.trajectory),
            "effort",
            lambda j: j.trajectory.leg_force * (j.trajectory.weights / j.trajectory.duration.unsqueeze(-1)).sqrt(),
        ),
        _row(
            "style",
            style.weight,
            lambda j: style_mismatch(j.trajectory, ordinary, style, beta),
            "style",
            lambda j: torch.stack(style_misses(j.trajectory, ordinary, style, beta), dim=-1),
        ),
        _row(
            "posture",
            style.trunk_lean_weight,
            lambda j: posture_mismatch(j.trajectory, lean),
            "style",
            lambda j: (mean_lean(j.trajectory) - lean).unsqueeze(-1),
        ),
        _row(
            "ordinary",
            settings.ordinary,
            lambda j: ((j.genes - everyday) ** 2 * free).mean(-1),
            "style",
            lambda j: (j.genes - everyday) * (free / len(free)).sqrt(),
        ),
    ]


def _row(
    name: str,
    weight: float,
    value: Callable[[Judged], Tensor],
    put_in: str,
    residuals: Callable[[Judged], Tensor] | None = None,
) -> Term:
    return Term(name, weight, value, put_in, "hopper", residuals)


def connectivity(trajectory: Trajectory, form: str, guard: float) -> Tensor:
    """gamma (P,), equation (12): how badly flight continues the joint rates of stance; 0 is perfect.

    form "smooth": sum of (a - b)^2 / (a^2 + b^2 + guard^2), at most 2 a joint. form "ratio": sum of
    (max / min - 1)^2 as printed, where the smaller magnitude is kept away from zero by `guard` [rad/s] and a
    change of sign counts with the distance between the rates. form "printed": that formula to the letter, of signed
    rates and without a guard: poles where the smaller rate crosses zero, and rates that turn from minus to plus count
    less than those that turn from plus to minus. Of the two take-offs of a limp it is the mean.
    """
    change, scale = _jumps(trajectory, form, guard)
    return (change**2 / scale).sum(-1) * (LEG_CHANNELS / change.shape[-1])


def _jumps(trajectory: Trajectory, form: str, guard: float) -> tuple[Tensor, Tensor]:
    """By how much joint rates change at take-off, and the square of what that is held against."""
    a, b = trajectory.rates_after, trajectory.rates_before
    if form == "printed":
        return torch.maximum(a, b) / torch.minimum(a, b) - 1.0, torch.ones_like(a)
    # max/min - 1 = |a - b| / min for rates of one sign.
    scale = a**2 + b**2 if form == "smooth" else torch.minimum(a**2, b**2)
    return a - b, scale + guard**2


def joint_effort(trajectory: Trajectory, character: Character) -> Tensor:
    """Integral of I theta''^2 over the step for every joint channel (P, C) [kg m^2 rad^2 / s^3]."""
    index = character.skeleton.index
    inertia = torch.stack([character.inertias[index(joint), axis] for _, joint, axis in JOINT_CHANNELS])
    return torch.einsum("pm,pmc,c->pc", trajectory.weights, trajectory.accelerations**2, inertia)


def energy_rate_raw(trajectory: Trajectory, character: Character) -> Tensor:
    """E_r (P,), equation (12), as an integral over time per distance, made dimensionless.

    The joint term is scaled by sqrt(l / g), the torque of gravity tau = m g |delta| by sqrt(g / l), and the sum by
    the body's weight, so that bodies of different size and any sampling in time compare.
    """
    pace = math.sqrt(character.leg_length / GRAVITY)
    weight = character.mass * GRAVITY
    torque = weight * safe_sqrt((trajectory.balance_error**2).sum(-1))
    work = joint_effort(trajectory, character).sum(-1) * pace + (torque * trajectory.weights).sum(-1) / pace
    return work / (weight * trajectory.speed * trajectory.duration)


def evaluation(gamma: Tensor, energy: Tensor, beta: float) -> Tensor:
    """eval (P,) in [0, 1), equation (14), for the scaled energy rate."""
    miss = (energy_target(beta) - energy) ** 2
    return 1.0 - 0.5 / (1.0 + gamma) - 0.5 / (1.0 + miss)


def eval_roots(judged: Judged, gamma: tuple[str, float], beta: float) -> Tensor:
    """(P, R) whose squares sum to `evaluation`. gamma: form and guard of the connectivity."""
    change, scale = _jumps(judged.trajectory, *gamma)
    jumps = change / scale.sqrt() * (LEG_CHANNELS / change.shape[-1]) ** 0.5
    miss = judged.energy - energy_target(beta)
    return torch.cat(
        (
            jumps / (2.0 * (1.0 + judged.gamma)).sqrt().unsqueeze(-1),
            (miss / (2.0 * (1.0 + miss**2)).sqrt()).unsqueeze(-1),
        ),
        dim=-1,
    )


def energy_target(beta: float) -> float:
    """Scaled energy rate that a briskness asks for, beta / (1 - beta)."""
    return beta / (1.0 - beta)


def energy_mismatch(energy: Tensor, beta: float) -> Tensor:
    """Squared relative distance from the energy target (P,).

    Below beta 0.2 the target soon lies under the least that the body needs: it counts less and less, down to a
    pull that makes a calm run thrifty without bending it out of shape.
    """
    return demand(beta) * energy_miss(energy, beta) ** 2


def demand(beta: float) -> float:
    """How much the energy target counts."""
    return max(min(energy_target(beta) / ORDINARY_TARGET, 1.0) ** 2, LEAST_DEMAND)


def energy_miss(energy: Tensor, beta: float) -> Tensor:
    """(P,) relative distance from the energy target."""
    target = energy_target(beta)
    return (energy - target) / max(target, ORDINARY_TARGET)


def leg_effort(trajectory: Trajectory) -> Tensor:
    """Mean square of the leg force over the step in body weights, less the 1 of standing still (P,)."""
    return (trajectory.leg_force**2 * trajectory.weights).sum(-1) / trajectory.duration - 1.0


def com_bounce(trajectory: Trajectory) -> Tensor:
    """Vertical travel of the centre of mass over the step (P,) [m]."""
    used = trajectory.weights > 0
    height = trajectory.com_height
    return height.masked_fill(~used, -torch.inf).amax(-1) - height.masked_fill(~used, torch.inf).amin(-1)


def arm_swing(trajectory: Trajectory) -> Tensor:
    """Root mean square swing of both shoulders about their mean (P,) [rad]."""
    names = [name for name, _, _ in JOINT_CHANNELS]
    arms = trajectory.angles[..., [names.index("left_shoulder"), names.index("right_shoulder")]]
    share = (trajectory.weights / (2.0 * trajectory.duration.unsqueeze(-1))).unsqueeze(-1)
    mean = (arms * share).sum((1, 2), keepdim=True)
    return safe_sqrt(((arms - mean) ** 2 * share).sum((1, 2)))


def style_mismatch(trajectory: Trajectory, ordinary: Calibration, style: StyleSettings, beta: float) -> Tensor:
    """Squared logarithmic distance from what the briskness asks, summed over the quantities of the style (P,)."""
    total = torch.zeros_like(trajectory.speed)
    for miss in style_misses(trajectory, ordinary, style, beta):
        total = total + miss**2
    return total


def style_misses(trajectory: Trajectory, ordinary: Calibration, style: StyleSettings, beta: float) -> list[Tensor]:
    """(P,) logarithmic distance of each quantity of the style from what the briskness asks."""
    growth = math.log(max(energy_target(beta), CALMEST * ORDINARY_TARGET) / ORDINARY_TARGET)
    found = []
    for value, usual, exponent in (
        (trajectory.contact_time, ordinary.contact_time, style.contact_time),
        (trajectory.flight_time, ordinary.flight_time, style.flight_time),
        (com_bounce(trajectory), ordinary.bounce, style.bounce),
        (arm_swing(trajectory), ordinary.arm_swing, style.arm_swing),
    ):
        found.append(torch.log(value.clamp_min(1e-4) / max(usual, 1e-4)) - exponent * growth)
    return found


def posture_mismatch(trajectory: Trajectory, lean: float) -> Tensor:
    """Squared distance of the mean trunk lean from `lean` (P,) [rad^2]."""
    return (mean_lean(trajectory) - lean) ** 2


def mean_lean(trajectory: Trajectory) -> Tensor:
    """Mean forward lean of the trunk over the step (P,) [rad]."""
    column = [name for name, _, _ in JOINT_CHANNELS].index("trunk_lean")
    mean: Tensor = (trajectory.angles[..., column] * trajectory.weights).sum(-1) / trajectory.duration
    return mean


def step_time(trajectory: Trajectory) -> Tensor:
    return trajectory.contact_time + trajectory.flight_time


def step_length(trajectory: Trajectory) -> Tensor:
    return trajectory.speed * step_time(trajectory)
