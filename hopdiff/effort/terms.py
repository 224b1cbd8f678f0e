"""The terms of a run's cost, one function each, all in body weights times the way.

Work and torque follow the usual cost of optimal gaits (Srinivasan and Ruina 2006; Ackermann and van den Bogert 2010):
muscles pay for positive work four times, for negative work less than once (Margaria 1968), and for holding.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import torch
from torch import Tensor
from torch.nn import functional

from hopdiff.effort.priced import Priced
from hopdiff.effort.settings import EffortSettings
from hopdiff.numerics import DEGREE, GRAVITY, absent
from hopdiff.objective import Term
from hopdiff.types import HopdiffError
from hopdiff.whole_body.dynamics import ANKLES
from hopdiff.whole_body.layout import SEGMENTS
from hopdiff.whole_body.places import places_of

TURNING = 0.1  # of the lesser strength: over what a torque passes from one direction's muscles to the other's
LEG_JOINTS = slice(3, 9)  # hips, knees, ankles among the joints after the pelvis
ORDINARY_BETA = 0.2  # the thesis calls this briskness an ordinary run (figure 5.4)
ORDINARY_TARGET = ORDINARY_BETA / (1.0 - ORDINARY_BETA)
ASKING = ("energy_match", "contact_cap")  # terms that there are where something is asked
LEAST_ENERGY = 0.8  # of the least run's: what no smaller target asks for

# Names of joints in the settings, by segment below them.
JOINT_KINDS = {
    "waist": "waist",
    "chest": "chest",
    "head": "neck",
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
    """forward, backward: (S - 1, 3, 1) strength per mass in either direction of an axis [m^2/s^2], inf where passive.
    give: (S - 1, 3, 1) of tendons [s^2/m^2 rad].
    """

    forward: Tensor
    backward: Tensor
    give: Tensor

    @classmethod
    def of(cls, settings: EffortSettings, leg: float, like: Tensor) -> Muscles:
        """Raises HopdiffError, naming the setting, for a joint that is missing or a number that is not positive."""
        unit = GRAVITY * leg
        rows: list[list[list[float]]] = [[], []]
        give = []
        for segment in SEGMENTS[1:]:
            kind = JOINT_KINDS[segment]
            row = list(settings.strength.get(kind, ()))
            pairs = [x if isinstance(x, list) else [x, x] for x in row]
            if len(row) != 3 or not all(_pair(pair) for pair in pairs):
                raise HopdiffError(
                    f"costs.strength.{kind} must be three entries (flexion, turn, sideways), each a number above 0, a"
                    f" pair of them for the two directions, or null for a passive axis, not {row}."
                )
            for direction in (0, 1):
                rows[direction].append([math.inf if pair[0] is None else unit * pair[direction] for pair in pairs])
            stiffness = settings.tendon.get(kind)
            if stiffness is not None and not (math.isfinite(stiffness) and stiffness > 0):
                raise HopdiffError(f"costs.tendon.{kind} must be a number above 0, not {stiffness}.")
            give.append([0.0 if stiffness is None else 1.0 / (unit * stiffness), 0.0, 0.0])
        for name, given in (("strength", settings.strength), ("tendon", settings.tendon)):
            for kind in given:
                if kind not in KINDS:
                    raise HopdiffError(f"costs.{name}.{kind}: there is no such joint; joints are {', '.join(KINDS)}.")
        forward, backward = (like.new_tensor(row).unsqueeze(-1) for row in rows)
        return cls(forward, backward, like.new_tensor(give).unsqueeze(-1))

    def burden(self, torque: Tensor) -> Tensor:
        """(P, S - 1, 3, M) one over the square of the strength in the direction of the torque."""
        ahead, behind = self.forward**-2, self.backward**-2
        turning = 1.0 / (TURNING * torch.minimum(self.forward, self.backward).clamp(max=1e3))
        return behind + (ahead - behind) * torch.sigmoid(torque * turning)


def _pair(strengths: list[Any]) -> bool:
    """Whether these are two numbers above 0, or no strength in either direction."""
    if len(strengths) != 2 or strengths == [None, None]:
        return len(strengths) == 2
    return all(isinstance(x, int | float) and math.isfinite(x) and x > 0 for x in strengths)


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


class Pull(NamedTuple):
    """What muscles do at the joints, on the finer nodes. torque, torque_rate: (P, S - 1, 3, F), of `Dynamics` less what
    holds passively; rate: of the joints.
    """

    torque: Tensor
    torque_rate: Tensor
    rate: Tensor


def muscle_pull(run: Priced, settings: EffortSettings) -> Pull:
    """Torques of the muscles: those of the joints, less what ligaments hold the feet with."""
    dynamics, angles = run.dynamics, run.body.angles
    torque, rate = dynamics.torque, dynamics.torque_rate
    if not absent(settings.ankle_stiffness):
        stiffness = settings.ankle_stiffness * GRAVITY * run.leg
        bent = angles.foot - angles.thigh + angles.knee - settings.ankle_rest_deg * DEGREE
        held = functional.pad(
            (stiffness * bent).unsqueeze(2), (0, 0, 0, 2, ANKLES.start, len(SEGMENTS) - 1 - ANKLES.stop)
        )
        torque, rate = torque - held, rate - run.movement.grid.derivative(held)
    return Pull(*run.finer(torch.stack((torque, rate, dynamics.rate))).unbind(0))


def muscle_power(pull: Pull, muscles: Muscles, transfer: float) -> Tensor:
    """(P, S - 1, 3, F) power of the muscles at every joint and axis [W/kg].

    Tendons in series give way: a muscle moves at the joint's rate plus torque rate over stiffness. Of the flexing
    powers of one leg the share `transfer` is evened out between hip, knee and ankle, as muscles that span two joints
    do (van Ingen Schenau 1989).
    """
    power = pull.torque * (pull.rate + pull.torque_rate * muscles.give)
    if absent(transfer):
        return power
    legs = power[:, LEG_JOINTS, 0].unflatten(1, (3, 2))
    mixed = transfer * legs.mean(1, keepdim=True) + (1.0 - transfer) * legs
    flexing = torch.cat((power[:, :3, 0], mixed.flatten(1, 2), power[:, 9:, 0]), dim=1)
    return torch.cat((flexing.unsqueeze(2), power[:, :, 1:]), dim=2)


def largest_swing_knee(run: Priced) -> Tensor:
    """(P, C) the largest flexion of each leg's knee in the air [rad]."""
    fine, movement = run.finer(run.body.angles.knee), run.movement
    found = []
    for contact in movement.plan.contacts:
        places = places_of(movement.plan.finer, contact.limb, movement.plan.swing(contact), fine.dtype, fine.device)
        found.append(places.of_both(fine).amax(-1))
    return torch.stack(found, dim=-1)


def mid_stance_drop(run: Priced) -> Tensor:
    """(P, C) by how much the swing side of the pelvis is lower than the other in the middle of each contact [rad]."""
    return torch.stack(
        [own[:, own.shape[-1] // 2] for own in _seen_by_limbs(run, run.body.angles.pelvis[:, 1])], dim=-1
    )


def touchdown_yaw(run: Priced) -> Tensor:
    """(P, C) how far the landing side of the pelvis is turned back at each touchdown [rad]."""
    return torch.stack([own[:, 0] for own in _seen_by_limbs(run, run.body.angles.pelvis[:, 2])], dim=-1)


def arm_swing(run: Priced) -> Tensor:
    """(P,) root mean square swing of both shoulders about their mean [rad]."""
    arms, shares = run.body.angles.shoulder, run.shares.unsqueeze(1)
    mean = (arms * shares).sum(-1, keepdim=True).mean(1, keepdim=True)
    return torch.sqrt(((arms - mean) ** 2 * shares).sum(-1).mean(-1) + 1e-9)


def _seen_by_limbs(run: Priced, angle: Tensor) -> list[Tensor]:
    """A roll or yaw (P, M) over each contact (P, K), as a left limb would see it."""
    support, found = run.movement.support, []
    for footing, places in zip(support.footings, support.pieces, strict=True):
        own = places.seen(angle) * footing.side
        found.append(own * places.flip[0] if places.mirrored else own)
    return found


class Effort(NamedTuple):
    """What muscles do in a run, worked out once for all terms and their residuals."""

    settings: EffortSettings
    muscles: Muscles

    def pull(self, run: Priced) -> Pull:
        """On the finer nodes."""
        return run.once("pull", lambda: muscle_pull(run, self.settings))

    def power(self, run: Priced) -> Tensor:
        """(P, S - 1, 3, F) [W/kg]."""
        return run.once("power", lambda: muscle_power(self.pull(run), self.muscles, self.settings.transfer))

    def work(self, run: Priced) -> tuple[Tensor, Tensor]:
        """Positive and negative (P,), in body weights times the way."""
        return run.once("work", lambda: run.work_per_way(self.power(run).flatten(1, 2)))

    def burden(self, run: Priced) -> Tensor:
        """(P, S - 1, 3, F) of `Muscles.burden`."""
        return run.once("burden", lambda: self.muscles.burden(self.pull(run).torque))


def terms_of(settings: EffortSettings, muscles: Muscles, pace: float, asked: Asked, swing_knee: float) -> list[Term]:
    """The rows of the cost. pace: sqrt(l / g) [s]. swing_knee: wished for at this speed [rad].

    A new term is one more row here; its weight may be `settings.extra.get(NAME, DEFAULT)`, which costs.NAME sets.
    """
    effort = Effort(settings, muscles)

    def held(run: Priced, order: int) -> Tensor:
        pull = effort.pull(run)
        strain = (pull.torque, pull.torque_rate)[order] ** 2 * effort.burden(run)
        return run.fine_per_way(strain) * (GRAVITY * run.leg / pace) * pace ** (2 * order)

    def over(run: Priced) -> Tensor:
        assert asked.contact_time is not None
        longest = run.contact_times().mean(-1) / asked.contact_time - 1.0
        return (torch.relu(longest) / 0.1) ** 2

    def missed(run: Priced) -> Tensor:
        assert asked.external_work is not None
        return (run.external_work() / (asked.energy * asked.external_work) - 1.0) ** 2

    wish = settings.human
    lean, drop, yaw = (DEGREE * x for x in (wish.trunk_lean_deg, wish.pelvis_drop_deg, wish.pelvis_yaw_deg))
    arms = DEGREE * wish.arm_swing_deg * asked.energy**wish.arm_growth
    rows = [
        Term("positive_work", settings.positive_work, lambda r: effort.work(r)[0], "effort"),
        Term("negative_work", settings.negative_work, lambda r: effort.work(r)[1], "effort"),
        Term("torque", settings.torque, lambda r: held(r, 0), "effort"),
        Term("torque_rate", settings.torque_rate, lambda r: held(r, 1), "effort"),
        Term("steady", settings.steady, lambda r: r.mean((r.body.angles.chest[:, 2] / 0.1) ** 2), "effort"),
        Term("trunk_lean", wish.trunk_lean, lambda r: ((r.movement.genes["trunk_lean"] - lean) / 0.1) ** 2, "human"),
        Term("pelvis_drop", wish.pelvis_drop, lambda r: (((mid_stance_drop(r) - drop) / 0.1) ** 2).mean(-1), "human"),
        Term("pelvis_yaw", wish.pelvis_yaw, lambda r: (((touchdown_yaw(r) - yaw) / 0.1) ** 2).mean(-1), "human"),
        Term("arm_swing", wish.arm_swing, lambda r: (torch.relu(arms - arm_swing(r)) / 0.1) ** 2, "human"),
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
    return rows
