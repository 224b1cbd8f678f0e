"""The body as physics sees it: rigid segments hung on each other, read from the character's file.

Segments, each with the frame of its joint (axes left, up, forward when standing straight): pelvis, waist (abdomen),
chest, head, and left and right thigh, shank, foot, upper arm, and forearm with hand. What the character's file leaves
open is filled in with the proportions of de Leva (1996): how much of shank and foot is the foot, and how much of the
trunk above the waist is the abdomen.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import torch
from torch import Tensor

from hopdiff.character import Character
from hopdiff.geometry.skeleton import Skeleton
from hopdiff.whole_body.skeleton import full_skeleton, heel_of

SEGMENTS = (
    *("pelvis", "waist", "chest", "head"),
    *(f"{side}_{part}" for part in ("thigh", "shank", "foot") for side in ("left", "right")),
    *(f"{side}_{part}" for part in ("upper_arm", "forearm") for side in ("left", "right")),
)
PARENTS = (-1, 0, 1, 2, 0, 0, 4, 5, 6, 7, 2, 2, 10, 11)
# The joint of the 22 that a segment turns about.
JOINT_OF = {
    **{name: name for name in ("pelvis", "waist", "chest")},
    "head": "neck",
    **{
        f"{side}_{part}": f"{side}_{joint}"
        for side in ("left", "right")
        for part, joint in (
            ("thigh", "hip"),
            ("shank", "knee"),
            ("foot", "ankle"),
            ("upper_arm", "shoulder"),
            ("forearm", "elbow"),
        )
    },
}
PELVIS, WAIST, CHEST, HEAD = range(4)
THIGHS, SHANKS, FEET, UPPER_ARMS, FOREARMS = (slice(k, k + 2) for k in range(4, 14, 2))
UPPER_BODY = (WAIST, CHEST, HEAD, 10, 11, 12, 13)
COUNT = len(SEGMENTS)

# De Leva (1996), table 4, male.
FOOT_SHARE = 0.0137 / (0.0433 + 0.0137)  # of the mass of shank and foot
SHANK_CENTRE = 0.4459  # of the shank's length, from the knee
SHANK_GYRATION = (0.255, 0.103, 0.249)  # of the shank's length, about the axes left, up, forward
FOOT_CENTRE = 0.4415  # of the foot's length, from the heel
FOOT_GYRATION = (0.257, 0.245, 0.124)  # of the foot's length
ABDOMEN_SHARE = 0.1033 / 0.3229  # of the mass of trunk above the waist: middle trunk up to a third of the spine
ABDOMEN_GYRATION = (0.30, 0.32, 0.36)  # of the abdomen's height times 1.6; about those of an elliptic cylinder


@dataclass(frozen=True, eq=False)
class Layout:
    """The S segments of one body, in the order of SEGMENTS.

    masses: (S,) [kg]. centres: (S, 3) centres of mass in their segments' frames [m]. inertias: (S, 3) principal
    moments about them [kg m^2]. spread: (S, 3) second moments of mass along the axes, (I_y + I_z - I_x) / 2 and so on.
    offsets: (S, 3) where each segment hangs in its parent's frame [m]. above: (S, S) 1 where column j is above or is
    segment i. skeleton: the 22 joints. heel, ball, toe: (3,) from the ankle of a level foot [m].
    """

    character: Character
    skeleton: Skeleton
    masses: Tensor
    centres: Tensor
    inertias: Tensor
    spread: Tensor
    offsets: Tensor
    above: Tensor
    heel: Tensor
    ball: Tensor
    toe: Tensor
    thigh: float
    shank: float

    @classmethod
    def of(cls, character: Character) -> Layout:
        """The layout of a character of eleven joints."""
        own = character.skeleton
        skeleton = full_skeleton(own, character.shoe)
        like = own.offsets
        index = own.index

        def joint(name: str) -> Tensor:
            return skeleton.offsets[skeleton.index(name)]

        mass, centre, inertia = ([like.new_zeros(())] * COUNT, [like.new_zeros(3)] * COUNT, [like.new_zeros(3)] * COUNT)
        radii = character.gyrations

        def put(name: str, m: Tensor, c: Tensor, moments: Tensor) -> None:
            k = SEGMENTS.index(name)
            mass[k], centre[k], inertia[k] = m, c, moments

        def copied(name: str, source: str) -> None:
            i = index(source)
            put(name, character.masses[i], character.coms[i], character.masses[i] * radii[i] ** 2)

        copied("pelvis", "pelvis")
        copied("head", "neck")
        for side in ("left", "right"):
            copied(f"{side}_thigh", f"{side}_hip")
            copied(f"{side}_upper_arm", f"{side}_shoulder")
            copied(f"{side}_forearm", f"{side}_elbow")
            i = index(f"{side}_knee")
            ankle, heel, toe = joint(f"{side}_ankle"), heel_of(own, character.shoe), _toe_tip(skeleton, side)
            length, size = ankle.norm(), toe[2] - heel[2]
            m = character.masses[i] * (1.0 - FOOT_SHARE)
            put(f"{side}_shank", m, SHANK_CENTRE * ankle, m * (like.new_tensor(SHANK_GYRATION) * length) ** 2)
            m = character.masses[i] * FOOT_SHARE
            middle = like.new_tensor((0.0, 0.5, 0.0)) * heel[1] + like.new_tensor((0.0, 0.0, 1.0)) * (
                heel[2] + FOOT_CENTRE * size
            )
            put(f"{side}_foot", m, middle, m * (like.new_tensor(FOOT_GYRATION) * size) ** 2)
        _split_trunk(character, joint("chest"), put)

        place = {"head": joint("upper_chest") + joint("neck")}
        for side in ("left", "right"):
            place[f"{side}_upper_arm"] = joint("upper_chest") + joint(f"{side}_collar") + joint(f"{side}_shoulder")
        offsets = torch.stack([place.get(name, joint(JOINT_OF[name])) for name in SEGMENTS])
        offsets[0] = 0.0
        above = like.new_zeros(COUNT, COUNT)
        for k, parent in enumerate(PARENTS):
            if parent >= 0:
                above[k] = above[parent]
            above[k, k] = 1.0
        moments = torch.stack(inertia)
        return cls(
            character,
            skeleton,
            torch.stack(mass),
            torch.stack(centre),
            moments,
            0.5 * moments.sum(-1, keepdim=True) - moments,
            offsets,
            above,
            heel_of(own, character.shoe),
            joint("left_toe"),
            _toe_tip(skeleton, "left"),
            float(joint("left_knee").norm()),
            float(joint("left_ankle").norm()),
        )

    @property
    def mass(self) -> float:
        return self.character.mass

    @cached_property
    def leg_length(self) -> float:
        """From hip to sole, standing [m]."""
        return self.character.leg_length

    @property
    def leg(self) -> float:
        """Length of thigh and shank [m]."""
        return self.thigh + self.shank

    @cached_property
    def sole(self) -> tuple[float, float, float]:
        """Height of the ankle over the sole of a level foot, and how far ahead of it heel and ball are [m]."""
        return -float(self.heel[1]), float(self.heel[2]), float(self.ball[2])

    # Places are sums of axes of frames, each times a number of the body: with the 3 S axes below each other, (3 S, 3)
    # in the world, all of them follow by one product.

    @cached_property
    def hanging(self) -> Tensor:
        """(S, 3 S) from the axes of all segments to where their joints are, from the root [m]."""
        held = self.offsets.new_zeros(COUNT, COUNT, 3)
        for k, parent in enumerate(PARENTS):
            if parent >= 0:
                held[k, parent] = self.offsets[k]
        return (self.above @ held.flatten(1)).contiguous()

    @cached_property
    def weighing(self) -> Tensor:
        """(S, 3 S) the same to their centres of mass [m]."""
        own = torch.diag_embed(torch.ones_like(self.masses)).unsqueeze(-1) * self.centres
        return self.hanging + own.flatten(1)

    @cached_property
    def balance(self) -> Tensor:
        """(1, 3 S) the same to the centre of mass of the body [m]."""
        return (self.masses / self.masses.sum()).unsqueeze(0) @ self.weighing

    @cached_property
    def turning(self) -> Tensor:
        """(3 S, 3 S) Q, symmetric: with the axes a_i, the angular momentum about the centre of mass of the body is
        sum_ij Q_ij a_i x a_j' per body mass [m^2]."""
        shares = self.masses / self.masses.sum()
        arms = self.weighing - self.balance
        return arms.T @ (shares.unsqueeze(-1) * arms) + torch.diag((self.spread / self.masses.sum()).flatten())


def _toe_tip(skeleton: Skeleton, side: str) -> Tensor:
    return skeleton.offsets[skeleton.index(f"{side}_toe")] + skeleton.end_sites[f"{side}_toe"]


def _split_trunk(character: Character, height: Tensor, put: object) -> None:
    """Cut the trunk above the waist at the chest joint (3,), so that mass, centre and moments of the whole stay."""
    i = character.skeleton.index("waist")
    m, c = character.masses[i], character.coms[i]
    whole = m * character.gyrations[i] ** 2
    low = ABDOMEN_SHARE * m
    low_centre = 0.5 * height + c * c.new_tensor((1.0, 0.0, 1.0))
    low_moments = low * (c.new_tensor(ABDOMEN_GYRATION) * 1.6 * height.norm()) ** 2
    high = m - low
    high_centre = (m * c - low * low_centre) / high

    def shift(mass: Tensor, arm: Tensor) -> Tensor:
        return mass * ((arm**2).sum() - arm**2)

    high_moments = whole - low_moments - shift(low, low_centre - c) - shift(high, high_centre - c)
    # A body that is drawn by hand may leave nothing: a third of the whole stays at least.
    high_moments = torch.maximum(high_moments, whole / 3.0)
    assert callable(put)
    put("waist", low, low_centre, low_moments)
    put("chest", high, high_centre - height, high_moments)
