"""Pelvis, waist, chest, neck and head of a body whose limbs are known."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise

from torch import Tensor

from hopdiff.geometry.joint_names import SIDES, is_helper, is_like, named, side_of
from hopdiff.geometry.skeleton import Skeleton

ASIDE = 0.02  # of the body's size from which on a joint belongs to a side
STEEP = 0.6  # of its length by which a bone of neck and head rises
CROWN = 1.2  # how much longer than the bone below it one is that ends on top of the head


def top_parts(skeleton: Skeleton, place: Tensor, off: Tensor, found: Mapping[str, int]) -> dict[str, int]:
    """Neck and head: by names, if they lie on from where the arms hang, or else what goes up from there.

    place: (J, 3) of the joints at rest [m]. off: (J,) to the left of the middle [m]. found: part -> joint, of
    the limbs.
    """
    named_parts = {part: named(skeleton.names, part) for part in ("neck", "head")}
    trunk = _arms_hang_on(skeleton, found)
    top = _named_above(skeleton, trunk, named_parts)
    if trunk is not None and "head" not in top:
        start = top.get("neck", trunk)
        up = _upwards(skeleton, place, off, start)
        if len(up) == 1 and _over_shoulders(place, trunk, found):
            top = {"neck": trunk, **top}
        if up and ("neck" in top or len(up) > 1):
            top = {"neck": up[0], **top}
        if up:
            top["head"] = up[-1]
    if trunk is not None and "head" in top and "neck" not in top:
        between = [joint for joint in skeleton.above(top["head"]) if trunk in skeleton.above(joint)]
        top |= {"neck": between[-1]} if between else {}
    return top or {part: joints[0] for part, joints in named_parts.items() if joints}


def trunk_parts(skeleton: Skeleton, found: Mapping[str, int]) -> dict[str, int]:
    """Pelvis: where both legs hang, and the trunk if that is not far; waist, chest and upper chest: of the chain from
    there to the neck or the arms."""
    hips = [found[f"{side}_hip"] for side in SIDES if f"{side}_hip" in found]
    if len(hips) < len(SIDES):
        return {}
    shared = [joint for joint in skeleton.above(hips[0]) if joint in skeleton.above(hips[1])]
    if not shared:
        return {}
    # A root on the ground, or a joint of the same place above it, is not the pelvis if something nearer is; a joint
    # that holds the legs alone is not either.
    top = next((found[part] for part in ("neck", "left_collar", "left_shoulder", "head") if part in found), None)
    over = [] if top is None else skeleton.above(top)
    trunk = {"pelvis": next((joint for joint in shared if joint in over), shared[0])}
    chain = [joint for joint in reversed(over) if trunk["pelvis"] in skeleton.above(joint)]
    chain = [joint for joint in chain if not is_helper(skeleton.names[joint])] or chain
    if chain:
        trunk["waist"] = chain[0]
    if len(chain) > 2:
        trunk["chest"] = chain[len(chain) // 2]
    if len(chain) > 1:
        trunk["upper_chest"] = chain[-1]
    return trunk


def _arms_hang_on(skeleton: Skeleton, found: Mapping[str, int]) -> int | None:
    """The nearest joint above both arms."""
    arms = [
        next((found[f"{side}_{part}"] for part in ("collar", "shoulder") if f"{side}_{part}" in found), None)
        for side in SIDES
    ]
    if arms[0] is None or arms[1] is None:
        return None
    return next((joint for joint in skeleton.above(arms[0]) if joint in skeleton.above(arms[1])), None)


def _over_shoulders(place: Tensor, joint: int, found: Mapping[str, int]) -> bool:
    """Whether a joint on which the arms hang lies so high that it is a neck, as that of 3ds Max's Biped."""
    return all(float(place[joint, 1]) >= float(place[found[f"{side}_shoulder"], 1]) for side in SIDES)


def _named_above(skeleton: Skeleton, trunk: int | None, joints: Mapping[str, list[int]]) -> dict[str, int]:
    """Neck and head of those with their names: of several the first that hangs on the trunk, and the head on the neck.
    Arms may hang on the neck."""
    if trunk is None:
        return {part: own[0] for part, own in joints.items() if own}
    above = skeleton.above(trunk)
    top = {}
    necks = [joint for joint in joints["neck"] if trunk in (joint, *skeleton.above(joint)) or joint in above]
    if necks:
        top["neck"] = necks[0]
    heads = [joint for joint in joints["head"] if trunk in skeleton.above(joint)]
    heads = [joint for joint in heads if "neck" in top and top["neck"] in skeleton.above(joint)] or heads
    if heads:
        top["head"] = heads[0]
    return top


def _upwards(skeleton: Skeleton, place: Tensor, off: Tensor, start: int) -> list[int]:
    """The joints in the middle that go up from a joint of the trunk, to the head."""
    size = float((place.amax(dim=0) - place.amin(dim=0)).max())
    names, found = skeleton.names, [start]
    while True:
        children = skeleton.children(found[-1])
        higher = [
            child
            for child in children
            if abs(float(off[child])) <= ASIDE * size
            and not any(_mirrored(float(off[child]), float(off[other]), size) for other in children)
            and float(place[child, 1] - place[found[-1], 1]) > STEEP * float((place[child] - place[found[-1]]).norm())
            and side_of(names[child]) == "middle"
            and not is_helper(names[child])
            and not is_like("face", names[child])
        ]
        if not higher:
            break
        found.append(max(higher, key=lambda child: float(place[child, 1])))
    bones = [float((place[one] - place[other]).norm()) for one, other in pairwise(found)]
    # From the head it goes on to the crown, or to hair: that is farther than from neck to head.
    return found[1:-1] if len(bones) > 1 and bones[-1] > CROWN * bones[-2] else found[1:]


def _mirrored(one: float, other: float, size: float) -> bool:
    """Whether two joints lie as far to the left and to the right, as eyes do."""
    return abs(one - other) > 0.01 * size and abs(one + other) < 0.002 * size
