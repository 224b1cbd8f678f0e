"""Which joints of a skeleton are its legs, whatever they are called, or as a user names them."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping

from hopdiff.geometry.body_parts import Leg, legs_of, rest_positions, with_end
from hopdiff.geometry.joint_names import SIDES, plain_name
from hopdiff.geometry.limb_names import LEG
from hopdiff.geometry.skeleton import Skeleton
from hopdiff.messages import near
from hopdiff.types import HopdiffError

__all__ = ["ROLES", "SIDES", "Leg", "facing", "find_legs", "plain_name", "rest_positions"]

ROLES = tuple(f"{side}_{part}" for side in SIDES for part in LEG)


def find_legs(skeleton: Skeleton, joints: Mapping[str, str] | None = None) -> tuple[Leg, ...]:
    """The left and the right leg by their joints' names, or by their shape where names do not tell; none if neither
    does.

    joints: role -> joint name, such as {"left_hip": "LeftUpLeg", ...}, in place of all that; hips and knees are needed.
    Without an ankle the leg ends in the end site of its knee, or in the joint that hangs on it.
    Raises HopdiffError for an unknown role or joint, or joints that are no leg.
    """
    return _named(skeleton, joints) if joints else legs_of(skeleton)


def facing(skeleton: Skeleton, legs: tuple[Leg, ...]) -> float:
    """Where the body faces in the rest pose, from +z towards +x [rad]: across the line from hip to hip."""
    if len(legs) < len(SIDES):
        return 0.0
    place = rest_positions(skeleton)
    across = place[legs[0].hip] - place[legs[1].hip]
    return 0.0 if float(across[[0, 2]].norm()) < 1e-6 else math.atan2(-float(across[2]), float(across[0]))


def _named(skeleton: Skeleton, joints: Mapping[str, str]) -> tuple[Leg, ...]:
    for role, name in joints.items():
        if role not in ROLES:
            raise HopdiffError(f"edit.joints: unknown part {role!r}; known are {', '.join(ROLES)}.{near(role, ROLES)}")
        if name not in skeleton.names:
            raise HopdiffError(f"edit.joints.{role}: there is no joint {name!r}.{near(name, skeleton.names)}")
    legs = []
    for side in SIDES:
        found = {role: joints.get(f"{side}_{role}") for role in LEG}
        for role in ("hip", "knee"):
            if found[role] is None:
                raise HopdiffError(f"edit.joints needs {side}_{role}, the name of a joint.")
        chain = [skeleton.index(name) for name in found.values() if name is not None]
        for upper, lower in itertools.pairwise(chain):
            if upper not in skeleton.above(lower):
                names = skeleton.names
                raise HopdiffError(f"edit.joints: {names[lower]!r} does not hang on {names[upper]!r}.")
        ankle, toe = (None if found[role] is None else skeleton.index(str(found[role])) for role in ("ankle", "toe"))
        leg = with_end(skeleton, Leg(side, chain[0], chain[1], ankle, toe))
        if leg is None:
            raise HopdiffError(f"edit.joints: nothing hangs on {side}_knee, {skeleton.names[chain[1]]!r}, to stand on.")
        legs.append(leg)
    return tuple(legs)
