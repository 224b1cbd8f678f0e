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
from hopdiff.numerics import DEGREE, GRAVITY, constant
from hopdiff.types import Status
from hopdiff.whole_body.layout import FEET, SHANKS
from hopdiff.whole_body.places import places_of

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
    angles, shares = run.body.angles, run.fine_shares
    found = []
    hip = angles.thigh + angles.pelvis[:, :1]
    ankle = angles.foot - angles.thigh + angles.knee
    force = run.body.carried.force / GRAVITY
    feet, knees = run.body.joints[:, FEET], run.body.joints[:, SHANKS]
    apart = torch.stack((feet[:, 0, 0] - feet[:, 1, 0], knees[:, 0, 0] - knees[:, 1, 0]), dim=1)
    pairs = (angles.knee, ankle, hip, angles.elbow, apart, feet[:, :, 1], angles.foot, force.flatten(1, 2))
    fine = run.finer(torch.cat(pairs, dim=1))
    knee, ankle, hip, elbow, apart, height, pitch = fine[:, :14].unflatten(1, (7, 2)).unbind(1)
    force = fine[:, 14:].unflatten(1, (2, 3))

    def between(values: Tensor, degrees: list[float], status: Status = Status.JOINT_LIMIT) -> None:
        low, high = (DEGREE * x for x in degrees)
        found.append(Excess(status, torch.stack((low - values, values - high), dim=1) / ANGLE, shares))

    between(knee, limits.knee_deg)
    between(ankle, limits.ankle_deg)
    between(hip, limits.hip_deg)
    between(elbow, limits.elbow_deg)
    sideways = torch.sqrt(force[:, :, 0] ** 2 + force[:, :, 2] ** 2 + 1e-12)
    lift = force[:, :, 1]
    found.append(Excess(Status.PULLED_DOWN, -lift / GRIP, shares))
    # Where a foot hardly touches the ground it needs little grip, but the share of it tells.
    pressed = lift.clamp_min(0.0)
    grip = sideways - limits.friction * pressed
    found.append(Excess(Status.SLIPPERY, grip / (0.005 + 0.015 * pressed), shares))
    footings = run.movement.support.footings
    reach = torch.cat([one.grid.finer(own) for one, own in zip(footings, run.body.reach, strict=True)], dim=-1)
    found.append(Excess(Status.LEG_OVERREACH, (reach - limits.reach) / 0.005, None))
    found += _clearance(run, limits, height, pitch)
    found.append(Excess(Status.LEGS_MEET, (limits.apart - apart / run.leg) / 0.03, shares))
    plan = run.movement.plan
    air = [phase for phase in range(plan.count) if phase not in plan.standing]
    if air:
        flight = run.movement.grid.durations[:, air] / run.pace
        found.append(Excess(Status.NO_FLIGHT, (limits.flight_time - flight) / 0.03, None))
    return found


def _clearance(run: Priced, limits: BodyLimits, height: Tensor, pitch: Tensor) -> list[Excess]:
    """Heel and ball of a swinging foot: above the ground, and in mid-swing as high as is asked.

    height, pitch: (P, 2, F) of ankle [m] and foot [rad].
    """
    movement = run.movement
    plan = movement.plan
    down, heel, ball = movement.layout.sole
    wishes, depths, weights = [], [], []
    for contact, swing in zip(plan.contacts, movement.legs.swings, strict=True):
        places = places_of(plan.finer, contact.limb, plan.swing(contact), height.dtype, height.device)
        phase = swing.grid.fine.times / swing.whole.unsqueeze(-1)
        wanted = limits.clearance * torch.sin(math.pi * phase) ** 2
        ankle, turn = places.of_both(height), places.of_both(pitch)
        above, ahead = ankle - down * torch.cos(turn), torch.sin(turn)
        points = torch.stack((above + heel * ahead, above + ball * ahead), dim=1) / run.leg
        wishes.append((wanted.unsqueeze(1) - points) / GROUND)
        depths.append(-points / GROUND)
        weights.append(run.fine_shares.index_select(-1, places.index))
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
        over = over.reshape(over.shape[0], -1, over.shape[-1])
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
    codes = constant(tuple(int(one.status) for one in asked), torch.int64, moved.device)[which]
    status = torch.where(largest > 1.0, codes, torch.zeros_like(codes))
    status = torch.where(largest.isfinite(), status, torch.full_like(status, int(Status.NOT_FINITE)))
    solved = moved.isfinite() & (moved < CONVERGED)
    return torch.where(solved, status, torch.full_like(status, int(Status.NOT_CLOSED)))
