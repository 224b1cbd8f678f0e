"""Which joints of a skeleton are which parts of a body: by their names, or by its shape where names do not tell."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from hopdiff.geometry.joint_names import SIDES, WORDS, named, plain_name
from hopdiff.geometry.skeleton import Skeleton

LEG, ARM = ("hip", "knee", "ankle", "toe"), ("shoulder", "elbow", "wrist")
ASIDE = 0.02  # of the body's size from which on a joint belongs to a side
ALIKE = 0.1  # share by which arms may differ in length
SHORTEST = 0.2  # of the body's size: arms are longer than ears


@dataclass(frozen=True)
class Leg:
    """Joints of a leg. ankle: None where the leg stands on the end site of the knee. toe: None where there is none."""

    side: str
    hip: int
    knee: int
    ankle: int | None
    toe: int | None


def rest_positions(skeleton: Skeleton) -> Tensor:
    """(J, 3) of the joints, nothing turned [m]."""
    straight = torch.eye(3, dtype=torch.float64).expand(len(skeleton.names), 3, 3)
    return skeleton.forward(torch.zeros(3, dtype=torch.float64), straight)[0]


def legs_of(skeleton: Skeleton) -> tuple[Leg, ...]:
    """The left and the right leg by their joints' names, or by their shape where names do not tell; none if neither
    does."""
    for found in (tuple(_leg_by_name(skeleton, side) for side in SIDES), _legs_by_shape(skeleton)):
        legs = tuple(whole for leg in found if leg is not None and (whole := with_end(skeleton, leg)) is not None)
        if len(legs) == len(SIDES):
            return legs
    return ()


def body_parts(skeleton: Skeleton) -> dict[str, int]:
    """Part of the body, by the names of a run's 22 joints, -> joint; without the parts that were not found.

    Legs and arms by names, or by shape; the trunk by what lies between pelvis and neck.
    """
    legs = legs_of(skeleton)
    found: dict[str, int] = {}
    for leg in legs:
        parts = {"hip": leg.hip, "knee": leg.knee, "ankle": leg.ankle, "toe": leg.toe}
        found |= {f"{leg.side}_{part}": joint for part, joint in parts.items() if joint is not None}
    arms = {side: _arm_by_name(skeleton, side) for side in SIDES}
    for side, arm in arms.items():
        if arm and found.get(f"{side}_hip") in arm.values():
            # Of a body without that leg.
            found = {part: joint for part, joint in found.items() if not part.startswith(side)}
    shaped: Mapping[str, int] = {}
    if not any("elbow" in arm for arm in arms.values()) and legs:
        arms, shaped = _arms_by_shape(skeleton, legs)
    for side, arm in arms.items():
        if "elbow" in arm:
            found |= {f"{side}_{part}": joint for part, joint in arm.items()}
    middle = {part: joints[0] for part in ("neck", "head") if (joints := named(skeleton.names, part))}
    found |= middle or shaped
    return found | _trunk(skeleton, found)


def may_have_arms(skeleton: Skeleton) -> bool:
    """Whether anything besides the legs lies aside from the middle of the body."""
    legs, place = legs_of(skeleton), rest_positions(skeleton)
    below = {joint for leg in legs for joint in range(len(place)) if leg.hip in (joint, *skeleton.above(joint))}
    held = {joint for leg in legs for joint in skeleton.above(leg.hip)}
    others = [joint for joint in range(len(place)) if joint not in below | held]
    if not legs or not others:
        return not legs
    across, middle, size = _across(place, legs)
    return bool(((place[others] - middle) @ across).abs().max() > ASIDE * size)


def with_end(skeleton: Skeleton, leg: Leg) -> Leg | None:
    """The leg with an ankle where its shank would have no end; none if nothing hangs on the knee either."""
    end = skeleton.end_sites.get(skeleton.names[leg.knee])
    if leg.ankle is not None or (end is not None and float(end.norm()) > 1e-6):
        return leg
    children = [leg.toe] if leg.toe is not None else skeleton.children(leg.knee)
    if not children:
        return None
    # The longest, of a foot and what else may hang there for twisting the shank.
    return replace(leg, ankle=max(children, key=lambda i: float(skeleton.offsets[i].norm())), toe=None)


def _leg_by_name(skeleton: Skeleton, side: str) -> Leg | None:
    plain = [plain_name(name) for name in skeleton.names]
    chain: list[int] = []
    for role in LEG:
        words = WORDS[role]
        if role == "toe" and plain[chain[-1]][1] == "ankle":
            words = (*words, "foot")
        fitting = [
            i
            for i, (own, word) in enumerate(plain)
            if own == side and word in words and (not chain or chain[-1] in skeleton.above(i))
        ]
        if not fitting:
            break
        # Of LHipJoint and LeftUpLeg, both hips, the one nearer to the knee; of several toes the first.
        chain.append(max(fitting, key=lambda i: len(skeleton.above(i))) if role == "hip" else fitting[0])
    if len(chain) < 2:
        return None
    return Leg(side, chain[0], chain[1], *(chain[k] if len(chain) > k else None for k in (2, 3)))


def _legs_by_shape(skeleton: Skeleton) -> tuple[Leg, ...]:
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


def _arm_by_name(skeleton: Skeleton, side: str) -> dict[str, int]:
    arm: dict[str, int] = {}
    for part in ARM:
        above = list(arm.values())[-1:]
        fitting = [
            joint for joint in named(skeleton.names, part, side) if all(one in skeleton.above(joint) for one in above)
        ]
        if not fitting:
            break
        arm[part] = fitting[0]
    if "shoulder" in arm:
        over = set(skeleton.above(arm["shoulder"]))
        collar = sorted(joint for joint in named(skeleton.names, "collar", side) if joint in over)
        if collar:
            arm["collar"] = collar[0]
    return arm


def _arms_by_shape(skeleton: Skeleton, legs: tuple[Leg, ...]) -> tuple[dict[str, dict[str, int]], dict[str, int]]:
    """Both arms, and neck and head: the longest chain besides the legs on either side, if they mirror each other."""
    place = rest_positions(skeleton)
    across, middle, size = _across(place, legs)
    off = (place - middle) @ across
    hips = {leg.hip for leg in legs}
    best: dict[str, tuple[float, list[int]]] = {}
    for leaf in range(len(place)):
        chain = [leaf, *skeleton.above(leaf)][::-1]
        if skeleton.children(leaf) or hips & set(chain) or abs(float(off[leaf])) <= ASIDE * size:
            continue
        side = SIDES[0] if float(off[leaf]) > 0.0 else SIDES[1]
        reach = _length(skeleton, chain, leaf)
        best[side] = max(best.get(side, (0.0, [])), (reach, chain))
    if len(best) < len(SIDES):
        return {}, {}
    left, right = (best[side][1] for side in SIDES)
    shared = [joint for joint in left if joint in right]
    if not shared:
        return {}, {}
    one, other = (_length(skeleton, chain[len(shared) - 1 :], chain[-1]) for chain in (left, right))
    if min(one, other) < SHORTEST * size or abs(one - other) > ALIKE * max(one, other):
        return {}, {}
    arms = {side: _arm_in(skeleton, chain[len(shared) :]) for side, (_, chain) in best.items()}
    if not all(arms.values()):
        return {}, {}
    return arms, _head_above(skeleton, place, shared[-1], off, size)


def _arm_in(skeleton: Skeleton, chain: list[int]) -> dict[str, int]:
    """The two longest bones in a row are upper arm and forearm; a joint before them is the collar."""
    bones = [float(skeleton.offsets[joint].norm()) for joint in chain[1:]]
    end = skeleton.end_sites.get(skeleton.names[chain[-1]])
    bones += [0.0 if end is None else float(end.norm())]
    if len(bones) < 2:
        return {}
    k = max(range(len(bones) - 1), key=lambda at: bones[at] + bones[at + 1])
    arm = {"shoulder": chain[k], "elbow": chain[k + 1]}
    if k + 2 < len(chain):
        arm["wrist"] = chain[k + 2]
    return arm | ({"collar": chain[k - 1]} if k else {})


def _head_above(skeleton: Skeleton, place: Tensor, trunk: int, off: Tensor, size: float) -> dict[str, int]:
    """Neck and head: the joints in the middle that go up from where the arms hang."""
    found: list[int] = []
    joint = trunk
    while True:
        middle = [child for child in skeleton.children(joint) if abs(float(off[child])) <= ASIDE * size]
        higher = [child for child in middle if float(place[child, 1]) > float(place[joint, 1])]
        if not higher:
            break
        joint = max(higher, key=lambda child: float(place[child, 1]))
        found.append(joint)
    return dict(zip(("neck", "head") if len(found) > 1 else ("head",), found, strict=False))


def _trunk(skeleton: Skeleton, found: Mapping[str, int]) -> dict[str, int]:
    """Pelvis: where both legs hang; waist, chest and upper chest: of the chain from there to the neck or the arms."""
    hips = [found[f"{side}_hip"] for side in SIDES if f"{side}_hip" in found]
    if len(hips) < len(SIDES):
        return {}
    shared = [joint for joint in skeleton.above(hips[0]) if joint in skeleton.above(hips[1])]
    if not shared:
        return {}
    # A root on the ground, or a joint of the same place above it, is not the pelvis if something nearer is.
    trunk = {"pelvis": shared[0]}
    top = next((found[part] for part in ("neck", "left_collar", "left_shoulder", "head") if part in found), None)
    if top is not None and shared[0] in skeleton.above(top):
        chain = [joint for joint in reversed(skeleton.above(top)) if shared[0] in skeleton.above(joint)]
        if chain:
            trunk["waist"] = chain[0]
        if len(chain) > 2:
            trunk["chest"] = chain[len(chain) // 2]
        if len(chain) > 1:
            trunk["upper_chest"] = chain[-1]
    return trunk


def _across(place: Tensor, legs: tuple[Leg, ...]) -> tuple[Tensor, Tensor, float]:
    """Unit vector (3,) from the right hip to the left one, the point between them, and the body's size."""
    left, right = (place[leg.hip] for leg in legs)
    across = left - right
    size = float((place.amax(dim=0) - place.amin(dim=0)).max())
    return across / across.norm().clamp(min=1e-9), 0.5 * (left + right), size


def _length(skeleton: Skeleton, chain: list[int], leaf: int) -> float:
    """Of the bones from the first joint of a chain to the end of its last."""
    end = skeleton.end_sites.get(skeleton.names[leaf])
    return sum(float(skeleton.offsets[joint].norm()) for joint in chain[1:]) + (
        0.0 if end is None else float(end.norm())
    )
