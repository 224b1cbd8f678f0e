"""Parts of bodies as many programs name their joints, or as their shape tells."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch

from hopdiff.geometry.body_parts import body_parts, legs_of, may_have_arms
from hopdiff.geometry.joint_names import plain_name, side_of
from hopdiff.geometry.rotation import axis_rotation
from hopdiff.geometry.skeleton import Skeleton
from hopdiff.whole_body.skeleton import JOINTS
from tests.export.rigs import skeleton, without

TRUNK = ("pelvis", "waist", "chest", "upper_chest", "neck", "head")
LIMBS = ("collar", "shoulder", "elbow", "wrist", "hip", "knee", "ankle", "toe")


def make(trunk: str, limbs: str, put: str = "{side}{word}", sides: str = "Left Right") -> dict[str, str]:
    """Part -> name. trunk, limbs: words in the order above. put: how a side and a word make a name."""
    found = dict(zip(TRUNK, trunk.split(), strict=True))
    for side, own in zip(("left", "right"), sides.split(), strict=True):
        words = zip(LIMBS, limbs.split(), strict=True)
        found |= {f"{side}_{part}": put.format(side=own, word=word) for part, word in words}
    return found


ANGLES = "Shoulder Arm ForeArm Hand UpLeg Leg Foot ToeBase"
MAKES = {
    "Mixamo": make(
        "mixamorig:Hips mixamorig:Spine mixamorig:Spine1 mixamorig:Spine2 mixamorig:Neck mixamorig:Head",
        ANGLES,
        "mixamorig:{side}{word}",
    ),
    "Mixamo of later days": make(
        "mixamorig1:Hips mixamorig1:Spine mixamorig1:Spine1 mixamorig1:Spine2 mixamorig1:Neck mixamorig1:Head",
        ANGLES,
        "mixamorig1:{side}{word}",
    ),
    "MotionBuilder": make("Hips Spine Spine1 Spine2 Neck Head", ANGLES),
    "motion capture suits": make(
        "Hips Spine Spine1 Chest Neck Head", "Shoulder UpperArm ForeArm Hand UpperLeg LowerLeg Foot Toe"
    ),
    "old BVH": make("Hips Chest Chest2 Chest3 Neck Head", "Collar Shoulder Elbow Wrist Hip Knee Ankle Toe"),
    "Poser": make("hip abdomen chest chest2 neck head", "Collar Shldr ForeArm Hand Thigh Shin Foot Toe", sides="l r"),
    "Daz": make(
        "hip abdomenLower abdomenUpper chest neckLower head",
        "Collar ShldrBend ForearmBend Hand ThighBend Shin Foot Toe",
        sides="l r",
    ),
    "capital letters": make(
        "Hips Spine Spine1 Spine2 Neck Head", "Collar Shldr Elbow Wrist Hip Knee Ankle Toe", sides="L R"
    ),
    "Acclaim": make(
        "root lowerback upperback thorax neck head", "clavicle humerus radius hand femur tibia foot toes", sides="l r"
    ),
    "game engines": make(
        "pelvis spine_01 spine_02 spine_03 neck_01 head",
        "clavicle upperarm lowerarm hand thigh calf foot ball",
        "{word}_{side}",
        "l r",
    ),
    "Blender": make(
        "spine spine.001 spine.002 spine.003 neck head",
        "shoulder upper_arm forearm hand thigh shin foot toe",
        "{word}.{side}",
        "L R",
    ),
    "Blender's own": make(
        "DEF-spine DEF-spine.001 DEF-spine.002 DEF-spine.003 DEF-neck DEF-head",
        "shoulder upper_arm forearm hand thigh shin foot toe",
        "DEF-{word}.{side}",
        "L R",
    ),
    "VRoid": make(
        "J_Bip_C_Hips J_Bip_C_Spine J_Bip_C_Chest J_Bip_C_UpperChest J_Bip_C_Neck J_Bip_C_Head",
        "Shoulder UpperArm LowerArm Hand UpperLeg LowerLeg Foot ToeBase",
        "J_Bip_{side}_{word}",
        "L R",
    ),
    "Character Creator": make(
        "CC_Base_Hip CC_Base_Waist CC_Base_Spine01 CC_Base_Spine02 CC_Base_NeckTwist01 CC_Base_Head",
        "Clavicle Upperarm Forearm Hand Thigh Calf Foot ToeBase",
        "CC_Base_{side}_{word}",
        "L R",
    ),
    "3ds Max": make(
        "Bip01 Bip01_Spine Bip01_Spine1 Bip01_Spine2 Bip01_Neck Bip01_Head",
        "Clavicle UpperArm Forearm Hand Thigh Calf Foot Toe0",
        "Bip01 {side} {word}",
        "L R",
    ),
    "Valve": make(
        " ".join(f"ValveBiped.Bip01_{word}" for word in ("Pelvis", "Spine", "Spine1", "Spine2", "Neck1", "Head1")),
        "Clavicle UpperArm Forearm Hand Thigh Calf Foot Toe0",
        "ValveBiped.Bip01_{side}_{word}",
        "L R",
    ),
    "models of bodies": make(
        "Pelvis Spine1 Spine2 Spine3 Neck Head",
        "Collar Shoulder Elbow Wrist Hip Knee Ankle Foot",
        "{side}_{word}",
        "L R",
    ),
    "animation by camera": make(
        "hips_JNT spine_JNT spine1_JNT spine2_JNT neck_JNT head_JNT",
        "shoulder arm forearm hand upleg leg foot toebase",
        "{side}_{word}_JNT",
        "l r",
    ),
    "a publisher of games": make(
        "Hips Spine Chest UpperChest Neck Head",
        "Shoulder UpperArm LowerArm Hand UpperLeg LowerLeg Foot Toes",
        "{word}_{side}",
        "L R",
    ),
    "depth cameras": make(
        "SpineBase SpineLow SpineMid SpineShoulder Neck Head",
        "Clavicle Shoulder Elbow Wrist Hip Knee Ankle Foot",
        "{word}{side}",
    ),
    "sides behind": make(
        "Hips Spine Spine1 Spine2 Neck Head", "clavicle arm forearm hand thigh calf foot toe", "{word}{side}", "L R"
    ),
    "nonsense": {part: f"x{'abcdefghijklmnopqrstuvwxyz'[k]}" for k, part in enumerate(JOINTS)},
}


def called(names: dict[str, str], rest: str = "t") -> Skeleton:
    body = skeleton("hopdiff", rest)
    ends = {names[name]: end for name, end in body.end_sites.items()}
    return replace(body, names=tuple(names[name] for name in body.names), end_sites=ends)


@pytest.mark.parametrize("rest", ["t", "a", "straight"])
@pytest.mark.parametrize("name", MAKES)
def test_all_parts_are_found_whatever_they_are_called(name: str, rest: str) -> None:
    assert set(MAKES[name]) == set(JOINTS)
    assert body_parts(called(MAKES[name], rest)) == {part: k for k, part in enumerate(JOINTS)}


@pytest.mark.parametrize("degrees", [0.0, 30.0, -20.0])
def test_arms_without_names_are_found_in_bodies_that_face_aside(degrees: float) -> None:
    body = called({part: part if "hip" in part or "knee" in part else f"x{k}" for k, part in enumerate(JOINTS)})
    turn = axis_rotation("Y", torch.tensor(degrees, dtype=torch.float64).deg2rad())
    ends = {name: turn @ end for name, end in body.end_sites.items()}
    turned = replace(body, offsets=body.offsets @ turn.T, end_sites=ends)
    # What hangs on a knee without a name is the ankle.
    assert body_parts(turned) == {part: k for k, part in enumerate(JOINTS) if "toe" not in part}


def test_arms_that_do_not_mirror_each_other_are_no_arms() -> None:
    body = called(MAKES["nonsense"])
    offsets = body.offsets.clone()
    offsets[JOINTS.index("left_elbow")] *= 2.0
    found = body_parts(replace(body, offsets=offsets))
    assert not any(part.endswith(("shoulder", "elbow", "wrist")) for part in found)
    assert may_have_arms(replace(body, offsets=offsets))


def test_ears_are_no_arms() -> None:
    body = without(called(MAKES["nonsense"]), *(MAKES["nonsense"][f"{side}_collar"] for side in ("left", "right")))
    head = body.index(MAKES["nonsense"]["head"])
    ears = torch.tensor([[0.07, 0.1, 0.0], [0.05, 0.02, 0.0], [-0.07, 0.1, 0.0], [-0.05, 0.02, 0.0]]).double()
    count = len(body.names)
    eared = Skeleton(
        (*body.names, "ya", "yb", "yc", "yd"),
        (*body.parents, head, count, head, count + 2),
        torch.cat((body.offsets, ears)),
        {name: end for name, end in body.end_sites.items() if name != MAKES["nonsense"]["head"]},
    )
    assert not any(part.endswith("shoulder") for part in body_parts(eared))
    assert len(legs_of(eared)) == 2


def test_a_body_of_legs_and_a_head_has_no_arms() -> None:
    body = without(called(MAKES["Poser"]), "lCollar", "rCollar")
    assert not may_have_arms(body)
    assert may_have_arms(called(MAKES["Poser"]))
    found = body_parts(body)
    assert {"pelvis", "neck", "head", "left_toe"} <= set(found)
    assert not any("shoulder" in part for part in found)


@pytest.mark.parametrize(
    ("name", "plain"),
    [
        ("lShldr", ("left", "shldr")),
        ("RShldr", ("right", "shldr")),
        ("lShldrBend", ("left", "shldr")),
        ("J_Bip_C_Hips", (None, "hips")),
        ("J_Bip_L_UpperLeg", ("left", "upperleg")),
        ("CC_Base_R_Forearm", ("right", "forearm")),
        ("lfemur", ("left", "femur")),
        ("handL", ("left", "hand")),
        ("rEar", ("right", "ear")),
        ("L5", (None, "l")),
        ("LowerBack", (None, "lowerback")),
        ("UprightSpine", (None, "uprightspine")),
        ("thigh_twist_01_l", ("left", "thightwist")),
        ("LeftLegEnd", ("left", "legend")),
        ("LeftToe_End", ("left", "toeend")),
        ("EndSite1", (None, "endsite")),
    ],
)
def test_names_are_taken_apart(name: str, plain: tuple[str | None, str]) -> None:
    assert plain_name(name) == plain
    assert side_of(name) == (plain[0] or "middle")


@pytest.mark.parametrize(
    ("name", "side", "word"),
    [
        ("mixamorig:LeftUpLeg", "left", "upleg"),
        ("hero:mixamorig:RightFoot", "right", "foot"),
        ("Leg:Left:Upper", "left", "legupper"),
        ("Arm:Right:Lower", "right", "armlower"),
        ("Fist.L", "left", "fist"),
    ],
)
def test_names_in_pieces(name: str, side: str, word: str) -> None:
    assert plain_name(name) == (side, word)
