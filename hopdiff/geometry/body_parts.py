"""Which joints of a skeleton are which parts of a body: by their names, or by its shape where names do not tell."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace

import numpy as np
import torch
from torch import Tensor

from hopdiff.geometry.joint_names import SIDES, is_helper, named
from hopdiff.geometry.limb_names import ARM, LEG, limb_by_name
from hopdiff.geometry.limb_shapes import Limb, Shape, arms_in, end_of_arm, legs_in
from hopdiff.geometry.skeleton import Skeleton
from hopdiff.geometry.trunk_parts import ASIDE, top_parts, trunk_parts

ALIKE = 0.1  # share by which arms may differ in length
LOW = 0.15  # of the way from a foot's lowest joint to the ankle up to which toes lie
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


def legs_of(skeleton: Skeleton, skin: Collection[int] = ()) -> tuple[Leg, ...]:
    """The left and the right leg by their joints' names, or by their shape where names do not tell; none if neither
    does. skin: the joints that carry the skin, where that is known: of several legs they are the ones."""
    place = rest_positions(skeleton)
    named_legs = [limb_by_name(skeleton, place, side, LEG, skin) for side in SIDES]
    by_name = tuple(_leg(side, chain) for side, (chain, _) in zip(SIDES, named_legs, strict=True))
    if all(sound for _, sound in named_legs) and (legs := _whole(skeleton, by_name)):
        return legs
    # What names say makes no leg: it counts if nothing else is one.
    return (
        _whole(skeleton, _legs_in(skeleton, place, skin))
        or _whole(skeleton, by_name)
        or _whole(skeleton, _legs_by_shape(skeleton))
    )


def body_parts(skeleton: Skeleton, skin: Collection[int] = ()) -> dict[str, int]:
    """Part of the body, by the names of a run's 22 joints, -> joint; without the parts that were not found.

    Legs and arms by names, or by shape; the trunk by what lies between pelvis and neck. skin: as of `legs_of`.
    """
    legs = legs_of(skeleton, skin)
    found: dict[str, int] = {}
    for leg in legs:
        parts = {"hip": leg.hip, "knee": leg.knee, "ankle": leg.ankle, "toe": leg.toe}
        found |= {f"{leg.side}_{part}": joint for part, joint in parts.items() if joint is not None}
    arms = _arms(skeleton, legs, skin)
    for side, arm in arms.items():
        if arm and found.get(f"{side}_hip") in arm.values():
            # Of a body without that leg.
            found = {part: joint for part, joint in found.items() if not part.startswith(side)}
    for side, arm in arms.items():
        if "elbow" in arm:
            found |= {f"{side}_{part}": joint for part, joint in arm.items()}
    place = rest_positions(skeleton)
    across, middle, _ = _across(place, legs) if legs else (place.new_tensor((1.0, 0.0, 0.0)), place[0], 1.0)
    found |= top_parts(skeleton, place, (place - middle) @ across, found)
    return found | trunk_parts(skeleton, found)


def may_have_arms(skeleton: Skeleton) -> bool:
    """Whether anything besides the legs lies aside from the middle of the body."""
    legs, place = legs_of(skeleton), rest_positions(skeleton)
    below = {joint for leg in legs for joint in skeleton.below(leg.hip)}
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


def _whole(skeleton: Skeleton, legs: tuple[Leg | None, ...]) -> tuple[Leg, ...]:
    """The legs with ends to stand on, if that are both."""
    found = tuple(whole for leg in legs if leg is not None and (whole := with_end(skeleton, leg)) is not None)
    return found if len(found) == len(SIDES) else ()


def _leg(side: str, chain: list[int]) -> Leg | None:
    if len(chain) < 2:
        return None
    return Leg(side, chain[0], chain[1], *(chain[k] if len(chain) > k else None for k in (2, 3)))


def _legs_in(skeleton: Skeleton, place: Tensor, skin: Collection[int]) -> tuple[Leg, ...]:
    """Of all pairs of limbs that hang down those that are most like legs. Left is where the toes say, or +x."""
    across = np.array([1.0, 0.0, 0.0])
    found = legs_in(Shape(skeleton, place.numpy(), across, place[0].numpy(), skin))
    if found is None:
        return ()
    legs = [Leg(side, one.upper, one.middle, one.lower, None) for side, one in zip(SIDES, found, strict=True)]
    legs = [replace(leg, toe=toe_of(skeleton, place, one.lower)) for leg, one in zip(legs, found, strict=True)]
    ahead = [float(place[leg.toe, 2] - place[leg.ankle, 2]) for leg in legs if leg.toe is not None]
    if ahead and max(ahead) < 0.0:
        legs = [replace(leg, side=side) for side, leg in zip(SIDES, legs[::-1], strict=True)]
    return tuple(legs)


def toe_of(skeleton: Skeleton, place: Tensor, ankle: int) -> int | None:
    """Going out from an ankle, the first joint that is low, or else the first; by shape. place: (J, 3) at rest [m]."""
    way = [ankle]
    while children := [child for child in skeleton.children(way[-1]) if not is_helper(skeleton.names[child])]:
        far = [float((place[child] - place[ankle])[[0, 2]].norm()) for child in children]
        way.append(children[far.index(max(far))])
    if len(way) == 1:
        return None
    heights = [float(place[joint, 1]) for joint in way]
    low = min(heights) + LOW * (heights[0] - min(heights))
    return next((joint for joint, height in zip(way[1:], heights[1:], strict=True) if height <= low), way[1])


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


def _arms(skeleton: Skeleton, legs: tuple[Leg, ...], skin: Collection[int]) -> dict[str, dict[str, int]]:
    """By side: by names, or by shape where names do not tell both."""
    place = rest_positions(skeleton)
    arms, sound = {}, {}
    for side in SIDES:
        chain, sound[side] = limb_by_name(skeleton, place, side, ARM, skin)
        arms[side] = dict(zip(ARM, chain, strict=False))
    by_name = {side: _completed(skeleton, place, side, arm) for side, arm in arms.items()}
    # Hands need not be called so: fists and claws. A shoulder may be a collar where something lies before the elbow.
    told = [
        "wrist" in arm or ("elbow" in arm and skeleton.parents[arm["elbow"]] == arm["shoulder"])
        for arm in arms.values()
    ]
    whole = [side for side, enough in zip(SIDES, told, strict=True) if enough and sound[side]]
    if len(whole) == len(SIDES) or not legs:
        return by_name
    across, middle, _ = _across(place, legs)
    pair = arms_in(Shape(skeleton, place.numpy(), across.numpy(), middle.numpy(), skin), [leg.hip for leg in legs])
    if pair is not None:
        shaped = {side: _arm_of(skeleton, limb, pair) for side, limb in zip(SIDES, pair, strict=True)}
        # Names that tell a part of an arm count if the shape is that of another limb.
        whole += [side for side in SIDES if sound[side] and set(shaped[side].values()).isdisjoint(arms[side].values())]
        return shaped | {side: by_name[side] for side in whole}
    return by_name if any("elbow" in arm for arm in arms.values()) else _arms_by_shape(skeleton, legs)


def _completed(skeleton: Skeleton, place: Tensor, side: str, arm: dict[str, int]) -> dict[str, int]:
    """An arm by names with its collarbone, and with a wrist by shape where names do not tell it."""
    if "shoulder" not in arm:
        return arm
    over = set(skeleton.above(arm["shoulder"]))
    collar = sorted(joint for joint in named(skeleton.names, "collar", side) if joint in over)
    arm = arm | ({"collar": collar[0]} if collar else {})
    if "elbow" in arm and "wrist" not in arm:
        shape = Shape(skeleton, place.numpy(), np.array([1.0, 0.0, 0.0]), place[0].numpy())
        wrist = end_of_arm(shape, arm["shoulder"], arm["elbow"])
        return arm | ({} if wrist is None else {"wrist": wrist})
    return arm


def _arm_of(skeleton: Skeleton, limb: Limb, pair: tuple[Limb, Limb]) -> dict[str, int]:
    """With the collar: of the joints of its own between trunk and shoulder the first."""
    shared = set(skeleton.above(pair[0].upper)) & set(skeleton.above(pair[1].upper))
    own = [joint for joint in skeleton.above(limb.upper) if joint not in shared]
    arm = {"shoulder": limb.upper, "elbow": limb.middle, "wrist": limb.lower}
    return arm | ({"collar": own[-1]} if own else {})


def _arms_by_shape(skeleton: Skeleton, legs: tuple[Leg, ...]) -> dict[str, dict[str, int]]:
    """Both arms: the longest chain besides the legs on either side, if they mirror each other."""
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
        return {}
    left, right = (best[side][1] for side in SIDES)
    shared = [joint for joint in left if joint in right]
    if not shared:
        return {}
    one, other = (_length(skeleton, chain[len(shared) - 1 :], chain[-1]) for chain in (left, right))
    if min(one, other) < SHORTEST * size or abs(one - other) > ALIKE * max(one, other):
        return {}
    arms = {side: _arm_in(skeleton, chain[len(shared) :]) for side, (_, chain) in best.items()}
    return arms if all(arms.values()) else {}


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
