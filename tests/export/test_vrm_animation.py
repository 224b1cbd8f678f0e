"""VRM animations, read by the words of VRMC_vrm_animation 1.0."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from hopdiff.export.full_body import full_body
from hopdiff.export.pose import with_rest_pose
from hopdiff.export.prepare import with_ground_root
from hopdiff.export.settings import ExportSettings
from hopdiff.export.take import Take
from hopdiff.export.vrm_animation import vrma_bytes
from hopdiff.export.write import write_exports
from hopdiff.geometry.clip import Clip
from hopdiff.geometry.rotation import axis_rotation
from hopdiff.types import HopdiffError
from tests.export.gltf import Gltf
from tests.export.rig_families import FAMILIES
from tests.export.takes import own, walked
from tests.export.test_parts_found import made

# Of VRMC_vrm 1.0: a bone, what it must hang on, the nearest of these that is there; and those that must be there.
OVER = {
    "spine": ("hips",),
    "chest": ("spine",),
    "upperChest": ("chest",),
    "neck": ("upperChest", "chest", "spine"),
    "head": ("neck", "upperChest", "chest", "spine"),
}
for _side in ("left", "right"):
    OVER |= {
        f"{_side}Shoulder": ("upperChest", "chest", "spine"),
        f"{_side}UpperArm": (f"{_side}Shoulder", "upperChest", "chest", "spine"),
        f"{_side}LowerArm": (f"{_side}UpperArm",),
        f"{_side}Hand": (f"{_side}LowerArm",),
        f"{_side}UpperLeg": ("hips",),
        f"{_side}LowerLeg": (f"{_side}UpperLeg",),
        f"{_side}Foot": (f"{_side}LowerLeg",),
        f"{_side}Toes": (f"{_side}Foot",),
    }
REQUIRED = {"hips", "spine", "head"} | {
    f"{side}{bone}"
    for side in ("left", "right")
    for bone in ("UpperArm", "LowerArm", "Hand", "UpperLeg", "LowerLeg", "Foot")
}
OURS = {
    "hips": "pelvis",
    "spine": "waist",
    "chest": "chest",
    "upperChest": "upper_chest",
    "neck": "neck",
    "head": "head",
    **{
        f"{side}{bone}": f"{side}_{part}"
        for side in ("left", "right")
        for bone, part in (
            ("Shoulder", "collar"),
            ("UpperArm", "shoulder"),
            ("LowerArm", "elbow"),
            ("Hand", "wrist"),
            ("UpperLeg", "hip"),
            ("LowerLeg", "knee"),
            ("Foot", "ankle"),
            ("Toes", "toe"),
        )
    },
}


PEOPLE = ("walk", "walk_straight_cmu_16_15")


def runner() -> Take:
    return with_rest_pose(full_body(own()), "t")


def turned_at_rest() -> Take:
    """The runner on joints whose frames say that it looks to the side, with its arms down."""
    take = with_rest_pose(full_body(own()), "straight")
    turn, skeleton = axis_rotation("Y", torch.tensor(1.2, dtype=torch.float64)), take.clip.skeleton
    ends = {name: turn @ end for name, end in skeleton.end_sites.items()}
    body = replace(skeleton, offsets=skeleton.offsets @ turn.T, end_sites=ends)
    rotations = turn @ take.clip.rotations @ turn.T
    rotations[:, 0] = take.clip.rotations[:, 0] @ turn.T
    return replace(take, clip=replace(take.clip, skeleton=body, rotations=rotations))


TAKES: dict[str, Any] = {
    "run": runner,
    "looking aside": turned_at_rest,
    "on a root on the ground": lambda: with_ground_root(runner(), "root"),
    **{name: lambda name=name: walked(name) for name in PEOPLE},
}


def bones(file: Gltf) -> dict[str, int]:
    return {bone: entry["node"] for bone, entry in extension(file)["humanoid"]["humanBones"].items()}


def extension(file: Gltf) -> dict[str, Any]:
    found: dict[str, Any] = file.content["extensions"]["VRMC_vrm_animation"]
    return found


def parents(file: Gltf) -> dict[int, int]:
    return {child: k for k, node in enumerate(file.content["nodes"]) for child in node.get("children", ())}


def standing(file: Gltf) -> dict[str, np.ndarray]:
    """Places of the bones at rest."""
    over, found = parents(file), dict[str, Any]()
    for bone, node in bones(file).items():
        place = np.zeros(3)
        while node is not None:
            entry = file.content["nodes"][node]
            assert not {"rotation", "scale", "matrix"} & set(entry)
            place = place + np.array(entry["translation"])
            node = over.get(node)  # type: ignore[assignment]
        found[bone] = place
    return found


@pytest.mark.parametrize("name", TAKES)
def test_the_file_is_a_vrm_animation(name: str) -> None:
    take = TAKES[name]()
    file = Gltf.of(vrma_bytes(take))
    content, map_ = file.content, bones(file)
    assert extension(file)["specVersion"] == "1.0"
    assert content["extensionsUsed"] == ["VRMC_vrm_animation"]
    assert not {"meshes", "skins", "materials"} & set(content)
    assert set(map_) >= REQUIRED
    assert set(map_) <= set(OURS)
    assert len(set(map_.values())) == len(map_)
    assert "chest" in map_ or "upperChest" not in map_
    over = parents(file)
    for bone, node in map_.items():
        # What a bone hangs on, through whatever lies between.
        above = [over[node]] if node in over else []
        while above and above[-1] in over:
            above.append(over[above[-1]])
        wanted = next((map_[one] for one in OVER.get(bone, ()) if one in map_), None)
        assert next((one for one in above if one in map_.values()), None) == wanted
    (animation,) = content["animations"]
    assert animation["name"] == take.name
    moved = [(channel["target"]["node"], channel["target"]["path"]) for channel in animation["channels"]]
    assert len(set(moved)) == len(moved)
    assert {path for _, path in moved} == {"rotation", "translation"}
    assert [node for node, path in moved if path == "translation"] == [map_["hips"]]
    assert {node for node, _ in moved} == set(map_.values())


@pytest.mark.parametrize("name", TAKES)
def test_it_stands_in_t_pose_facing_ahead(name: str) -> None:
    places = standing(Gltf.of(vrma_bytes(TAKES[name]())))
    for side, sign in (("left", 1.0), ("right", -1.0)):
        for upper, lower, wanted in (
            ("UpperArm", "LowerArm", (sign, 0, 0)),
            ("LowerArm", "Hand", (sign, 0, 0)),
            ("UpperLeg", "LowerLeg", (0, -1, 0)),
            ("LowerLeg", "Foot", (0, -1, 0)),
        ):
            way = places[f"{side}{lower}"] - places[f"{side}{upper}"]
            np.testing.assert_allclose(way / np.linalg.norm(way), wanted, atol=1e-5)
        if f"{side}Toes" in places:
            ahead = places[f"{side}Toes"] - places[f"{side}Foot"]
            assert ahead[2] > 0.0
            assert abs(ahead[0]) < 1e-5
    assert min(place[1] for place in places.values()) >= -1e-5
    assert min(place[1] for place in places.values()) < 0.1
    assert places["head"][1] > places["hips"][1] + 0.3
    across = places["leftUpperLeg"] - places["rightUpperLeg"]
    np.testing.assert_allclose(across / np.linalg.norm(across), (1, 0, 0), atol=0.05)


@pytest.mark.parametrize("name", ["run", "looking aside", "on a root on the ground"])
def test_bones_are_where_the_runner_has_its_joints(name: str) -> None:
    """Whatever the frames of its joints are at rest."""
    take, given = runner(), TAKES[name]()
    file = Gltf.of(vrma_bytes(given))
    places = take.clip.joint_positions().numpy()
    for frame in (0, take.frames // 3, take.frames - 1):
        found = file.places(given.name, frame * take.clip.frame_time)
        for bone, part in OURS.items():
            wanted = places[frame, take.clip.skeleton.index(part)]
            np.testing.assert_allclose(found[bone], wanted, atol=2e-4)


@pytest.mark.parametrize("name", PEOPLE)
def test_limbs_of_people_point_where_they_did(name: str) -> None:
    take = walked(name)
    file = Gltf.of(vrma_bytes(take))
    places, names = take.clip.joint_positions().numpy(), take.clip.skeleton.names
    frame = take.frames // 2
    found = file.places(take.name, frame * take.clip.frame_time)
    np.testing.assert_allclose(found["hips"], places[frame, 0], atol=1e-4)
    for side in ("left", "right"):
        word = side.capitalize()
        for one, other, upper, lower in (
            ("UpLeg", "Leg", "UpperLeg", "LowerLeg"),
            ("Leg", "Foot", "LowerLeg", "Foot"),
            ("Arm", "ForeArm", "UpperArm", "LowerArm"),
            ("ForeArm", "Hand", "LowerArm", "Hand"),
        ):
            wanted = places[frame, names.index(word + other)] - places[frame, names.index(word + one)]
            way = found[side + lower] - found[side + upper]
            np.testing.assert_allclose(way, wanted, atol=1e-4)


def test_joints_between_bones_count_for_those_below() -> None:
    """A spine of five, of which three are bones, that bends in all of them."""
    body = made(FAMILIES["unreal_5"])
    rotations = torch.eye(3, dtype=torch.float64).repeat(2, len(body.names), 1, 1)
    bend = axis_rotation("X", torch.tensor(0.2, dtype=torch.float64))
    for joint in ("spine_01", "spine_02", "spine_03", "spine_04", "spine_05"):
        rotations[1, body.index(joint)] = bend
    clip = Clip(body, body.offsets[:1].repeat(2, 1), rotations, 0.1)
    take = Take.of_clip("bend", clip, {})
    found = Gltf.of(vrma_bytes(take)).places("bend", 0.1)
    wanted = clip.joint_positions()[1]
    way = found["head"] - found["neck"]
    np.testing.assert_allclose(way, (wanted[body.index("head")] - wanted[body.index("neck_01")]).numpy(), atol=1e-5)


def without_joint(joint: str) -> Take:
    """The walk without a joint that nothing hangs on."""
    take = walked("walk")
    kept = [k for k, name in enumerate(take.clip.skeleton.names) if name != joint]
    body = take.clip.skeleton
    skeleton = replace(
        body,
        names=tuple(body.names[k] for k in kept),
        parents=tuple(kept.index(body.parents[k]) if body.parents[k] >= 0 else -1 for k in kept),
        offsets=body.offsets[kept],
        end_sites={name: end for name, end in body.end_sites.items() if name != joint},
    )
    return replace(take, clip=replace(take.clip, skeleton=skeleton, rotations=take.clip.rotations[:, kept]))


@pytest.mark.parametrize(
    ("take", "said"),
    [
        (own, "run: a VRM animation needs the bone 'head', and no joint of this body is known to be its head"),
        (lambda: walked("walk without toes"), "needs the bone 'head'"),
        (lambda: without_joint("LeftHand"), "needs the bone 'leftHand'.*its left wrist"),
    ],
)
def test_a_bone_that_vrm_asks_for_and_is_missing_is_told(take: Any, said: str) -> None:
    with pytest.raises(HopdiffError, match=said):
        vrma_bytes(take())


def test_toes_may_be_missing() -> None:
    map_ = bones(Gltf.of(vrma_bytes(without_joint("LeftToeBase"))))
    assert "leftToes" not in map_
    assert "rightToes" in map_


def test_every_motion_has_a_file_of_its_own(tmp_path: Path) -> None:
    takes = [full_body(own()), replace(full_body(own()), name="again")]
    written = write_exports(takes, {"vrma": ExportSettings("vrma", "motion.vrma", rest="t")}, tmp_path)
    assert len(written) == 2
    for path, output in written:
        assert path.suffix == ".vrma"
        (animation,) = Gltf.of(path.read_bytes()).content["animations"]
        assert animation["name"] == output.takes[0].name
