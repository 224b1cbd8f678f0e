from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from hopdiff.geometry.joint_names import side_of
from hopdiff.geometry.skeleton import Skeleton
from hopdiff.plots.joints import Bones, points_of
from hopdiff.types import HopdiffError
from tests.people import clip_of
from tests.plots.conftest import make_skeleton
from tests.plots.walkers import MAKES, sided, skeleton, walker

PAIRS = [("LeftUpLeg", "RightUpLeg"), ("left_hip", "right_hip"), ("lfemur", "rfemur"), ("LHipJoint", "RHipJoint")]
PAIRS += [("lShldr", "rShldr"), ("LThumb", "RThumb"), ("Bip01 L Thigh", "Bip01 R Thigh"), ("thigh.L", "thigh.R")]
PAIRS += [("foot_l", "foot_r"), ("mixamorig:LeftArm", "mixamorig:RightArm"), ("L_Foot", "R_Foot"), ("handL", "handR")]
PAIRS += [("LWrist", "RWrist"), ("Bip01_LCalf", "Bip01_RCalf"), ("lradius", "rradius"), ("LEFT_KNEE", "RIGHT_KNEE")]
MIDDLE = ["Hips", "LowerBack", "L5", "Lumbar", "Root", "root", "lowerback", "Spine1", "Neck", "Head", "thorax", "T12"]
MIDDLE += ["UprightSpine", "Ribs", "mixamorig:Hips", "upperback"]


@pytest.mark.parametrize(("left", "right"), PAIRS)
def test_sides_are_read_from_names(left: str, right: str) -> None:
    assert (side_of(left), side_of(right)) == ("left", "right")


@pytest.mark.parametrize("name", MIDDLE)
def test_names_that_only_look_like_a_side_do_not_count(name: str) -> None:
    assert side_of(name) == "middle"


@pytest.mark.parametrize("make", MAKES)
def test_every_make_has_its_limbs_on_their_sides(make: str) -> None:
    body = skeleton(make)
    sides = dict(zip(body.names, Bones(body).sides, strict=False))
    assert all(sides[name] == "left" for name in sided(make, 0))
    assert all(sides[name] == "right" for name in sided(make, 1))
    assert {name for name, side in sides.items() if side == "middle"} == {"Hips", "Spine", "Chest", "Neck", "Head"}


def test_without_a_hint_in_any_name_the_rest_pose_tells() -> None:
    body = skeleton()
    nameless = Skeleton(
        tuple(f"joint{k}" for k in range(len(body.names))),
        body.parents,
        body.offsets,
        {f"joint{body.index(name)}": end for name, end in body.end_sites.items()},
    )
    assert Bones(nameless).sides == Bones(body).sides


def test_a_joint_without_a_hint_goes_with_the_one_before_it() -> None:
    body = skeleton()
    names = tuple({"LeftLeg": "Knee", "RightLeg": "Knee_2"}.get(name, name) for name in body.names)
    bones = Bones(replace(body, names=names))
    assert bones.sides[names.index("Knee")] == "left"
    assert bones.sides[names.index("Knee_2")] == "right"


@pytest.mark.parametrize(("fingers", "toes"), [(0, True), (5, True), (0, False), (5, False)])
def test_chains_hold_every_bone_once(fingers: int, toes: bool) -> None:
    bones = Bones(skeleton(fingers=fingers, toes=toes))
    drawn = [pair for chain in bones.chains for pair in zip(chain.nodes, chain.nodes[1:], strict=False)]
    assert sorted(drawn) == sorted((bones.parents[node], node) for node in range(1, len(bones.parents)))
    for chain in bones.chains:
        assert {bones.sides[node] for node in chain.nodes[1:]} == {chain.side}
    named = {bones.names[chain.nodes[-1]] for chain in bones.chains if chain.finger}
    assert len(named) == 2 * fingers
    assert all("Finger" in name for name in named)


def test_a_leg_is_one_line_from_the_hips_to_the_tip_of_the_foot() -> None:
    bones = Bones(skeleton())
    ways = [[bones.names[node] for node in chain.nodes] for chain in bones.chains]
    assert ["Hips", "LeftUpLeg", "LeftLeg", "LeftFoot", "LeftToeBase", "LeftToeBase"] in ways
    assert ["Hips", "Spine", "Chest", "Neck", "Head", "Head"] in ways


def test_a_leg_goes_on_along_its_longest_way() -> None:
    body = skeleton()
    pocket = torch.tensor([[0.05, 0.0, 0.05]], dtype=torch.float64)
    offsets = torch.cat((body.offsets, pocket))
    longer = Skeleton((*body.names, "LeftPocket"), (*body.parents, body.index("LeftUpLeg")), offsets, body.end_sites)
    bones = Bones(longer)
    ways = [[bones.names[node] for node in chain.nodes] for chain in bones.chains]
    assert ["LeftUpLeg", "LeftPocket"] in ways
    assert ["Hips", "LeftUpLeg", "LeftLeg", "LeftFoot", "LeftToeBase", "LeftToeBase"] in ways


def test_points_are_joints_and_then_end_sites() -> None:
    clip = walker(skeleton(), bend=1.0)
    points = points_of(clip)
    bones = Bones(clip.skeleton)
    np.testing.assert_allclose(points[:, : len(clip.skeleton.names)], clip.joint_positions())
    for name, track in clip.end_positions().items():
        node = len(clip.skeleton.names) + [*bones.names[len(clip.skeleton.names) :]].index(name)
        np.testing.assert_allclose(points[:, node], track)


def test_points_follow_joints_that_move_against_their_parents() -> None:
    clip = walker(skeleton())
    offsets = clip.skeleton.offsets.repeat(clip.frames, 1, 1)
    offsets[:, clip.skeleton.index("Head"), 1] += torch.linspace(0.0, 0.3, clip.frames, dtype=torch.float64)
    rise = (points_of(replace(clip, offsets=offsets)) - points_of(clip))[:, clip.skeleton.index("Head")]
    np.testing.assert_allclose(rise[:, 1], np.linspace(0.0, 0.3, clip.frames), atol=1e-12)


@pytest.mark.parametrize("make", MAKES)
def test_the_head_ends_where_the_body_does(make: str) -> None:
    clip = walker(skeleton(make))
    bones = Bones(clip.skeleton)
    assert bones.head is not None
    points = points_of(clip)
    centre = bones.head.centre(points, 0.1)
    # The bone of the head is 0.18 m long: a disc of 0.2 m reaches a little beyond its end.
    np.testing.assert_allclose(points[..., 1].max(axis=1) - centre[:, 1], 0.08)


@pytest.mark.parametrize(("bone", "below"), [(0.05, 0.0), (0.15, 0.05), (0.4, 0.1)])
def test_the_longer_its_bone_the_lower_a_head_hangs_from_its_end(bone: float, below: float) -> None:
    body = skeleton()
    body = replace(body, end_sites={**body.end_sites, "Head": torch.tensor([0.0, bone, 0.0], dtype=torch.float64)})
    points = points_of(walker(body))
    head = Bones(body).head
    assert head is not None
    np.testing.assert_allclose(points[:, head.tip, 1] - head.centre(points, 0.1)[:, 1], below, atol=1e-12)


def test_our_own_body_has_its_head_at_the_end_of_the_neck() -> None:
    body = make_skeleton()
    head = Bones(body).head
    assert head is not None
    assert (head.base, head.tip) == (body.index("neck"), len(body.names) + [*body.end_sites].index("neck"))


def test_a_body_without_a_head_gets_none() -> None:
    assert Bones(skeleton(head=False)).head is None


@pytest.mark.parametrize(
    ("name", "tip"),
    [
        ("walk", "Head"),
        ("walk sideways", "Spine1"),
        ("walk_straight_cmu_16_15", "Head"),
        ("wander_snu_93s_30hz", "HEad"),
        ("walk_sideways_snu_cross90", "Spine1"),
    ],
)
def test_heads_of_people(name: str, tip: str) -> None:
    body = clip_of(name).skeleton
    bones = Bones(body)
    assert bones.head is not None
    assert bones.names[bones.head.tip] == tip
    for side in ("Left", "Right"):
        assert all(bones.sides[k] == side.lower() for k, joint in enumerate(bones.names) if side in joint)


@pytest.mark.parametrize(
    ("sides", "message"),
    [(["left"], "each of"), (["up"] * 19, "not 'up'")],
)
def test_sides_that_do_not_fit(sides: list[str], message: str) -> None:
    assert len(skeleton().names) == 19
    with pytest.raises(HopdiffError, match=message):
        Bones(skeleton(), sides)
