# No `from __future__ import annotations`: Hydra reads the types of the settings classes.
"""What a run is judged by: the terms of the objective and the constraints, one function each.

`eval`, connectivity gamma and energy rate E_r follow Kang (1999), equations (12) to (14). Constraints are defined
once, as signed excesses: a population search drops a candidate with a positive one, a gradient sees the smooth
penalty that starts a little before.
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
from hopdiff.types import Status

ORDINARY_BETA = 0.2  # the thesis calls this briskness an ordinary run (figure 5.4)
ORDINARY_TARGET = ORDINARY_BETA / (1.0 - ORDINARY_BETA)
LEAST_DEMAND = 0.1  # weight of the energy target at beta 0, where it cannot be met, relative to beta >= 0.2
GAMMAS = ("smooth", "ratio", "printed")
CALMEST = 0.5  # share of the ordinary target down to which the style follows beta
JOINT_LIMIT_SCALE = 0.5  # rad beyond its range at which a joint is grossly wrong


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
    style = settings.style
    lean = math.radians(style.trunk_lean_deg)
    return [
        _row("eval", 1.0, lambda j: evaluation(j.gamma, j.energy, beta), "paper"),
        _row("energy_match", settings.energy_match, lambda j: energy_mismatch(j.energy, beta), "energy"),
        _row("leg_force", settings.leg_force * (1.0 - beta), lambda j: leg_effort(j.trajectory), "effort"),
        _row("style", style.weight, lambda j: style_mismatch(j.trajectory, ordinary, style, beta), "style"),
        _row("posture", style.trunk_lean_weight, lambda j: posture_mismatch(j.trajectory, lean), "style"),
        _row("ordinary", settings.ordinary, lambda j: ((j.genes - everyday) ** 2 * free).mean(-1), "style"),
    ]


def _row(name: str, weight: float, value: Callable[[Judged], Tensor], put_in: str) -> Term:
    return Term(name, weight, value, put_in, view="hopper")


def connectivity(trajectory: Trajectory, form: str, guard: float) -> Tensor:
    """gamma (P,), equation (12): how badly flight continues the joint rates of stance; 0 is perfect.

    form "smooth": sum of (a - b)^2 / (a^2 + b^2 + guard^2), at most 2 a joint. form "ratio": sum of
    (max / min - 1)^2 as printed, where the smaller magnitude is kept away from zero by `guard` [rad/s] and a
    change of sign counts with the distance between the rates. form "printed": that formula to the letter, of signed
    rates and without a guard: poles where the smaller rate crosses zero, and rates that turn from minus to plus count
    less than those that turn from plus to minus. Of the two take-offs of a limp it is the mean.
    """
    a, b = trajectory.rates_after, trajectory.rates_before
    if form == "printed":
        terms = (torch.maximum(a, b) / torch.minimum(a, b) - 1.0) ** 2
        return terms.sum(-1) * (LEG_CHANNELS / a.shape[-1])
    # max/min - 1 = |a - b| / min for rates of one sign.
    scale = a**2 + b**2 if form == "smooth" else torch.minimum(a**2, b**2)
    return ((a - b) ** 2 / (scale + guard**2)).sum(-1) * (LEG_CHANNELS / a.shape[-1])


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


def energy_target(beta: float) -> float:
    """Scaled energy rate that a briskness asks for, beta / (1 - beta)."""
    return beta / (1.0 - beta)


def energy_mismatch(energy: Tensor, beta: float) -> Tensor:
    """Squared relative distance from the energy target (P,).

    Below beta 0.2 the target soon lies under the least that the body needs: it counts less and less, down to a
    pull that makes a calm run thrifty without bending it out of shape.
    """
    target = energy_target(beta)
    demand = max(min(target / ORDINARY_TARGET, 1.0) ** 2, LEAST_DEMAND)
    return demand * ((energy - target) / max(target, ORDINARY_TARGET)) ** 2


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
    growth = math.log(max(energy_target(beta), CALMEST * ORDINARY_TARGET) / ORDINARY_TARGET)
    total = torch.zeros_like(trajectory.speed)
    for value, usual, exponent in (
        (trajectory.contact_time, ordinary.contact_time, style.contact_time),
        (trajectory.flight_time, ordinary.flight_time, style.flight_time),
        (com_bounce(trajectory), ordinary.bounce, style.bounce),
        (arm_swing(trajectory), ordinary.arm_swing, style.arm_swing),
    ):
        total = total + (torch.log(value.clamp_min(1e-4) / max(usual, 1e-4)) - exponent * growth) ** 2
    return total


def posture_mismatch(trajectory: Trajectory, lean: float) -> Tensor:
    """Squared distance of the mean trunk lean from `lean` (P,) [rad^2]."""
    column = [name for name, _, _ in JOINT_CHANNELS].index("trunk_lean")
    mean = (trajectory.angles[..., column] * trajectory.weights).sum(-1) / trajectory.duration
    return (mean - lean) ** 2


def step_time(trajectory: Trajectory) -> Tensor:
    return trajectory.contact_time + trajectory.flight_time


def step_length(trajectory: Trajectory) -> Tensor:
    return trajectory.speed * step_time(trajectory)


def excesses(trajectory: Trajectory, character: Character, limits: LimitSettings) -> dict[Status, Tensor]:
    """How far each constraint is broken (P,), in units in which 1 is gross; negative inside."""
    columns = {name: i for i, (name, _, _) in enumerate(JOINT_CHANNELS)}
    used = trajectory.weights > 0

    def largest(values: Tensor) -> Tensor:
        return values.masked_fill(~used, -torch.inf).amax(-1)

    standing = trajectory.leg_force > 0
    knee = trajectory.angles[..., columns["left_knee"]]
    stance_knee = knee.masked_fill(~(standing & used), 0.0).amax(-1)
    joints = []
    for kind, channel_names in (
        ("knee", ("left_knee", "right_knee")),
        ("shoulder", ("left_shoulder", "right_shoulder")),
        ("elbow", ("left_elbow", "right_elbow")),
        ("neck", ("neck_flex",)),
    ):
        low, high = character.limits[kind]
        for name in channel_names:
            values = trajectory.angles[..., columns[name]]
            joints += [largest(values - high), largest(low - values)]
    for side in ("left", "right"):
        # The pelvis tips forward under the trunk, which folds the hip by as much.
        values = trajectory.angles[..., columns[f"{side}_thigh"]] + trajectory.pelvis_tilt.unsqueeze(-1)
        low, high = character.limits["hip"]
        joints += [largest(values - high), largest(low - values)]
    waist = trajectory.angles[..., columns["trunk_lean"]] - trajectory.pelvis_tilt.unsqueeze(-1)
    low, high = character.limits["waist"]
    joints += [largest(waist - high), largest(low - waist)]
    lowest = trajectory.foot_height.flatten(1).amin(-1)
    tolerance = 1e-3 * limits.foot_below_ground_mm
    return {
        Status.LEG_OVERREACH: (trajectory.reach - limits.reach) / 0.05,
        Status.LEG_COLLAPSED: (stance_knee - math.radians(limits.knee_stance_deg)) / 0.5,
        Status.LEG_FORCE: (largest(trajectory.leg_force) - limits.leg_force_bw) / 2.0,
        Status.FOOT_UNDERGROUND: (-lowest - tolerance) / (0.05 * character.leg_length),
        Status.JOINT_LIMIT: torch.stack(joints).amax(0) / JOINT_LIMIT_SCALE,
        Status.BALANCE_UNSTABLE: (limits.sway_stiffness - trajectory.sway_stiffness) / 0.1,
        Status.NO_FLIGHT: (limits.flight_time_s - trajectory.flight_time) / 0.02,
    }


def penalty(excess: dict[Status, Tensor], limits: LimitSettings) -> Tensor:
    """Smooth penalty (P,) that starts `margin` inside every constraint."""
    stacked = torch.stack(list(excess.values()))
    return limits.penalty * (torch.relu(stacked + limits.margin) ** 2).sum(0)


def status_of(excess: dict[Status, Tensor], solved: Tensor) -> Tensor:
    """(P,) int64 status: the constraint that is broken worst, STANCE_UNSOLVED first of all."""
    kinds = list(excess)
    stacked = torch.stack(list(excess.values()))
    worst, which = stacked.max(0)
    codes = torch.tensor([int(k) for k in kinds], device=worst.device)[which]
    status = torch.where(worst > 0, codes, torch.zeros_like(codes))
    status = torch.where(torch.isfinite(stacked).all(0), status, torch.full_like(status, int(Status.NOT_FINITE)))
    return torch.where(solved, status, torch.full_like(status, int(Status.STANCE_UNSOLVED)))
