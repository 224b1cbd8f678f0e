"""Limbs of a body by its shape: pairs of chains that mirror each other, each of two long bones with a joint between.

Only lengths and places of the joints at rest are looked at. Limbs may be split into pieces and have helpers beside
them, so that bones are not counted one by one: of all joints that may be the upper one, the middle one and the lower
one of a limb, those that are most like a limb are taken.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hopdiff.geometry.joint_names import is_end, is_helper, plain_name
from hopdiff.geometry.limb_names import UNLIKE
from hopdiff.geometry.skeleton import Skeleton

ASIDE = 0.01  # of the body's size from which on a joint belongs to a side
MIRRORED = 0.03  # of the body's size by which a joint may lie beside the mirror image of its twin
HANGING = 0.7  # of its length by which a leg hangs down
SHORTEST_LEG = 0.1  # of the body's height
SHORTEST_ARM = 0.1  # of the body's size
SHOULDERS = 0.25  # of the way from the hips to the top at which arms begin at least
# How like a limb three joints are, in doublings of its length. The weights are set by hand on skeletons of many
# programs, which tests hold.
PIECE = 0.3  # for every joint on the way that is none of the three, and of a leg for those of its own before it
MOST_PIECES = 12  # of one bone of a limb
MARK = 0.7  # where the lower one but marks the end of a bone
BENT = 2.0  # for a leg that goes nowhere
HAND, TIP = 0.5, 0.2  # where several chains begin at the lower joint, or nothing hangs on it
FOOT = 0.5  # where something stands out ahead or behind of the lower joint
HIGH = 2.0  # for a leg's end as high as its hip
FAR = 0.3  # for every joint of the trunk between pelvis and arm
CARRIED = 2.0  # where the skin hangs on all three


@dataclass(frozen=True)
class Limb:
    """Hip, knee and ankle, or shoulder, elbow and wrist."""

    upper: int
    middle: int
    lower: int


@dataclass(frozen=True, eq=False)
class Shape:
    """A body at rest. place: (J, 3) of the joints [m]. across: (3,) unit vector from right to left. middle: (3,) a
    point in the plane between the sides [m]. skin: the joints that carry the skin, where that is known."""

    skeleton: Skeleton
    place: NDArray[np.float64]
    across: NDArray[np.float64]
    middle: NDArray[np.float64]
    skin: Collection[int] = ()

    @property
    def size(self) -> float:
        return float(np.ptp(self.place, axis=0).max())

    def off(self) -> NDArray[np.float64]:
        """(J,) how far the joints are to the left of the middle [m]."""
        found: NDArray[np.float64] = (self.place - self.middle) @ self.across
        return found

    def twins(self) -> dict[int, int]:
        """For joints on a side the one at the mirror image of their place."""
        off, skeleton = self.off(), self.skeleton
        images = self.place - 2.0 * off[:, None] * self.across
        words = [plain_name(name)[1] for name in skeleton.names]
        depth = [len(skeleton.above(joint)) for joint in range(len(off))]
        twins = {}
        for joint in np.flatnonzero(np.abs(off) > ASIDE * self.size).tolist():
            gaps = np.linalg.norm(self.place - images[joint], axis=1)
            near = [k for k in np.flatnonzero(gaps < MIRRORED * self.size).tolist() if off[k] * off[joint] < 0.0]
            if near:
                twins[joint] = min(
                    near,
                    key=lambda k: (
                        words[k] != words[joint],
                        abs(depth[k] - depth[joint]),
                        round(float(gaps[k]) / self.size, 4),
                        abs(k - joint),
                    ),
                )
        return twins

    def limbs(self, joints: Collection[int]) -> Iterator[tuple[float, Limb]]:
        """Of all three joints that hang on each other how like a limb they are."""
        for lower in joints:
            chain = [joint for joint in self.skeleton.above(lower) if joint in joints]
            for k, middle in enumerate(chain[:MOST_PIECES]):
                for upper in chain[k + 1 : k + 1 + MOST_PIECES]:
                    if (score := self.likeness(limb := Limb(upper, middle, lower))) is not None:
                        yield score, limb

    def likeness(self, limb: Limb) -> float | None:
        """None where it cannot be a limb."""
        names = self.skeleton.names
        one, other = (self.length(*pair) for pair in ((limb.upper, limb.middle), (limb.middle, limb.lower)))
        if min(one, other) < 1e-6 or max(one, other) > UNLIKE * min(one, other):
            return None
        if any(is_helper(names[joint]) for joint in (limb.upper, limb.middle)):
            return None
        if is_helper(names[limb.lower]) and not is_end(names[limb.lower]):
            return None
        above = self.skeleton.above(limb.lower)
        score = float(np.log2(one + other) - abs(np.log2(one / other)))
        score -= PIECE * (above.index(limb.upper) - 1) + MARK * is_helper(names[limb.lower])
        return score + CARRIED * (bool(self.skin) and {limb.upper, limb.middle, limb.lower} <= set(self.skin))

    def hanging(self, joint: int) -> int:
        """How many chains begin at a joint."""
        return sum(not is_helper(self.skeleton.names[child]) for child in self.skeleton.children(joint))

    def length(self, one: int, other: int) -> float:
        return float(np.linalg.norm(self.place[one] - self.place[other]))

    def pairs(self, joints: Collection[int]) -> Iterator[tuple[float, Limb, Limb]]:
        """Limbs on the left with their mirror images."""
        off, twins = self.off(), self.twins()
        left = {joint for joint in joints if joint in twins and off[joint] > 0.0}
        for score, limb in self.limbs(left):
            other = Limb(*(twins[joint] for joint in (limb.upper, limb.middle, limb.lower)))
            above = self.skeleton.above(other.lower)
            if other.middle in above and other.upper in self.skeleton.above(other.middle):
                yield score, limb, other


def legs_in(shape: Shape) -> tuple[Limb, Limb] | None:
    """Those on the left and on the right that stand on the ground, if there are any."""
    place, best = shape.place, None
    ground, high = float(place[:, 1].min()), 0.0
    for score, left, right in shape.pairs(range(len(place))):
        hip, ankle = place[left.upper], place[left.lower]
        long = shape.length(left.upper, left.middle) + shape.length(left.middle, left.lower)
        if hip[1] - ankle[1] < max(HANGING * long, SHORTEST_LEG * np.ptp(place[:, 1])):
            continue
        score -= HIGH * (ankle[1] - ground) / (hip[1] - ground) + BENT * (1.0 - (hip[1] - ankle[1]) / long)
        above, others = (shape.skeleton.above(limb.upper) for limb in (left, right))
        score -= PIECE * len([joint for joint in above if joint not in others])
        score += FOOT * _stands_out(shape, left.lower, long)
        score += 0.0 if shape.hanging(left.lower) else TIP
        if best is None or score > high:
            best, high = (left, right), score
    return best


def arms_in(shape: Shape, hips: Collection[int]) -> tuple[Limb, Limb] | None:
    """Those on the left and on the right that hang on the trunk, if there are any. hips: of the legs."""
    skeleton, place = shape.skeleton, shape.place
    legs = {joint for joint in range(len(place)) if not set(hips).isdisjoint((joint, *skeleton.above(joint)))}
    floor = float(np.mean([place[hip][1] for hip in hips]))
    middle = [joint for joint in range(len(place)) if abs(shape.off()[joint]) <= ASIDE * shape.size]
    top = max((float(place[joint][1]) for joint in middle), default=floor)
    lowest = floor + SHOULDERS * (top - floor)
    best, high = None, 0.0
    for score, left, right in shape.pairs([joint for joint in range(len(place)) if joint not in legs]):
        long = shape.length(left.upper, left.middle) + shape.length(left.middle, left.lower)
        if long < SHORTEST_ARM * shape.size or place[left.upper][1] < lowest:
            continue
        score += _hand(shape, left.lower)
        score -= FAR * len([joint for joint in skeleton.above(left.upper) if joint in skeleton.above(right.upper)])
        if best is None or score > high:
            best, high = (left, right), score
    return best


def end_of_arm(shape: Shape, shoulder: int, elbow: int) -> int | None:
    """The wrist of an arm, if there is one."""
    below = [joint for joint in range(len(shape.place)) if elbow in shape.skeleton.above(joint)]
    likely = {joint: shape.likeness(Limb(shoulder, elbow, joint)) for joint in below}
    scores = {joint: score + _hand(shape, joint) for joint, score in likely.items() if score is not None}
    return max(scores, key=lambda joint: scores[joint], default=None)


def _hand(shape: Shape, joint: int) -> float:
    hanging = shape.hanging(joint)
    return HAND if hanging > 1 else 0.0 if hanging else TIP


def _stands_out(shape: Shape, ankle: int, long: float) -> bool:
    below = [joint for joint in range(len(shape.place)) if ankle in shape.skeleton.above(joint)]
    flat = [np.linalg.norm((shape.place[joint] - shape.place[ankle])[[0, 2]]) for joint in below]
    return bool(flat) and float(max(flat)) > 0.05 * long
