"""Parts of bodies as two dozen programs write them, with all their helpers, and of bodies whose names tell nothing, or
something wrong."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import pytest
import torch

from hopdiff.export.anatomy import parts_of
from hopdiff.geometry.skeleton import Skeleton
from hopdiff.whole_body.skeleton import JOINTS
from tests.export.rig_families import FAMILIES, Family
from tests.export.rigs import without

LIMBS = ("hip", "knee", "ankle", "toe", "collar", "shoulder", "elbow", "wrist")
# Of the left side and the middle, of a human of 1.7 m in T pose [m].
PLACES = {
    "pelvis": (0.0, 0.97, 0.0),
    "waist": (0.0, 1.05, 0.0),
    "chest": (0.0, 1.17, -0.01),
    "upper_chest": (0.0, 1.28, -0.02),
    "neck": (0.0, 1.45, -0.03),
    "head": (0.0, 1.53, -0.01),
    "left_collar": (0.03, 1.40, -0.02),
    "left_shoulder": (0.18, 1.42, -0.03),
    "left_elbow": (0.46, 1.42, -0.03),
    "left_wrist": (0.72, 1.42, -0.03),
    "left_hip": (0.09, 0.91, 0.0),
    "left_knee": (0.09, 0.5, 0.01),
    "left_ankle": (0.09, 0.08, -0.02),
    "left_toe": (0.09, 0.02, 0.11),
}
# In a pose with the arms down by 45 degrees.
LOWERED = {"left_elbow": (0.38, 1.22, -0.03), "left_wrist": (0.56, 1.04, -0.03)}


def made(family: Family, moved: Mapping[str, tuple[float, float, float]] | None = None) -> Skeleton:
    """The skeleton of a family. moved: other places of parts."""
    left = {**PLACES, **(moved or {})}
    places = left | {
        part.replace("left", "right"): (-x, y, z) for part, (x, y, z) in left.items() if part.startswith("left")
    }
    names, parents = [bone.name for bone in family.bones], list[int]()
    where: list[torch.Tensor] = []
    for bone in family.bones:
        parents.append(-1 if bone.parent is None else names.index(bone.parent))
        offset = torch.tensor(places[bone.part] if bone.part else bone.offset, dtype=torch.float64)
        where.append(offset if bone.part or bone.parent is None else offset + where[parents[-1]])
    offsets = [place - where[parent] if parent >= 0 else place for place, parent in zip(where, parents, strict=True)]
    return Skeleton(tuple(names), tuple(parents), torch.stack(offsets), {})


def numbered(body: Skeleton) -> Skeleton:
    return replace(body, names=tuple(f"node_{joint}" for joint in range(len(body.names))))


def called(family: Family, names: Mapping[str, str]) -> Family:
    """The same with other names of parts, `LR_` being the side."""
    new = {}
    for bone in family.bones:
        side, _, part = (bone.part or "").rpartition("_")
        if side in ("left", "right") and part in names:
            new[bone.name] = names[part].replace("LR", side[0].upper())
    return Family(
        tuple(
            b._replace(name=new.get(b.name, b.name), parent=b.parent and new.get(b.parent, b.parent))
            for b in family.bones
        )
    )


def found(body: Skeleton, names: tuple[str, ...] | None = None, skin: frozenset[int] = frozenset()) -> dict[str, str]:
    return {part: (names or body.names)[joint] for part, joint in parts_of(body, skin).items()}


@pytest.mark.parametrize("pose", ["t", "a"])
@pytest.mark.parametrize("name", FAMILIES)
def test_all_parts_of_a_family_are_found_and_no_helper(name: str, pose: str) -> None:
    family = FAMILIES[name]
    assert set(family.parts) <= set(JOINTS)
    assert found(made(family, LOWERED if pose == "a" else None)) == family.parts


@pytest.mark.parametrize("name", FAMILIES)
def test_without_names_parts_are_found_by_shape(name: str) -> None:
    body, parts = made(FAMILIES[name]), FAMILIES[name].parts
    # Of those that have limbs twice at the same places it is known which carry the skin.
    twice = name in ("rigify_whole", "mmd_later")
    skin = frozenset(body.index(joint) for joint in parts.values()) if twice else frozenset[int]()
    by_shape = found(numbered(body), body.names, skin)
    if name == "mmd_later":
        # What a collarbone hangs on lies at its place.
        by_shape |= {part: joint for part, joint in parts.items() if part.endswith("collar")}
    assert {part: by_shape.get(part) for part in parts} == parts
    # Without names the end of a foot is a toe.
    assert set(by_shape) - set(parts) <= {"left_toe", "right_toe"}


def test_of_copies_of_a_body_the_one_with_the_skin_is_found() -> None:
    """All joints there are three times, at the same places, and their names tell nothing."""
    family = FAMILIES["rigify_whole"]
    body, parts = made(family), family.parts
    skin = frozenset(body.index(joint) for joint in parts.values())
    assert found(numbered(body), body.names, skin) == parts
    legs = {part: name.replace("DEF", "ORG") for part, name in parts.items() if part.endswith(("hip", "knee", "ankle"))}
    other = found(body, skin=frozenset(body.index(joint) for joint in legs.values()))
    assert {part: other[part] for part in legs} == legs


PLAIN = FAMILIES["ready_player_me"]


@pytest.mark.parametrize(
    "names",
    [
        {"hip": "leg_LR", "knee": "knee_LR", "ankle": "ankle_LR", "toe": "toe_LR"},
        {"shoulder": "arm_LR", "elbow": "elbow_LR", "wrist": "wrist_LR", "collar": "shoulder_LR"},
        {"elbow": "xLR1"},
        {"shoulder": "xLR1", "elbow": "xLR2"},
        {"shoulder": "xLR1", "wrist": "xLR2"},
        {"knee": "xLR1"},
        {"hip": "xLR1", "ankle": "xLR2"},
        {part: f"LR{number}" for number, part in enumerate(LIMBS)},
    ],
)
def test_what_names_do_not_tell_is_told_by_shape(names: dict[str, str]) -> None:
    family = called(PLAIN, names)
    assert found(made(family)) == family.parts


def test_a_foot_without_a_name_below_a_leg_with_one_has_no_toes() -> None:
    family = called(PLAIN, {"ankle": "xLR1", "toe": "xLR2"})
    assert found(made(family)) == {part: name for part, name in family.parts.items() if "toe" not in part}


def with_joint(body: Skeleton, name: str, parent: str, offset: tuple[float, float, float]) -> Skeleton:
    return Skeleton(
        (*body.names, name),
        (*body.parents, body.index(parent)),
        torch.cat((body.offsets, torch.tensor([offset], dtype=torch.float64))),
        body.end_sites,
    )


@pytest.mark.parametrize(
    ("part", "names", "parent"),
    [
        ("ankle", {"ankle": "xLR1"}, "LeftLeg"),
        ("wrist", {"wrist": "xLR2"}, "LeftForeArm"),
    ],
)
def test_a_name_that_makes_no_limb_does_not_count(part: str, names: dict[str, str], parent: str) -> None:
    """A foot or a hand that something else is called which lies at the knee, or the elbow."""
    family = called(PLAIN, names)
    body = made(family)
    for side in ("Left", "Right"):
        word = {"ankle": "Foot", "wrist": "Hand"}[part]
        body = with_joint(body, f"{side}{word}", parent.replace("Left", side), (0.0, 0.01, 0.02))
    expected = {name: joint for name, joint in family.parts.items() if part != "ankle" or "toe" not in name}
    assert found(body) == expected


def test_a_thigh_called_leg_below_a_hip_of_the_pelvis() -> None:
    family = called(FAMILIES["capture"], {"hip": "LR_Leg", "knee": "LR_Knee", "ankle": "LR_Foot"})
    new = {"LeftHipJoint": "L_Hip", "RightHipJoint": "R_Hip"}
    bones = [b._replace(name=new.get(b.name, b.name), parent=new.get(b.parent or "", b.parent)) for b in family.bones]
    assert found(made(Family(tuple(bones)))) == family.parts


@pytest.mark.parametrize("numbers", [False, True])
def test_a_long_skirt_and_twin_tails_are_no_limbs(numbers: bool) -> None:
    family = FAMILIES["unreal_4"]
    body = made(family)
    for side, sign in (("l", 1.0), ("r", -1.0)):
        for k, parent, offset in (
            (0, "pelvis", (0.12 * sign, -0.05, 0.1)),
            (1, f"skirt_0_{side}", (0.02 * sign, -0.45, 0.02)),
            (2, f"skirt_1_{side}", (0.02 * sign, -0.45, 0.02)),
        ):
            body = with_joint(body, f"skirt_{k}_{side}", parent, offset)
        for k, parent, offset in (
            (0, "head", (0.1 * sign, 0.1, 0.0)),
            (1, f"tail_0_{side}", (0.1 * sign, -0.4, 0.0)),
            (2, f"tail_1_{side}", (0.05 * sign, -0.4, 0.0)),
        ):
            body = with_joint(body, f"tail_{k}_{side}", parent, offset)
    assert found(numbered(body) if numbers else body, body.names) == family.parts


def test_legs_with_high_ankles_and_long_feet_are_found_by_shape() -> None:
    """Shank and foot of a stocky figure are as long as thigh and shank."""
    heights = {"hip": 0.5, "knee": 0.33, "ankle": 0.16, "toe": 0.05}
    moved: dict[str, tuple[float, float, float]] = {}
    for part, (x, y, z) in PLACES.items():
        moved[part] = (x, heights.get(part.rpartition("_")[2], y - 0.42), z)
    body = made(PLAIN, moved)
    assert found(numbered(body), body.names) == PLAIN.parts


def test_a_leg_may_end_in_a_mark() -> None:
    """Where feet hang elsewhere, the shank's end is all that there is."""
    body = without(made(PLAIN), "LeftToeBase", "RightToeBase")
    body = replace(body, names=tuple(name.replace("Foot", "Leg_end") for name in body.names))
    names = tuple(name if name.endswith("Leg_end") else f"node_{k}" for k, name in enumerate(body.names))
    by_shape = found(replace(body, names=names), body.names)
    assert (by_shape["left_knee"], by_shape["left_ankle"]) == ("LeftLeg", "LeftLeg_end")


def test_a_body_that_faces_backwards_has_its_left_where_its_toes_say() -> None:
    body = made(PLAIN)
    turned = replace(numbered(body), offsets=body.offsets * torch.tensor([-1.0, 1.0, -1.0], dtype=torch.float64))
    assert found(turned, body.names) == PLAIN.parts


def test_names_of_a_whole_scheme_count_whatever_the_shape() -> None:
    family = FAMILIES["mixamo"]
    assert found(made(family, {"left_wrist": (1.6, 1.42, -0.03)})) == family.parts


def test_limbs_of_one_bone_are_no_legs() -> None:
    """As the smallest figures of games have them."""
    places = {
        "root": (None, (0.0, 0.0, 0.0)),
        "leg-left": ("root", (0.1, 0.4, 0.0)),
        "leg-right": ("root", (-0.1, 0.4, 0.0)),
        "torso": ("root", (0.0, 0.45, 0.0)),
        "arm-left": ("torso", (0.2, 0.4, 0.0)),
        "arm-right": ("torso", (-0.2, 0.4, 0.0)),
        "head": ("torso", (0.0, 0.5, 0.0)),
    }
    names = tuple(places)
    parents = tuple(-1 if parent is None else names.index(parent) for parent, _ in places.values())
    offsets = torch.tensor([offset for _, offset in places.values()], dtype=torch.float64)
    assert not any("hip" in part or "knee" in part for part in found(Skeleton(names, parents, offsets, {})))
