"""Which joints of a skeleton are which parts of the body, whatever they are called, and how heavy they are."""

from __future__ import annotations

from collections.abc import Collection, Mapping

import numpy as np
from numpy.typing import NDArray

from hopdiff.geometry.body_parts import body_parts
from hopdiff.geometry.joint_names import SIDES
from hopdiff.geometry.skeleton import Skeleton
from hopdiff.geometry.trunk_parts import trunk_parts
from hopdiff.types import HopdiffError
from hopdiff.whole_body.skeleton import JOINTS

# The names of joints in other programs, by those of `full_body`. A root that is not the pelvis is put under it.
SCHEMES: Mapping[str, Mapping[str, str]] = {
    "hopdiff": {name: name for name in JOINTS},
    "mixamo": {
        "pelvis": "mixamorig:Hips",
        "waist": "mixamorig:Spine",
        "chest": "mixamorig:Spine1",
        "upper_chest": "mixamorig:Spine2",
        "neck": "mixamorig:Neck",
        "head": "mixamorig:Head",
        **{
            f"{side.lower()}_{ours}": f"mixamorig:{side}{theirs}"
            for side in ("Left", "Right")
            for ours, theirs in (
                ("collar", "Shoulder"),
                ("shoulder", "Arm"),
                ("elbow", "ForeArm"),
                ("wrist", "Hand"),
                ("hip", "UpLeg"),
                ("knee", "Leg"),
                ("ankle", "Foot"),
                ("toe", "ToeBase"),
            )
        },
    },
    "unreal_mannequin": {
        "pelvis": "pelvis",
        "waist": "spine_01",
        "chest": "spine_02",
        "upper_chest": "spine_03",
        "neck": "neck_01",
        "head": "head",
        **{
            f"{side}_{ours}": f"{theirs}_{side[0]}"
            for side in SIDES
            for ours, theirs in (
                ("collar", "clavicle"),
                ("shoulder", "upperarm"),
                ("elbow", "lowerarm"),
                ("wrist", "hand"),
                ("hip", "thigh"),
                ("knee", "calf"),
                ("ankle", "foot"),
                ("toe", "ball"),
            )
        },
    },
}
SPINE = ("pelvis", "waist", "chest", "upper_chest", "neck", "head")  # the line of the back
# Parts of which each hangs on the one before, whatever lies between.
CHAINS = (
    SPINE,
    *(("pelvis", *(f"{side}_{part}" for part in ("collar", "shoulder", "elbow", "wrist"))) for side in SIDES),
    *(("pelvis", *(f"{side}_{part}" for part in ("hip", "knee", "ankle", "toe"))) for side in SIDES),
)
REQUIRED = ("pelvis", *(f"{side}_{part}" for side in SIDES for part in ("hip", "knee")))
# Segment masses in body masses: de Leva (1996), table 4, male; the shank with the foot, the forearm with the hand.
SHARES = {
    "pelvis": 0.1117,
    "waist": 0.3229,
    "neck": 0.0694,
    **{
        f"{side}_{part}": share
        for side in ("left", "right")
        for part, share in (("shoulder", 0.0271), ("elbow", 0.0223), ("hip", 0.1416), ("knee", 0.057))
    },
}
BUILD = 22.9  # kg/m^2, body mass over height squared, of bodies whose mass is not known
LEG = 0.53  # height of the hip in body heights: Drillis and Contini (1966)
GROUND_ROOT = {"unreal_mannequin": "root"}  # schemes whose root is a joint on the ground, and its name


def parts_of(skeleton: Skeleton, skin: Collection[int] = ()) -> dict[str, int]:
    """Part of the body, by the names of `full_body`, -> joint; without the parts that were not found.

    By the names of a whole scheme, whatever the shape, with what the spine has between pelvis and neck; or else as
    `body_parts` finds them. skin: the joints that carry the skin, where that is known.
    """
    for scheme in SCHEMES.values():
        if set(scheme.values()) <= set(skeleton.names):
            found = {part: skeleton.index(name) for part, name in scheme.items()}
            return found | trunk_parts(skeleton, found)
    return body_parts(skeleton, skin)


def renamed(skeleton: Skeleton, scheme: str) -> Skeleton:
    """The skeleton with its joints called as another program calls them; joints that it does not know keep their name.

    Raises HopdiffError if none of its parts can be told.
    """
    parts = parts_of(skeleton)
    if not parts:
        raise HopdiffError(f"names={scheme}: no part of this skeleton can be told by its joints' names.")
    names = list(skeleton.names)
    for part, joint in parts.items():
        names[joint] = SCHEMES[scheme][part]
    if len(set(names)) < len(names):
        twice = next(name for name in names if names.count(name) > 1)
        raise HopdiffError(f"names={scheme}: two joints of this skeleton would be called {twice!r}.")
    ends = {names[skeleton.index(name)]: end for name, end in skeleton.end_sites.items()}
    return Skeleton(tuple(names), skeleton.parents, skeleton.offsets, ends)


def ordinary_masses(places: NDArray[np.float64], parts: Mapping[str, int]) -> dict[str, float]:
    """Masses of the segments of a body of ordinary build by joint [kg]. places: (J, 3) joints of its rest pose [m]."""
    height = 1.75
    if {"left_hip", "left_knee"} <= set(parts):
        hip, lowest = places[parts["left_hip"]], float(places[:, 1].min())
        bones = np.linalg.norm(hip - places[parts["left_knee"]])
        if "left_ankle" in parts:
            bones = bones + np.linalg.norm(places[parts["left_knee"]] - places[parts["left_ankle"]]) * 1.12
        height = max(float(bones), 0.9 * (float(hip[1]) - lowest), 1e-3) / LEG
    return {part: share * BUILD * height**2 * (height / 1.75) for part, share in SHARES.items()}
