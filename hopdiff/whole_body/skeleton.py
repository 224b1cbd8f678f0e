"""The runner's body with the joints that people and programs expect: spine, collarbones, wrists, head, ankles and toes.

Characters are described by eleven joints (Kang 1999, figure 2.1), whose shanks end in points. The others are put on
their bones.
"""

from __future__ import annotations

import torch
from torch import Tensor

from hopdiff.geometry.skeleton import Skeleton

# Lengths of body parts in body heights: Drillis and Contini (1966), figure 1; those of the leg in lengths of the shank
# with the foot, .285 body heights, those of the arm in lengths of forearm and hand, .254.
ANKLE = 0.039 / 0.285  # height of the ankle above the sole
HEEL = 0.04 / 0.285  # from the ankle back to the heel
BALL = 0.072 / 0.285  # from the ankle ahead to the ball of the foot
TOE_TIP = 0.112 / 0.285  # and to the tips of the toes
WRIST = 0.146 / 0.254  # from the elbow to the wrist
CHEST, UPPER_CHEST = 1.0 / 3.0, 2.0 / 3.0  # of the way from waist to neck
COLLAR = 0.2  # of the way to the shoulder where a collarbone begins
HEAD = 0.35  # of the way from the neck to the crown

JOINTS = (
    "pelvis",
    "waist",
    "chest",
    "upper_chest",
    "neck",
    "head",
    *(f"left_{part}" for part in ("collar", "shoulder", "elbow", "wrist")),
    *(f"right_{part}" for part in ("collar", "shoulder", "elbow", "wrist")),
    *(f"left_{part}" for part in ("hip", "knee", "ankle", "toe")),
    *(f"right_{part}" for part in ("hip", "knee", "ankle", "toe")),
)
PARENTS = {
    "waist": "pelvis",
    "chest": "waist",
    "upper_chest": "chest",
    "neck": "upper_chest",
    "head": "neck",
    **{f"{side}_{joint}": parent for side in ("left", "right") for joint, parent in (("collar", "upper_chest"),)},
    **{f"{side}_hip": "pelvis" for side in ("left", "right")},
    **{
        f"{side}_{joint}": f"{side}_{parent}"
        for side in ("left", "right")
        for joint, parent in (
            ("shoulder", "collar"),
            ("elbow", "shoulder"),
            ("wrist", "elbow"),
            ("knee", "hip"),
            ("ankle", "knee"),
            ("toe", "ankle"),
        )
    },
}


def full_skeleton(skeleton: Skeleton, shoe: float = 0.0) -> Skeleton:
    """The 22 joints of a body of eleven, which stands `shoe` [m] higher on soles of that thickness."""

    def old(name: str) -> Tensor:
        return skeleton.offsets[skeleton.index(name)]

    spine, crown = old("neck"), skeleton.end_sites["neck"]
    places = {
        "pelvis": old("pelvis") + crown.new_tensor((0.0, shoe, 0.0)),
        "waist": old("waist"),
        "chest": CHEST * spine,
        "upper_chest": (UPPER_CHEST - CHEST) * spine,
        "neck": (1.0 - UPPER_CHEST) * spine,
        "head": HEAD * crown,
    }
    ends = {"head": (1.0 - HEAD) * crown}
    for side in ("left", "right"):
        shoulder = old(f"{side}_shoulder")
        collar = torch.stack((COLLAR * shoulder[0], shoulder[1], shoulder[2])) - UPPER_CHEST * spine
        hand, shank = skeleton.end_sites[f"{side}_elbow"], skeleton.end_sites[f"{side}_knee"]
        size = float(shank.norm())
        places |= {
            f"{side}_collar": collar,
            f"{side}_shoulder": shoulder - UPPER_CHEST * spine - collar,
            f"{side}_elbow": old(f"{side}_elbow"),
            f"{side}_wrist": WRIST * hand,
            f"{side}_hip": old(f"{side}_hip"),
            f"{side}_knee": old(f"{side}_knee"),
            f"{side}_ankle": (1.0 - ANKLE) * shank,
            f"{side}_toe": shank.new_tensor((0.0, -ANKLE * size - shoe, BALL * size)),
        }
        ends[f"{side}_wrist"] = (1.0 - WRIST) * hand
        ends[f"{side}_toe"] = shank.new_tensor((0.0, 0.0, (TOE_TIP - BALL) * size))
    parents = tuple(JOINTS.index(PARENTS[name]) if name in PARENTS else -1 for name in JOINTS)
    return Skeleton(JOINTS, parents, torch.stack([places[name] for name in JOINTS]), ends)


def heel_of(skeleton: Skeleton, shoe: float = 0.0) -> Tensor:
    """(3,) the heel of a body of eleven joints in shoes, from the ankle of a level foot [m]."""
    size = skeleton.end_sites["left_knee"].norm()
    return torch.stack((torch.zeros_like(size), -ANKLE * size - shoe, -HEEL * size))
