"""Which joints of a skeleton are its legs, whatever they are called."""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from hopdiff.geometry.skeleton import Skeleton
from hopdiff.messages import near
from hopdiff.types import HopdiffError

SIDES = ("left", "right")
ROLES = tuple(f"{side}_{part}" for side in SIDES for part in ("hip", "knee", "ankle", "toe"))
# What joints of a leg are called, without the side, letters only; a joint is named after the bone that hangs on it or
# after itself.
NAMES = {
    "hip": ("upleg", "upperleg", "thigh", "hip", "femur"),
    "knee": ("leg", "lowleg", "lowerleg", "calf", "shin", "knee", "tibia"),
    "ankle": ("foot", "ankle"),
    "toe": ("toe", "toes", "toebase", "ball"),
}
_PREFIXES = ("mixamorig", "bip", "biped", "character", "skeleton", "b", "def", "jnt", "joint", "human")


@dataclass(frozen=True)
class Leg:
    """Joints of a leg. ankle: None where the leg stands on the end site of the knee. toe: None where there is none."""

    side: str
    hip: int
    knee: int
    ankle: int | None
    toe: int | None


def find_legs(skeleton: Skeleton, joints: Mapping[str, str] | None = None) -> tuple[Leg, ...]:
    """The left and the right leg by their joints' names, or by their shape where names do not tell; none if neither
    does.

    joints: role -> joint name, such as {"left_hip": "LeftUpLeg", ...}, in place of all that; hips and knees are needed.
    Without an ankle the leg ends in the end site of its knee, or in the joint that hangs on it.
    Raises HopdiffError for an unknown role or joint, or joints that are no leg.
    """
    if joints:
        return _named(skeleton, joints)
    for found in (tuple(_by_name(skeleton, side) for side in SIDES), _by_shape(skeleton)):
        legs = tuple(whole for leg in found if leg is not None and (whole := _with_end(skeleton, leg)) is not None)
        if len(legs) == len(SIDES):
            return legs
    return ()


def facing(skeleton: Skeleton, legs: tuple[Leg, ...]) -> float:
    """Where the body faces in the rest pose, from +z towards +x [rad]: across the line from hip to hip."""
    if len(legs) < len(SIDES):
        return 0.0
    place = rest_positions(skeleton)
    across = place[legs[0].hip] - place[legs[1].hip]
    return 0.0 if float(across[[0, 2]].norm()) < 1e-6 else math.atan2(-float(across[2]), float(across[0]))


def rest_positions(skeleton: Skeleton) -> Tensor:
    """(J, 3) of the joints, nothing turned [m]."""
    straight = torch.eye(3, dtype=torch.float64).expand(len(skeleton.names), 3, 3)
    return skeleton.forward(torch.zeros(3, dtype=torch.float64), straight)[0]


def _named(skeleton: Skeleton, joints: Mapping[str, str]) -> tuple[Leg, ...]:
    for role, name in joints.items():
        if role not in ROLES:
            raise HopdiffError(f"edit.joints: unknown part {role!r}; known are {', '.join(ROLES)}.{near(role, ROLES)}")
        if name not in skeleton.names:
            raise HopdiffError(f"edit.joints.{role}: there is no joint {name!r}.{near(name, skeleton.names)}")
    legs = []
    for side in SIDES:
        found = {role: joints.get(f"{side}_{role}") for role in ("hip", "knee", "ankle", "toe")}
        for role in ("hip", "knee"):
            if found[role] is None:
                raise HopdiffError(f"edit.joints needs {side}_{role}, the name of a joint.")
        chain = [skeleton.index(name) for name in found.values() if name is not None]
        for upper, lower in itertools.pairwise(chain):
            if upper not in skeleton.above(lower):
                names = skeleton.names
                raise HopdiffError(f"edit.joints: {names[lower]!r} does not hang on {names[upper]!r}.")
        ankle, toe = (None if found[role] is None else skeleton.index(str(found[role])) for role in ("ankle", "toe"))
        leg = _with_end(skeleton, Leg(side, chain[0], chain[1], ankle, toe))
        if leg is None:
            raise HopdiffError(f"edit.joints: nothing hangs on {side}_knee, {skeleton.names[chain[1]]!r}, to stand on.")
        legs.append(leg)
    return tuple(legs)


def _with_end(skeleton: Skeleton, leg: Leg) -> Leg | None:
    """The leg with an ankle where its shank would have no end; none if nothing hangs on the knee either."""
    end = skeleton.end_sites.get(skeleton.names[leg.knee])
    if leg.ankle is not None or (end is not None and float(end.norm()) > 1e-6):
        return leg
    children = [leg.toe] if leg.toe is not None else skeleton.children(leg.knee)
    if not children:
        return None
    # The longest, of a foot and what else may hang there for twisting the shank.
    return replace(leg, ankle=max(children, key=lambda i: float(skeleton.offsets[i].norm())), toe=None)


def _by_name(skeleton: Skeleton, side: str) -> Leg | None:
    plain = [plain_name(name) for name in skeleton.names]
    chain: list[int] = []
    for role in ("hip", "knee", "ankle", "toe"):
        fitting = [
            i
            for i, (own, word) in enumerate(plain)
            if own == side and word in NAMES[role] and (not chain or chain[-1] in skeleton.above(i))
        ]
        if not fitting:
            break
        # Of LHipJoint and LeftUpLeg, both hips, the one nearer to the knee; of several toes the first.
        chain.append(max(fitting, key=lambda i: len(skeleton.above(i))) if role == "hip" else fitting[0])
    if len(chain) < 2:
        return None
    return Leg(side, chain[0], chain[1], *(chain[k] if len(chain) > k else None for k in (2, 3)))


def plain_name(name: str) -> tuple[str | None, str]:
    """Side and bare word of a joint's name: ("left", "upleg") of "mixamorig:LeftUpLeg"."""
    word = name.rsplit(":", 1)[-1]
    word = re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "_", word)
    parts = [part.lower() for part in re.split(r"[^A-Za-z]+", word) if part]
    while len(parts) > 1 and parts[0] in _PREFIXES:
        parts = parts[1:]
    for letter, side in (("l", "left"), ("r", "right")):
        for part in (letter, side):
            if part in parts:
                return side, "".join(other for other in parts if other != part)
    joined = "".join(parts)
    for side in SIDES:
        if joined.startswith(side):
            return side, joined.removeprefix(side)
    # LHipJoint is split into l, hip, joint above only where a small letter comes before a capital one.
    if (match := re.match(r"^([LR])([A-Z][a-z].*)$", name)) is not None:
        return ("left" if match[1] == "L" else "right"), match[2].lower()
    return None, joined


def _by_shape(skeleton: Skeleton) -> tuple[Leg, ...]:
    """Of all chains from the root the two that come down lowest, if they mirror each other and bend once or more."""
    place = rest_positions(skeleton)
    lowest: list[tuple[float, list[int]]] = []
    for leaf in range(len(skeleton.names)):
        if skeleton.children(leaf):
            continue
        chain = [leaf, *skeleton.above(leaf)][::-1]
        # The chain of its own: below the last joint that has several children on the way up to a hip.
        chain = [i for i in chain if abs(float(place[i, 0])) > 1e-4]
        end = skeleton.end_sites.get(skeleton.names[leaf])
        down = float(place[leaf, 1]) + (float(end[1]) if end is not None else 0.0)
        lowest.append((down, chain))
    lowest.sort(key=lambda item: item[0])
    if len(lowest) < 2 or any(len(chain) < 2 for _, chain in lowest[:2]):
        return ()
    first, second = (chain for _, chain in lowest[:2])
    if set(first) & set(second) or float(place[first[-1], 0]) * float(place[second[-1], 0]) >= 0.0:
        return ()
    total = float(place[:, 1].max()) - lowest[0][0]
    if lowest[0][0] > -0.25 * total:
        return ()
    sides = (first, second) if float(place[first[-1], 0]) > 0 else (second, first)
    legs = []
    for side, chain in zip(SIDES, sides, strict=True):
        # The two longest bones are thigh and shank.
        bones = [float(skeleton.offsets[i].norm()) for i in chain[1:]]
        knee = 1 + max(range(len(bones)), key=lambda k: bones[k] + (bones[k + 1] if k + 1 < len(bones) else 0.0))
        ankle = chain[knee + 1] if len(chain) > knee + 1 else None
        toe = chain[knee + 2] if len(chain) > knee + 2 else None
        legs.append(Leg(side, chain[knee - 1], chain[knee], ankle, toe))
    return tuple(legs)
