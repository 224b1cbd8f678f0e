"""The terms of a run's cost, one function each, all in body weights times the way.

Work and torque follow the usual cost of optimal gaits (Srinivasan and Ruina 2006; Ackermann and van den Bogert 2010):
muscles pay for positive work four times, for negative work less than once (Margaria 1968), and for holding.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import torch
from torch import Tensor

from hopdiff.effort.priced import Priced, softly_positive
from hopdiff.effort.settings import EffortSettings
from hopdiff.numerics import GRAVITY
from hopdiff.types import HopdiffError
from hopdiff.whole_body.layout import SEGMENTS

POWER_WIDTH = 0.07  # W/kg over which positive and negative work pass into each other
SHARPNESS = 30.0  # 1/rad, of the largest knee flexion
LEG_JOINTS = slice(3, 9)  # hips, knees, ankles among the joints after the pelvis
ORDINARY_BETA = 0.2  # the thesis calls this briskness an ordinary run (figure 5.4)
ORDINARY_TARGET = ORDINARY_BETA / (1.0 - ORDINARY_BETA)
LEAST_ENERGY = 0.8  # of the least run's: what no smaller target asks for

# Names of joints in the settings, by segment below them.
JOINT_KINDS = {
    **{"waist": "waist", "chest": "chest", "head": "neck"},
    **{
        f"{side}_{part}": kind
        for side in ("left", "right")
        for part, kind in (
            ("thigh", "hip"),
            ("shank", "knee"),
            ("foot", "ankle"),
            ("upper_arm", "shoulder"),
            ("forearm", "elbow"),
        )
    },
}
KINDS = tuple(dict.fromkeys(JOINT_KINDS.values()))


class Muscles(NamedTuple):
    """strength: (S - 1, 3, 1) per mass [m^2/s^2], inf where passive. give: (S - 1, 3, 1) of tendons [s^2/m^2 rad]."""

    strength: Tensor
    give: Tensor

    @classmethod
    def of(cls, settings: EffortSettings, leg: float, like: Tensor) -> Muscles:
        """Raises HopdiffError, naming the setting, for a joint that is missing or a number that is not positive."""
        unit = GRAVITY * leg
        rows, give = [], []
        for segment in SEGMENTS[1:]:
            kind = JOINT_KINDS[segment]
            row = list(settings.strength.get(kind, ()))
            if len(row) != 3 or any(x is not None and not (math.isfinite(x) and x > 0) for x in row):
                raise HopdiffError(
                    f"costs.strength.{kind} must be three numbers above 0 (flexion, turn, sideways; null: passive),"
                    f" not {row}."
                )
            rows.append([math.inf if x is None else unit * x for x in row])
            stiffness = settings.tendon.get(kind)
            if stiffness is not None and not (math.isfinite(stiffness) and stiffness > 0):
                raise HopdiffError(f"costs.tendon.{kind} must be a number above 0, not {stiffness}.")
            give.append([0.0 if stiffness is None else 1.0 / (unit * stiffness), 0.0, 0.0])
        for name, given in (("strength", settings.strength), ("tendon", settings.tendon)):
            for kind in given:
                if kind not in KINDS:
                    raise HopdiffError(f"costs.{name}.{kind}: there is no such joint; joints are {', '.join(KINDS)}.")
        return cls(like.new_tensor(rows).unsqueeze(-1), like.new_tensor(give).unsqueeze(-1))


class Asked(NamedTuple):
    """What a run is asked for. energy: times the external work of the least run. Both least numbers are None where
    nothing is asked."""

    energy: float
    external_work: float | None
    contact_time: float | None


def energy_target(beta: float) -> float:
    """beta / (1 - beta) of Kang (1999), equation (14)."""
    return beta / (1.0 - beta)


def energy_ratio(beta: float, scale: float) -> float:
    """External work asked for, in that of the least run: (target / ordinary target) ** scale, 1 at beta 0.2."""
    return max((energy_target(beta) / ORDINARY_TARGET) ** scale, LEAST_ENERGY) if beta > 0 else LEAST_ENERGY


def energy_rate(ratio: Tensor, scale: float) -> Tensor:
    """E_r, whose target is beta / (1 - beta), for external work in that of the least run: `energy_ratio` undone."""
    return ORDINARY_TARGET * ratio ** (1.0 / scale)


@dataclass(frozen=True)
class Term:
    """One row of the cost: what it adds for P candidates is weight * value(run)."""

    name: str
    weight: float
    value: Callable[[Priced], Tensor]
    put_in: str  # "effort", "energy" or "human": what kind of thing it puts in


def muscle_power(run: Priced, muscles: Muscles, transfer: float) -> Tensor:
    """(P, S - 1, 3, M) power of the muscles at every joint and axis [W/kg].

    Tendons in series give way: a muscle moves at the joint's rate plus torque rate over stiffness. Of the flexing
    powers of one leg the share `transfer` is evened out between hip, knee and ankle, as muscles that span two joints
    do (van Ingen Schenau 1989).
    """
    dynamics = run.dynamics
    power = dynamics.torque * (dynamics.rate + dynamics.torque_rate * muscles.give)
    legs = power[:, LEG_JOINTS, 0].unflatten(1, (3, 2))
    mixed = transfer * legs.mean(1, keepdim=True) + (1.0 - transfer) * legs
    flexing = torch.cat((power[:, :3, 0], mixed.flatten(1, 2), power[:, 9:, 0]), dim=1)
    return torch.cat((flexing.unsqueeze(2), power[:, :, 1:]), dim=2)


def largest_swing_knee(run: Priced) -> Tensor:
    """(P, C) softly the largest flexion of each leg's knee in the air [rad]."""
    found = []
    for swing in run.movement.legs.swings:
        knee = torch.cat([run.body.angles.knee[:, p.side, p.period] for p in swing[0]], dim=-1)
        found.append(torch.logsumexp(SHARPNESS * knee, dim=-1) / SHARPNESS)
    return torch.stack(found, dim=-1)


def mid_stance_drop(run: Priced) -> Tensor:
    """(P, C) by how much the swing side of the pelvis is lower than the other in the middle of each contact [rad]."""
    roll = run.body.angles.pelvis[:, 1]
    found = []
    for k, footing in enumerate(run.movement.support.footings):
        middle = footing.lift.shape[-1] // 2
        signs = [roll[:, p.period] * (-1.0 if p.mirrored else 1.0) for p in run.movement.support.pieces[k]]
        found.append(footing.side * torch.cat(signs, dim=-1)[:, middle])
    return torch.stack(found, dim=-1)


def terms_of(settings: EffortSettings, muscles: Muscles, pace: float, asked: Asked, swing_knee: float) -> list[Term]:
    """The rows of the cost. pace: sqrt(l / g) [s]. swing_knee: wished for at this speed [rad]."""

    def power(run: Priced) -> Tensor:
        return muscle_power(run, muscles, settings.transfer)

    def held(run: Priced, values: Tensor, orders: int) -> Tensor:
        return run.per_way((values / muscles.strength) ** 2) * (GRAVITY * run.leg / pace) * pace ** (2 * orders)

    def over(run: Priced) -> Tensor:
        assert asked.contact_time is not None
        longest = run.contact_times().mean(-1) / asked.contact_time - 1.0
        return (torch.relu(longest) / 0.1) ** 2

    def missed(run: Priced) -> Tensor:
        assert asked.external_work is not None
        return (run.external_work() / (asked.energy * asked.external_work) - 1.0) ** 2

    wish = settings.human
    lean, drop = math.radians(wish.trunk_lean_deg), math.radians(wish.pelvis_drop_deg)
    rows = [
        Term(
            "positive_work",
            settings.positive_work,
            lambda r: r.per_way(softly_positive(power(r), POWER_WIDTH)),
            "effort",
        ),
        Term(
            "negative_work",
            settings.negative_work,
            lambda r: r.per_way(softly_positive(-power(r), POWER_WIDTH)),
            "effort",
        ),
        Term("torque", settings.torque, lambda r: held(r, r.dynamics.torque, 0), "effort"),
        Term("torque_rate", settings.torque_rate, lambda r: held(r, r.dynamics.torque_rate, 1), "effort"),
        Term("steady", settings.steady, lambda r: r.mean((r.body.angles.chest[:, 2] / 0.1) ** 2), "effort"),
        Term("trunk_lean", wish.trunk_lean, lambda r: ((r.movement.genes["trunk_lean"] - lean) / 0.1) ** 2, "human"),
        Term("pelvis_drop", wish.pelvis_drop, lambda r: (((mid_stance_drop(r) - drop) / 0.1) ** 2).mean(-1), "human"),
        Term(
            "swing_knee",
            wish.swing_knee,
            lambda r: ((torch.relu(swing_knee - largest_swing_knee(r)) / 0.3) ** 2).mean(-1),
            "human",
        ),
    ]
    if asked.external_work is not None:
        rows.append(Term("energy_match", settings.energy, missed, "energy"))
        rows.append(Term("contact_cap", settings.contact_cap, over, "energy"))
    return [row for row in rows if row.weight != 0.0]
