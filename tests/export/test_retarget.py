from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
import torch
from torch import Tensor

from hopdiff.export.anatomy import SCHEMES, parts_of
from hopdiff.export.full_body import full_body
from hopdiff.export.pose import with_rest_pose
from hopdiff.export.prepare import with_ground_root
from hopdiff.export.retarget import read_target, retargeted, write_retargeted
from hopdiff.export.take import Take
from hopdiff.feet.contacts import spans
from hopdiff.geometry.clip import Clip
from hopdiff.geometry.rotation import axis_rotation
from hopdiff.geometry.skeleton import Skeleton
from hopdiff.io.bvh import read_bvh, write_bvh
from hopdiff.types import HopdiffError
from tests.export.gltf import Gltf
from tests.export.rigs import armature, glb, skeleton, with_legs, without, write_rest
from tests.export.takes import WALKS, own, walked
from tests.io.bvh_files import simple_positions
from tests.people import file_of
from tests.tasks.writings import below


def of_parts(take: Take) -> dict[str, Tensor]:
    """(T, 3) places of the parts of the body that can be told [m]."""
    places = take.clip.joint_positions()
    return {part: places[:, joint] for part, joint in parts_of(take.clip.skeleton).items()}


def drift(take: Take) -> float:
    """Farthest that a foot gets from where it stands [m]."""
    assert take.contact is not None
    assert take.feet is not None
    found = [0.0]
    for k in range(2):
        for first, last in spans(take.contact[:, k]):
            here = take.feet[first : last + 1, k][:, [0, 2]]
            found.append(float((here - here[0]).norm(dim=-1).max()))
    return max(found)


@pytest.mark.parametrize("rest", ["t", "a", "straight"])
@pytest.mark.parametrize("names", list(SCHEMES))
def test_the_same_body_moves_as_it_did(tmp_path: Path, names: str, rest: str) -> None:
    target = read_target(write_rest(tmp_path / "body.bvh", skeleton(names, rest), 100.0))
    take = retargeted(own(), target)
    assert take.numbers["leg_ratio"] == pytest.approx(1.0, abs=1e-3)
    ours, theirs = of_parts(full_body(own())), of_parts(take)
    assert set(ours) == set(theirs)
    for part, places in ours.items():
        assert float((theirs[part] - places).norm(dim=-1).max()) < 1e-3, part


@pytest.mark.parametrize("factor", [0.6, 1.0, 1.4])
def test_steps_go_with_the_legs_and_feet_stand(tmp_path: Path, factor: float) -> None:
    target = read_target(write_rest(tmp_path / "body.bvh", with_legs(skeleton(), factor)))
    take, source = retargeted(own(), target), own()
    assert take.numbers["leg_ratio"] == pytest.approx(factor, rel=0.01)
    way, before = (one.clip.root_position[-1, 2] - one.clip.root_position[0, 2] for one in (take, source))
    assert float(way / before) == pytest.approx(factor, rel=0.01)
    assert take.clip.duration == pytest.approx(source.clip.duration)
    assert take.numbers["speed"] == pytest.approx(factor * 3.0, rel=0.01)
    assert (take.numbers["beta"], take.numbers["body"]) == (0.2, "body.bvh")
    assert drift(take) < 1e-3
    assert take.feet is not None
    assert take.contact is not None
    assert float(take.feet[take.contact][:, 1].abs().max()) < 1e-3
    assert float(take.clip.joint_positions()[..., 1].min()) > -1e-3
    # It goes on as a loop, with all bones as long as they are.
    assert Take.of_clip("again", take.clip, {}).loop
    places = take.clip.joint_positions()
    for joint, parent in enumerate(take.clip.skeleton.parents):
        if parent >= 0:
            length = (places[:, joint] - places[:, parent]).norm(dim=-1)
            wanted = target.skeleton.offsets[joint].norm().expand_as(length)
            torch.testing.assert_close(length, wanted, atol=1e-6, rtol=0)


def test_knees_bend_forwards_and_it_faces_its_way(tmp_path: Path) -> None:
    """On a body that faces backwards in its rest pose."""
    body = skeleton()
    back = axis_rotation("Y", torch.tensor(torch.pi, dtype=torch.float64))
    ends = {name: back @ end for name, end in body.end_sites.items()}
    turned = replace(body, offsets=(back @ body.offsets.unsqueeze(-1)).squeeze(-1), end_sites=ends)
    take = retargeted(own(), read_target(write_rest(tmp_path / "body.bvh", turned)))
    parts = of_parts(take)
    assert float((parts["left_hip"] - parts["right_hip"])[:, 0].min()) > 0.05
    for side in ("left", "right"):
        hip, knee, ankle = (parts[f"{side}_{part}"] for part in ("hip", "knee", "ankle"))
        # The knee lies ahead of the line from hip to ankle, or on it.
        share = ((hip[:, 1] - knee[:, 1]) / (hip[:, 1] - ankle[:, 1])).unsqueeze(-1)
        bent = (hip - ankle).norm(dim=-1) < 0.95 * ((hip - knee).norm(dim=-1) + (knee - ankle).norm(dim=-1))
        assert bool(bent.any())
        assert float((knee - (hip + share * (ankle - hip)))[bent][:, 2].min()) > 0.0
        assert float((parts[f"{side}_toe"] - ankle)[take.contact[:, int(side == "right")]][:, 2].min()) > 0.0  # type: ignore[index]


@pytest.mark.parametrize("matrix_node", [None, 0, 7])
def test_a_rig_with_frames_of_its_own_gets_the_motion_and_keeps_all_else(
    tmp_path: Path, matrix_node: int | None
) -> None:
    before = armature(skeleton(), matrix_node)
    (tmp_path / "rig.glb").write_bytes(before)
    target = read_target(tmp_path / "rig.glb", "mixamo")
    take = retargeted(own(), target)
    write_retargeted(tmp_path / "out.glb", [take], target)
    file, old = Gltf.of((tmp_path / "out.glb").read_bytes()), Gltf.of(before)
    places = take.clip.joint_positions().numpy()
    for frame in (0, 9, take.frames - 1):
        found = file.places("run", frame * take.clip.frame_time)
        for joint, name in enumerate(take.clip.skeleton.names):
            assert abs(found[name] - places[frame, joint]).max() < 1e-4, name
    for name in ("meshes", "materials", "skins", "scenes", "asset"):
        assert file.content[name] == old.content[name]
    assert file.content["animations"][0] == old.content["animations"][0]
    assert [clip["name"] for clip in file.content["animations"]] == ["idle", "run"]
    assert file.data.startswith(old.data)
    assert file.content["accessors"][: len(old.content["accessors"])] == old.content["accessors"]
    assert all(view.get("byteOffset", 0) % 4 == 0 for view in file.content["bufferViews"])
    # The same motion as on a plain skeleton.
    plain = retargeted(own(), read_target(write_rest(tmp_path / "body.bvh", skeleton())))
    away = (take.clip.joint_positions() - plain.clip.joint_positions()).norm(dim=-1).amax(dim=0)
    for joint, name in enumerate(take.clip.skeleton.names):
        # The rig does not say where its toes end, which the sole is told from.
        assert float(away[joint]) < (0.03 if "Leg" in name or "Foot" in name or "Toe" in name else 1e-4), name
    # Once more: both animations stay.
    again = read_target(tmp_path / "out.glb")
    write_retargeted(tmp_path / "twice.glb", [retargeted(own(), again)], again)
    clips = Gltf.of((tmp_path / "twice.glb").read_bytes()).content["animations"]
    assert [clip["name"] for clip in clips] == ["idle", "run", "run_2"]


def test_a_root_on_the_ground_carries_the_way(tmp_path: Path) -> None:
    """As Unreal Engine's mannequin has it."""
    grounded = with_ground_root(with_rest_pose(full_body(own()), "a"), "root").clip.skeleton
    names = {"root": "root", **SCHEMES["unreal_mannequin"]}
    body = replace(
        grounded,
        names=tuple(names[name] for name in grounded.names),
        end_sites={names[name]: end for name, end in grounded.end_sites.items()},
    )
    (tmp_path / "hero.glb").write_bytes(armature(body))
    target = read_target(tmp_path / "hero.glb", "unreal_mannequin")
    take = retargeted(own(), target)
    write_retargeted(tmp_path / "out.glb", [take], target)
    file, places = Gltf.of((tmp_path / "out.glb").read_bytes()), take.clip.joint_positions().numpy()
    for frame in (0, 13, take.frames - 1):
        found = file.places("run", frame * take.clip.frame_time)
        assert abs(found["root"][1]) < 1e-5
        for joint, name in enumerate(take.clip.skeleton.names):
            assert abs(found[name] - places[frame, joint]).max() < 1e-4, name
    # Evenly ahead, while the pelvis goes up and down.
    steps = take.clip.root_position.diff(dim=0)
    assert float(steps[:, 2].max() - steps[:, 2].min()) < 1e-6
    assert float(take.clip.joint_positions()[:, take.clip.skeleton.index("pelvis"), 1].std()) > 0.005
    theirs = of_parts(full_body(own()))
    for part in ("pelvis", "head", "left_wrist", "right_elbow"):
        there = take.clip.joint_positions()[:, take.clip.skeleton.index(SCHEMES["unreal_mannequin"][part])]
        torch.testing.assert_close(there, theirs[part], atol=1e-3, rtol=0)


@pytest.mark.parametrize("name", WALKS)
def test_skeletons_of_people_in_their_own_files(tmp_path: Path, name: str) -> None:
    path = file_of(name, tmp_path)
    target = read_target(path)
    take = retargeted(own(), target)
    assert drift(take) < 1e-3
    write_retargeted(tmp_path / "out.bvh", [take], target)
    before, after = read_bvh(path), read_bvh(tmp_path / "out.bvh")
    assert after.joints == before.joints
    torch.testing.assert_close(after.clip().joint_positions(), take.clip.joint_positions(), atol=1e-4, rtol=0)


@pytest.mark.parametrize("name", ["walk", "walk_straight_cmu_16_15"])
def test_walks_of_people_on_our_body(tmp_path: Path, name: str) -> None:
    source = walked(name)
    take = retargeted(source, read_target(write_rest(tmp_path / "body.bvh", skeleton())))
    assert take.frames == source.frames
    parts, theirs = of_parts(take), of_parts(source)
    for part in ("left_knee", "right_elbow"):
        ours = (parts[part] - parts["pelvis"])[:, 1] / take.numbers["leg_ratio"]
        correlated = torch.corrcoef(torch.stack((ours, (theirs[part] - theirs["pelvis"])[:, 1])))[0, 1]
        assert float(correlated) > 0.9, part
    assert take.feet is not None
    assert take.contact is not None
    assert float(take.clip.joint_positions()[..., 1].min()) > -0.01


def test_names_from_a_file(tmp_path: Path) -> None:
    body = skeleton("mixamo")
    odd = {name: f"b{k}" for k, name in enumerate(body.names)}
    ends = {odd[name]: end for name, end in body.end_sites.items()}
    path = write_rest(tmp_path / "odd.bvh", replace(body, names=tuple(odd.values()), end_sites=ends))
    lines = [f"{part}: {odd[name]}" for part, name in SCHEMES["mixamo"].items()]
    (tmp_path / "names.yaml").write_text("\n".join(lines))
    take = retargeted(own(), read_target(path, str(tmp_path / "names.yaml")))
    plain = retargeted(own(), read_target(write_rest(tmp_path / "body.bvh", body)))
    torch.testing.assert_close(take.clip.joint_positions(), plain.clip.joint_positions(), atol=1e-9, rtol=0)
    # Without the arms they stay as they are at rest.
    short = [line for line in lines if not any(word in line for word in ("shoulder", "elbow", "wrist", "collar"))]
    (tmp_path / "names.yaml").write_text("\n".join(short))
    stiff = retargeted(own(), read_target(path, str(tmp_path / "names.yaml"))).clip
    arm = stiff.skeleton.index(odd["mixamorig:LeftArm"])
    assert float((stiff.rotations[:, arm] - torch.eye(3).double()).abs().max()) < 1e-9


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("left_hip: nowhere", r"left_hip is 'nowhere', but the skeleton has no such joint"),
        ("left_hip: mixamorig:LeftUpLegs", r"Did you mean 'mixamorig:LeftUpLeg'"),
        ("tail: mixamorig:Hips", r"there is no part 'tail'"),
        ("pelvis: mixamorig:Hips", r"lacks left_hip"),
        ("pelvis: mixamorig:Hips\nleft_hip: mixamorig:Hips", r"'mixamorig:Hips' is given for two parts"),
        ("- a\n- b", r"must hold lines part: joint"),
        ("", r"must hold lines part: joint"),
        ("a: [", r"names.yaml, line 2: not YAML"),
    ],
)
def test_names_that_are_no_parts(tmp_path: Path, text: str, message: str) -> None:
    path = write_rest(tmp_path / "body.bvh", skeleton())
    (tmp_path / "names.yaml").write_text(text + "\n")
    with pytest.raises(HopdiffError, match=message):
        read_target(path, str(tmp_path / "names.yaml"))


def lying(body: Skeleton) -> Skeleton:
    """On its side: one that lies on its back may be a file whose z is up."""
    turn = axis_rotation("Z", torch.tensor(torch.pi / 2.0, dtype=torch.float64))
    ends = {name: turn @ end for name, end in body.end_sites.items()}
    return replace(body, offsets=(turn @ body.offsets.unsqueeze(-1)).squeeze(-1), end_sites=ends)


def test_bodies_that_cannot_be(tmp_path: Path) -> None:
    body = skeleton()
    wrong = {
        "one.bvh": (without(body, "mixamorig:LeftUpLeg"), "one.bvh lacks a left leg"),
        "shank.bvh": (without(body, "mixamorig:RightLeg"), "shank.bvh lacks a pair of legs"),
        "lies.bvh": (lying(body), "lies.bvh: its body does not stand upright"),
    }
    for name, (bones, message) in wrong.items():
        write_rest(tmp_path / name, bones)
        with pytest.raises(HopdiffError, match=message):
            read_target(tmp_path / name)
    path = write_rest(tmp_path / "body.bvh", body)
    for names, message in (("mixammo", "Did you mean 'mixamo'"), ("unreal_mannequin", "no joint 'pelvis'")):
        with pytest.raises(HopdiffError, match=message):
            read_target(path, names)
    with pytest.raises(HopdiffError, match=r"body\.fbx: a skeleton is read from a \.bvh, \.glb or \.vrm file"):
        read_target(tmp_path / "body.fbx")
    (tmp_path / "bare.glb").write_bytes(glb({"asset": {"version": "2.0"}, "nodes": [{"name": "a"}]}))
    with pytest.raises(HopdiffError, match=r"bare\.glb: it has no skin"):
        read_target(tmp_path / "bare.glb")


def test_files_of_the_wrong_kind_are_not_written(tmp_path: Path) -> None:
    target = read_target(write_rest(tmp_path / "body.bvh", skeleton()))
    take = retargeted(own(), target)
    with pytest.raises(HopdiffError, match=r"is written into a \.bvh file"):
        write_retargeted(tmp_path / "out.glb", [take], target)
    with pytest.raises(HopdiffError, match="cannot write"):
        write_retargeted(tmp_path / "nowhere" / "out.bvh", [take], target)
    assert {path.name for path in tmp_path.iterdir()} == {"body.bvh"}


def test_motions_that_stand_still(tmp_path: Path) -> None:
    """A foot that is never lifted, and one frame alone."""
    clip = full_body(own()).clip
    still = Clip(clip.skeleton, clip.root_position[:1].repeat(9, 1), clip.rotations[:1].repeat(9, 1, 1, 1), 0.1)
    target = read_target(write_rest(tmp_path / "body.bvh", with_legs(skeleton(), 0.8)))
    for frames in (1, 9):
        part = replace(still, root_position=still.root_position[:frames], rotations=still.rotations[:frames])
        take = retargeted(Take.of_clip("still", part, {}), target)
        assert take.frames == frames
        places = take.clip.joint_positions()
        assert bool(torch.isfinite(places).all())
        assert float((places - places[0]).abs().max()) < 1e-6


def test_a_body_below_a_root_without_channels_gets_the_motion_on_its_hips(tmp_path: Path) -> None:
    plain = write_rest(tmp_path / "body.bvh", skeleton(), 100.0)
    (tmp_path / "below.bvh").write_text(below(plain.read_text(), ("Armature", "", "")))
    target = read_target(tmp_path / "below.bvh")
    take = retargeted(own(), target)
    write_retargeted(tmp_path / "out.bvh", [take], target)
    names, places, _ = simple_positions((tmp_path / "out.bvh").read_text())
    assert names[:2] == ["Armature", "mixamorig:Hips"]
    known = take.clip.joint_positions()
    order = [take.clip.skeleton.index(name) for name in names[1:]]
    torch.testing.assert_close(torch.from_numpy(places[:, 1:] / 100.0), known[:, order], atol=1e-6, rtol=0)
    assert float((known[-1, 0] - known[0, 0]).norm()) > 0.5


def test_written_and_read_again_in_every_axes(tmp_path: Path) -> None:
    """Unreal's: centimetres, z up."""
    path = write_rest(tmp_path / "body.bvh", skeleton("unreal_mannequin", "a"), 100.0, "z")
    target = read_target(path)
    take = retargeted(own(), target)
    write_retargeted(tmp_path / "out.bvh", [take], target)
    again = read_bvh(tmp_path / "out.bvh").clip()
    torch.testing.assert_close(again.joint_positions(), take.clip.joint_positions(), atol=1e-4, rtol=0)
    write_bvh(tmp_path / "plain.bvh", take.clip)
    assert read_bvh(tmp_path / "plain.bvh").clip().frames == take.frames
