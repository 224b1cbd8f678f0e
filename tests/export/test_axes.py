"""Frames of joints: the same motion whatever they are, and those of Mixamo and of Unreal Engine's mannequin."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from hopdiff.export.anatomy import renamed
from hopdiff.export.axes import AXES, joint_axes
from hopdiff.export.full_body import full_body
from hopdiff.export.glb import glb_bytes
from hopdiff.export.pose import with_rest_pose
from hopdiff.export.prepare import with_ground_root
from hopdiff.export.settings import ExportSettings
from hopdiff.export.take import Take
from hopdiff.geometry.skeleton import Skeleton
from hopdiff.types import HopdiffError
from hopdiff.whole_body.skeleton import JOINTS
from tests.export.gltf import Gltf
from tests.export.takes import own, walked


def body(rest: str = "t") -> Take:
    return with_rest_pose(full_body(own()), rest)


def moving() -> Take:
    """Bones that stretch, below a root on the ground."""
    take = with_ground_root(body(), "root")
    assert take.clip.offsets is not None
    swing = 1.0 + 0.05 * torch.sin(torch.arange(take.frames).double())[:, None, None]
    offsets = torch.cat((take.clip.offsets[:, :2], swing * take.clip.offsets[:, 2:]), dim=1)
    return replace(take, clip=replace(take.clip, offsets=offsets))


@pytest.mark.parametrize("swapped", [True, False])
@pytest.mark.parametrize("axes", [name for name in AXES if name != "world"])
@pytest.mark.parametrize("which", ["full", "a", "moving", "captured"])
def test_bodies_move_alike_whatever_their_axes(which: str, axes: str, swapped: bool) -> None:
    take = {"full": body, "a": lambda: body("a"), "moving": moving, "captured": walked}[which]()
    plain, turned = (Gltf.of(glb_bytes([take], one, swapped)) for one in ("world", axes))
    rest = [[node.get("rotation") for node in file.content["nodes"]] for file in (plain, turned)]
    assert rest[0] != rest[1]
    for time in (0.0, 0.37 * take.clip.duration, take.clip.duration):
        before, after = plain.frames(take.name, time), turned.frames(take.name, time)
        own_frames = joint_axes(take.clip.skeleton, axes, swapped)
        for joint, name in enumerate(take.clip.skeleton.names):
            np.testing.assert_allclose(after[name][0], before[name][0], atol=1e-5)
            # The frames themselves have turned with the body.
            wanted = before[name][1] * Rotation.from_matrix(own_frames[joint].numpy())
            assert (wanted.inv() * after[name][1]).magnitude() < 1e-4
        np.testing.assert_allclose(turned.skinned(take.name, time), plain.skinned(take.name, time), atol=2e-5)


@pytest.mark.parametrize("axes", AXES)
@pytest.mark.parametrize("rest", ["t", "a", "straight"])
def test_frames_turn_and_nothing_else(rest: str, axes: str) -> None:
    for swapped in (True, False):
        frames = joint_axes(body(rest).clip.skeleton, axes, swapped)
        eye = torch.eye(3, dtype=torch.float64).expand_as(frames)
        torch.testing.assert_close(frames @ frames.transpose(-1, -2), eye, atol=1e-12, rtol=0)
        assert float((torch.linalg.det(frames) - 1.0).abs().max()) < 1e-12


@pytest.mark.parametrize("axes", ["bone", "mixamo"])
def test_y_leads_along_every_bone_to_the_next_joint(axes: str) -> None:
    skeleton = body().clip.skeleton
    frames = joint_axes(skeleton, axes)
    for joint, name in enumerate(JOINTS):
        ends = [skeleton.offsets[child] for child in skeleton.children(joint)] or [skeleton.end_sites[name]]
        # Of several that hang on a joint the spine goes on.
        off = [float(frames[joint, :, 1] @ end / end.norm()) for end in ends]
        assert max(off) > 1.0 - 1e-12, name


def of_bones(bones: dict[str, tuple[float, float, float]]) -> Skeleton:
    """Our own joints where each one's bone has a direction; others hang straight below."""
    take = body("straight").clip.skeleton
    offsets, ends = take.offsets.clone(), dict(take.end_sites)
    for part, line in bones.items():
        joint = JOINTS.index(part)
        wanted = torch.tensor(line, dtype=torch.float64)
        children = take.children(joint)
        if not children:
            ends[part] = wanted
        for child in children:
            # Where several go on from a joint it is the spine that has the direction.
            if len(children) == 1 or JOINTS[child] in ("waist", "neck"):
                offsets[child] = wanted
    return Skeleton(take.names, take.parents, offsets, ends)


# The bind pose of three.js's Xbot.glb, a character of Mixamo's: a bone's direction, and x and y of its joint.
XBOT = {
    "pelvis": ((0.0, 1.0, 0.013), (1.0, 0.0, 0.0), (0.0, 1.0, 0.013)),
    "waist": ((0.0, 0.989, -0.147), (1.0, 0.0, 0.0), (0.0, 0.989, -0.147)),
    "right_collar": ((-0.977, -0.048, -0.206), (-0.206, -0.010, 0.979), (-0.977, -0.048, -0.206)),
    "right_shoulder": ((-1.0, 0.0, 0.0), (0.0, 0.0, 1.0), (-1.0, 0.0, 0.0)),
    "left_elbow": ((1.0, 0.0, 0.0), (0.0, 0.0, -1.0), (1.0, 0.0, 0.0)),
    "left_wrist": ((1.0, 0.0, 0.0), (0.0, 0.0, -1.0), (1.0, 0.0, 0.0)),
    "left_hip": ((0.0, -1.0, 0.009), (-1.0, 0.0, 0.0), (0.0, -1.0, 0.009)),
    "right_knee": ((0.0, -0.998, -0.070), (-1.0, 0.0, 0.0), (0.0, -0.998, -0.070)),
    "left_ankle": ((0.0, -0.632, 0.775), (-1.0, 0.0, 0.0), (0.0, -0.632, 0.775)),
    "right_toe": ((0.0, 0.0, 1.0), (-1.0, 0.0, 0.0), (0.0, 0.0, 1.0)),
}
# The bind pose of Epic's SK_Mannequin.FBX (x to its left, y up, z ahead): the same.
MANNEQUIN = {
    "waist": ((0.0, 0.992, 0.128), (0.0, 0.992, 0.128), (0.0, 0.128, -0.992)),
    "chest": ((0.0, 0.993, -0.117), (0.0, 0.993, -0.117), (0.0, -0.117, -0.993)),
    "left_collar": ((0.882, -0.169, -0.440), (0.882, -0.169, -0.440), (-0.447, 0.0, -0.895)),
    "left_shoulder": ((0.645, -0.761, -0.072), (0.645, -0.761, -0.072), (-0.068, 0.037, -0.997)),
    "right_shoulder": ((-0.645, -0.761, -0.072), (0.645, 0.761, 0.072), (-0.068, -0.037, 0.997)),
    "right_elbow": ((-0.718, -0.547, 0.429), (0.718, 0.547, -0.429), (0.226, 0.400, 0.888)),
    "left_wrist": ((0.687, -0.576, 0.442), (0.687, -0.576, 0.442), (-0.614, -0.786, -0.069)),
    "left_hip": ((0.122, -0.992, -0.030), (-0.122, 0.992, 0.030), (-0.148, 0.012, -0.989)),
    "right_knee": ((-0.071, -0.985, -0.156), (-0.071, -0.985, -0.156), (-0.064, -0.152, 0.986)),
    "left_ankle": ((0.046, -0.5, 0.8), (-0.015, 1.000, 0.013), (-0.046, 0.012, -0.999)),
    "left_toe": ((0.046, -0.045, 0.998), (0.046, -0.045, 0.998), (-0.013, 0.999, 0.046)),
    "right_toe": ((-0.046, -0.045, 0.998), (0.046, 0.045, -0.998), (-0.013, -0.999, -0.046)),
}


@pytest.mark.parametrize(("axes", "joints", "bound"), [("mixamo", XBOT, 1.5), ("unreal", MANNEQUIN, 11.0)])
def test_frames_are_those_of_the_programs_own_skeletons(
    axes: str, joints: dict[str, tuple[tuple[float, float, float], ...]], bound: float
) -> None:
    """The mannequin's elbows are bent in its bind pose, and turned by 10 degrees about the bone for it."""
    skeleton = of_bones({part: bone for part, (bone, _, _) in joints.items()})
    frames = joint_axes(skeleton, axes).numpy()
    for part, (_, x, y) in joints.items():
        for axis, wanted in zip(frames[JOINTS.index(part)].T[:2], (x, y), strict=True):
            off = np.degrees(np.arccos(np.clip(axis @ wanted / np.linalg.norm(wanted), -1.0, 1.0)))
            assert off < bound, (part, axis, wanted)


def test_unreal_gets_the_same_frames_from_glb_and_from_fbx() -> None:
    """Its glTF importer swaps y and z of places, and of turns (-x, -z, -y, w); that of FBX stands the scene up and then
    turns y round, of places and of axes."""
    skeleton = renamed(with_ground_root(body("a"), "root").clip.skeleton, "unreal_mannequin")
    glb, fbx = (joint_axes(skeleton, "unreal", swapped) for swapped in (True, False))
    for joint, name in enumerate(skeleton.names):
        x, y, z, w = Rotation.from_matrix(glb[joint].numpy()).as_quat()
        of_glb = Rotation.from_quat((-x, -z, -y, w)).as_matrix()
        turned = fbx[joint].numpy()[[0, 2, 1]] * np.array([[1.0], [-1.0], [1.0]])  # z up
        of_fbx = np.diag((1.0, -1.0, 1.0)) @ turned @ np.diag((1.0, -1.0, 1.0))
        np.testing.assert_allclose(of_glb, of_fbx, atol=1e-12, err_msg=name)
    # The root on the ground is not turned there at all.
    np.testing.assert_allclose(glb[0].numpy(), np.eye(3), atol=1e-12)


def test_files_without_frames_of_their_own_refuse_them() -> None:
    for kind, suffix in (("bvh", r"\.bvh"), ("html", r"\.html"), ("csv", r"\.csv")):
        with pytest.raises(HopdiffError, match=rf"exports.a.axes=bone cannot be had in {suffix} files"):
            ExportSettings(kind, axes="bone").check("a")
    with pytest.raises(HopdiffError, match=r"Unknown exports\.a\.axes 'bones'"):
        ExportSettings("glb", axes="bones").check("a")
