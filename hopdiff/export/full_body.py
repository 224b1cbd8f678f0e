"""The runner's body with the joints that other programs expect: spine, collarbones, wrists, head, ankles and toes.

The model has eleven joints (Kang 1999, figure 2.1), and its shanks end in points. The others are put on its bones and
turn with them; feet are posed by `hopdiff.export.stance`.
"""

from __future__ import annotations

from dataclasses import replace

import torch
from torch import Tensor

from hopdiff.character import REQUIRED_PARENTS
from hopdiff.export.stance import with_feet
from hopdiff.export.take import Take
from hopdiff.geometry.skeleton import Skeleton
from hopdiff.types import HopdiffError

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
_PARENTS = {
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


def is_model_body(skeleton: Skeleton) -> bool:
    """Whether a skeleton has the joints of hopdiff's characters."""
    parents = {
        name: None if parent < 0 else skeleton.names[parent]
        for name, parent in zip(skeleton.names, skeleton.parents, strict=True)
    }
    return parents == dict(REQUIRED_PARENTS)


def full_body(take: Take) -> Take:
    """A run of hopdiff's own on 22 joints. Raises HopdiffError for another skeleton, or contacts that are not known."""
    skeleton = take.clip.skeleton
    if not is_model_body(skeleton) or take.contact is None or take.feet is None:
        raise HopdiffError(f"{take.name}: only runs of hopdiff's own have the joints that joints=full begins with.")
    # Of a loop the legs of three repetitions are posed, so that those of the middle one know what came and comes.
    wide = take.repeated(3) if take.loop else take
    straight = torch.eye(3, dtype=torch.float64).expand(wide.frames, 3, 3)
    rotations = dict.fromkeys(JOINTS, straight)
    rotations |= {name: wide.clip.rotations[:, k] for k, name in enumerate(skeleton.names)}
    posed = torch.stack([rotations[name] for name in JOINTS], dim=1)
    posed = with_feet(replace(wide, clip=replace(wide.clip, skeleton=full_skeleton(skeleton), rotations=posed)))
    if take.loop:
        # The root's own turn is that of its repetition.
        posed = posed[take.frames - 1 : 2 * take.frames - 1]
        posed = torch.cat((take.clip.rotations[:, :1], posed[:, 1:]), dim=1)
    return replace(take, clip=replace(take.clip, skeleton=full_skeleton(skeleton), rotations=posed))


def full_skeleton(skeleton: Skeleton) -> Skeleton:
    """The 22 joints of a body of eleven."""

    def old(name: str) -> Tensor:
        return skeleton.offsets[skeleton.index(name)]

    spine, crown = old("neck"), skeleton.end_sites["neck"]
    places = {
        "pelvis": old("pelvis"),
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
            f"{side}_toe": shank.new_tensor((0.0, -ANKLE * size, BALL * size)),
        }
        ends[f"{side}_wrist"] = (1.0 - WRIST) * hand
        ends[f"{side}_toe"] = shank.new_tensor((0.0, 0.0, (TOE_TIP - BALL) * size))
    parents = tuple(JOINTS.index(_PARENTS[name]) if name in _PARENTS else -1 for name in JOINTS)
    return Skeleton(JOINTS, parents, torch.stack([places[name] for name in JOINTS]), ends)
