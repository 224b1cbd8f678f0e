"""Limbs of a body by the names of its joints, as far as its shape allows what the names say."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from itertools import pairwise

from torch import Tensor

from hopdiff.geometry.joint_names import WORDS, is_copy, plain_name
from hopdiff.geometry.skeleton import Skeleton

LEG, ARM = ("hip", "knee", "ankle", "toe"), ("shoulder", "elbow", "wrist")
UNLIKE = 2.5  # how much longer one of a limb's two bones may be than the other
LONGEST_FOOT = 1.2  # of the shank's length
FEW = 6  # joints of a name that are looked at


def limb_by_name(
    skeleton: Skeleton, place: Tensor, side: str, roles: tuple[str, ...], skin: Collection[int] = ()
) -> tuple[list[int], bool]:
    """Joints of a limb, each hanging on the one before, as many as there are names for, and whether its bones have
    lengths that make sense. place: (J, 3) of the joints at rest. skin: the joints that carry the skin, where known."""
    best: tuple[list[int], bool] = [], False
    first: tuple[object, ...] | None = None
    for chain, ranks in _chains(skeleton, side, roles):
        sound = _sound(skeleton, place, chain)
        copies = sum(is_copy(skeleton.names[joint]) for joint in chain)
        bare = sum(joint not in skin for joint in chain) if skin else 0
        key = (not sound, -len(chain), bare, copies, ranks)
        if len(chain) > 1 and (first is None or key < first):
            best, first = (chain, sound), key
    if not best[0]:
        best = next(((chain, False) for chain, _ in _chains(skeleton, side, roles)), best)
    return best


def candidates(skeleton: Skeleton, side: str, role: str, above: int | None) -> list[tuple[tuple[int, ...], int]]:
    """Joints with a name of a part, below another if one is given, with how good the names are, smaller is better."""
    plain = [plain_name(name) for name in skeleton.names]
    words = WORDS[role]
    if role == "toe" and above is not None and plain[above][1] == "ankle":
        words = (*words, "foot")
    fitting = [
        joint
        for joint, (own, word) in enumerate(plain)
        if own == side and word in words and (above is None or above in skeleton.above(joint))
    ]
    ranked: list[tuple[tuple[int, ...], int]] = []
    for joint in fitting:
        over = [other for other in fitting if other in skeleton.above(joint)]
        piece = any(plain[other][1] == plain[joint][1] for other in over)
        rank = words.index(plain[joint][1])
        if role == "hip":
            # Of LHip and LeftUpLeg, both hips, the one nearer to the knee.
            ranked.append(((int(piece), -len(skeleton.above(joint)), rank), joint))
        elif role == "shoulder":
            ranked.append(((int(piece), rank, joint), joint))
        else:
            ranked.append(((int(bool(over)), rank, joint), joint))
    return sorted(ranked)[:FEW]


def _chains(
    skeleton: Skeleton, side: str, roles: tuple[str, ...], above: int | None = None
) -> Iterator[tuple[list[int], tuple[tuple[int, ...], ...]]]:
    """All chains of joints with the names of a limb's parts, also those that end early."""
    if not roles:
        return
    for rank, joint in candidates(skeleton, side, roles[0], above):
        yield [joint], (rank,)
        for chain, ranks in _chains(skeleton, side, roles[1:], joint):
            yield [joint, *chain], (rank, *ranks)


def _sound(skeleton: Skeleton, place: Tensor, chain: list[int]) -> bool:
    """Whether the two long bones are about as long as each other, and the foot not longer than the shank."""
    bones = [float((place[one] - place[other]).norm()) for one, other in pairwise(chain)]
    if len(bones) == 1:
        end = skeleton.end_sites.get(skeleton.names[chain[1]])
        bones += [float(end.norm())] if end is not None and not skeleton.children(chain[1]) else []
    if len(bones) > 1 and not max(bones[:2]) <= UNLIKE * min(bones[:2]):
        return False
    return len(bones) < 3 or bones[2] <= LONGEST_FOOT * bones[1]
