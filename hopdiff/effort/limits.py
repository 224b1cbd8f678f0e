"""What is possible: each limit once, as curves of how far it is overstepped, in units in which 1 is gross.

A gradient sees the mean square of what is over the limit, a population search whether it is over by more than a
tolerance.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import torch
from torch import Tensor

from hopdiff.effort.priced import Priced
from hopdiff.effort.settings import BodyLimits
from hopdiff.numerics import GRAVITY
from hopdiff.types import Status
from hopdiff.whole_body.layout import FEET, SHANKS

CONVERGED = 0.02  # m and rad that the last round of the solution may go
TOLERANCE = 0.5  # of a unit by which a limit may be overstepped at any moment
SOFT = {Status.JOINT_LIMIT: 1.0, Status.SLIPPERY: 1.0}  # of those that give way, or are told in finer units
MARGINS = {Status.JOINT_LIMIT: 0.3}  # inside of a limit, from where on it is felt
ANGLE = 0.1  # rad
GROUND = 0.02  # leg lengths
GRIP = 0.05  # of gravity


class Excess(NamedTuple):
    """status: what is wrong where it is overstepped. curves: (P, ..., K). weights: (P, K) of their mean, None: evenly.
    wish: whether it is a wish for room that is no limit.
    """

    status: Status
    curves: Tensor
    weights: Tensor | None
    wish: bool = False


def excesses(run: Priced, limits: BodyLimits) -> list[Excess]:
    """How far each limit is overstepped."""
    angles, shares = run.body.angles, run.shares
    found = []

    def between(values: Tensor, degrees: list[float], status: Status = Status.JOINT_LIMIT) -> None:
        low, high = (math.radians(x) for x in degrees)
        found.append(Excess(status, torch.stack((low - values, values - high), dim=1) / ANGLE, shares))

    between(angles.knee, limits.knee_deg)
    between(angles.foot - angles.thigh + angles.knee, limits.ankle_deg)
    between(angles.thigh + angles.pelvis[:, :1], limits.hip_deg)
    between(angles.elbow, limits.elbow_deg)
    force = run.body.carried.force / GRAVITY
    sideways = torch.sqrt(force[:, :, 0] ** 2 + force[:, :, 2] ** 2 + 1e-12)
    lift = force[:, :, 1]
    found.append(Excess(Status.PULLED_DOWN, -lift / GRIP, shares))
    # Where a foot hardly touches the ground it needs little grip, but the share of it tells.
    grip = sideways - limits.friction * lift.clamp_min(0.0)
    found.append(Excess(Status.SLIPPERY, grip / (0.005 + 0.015 * lift.clamp_min(0.0)), shares))
    reach = torch.cat(run.body.reach, dim=-1)
    found.append(Excess(Status.LEG_OVERREACH, (reach - limits.reach) / 0.005, None))
    found += _clearance(run, limits)
    feet, knees = run.body.joints[:, FEET, 0], run.body.joints[:, SHANKS, 0]
    apart = torch.stack((feet[:, 0] - feet[:, 1], knees[:, 0] - knees[:, 1]), dim=1)
    found.append(Excess(Status.LEGS_MEET, (limits.apart - apart / run.leg) / 0.03, shares))
    plan = run.movement.plan
    air = [phase for phase in range(plan.count) if phase not in plan.standing]
    if air:
        flight = run.movement.grid.durations[:, air] / run.pace
        found.append(Excess(Status.NO_FLIGHT, (limits.flight_time - flight) / 0.03, None))
    return found


def _clearance(run: Priced, limits: BodyLimits) -> list[Excess]:
    """Heel and ball of a swinging foot: above the ground, and in mid-swing as high as is asked."""
    layout = run.movement.layout
    wishes, depths, weights = [], [], []
    for phase, swing in zip(run.movement.legs.phases, run.movement.legs.swings, strict=True):
        wanted = limits.clearance * torch.sin(math.pi * phase) ** 2
        for piece in swing[0]:
            ankle = run.body.joints[:, FEET][:, piece.side, 1, piece.period]
            pitch = run.body.angles.foot[:, piece.side, piece.period]
            points = [
                ankle + point[1] * torch.cos(pitch) + point[2] * torch.sin(pitch)
                for point in (layout.heel, layout.ball)
            ]
            height = torch.stack(points, dim=1) / run.leg
            wishes.append((wanted[:, piece.own].unsqueeze(1) - height) / GROUND)
            depths.append(-height / GROUND)
            weights.append(run.shares[:, piece.period])
    shares = torch.cat(weights, dim=-1)
    return [
        Excess(Status.FOOT_UNDERGROUND, torch.cat(depths, dim=-1), shares),
        Excess(Status.FOOT_UNDERGROUND, torch.cat(wishes, dim=-1), shares, wish=True),
    ]


def penalty(found: list[Excess]) -> Tensor:
    """(P,) the means of the squares of what is over the limits, summed."""
    total = []
    for one in found:
        over = torch.relu(one.curves + MARGINS.get(one.status, 0.0)) ** 2
        over = over.reshape(len(over), -1, over.shape[-1])
        if one.weights is None:
            total.append(over.mean(-1).sum(-1))
        else:
            total.append((over.sum(1) * one.weights).sum(-1))
    return torch.stack(total).sum(0)


def status_of(found: list[Excess], moved: Tensor) -> Tensor:
    """(P,) int64 status: the limit that is overstepped worst, an unsolved movement first of all."""
    asked = [one for one in found if not one.wish]
    worst = torch.stack([one.curves.flatten(1).amax(-1) / SOFT.get(one.status, TOLERANCE) for one in asked])
    largest, which = worst.max(0)
    codes = torch.tensor([int(one.status) for one in asked], device=moved.device)[which]
    status = torch.where(largest > 1.0, codes, torch.zeros_like(codes))
    status = torch.where(largest.isfinite(), status, torch.full_like(status, int(Status.NOT_FINITE)))
    solved = moved.isfinite() & (moved < CONVERGED)
    return torch.where(solved, status, torch.full_like(status, int(Status.NOT_CLOSED)))
