"""What is possible: constraints of runs of `smooth` and `thesis`.

Each is defined once, as a signed excess: a population search drops a candidate with a positive one, a gradient sees
the smooth penalty that starts a little before.
"""

from __future__ import annotations

import math

import torch
from torch import Tensor

from hopdiff.channels import SIDES
from hopdiff.character import Character
from hopdiff.costs import LimitSettings
from hopdiff.models.trajectory import JOINT_CHANNELS, Trajectory
from hopdiff.numerics import constant
from hopdiff.types import Status

JOINT_LIMIT_SCALE = 0.5  # rad beyond its range at which a joint is grossly wrong
COLUMNS = {name: i for i, (name, _, _) in enumerate(JOINT_CHANNELS)}
# Kind of joint, channel, and how much of the pelvis tilt comes on top: the pelvis tips forward under the trunk, which
# folds the hip by as much and straightens the waist.
LIMITED = (
    *((kind, f"{side}_{kind}", 0.0) for kind in ("knee", "shoulder", "elbow") for side in SIDES),
    ("neck", "neck_flex", 0.0),
    *(("hip", f"{side}_thigh", 1.0) for side in SIDES),
    ("waist", "trunk_lean", -1.0),
)


def excesses(trajectory: Trajectory, character: Character, limits: LimitSettings) -> dict[Status, Tensor]:
    """How far each constraint is broken (P,), in units in which 1 is gross; negative inside."""
    used = trajectory.weights > 0

    def largest(values: Tensor) -> Tensor:
        return values.masked_fill(~used, -torch.inf).amax(-1)

    standing = trajectory.leg_force > 0
    knee = trajectory.angles[..., COLUMNS["left_knee"]]
    stance_knee = knee.masked_fill(~(standing & used), 0.0).amax(-1)
    lowest = trajectory.foot_height.flatten(1).amin(-1)
    tolerance = 1e-3 * limits.foot_below_ground_mm
    return {
        Status.LEG_OVERREACH: (trajectory.reach - limits.reach) / 0.05,
        Status.LEG_COLLAPSED: (stance_knee - math.radians(limits.knee_stance_deg)) / 0.5,
        Status.LEG_FORCE: (largest(trajectory.leg_force) - limits.leg_force_bw) / 2.0,
        Status.FOOT_UNDERGROUND: (-lowest - tolerance) / (0.05 * character.leg_length),
        Status.JOINT_LIMIT: _joint_excess(trajectory, character, used) / JOINT_LIMIT_SCALE,
        Status.BALANCE_UNSTABLE: (limits.sway_stiffness - trajectory.sway_stiffness) / 0.1,
        Status.NO_FLIGHT: (limits.flight_time_s - trajectory.flight_time) / 0.02,
    }


def _joint_excess(trajectory: Trajectory, character: Character, used: Tensor) -> Tensor:
    """How far the joint that is worst is beyond its range (P,), negative inside [rad]."""
    angles = trajectory.angles
    kinds, names, tilts = zip(*LIMITED, strict=True)
    columns = constant(tuple(COLUMNS[name] for name in names), torch.int64, angles.device)
    low, high, tilt = (
        constant(tuple(row), angles.dtype, angles.device).unsqueeze(-1)
        for row in (*zip(*(character.limits[kind] for kind in kinds), strict=True), tilts)
    )
    values = angles.permute(2, 0, 1).index_select(0, columns)
    shift = tilt * trajectory.pelvis_tilt
    most = values.masked_fill(~used, -torch.inf).amax(-1) + shift - high
    least = low - shift - values.masked_fill(~used, torch.inf).amin(-1)
    return torch.maximum(most, least).amax(0)


def penalty(excess: dict[Status, Tensor], limits: LimitSettings) -> Tensor:
    """Smooth penalty (P,) that starts `margin` inside every constraint."""
    return limits.penalty * (_over(excess, limits) ** 2).sum(0)


def penalty_roots(excess: dict[Status, Tensor], limits: LimitSettings) -> Tensor:
    """(P, R) whose squares sum to `penalty`."""
    return math.sqrt(limits.penalty) * _over(excess, limits).T


def _over(excess: dict[Status, Tensor], limits: LimitSettings) -> Tensor:
    return torch.relu(torch.stack(list(excess.values())) + limits.margin)


def status_of(excess: dict[Status, Tensor], solved: Tensor) -> Tensor:
    """(P,) int64 status: the constraint that is broken worst, STANCE_UNSOLVED first of all."""
    kinds = list(excess)
    stacked = torch.stack(list(excess.values()))
    worst, which = stacked.max(0)
    codes = constant(tuple(int(k) for k in kinds), torch.int64, worst.device)[which]
    status = torch.where(worst > 0, codes, torch.zeros_like(codes))
    status = torch.where(torch.isfinite(stacked).all(0), status, torch.full_like(status, int(Status.NOT_FINITE)))
    return torch.where(solved, status, torch.full_like(status, int(Status.STANCE_UNSOLVED)))
