"""The body: what a settings file may hold, and what becomes of it."""

from __future__ import annotations

import math
from typing import Any

import pytest
import torch
from omegaconf import OmegaConf

from hopdiff.character import REQUIRED_PARENTS, Character
from hopdiff.types import HopdiffError
from tests.builders import make_character, settings_of

BODIES = ("human", "child", "cartoon")


def build(plain: dict[str, Any]) -> Character:
    return Character.build(OmegaConf.create(plain))


@pytest.fixture
def plain() -> dict[str, Any]:
    return settings_of("character", "human")


def put(plain: dict[str, Any], path: str, value: Any) -> None:
    *folders, last = path.split(".")
    for name in folders:
        plain = plain[name]
    plain[last] = value


@pytest.mark.parametrize(
    ("path", "value", "said"),
    [
        ("height", -1.0, "height must be a positive number"),
        ("height", math.nan, "height must be a positive number"),
        ("mass", 0.0, "mass must be a positive number"),
        ("shoe", -0.01, "shoe must lie between 0 and 0.1 body heights"),
        ("shoe", math.nan, "shoe must lie between 0 and 0.1 body heights"),
        ("shoe", 0.2, "shoe must lie between 0 and 0.1 body heights"),
        ("mass", math.inf, "mass must be a positive number"),
        ("joints.neck.segment.mass", -0.1, "mass of 'neck'"),
        ("joints.neck.segment.mass", math.nan, "mass of 'neck'"),
        ("joints.neck.segment.mass", 0.5, "must add up to 1"),
        ("joints.waist.parent", "neck", "cycle"),
        ("joints.waist.parent", None, "second root"),
        ("joints.waist.parent", "tail", "'tail' of joint 'waist' is missing"),
        ("joints.left_knee.parent", "right_hip", "'left_knee' must have the parent 'left_hip'"),
        ("joints.left_knee.offset", [0.0, math.nan, 0.0], "left_knee.offset must be three finite numbers"),
        ("joints.left_knee.offset", [0.0, 1.0], "left_knee.offset must be three finite numbers"),
        ("joints.left_knee.offset", [0.0, -0.2, 0.0], "left_knee and right_knee must mirror"),
        ("joints.left_knee.segment.com", [0.0, math.inf, 0.0], "left_knee.segment.com"),
        ("joints.left_knee.segment.gyration", [0.1], "left_knee.segment.gyration"),
        ("joints.left_knee.end", None, "'left_knee' has no children and needs an `end`"),
        ("joints.left_knee.end", [0.0, 0.0, 0.0], "shank"),
        ("joints.left_hip.offset", [-0.05, 0.0, 0.0], "must point to the left"),
        ("joint_limits_deg.knee", [150.0, 0.0], "joint_limits_deg.knee must be"),
        ("joint_limits_deg.knee", [150.0], "joint_limits_deg.knee must be"),
        ("height", 1e300, "height and mass must not be above 100 m and 1e+06 kg"),
        ("mass", 1e300, "height and mass must not be above"),
    ],
)
def test_one_sentence_names_what_is_wrong(plain: dict[str, Any], path: str, value: Any, said: str) -> None:
    put(plain, path, value)
    with pytest.raises(HopdiffError) as caught:
        build(plain)
    assert said in str(caught.value)
    assert "'human'" in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("joint", [name for name in REQUIRED_PARENTS if name != "pelvis"])
def test_a_missing_joint_is_named(plain: dict[str, Any], joint: str) -> None:
    del plain["joints"][joint]
    with pytest.raises(HopdiffError, match=f"'{joint}'.* is missing"):
        build(plain)


def test_an_unknown_joint_is_named(plain: dict[str, Any]) -> None:
    plain["joints"]["tail"] = {**plain["joints"]["neck"], "parent": "pelvis"}
    with pytest.raises(HopdiffError, match="unknown joint 'tail'"):
        build(plain)


def test_missing_limits_are_named(plain: dict[str, Any]) -> None:
    del plain["joint_limits_deg"]["elbow"]
    with pytest.raises(HopdiffError, match="lacks 'elbow'"):
        build(plain)


@pytest.mark.parametrize("name", BODIES)
def test_a_body_stands_on_the_ground_and_ends_at_its_height(name: str) -> None:
    body = make_character(name)
    straight = torch.eye(3, dtype=torch.float64).expand(11, 3, 3)
    positions, orientations = body.skeleton.forward(body.skeleton.offsets[0], straight)
    ends = body.skeleton.end_positions(positions, orientations)
    for side in ("left", "right"):
        assert float(ends[f"{side}_knee"][1]) == pytest.approx(0.0, abs=1e-9)
        assert 0.0 < float(ends[f"{side}_elbow"][1]) < float(positions[0, 1]) + 0.1
    assert float(ends["neck"][1]) == pytest.approx(body.height, abs=1e-9)
    assert float(body.masses.sum()) == pytest.approx(body.mass)
    centre = body.centre_of_mass(positions, orientations)
    assert float(centre[0]) == pytest.approx(0.0, abs=1e-12)
    assert 0.45 < float(centre[1]) / body.height < 0.65


def test_height_and_mass_scale_with_one_number_each(plain: dict[str, Any]) -> None:
    small = build(plain)
    tall = build({**plain, "height": 2.0 * plain["height"], "mass": 3.0 * plain["mass"]})
    assert tall.leg_length == pytest.approx(2.0 * small.leg_length)
    assert torch.allclose(tall.skeleton.offsets, 2.0 * small.skeleton.offsets)
    assert torch.allclose(tall.masses, 3.0 * small.masses)
    assert torch.allclose(tall.inertias, 12.0 * small.inertias)


def test_inertia_of_what_hangs_on_a_joint(plain: dict[str, Any]) -> None:
    body = build(plain)
    shank = plain["joints"]["left_knee"]
    own = shank["segment"]["mass"] / sum(j["segment"]["mass"] for j in plain["joints"].values()) * plain["mass"]
    x, y, z = (c * plain["height"] for c in shank["segment"]["com"])
    gyration = [g * plain["height"] for g in shank["segment"]["gyration"]]
    wanted = [own * (gyration[0] ** 2 + y * y + z * z), own * (gyration[1] ** 2 + x * x + z * z)]
    found = body.inertias[body.skeleton.index("left_knee")]
    assert found[:2].tolist() == pytest.approx(wanted)
    # The whole body about the pelvis: more than any limb, and the same from both sides.
    index = body.skeleton.index
    assert (body.inertias[0] > body.inertias[1:].amax(0)).all()
    assert torch.allclose(body.inertias[index("left_hip")], body.inertias[index("right_hip")])


def channels_of(**given: float) -> dict[str, torch.Tensor]:
    names = [
        "pelvis_tilt",
        "pelvis_roll",
        "pelvis_yaw",
        "trunk_lean",
        "trunk_side",
        "trunk_yaw",
        "neck_flex",
        "neck_side",
    ]
    for side in ("left", "right"):
        names += [f"{side}_{c}" for c in ("thigh", "tilt", "knee", "shoulder", "abduction", "inward", "elbow")]
    assert set(given) <= set(names)
    return {name: torch.tensor(given.get(name, 0.0), dtype=torch.float64) for name in names}


@pytest.mark.parametrize(
    ("channel", "point", "axis", "sign"),
    [
        ("pelvis_tilt", "waist", 2, 1),
        ("pelvis_roll", "waist", 0, -1),
        ("pelvis_yaw", "left_hip", 2, -1),
        ("trunk_lean", "neck", 2, 1),
        ("trunk_side", "neck", 0, -1),
        ("trunk_yaw", "left_shoulder", 2, -1),
        ("neck_flex", "head", 2, 1),
        ("neck_side", "head", 0, -1),
        ("left_thigh", "left_knee", 2, 1),
        ("right_thigh", "right_knee", 2, 1),
        ("left_tilt", "left_foot", 0, 1),
        ("right_tilt", "right_foot", 0, 1),
        ("left_knee", "left_foot", 2, -1),
        ("left_shoulder", "left_elbow", 2, 1),
        ("left_abduction", "left_elbow", 0, 1),
        ("right_abduction", "right_elbow", 0, -1),
        ("left_elbow", "left_hand", 2, 1),
    ],
)
def test_channels_turn_the_body_the_way_their_names_say(channel: str, point: str, axis: int, sign: int) -> None:
    body = make_character()

    def place(**given: float) -> torch.Tensor:
        skeleton = body.skeleton
        positions, orientations = skeleton.forward(torch.zeros(3).double(), body.rotations(channels_of(**given)))
        ends = skeleton.end_positions(positions, orientations)
        named = {"head": "neck", "left_foot": "left_knee", "right_foot": "right_knee", "left_hand": "left_elbow"}
        return ends[named[point]] if point in named else positions[skeleton.index(point)]

    moved = place(**{channel: 0.2}) - place()
    assert float(moved[axis]) * sign > 0.005


def test_inward_turn_brings_the_forearm_to_the_inside() -> None:
    body = make_character()

    def hands(inward: float) -> dict[str, torch.Tensor]:
        bent = channels_of(left_elbow=1.5, right_elbow=1.5, left_inward=inward, right_inward=inward)
        return body.skeleton.end_positions(*body.skeleton.forward(torch.zeros(3).double(), body.rotations(bent)))

    assert hands(0.5)["left_elbow"][0] < hands(0.0)["left_elbow"][0] - 0.05
    assert hands(0.5)["right_elbow"][0] > hands(0.0)["right_elbow"][0] + 0.05


def test_thigh_and_trunk_attitudes_do_not_depend_on_the_pelvis() -> None:
    body = make_character()
    index = body.skeleton.index

    def orientations(**pelvis: float) -> torch.Tensor:
        channels = channels_of(trunk_lean=0.2, trunk_yaw=0.1, left_thigh=0.4, left_tilt=0.05, **pelvis)
        return body.skeleton.forward(torch.zeros(3).double(), body.rotations(channels))[1]

    level, tipped = orientations(), orientations(pelvis_tilt=0.2, pelvis_roll=0.1, pelvis_yaw=-0.1)
    for joint in ("waist", "left_hip"):
        assert torch.allclose(level[index(joint)], tipped[index(joint)], atol=1e-12)
    assert not torch.allclose(level[0], tipped[0], atol=1e-3)
