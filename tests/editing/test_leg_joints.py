from __future__ import annotations

import math
from dataclasses import replace

import pytest
import torch

from hopdiff.editing.leg_joints import Leg, facing, find_legs, plain_name
from hopdiff.geometry.rotation import axis_rotation
from hopdiff.geometry.skeleton import Skeleton
from hopdiff.types import HopdiffError
from tests.editing.walks import stride
from tests.people import clip_of

PARTS = ("hip", "knee", "ankle", "toe")
# How some makers call root, left and right hip, knee, ankle and toe.
MAKES = {
    "motionbuilder": (
        "Hips",
        *(f"{side}{part}" for side in ("Left", "Right") for part in ("UpLeg", "Leg", "Foot", "ToeBase")),
    ),
    "mixamo": (
        "mixamorig:Hips",
        *(f"mixamorig:{side}{part}" for side in ("Left", "Right") for part in ("UpLeg", "Leg", "Foot", "ToeBase")),
    ),
    "unreal": ("pelvis", *(f"{part}_{side}" for side in "lr" for part in ("thigh", "calf", "foot", "ball"))),
    "biped": ("Bip01", *(f"Bip01 {side} {part}" for side in "LR" for part in ("Thigh", "Calf", "Foot", "Toe"))),
    "blender": ("root", *(f"{part}.{side}" for side in "LR" for part in ("thigh", "shin", "foot", "toe"))),
    "plain": ("root", *(f"{side}_{part}" for side in ("left", "right") for part in PARTS)),
    "nonsense": ("a", *"bcdefghi"),
}


def skeleton(names: tuple[str, ...], toes: bool = True, turned: float = 0.0) -> Skeleton:
    """A root with two legs."""
    legs = []
    for side in (0.1, -0.1):
        legs += [[side, -0.05, 0.0], [0.0, -0.4, 0.0], [0.0, -0.4, 0.0], [0.0, -0.05, 0.12]]
    offsets = torch.tensor([[0.0, 0.9, 0.0], *legs], dtype=torch.float64)
    parents = (-1, 0, 1, 2, 3, 0, 5, 6, 7)
    keep = [i for i in range(9) if toes or i not in (4, 8)]
    number = {old: new for new, old in enumerate(keep)}
    offsets = offsets @ axis_rotation("Y", torch.tensor(turned, dtype=torch.float64)).T
    return Skeleton(
        tuple(names[i] for i in keep),
        tuple(-1 if parents[i] < 0 else number[parents[i]] for i in keep),
        offsets[keep],
    )


@pytest.mark.parametrize("make", MAKES)
def test_legs_are_found_whatever_they_are_called(make: str) -> None:
    assert find_legs(skeleton(MAKES[make])) == (Leg("left", 1, 2, 3, 4), Leg("right", 5, 6, 7, 8))


@pytest.mark.parametrize("make", MAKES)
def test_they_need_no_toes(make: str) -> None:
    assert find_legs(skeleton(MAKES[make], toes=False)) == (Leg("left", 1, 2, 3, None), Leg("right", 4, 5, 6, None))


def test_a_run_of_our_own_stands_on_the_ends_of_its_shanks() -> None:
    body = stride().skeleton
    legs = find_legs(body)
    assert [(leg.side, body.names[leg.hip], body.names[leg.knee], leg.ankle) for leg in legs] == [
        ("left", "left_hip", "left_knee", None),
        ("right", "right_hip", "right_knee", None),
    ]


@pytest.mark.parametrize(
    "name",
    ["walk", "walk without toes", "walk_straight_cmu_07_01", "walk_straight_snu_30hz", "wander_snu_93s_30hz"],
)
def test_skeletons_of_people(name: str) -> None:
    body = clip_of(name).skeleton
    for leg in find_legs(body):
        names = [body.names[i] for i in (leg.hip, leg.knee, leg.ankle) if i is not None]
        assert names == [f"{leg.side.capitalize()}{part}" for part in ("UpLeg", "Leg", "Foot")]


@pytest.mark.parametrize("turned", [0.0, 1.0, -2.5])
def test_the_rest_pose_faces_across_its_hips(turned: float) -> None:
    body = skeleton(MAKES["plain"], turned=turned)
    assert math.remainder(facing(body, find_legs(body)) - turned, math.tau) == pytest.approx(0.0, abs=1e-9)


def test_a_thing_without_legs_has_none() -> None:
    offsets = torch.tensor([[0.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 1.0, 0.0]], dtype=torch.float64)
    snake = Skeleton(("a", "b", "c"), (-1, 0, 1), offsets)
    assert find_legs(snake) == ()
    assert facing(snake, ()) == 0.0


def test_joints_can_be_named() -> None:
    names = MAKES["nonsense"]
    joints = {
        f"{side}_{part}": names[1 + k]
        for k, (side, part) in enumerate((s, p) for s in ("left", "right") for p in PARTS)
    }
    assert find_legs(skeleton(names), joints) == (Leg("left", 1, 2, 3, 4), Leg("right", 5, 6, 7, 8))
    # What hangs on the knee is the ankle unless another is named.
    short = {role: name for role, name in joints.items() if not role.endswith(("toe", "ankle"))}
    assert find_legs(skeleton(names), short) == (Leg("left", 1, 2, 3, None), Leg("right", 5, 6, 7, None))


def test_every_leg_that_is_found_has_an_end_to_stand_on() -> None:
    """Legs whose knees are the last joints, with and without end sites."""
    body = skeleton(MAKES["plain"])
    kept = (0, 1, 2, 5, 6)
    names = tuple(body.names[i] for i in kept)
    bare = Skeleton(names, (-1, 0, 1, 0, 3), body.offsets[list(kept)])
    assert find_legs(bare) == ()
    joints = {f"{side}_{part}": f"{side}_{part}" for side in ("left", "right") for part in ("hip", "knee")}
    with pytest.raises(HopdiffError, match=r"edit\.joints: nothing hangs on left_knee, 'left_knee', to stand on\."):
        find_legs(bare, joints)
    down = torch.tensor([0.0, -0.4, 0.0], dtype=torch.float64)
    standing = replace(bare, end_sites={"left_knee": down, "right_knee": down})
    assert find_legs(standing) == (Leg("left", 1, 2, None, None), Leg("right", 3, 4, None, None))
    assert find_legs(standing, joints) == find_legs(standing)


@pytest.mark.parametrize(
    ("joints", "said"),
    [
        ({"left_hips": "b"}, "unknown part 'left_hips'; known are left_hip, left_knee"),
        ({"left_hip": "x"}, "edit.joints.left_hip: there is no joint 'x'"),
        ({"left_hip": "b"}, "edit.joints needs left_knee, the name of a joint."),
        ({"left_hip": "c", "left_knee": "b", "right_hip": "f", "right_knee": "g"}, "'b' does not hang on 'c'"),
    ],
)
def test_a_wrong_map_is_told(joints: dict[str, str], said: str) -> None:
    with pytest.raises(HopdiffError) as caught:
        find_legs(skeleton(MAKES["nonsense"]), joints)
    assert said in str(caught.value)


def test_hips_above_each_other_face_nowhere() -> None:
    body = skeleton(MAKES["plain"])
    offsets = body.offsets.clone()
    offsets[[1, 5]] = torch.tensor([[0.0, 0.1, 0.0], [0.0, -0.1, 0.0]], dtype=torch.float64)
    assert facing(replace(body, offsets=offsets), find_legs(body)) == 0.0


@pytest.mark.parametrize(
    ("name", "plain"),
    [
        ("mixamorig:LeftUpLeg", ("left", "upleg")),
        ("RightToeBase", ("right", "toebase")),
        ("Bip01 L Thigh", ("left", "thigh")),
        ("thigh.R", ("right", "thigh")),
        ("leftfoot", ("left", "foot")),
        ("LHipJoint", ("left", "hipjoint")),
        ("RHip", ("right", "hip")),
        ("lHand", ("left", "hand")),
        ("Spine1", (None, "spine")),
        ("root", (None, "root")),
        ("jnt", (None, "jnt")),
    ],
)
def test_names_are_split_into_side_and_part(name: str, plain: tuple[str | None, str]) -> None:
    assert plain_name(name) == plain


def test_of_two_hips_in_a_chain_the_nearer_to_the_knee_counts_and_of_toes_the_first() -> None:
    names = ("Hips", "LHipJoint", "LeftUpLeg", "LeftLeg", "LeftFoot", "LeftToeBase", "LeftToe")
    names = (*names, "RHipJoint", "RightUpLeg", "RightLeg", "RightFoot", "RightToeBase", "RightToe")
    leg = [[0.0, 0.0, 0.0], [0.1, -0.05, 0.0], [0.0, -0.4, 0.0], [0.0, -0.4, 0.0], [0.0, -0.05, 0.1], [0.0, 0.0, 0.1]]
    offsets = torch.tensor([[0.0, 0.9, 0.0], *leg, *leg], dtype=torch.float64)
    offsets[8, 0] = -0.1
    parents = (-1, 0, 1, 2, 3, 4, 5, 0, 7, 8, 9, 10, 11)
    assert find_legs(Skeleton(names, parents, offsets)) == (Leg("left", 2, 3, 4, 5), Leg("right", 8, 9, 10, 11))


def test_shapes_that_do_not_mirror_each_other_are_no_legs() -> None:
    body = skeleton(MAKES["nonsense"])
    assert len(find_legs(body)) == 2
    both_left = body.offsets.clone()
    both_left[5] = both_left[1] + torch.tensor([0.3, 0.0, 0.0])
    assert find_legs(replace(body, offsets=both_left)) == ()
    # Legs that end higher than a quarter of the body below its root are arms, or a tail.
    short = body.offsets.clone()
    short[[2, 3, 4, 6, 7, 8]] *= 0.1
    tall = torch.cat((short, torch.tensor([[0.0, 3.0, 0.0]], dtype=torch.float64)))
    assert find_legs(Skeleton((*body.names, "z"), (*body.parents, 0), tall)) == ()
    # The two longest bones are thigh and shank, below a short hip.
    swapped = replace(body, offsets=body.offsets * torch.tensor([-1.0, 1.0, 1.0], dtype=torch.float64))
    assert find_legs(swapped) == (Leg("left", 5, 6, 7, 8), Leg("right", 1, 2, 3, 4))
