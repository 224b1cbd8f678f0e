from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from hopdiff.export.full_body import full_body
from hopdiff.export.glb import glb_bytes, write_glb
from hopdiff.export.prepare import in_place, with_ground_root
from hopdiff.export.take import Take
from hopdiff.types import HopdiffError
from hopdiff.whole_body.skeleton import JOINTS
from tests.export.gltf import Gltf
from tests.export.takes import WALKS, own, walked


def body() -> Take:
    return full_body(own())


@pytest.mark.parametrize("which", ["eleven", "full", "ground", "moving", *WALKS])
def test_joints_are_where_they_are(which: str) -> None:
    take = {
        "eleven": own,
        "full": body,
        "ground": lambda: with_ground_root(body(), "root"),
        "moving": lambda: stretched(own()),
    }.get(which, lambda: walked(which))()
    file = Gltf.of(glb_bytes([take]))
    places = take.clip.joint_positions().numpy()
    for frame in {0, take.frames // 3, take.frames - 1}:
        found = file.places(take.name, frame * take.clip.frame_time)
        assert set(found) == set(take.clip.skeleton.names)
        for joint, name in enumerate(take.clip.skeleton.names):
            np.testing.assert_allclose(found[name], places[frame, joint], atol=2e-5)


def stretched(take: Take) -> Take:
    swing = 0.05 * torch.sin(torch.arange(take.frames).double())[:, None, None]
    return replace(take, clip=replace(take.clip, offsets=take.clip.skeleton.offsets * (1.0 + swing)))


def test_engines_see_every_joint_and_a_body_that_follows_it() -> None:
    take = body()
    file = Gltf.of(glb_bytes([take]))
    skin = file.content["skins"][0]
    names = [file.content["nodes"][node]["name"] for node in skin["joints"]]
    assert tuple(names) == JOINTS
    # The inverse of what takes a joint's frame to its place in the rest pose.
    inverse = file.values(skin["inverseBindMatrices"]).reshape(-1, 4, 4)
    standing = take.clip.skeleton.offsets.clone()
    standing[0] = torch.tensor(file.content["nodes"][0]["translation"]).double()
    straight = torch.eye(3, dtype=torch.float64).expand(1, 22, 3, 3)
    rest = take.clip.skeleton.forward(standing[:1], straight)[0][0].numpy()
    np.testing.assert_allclose(inverse[:, 3, :3], -rest, atol=1e-6)
    lowest, highest, used = np.inf, -np.inf, set()
    for primitive in file.content["meshes"][0]["primitives"]:
        points = file.values(primitive["attributes"]["POSITION"])
        joints, weights = (file.values(primitive["attributes"][name]) for name in ("JOINTS_0", "WEIGHTS_0"))
        normals, faces = file.values(primitive["attributes"]["NORMAL"]), file.values(primitive["indices"])
        assert faces.max() == len(points) - 1
        np.testing.assert_allclose(weights.sum(axis=-1), 1.0, atol=1e-6)
        np.testing.assert_allclose(np.linalg.norm(normals, axis=-1), 1.0, atol=1e-5)
        lowest, highest = min(lowest, points[:, 1].min()), max(highest, points[:, 1].max())
        used |= set(joints[weights > 0.3].tolist())
    assert lowest == pytest.approx(0.0, abs=0.01)
    assert highest == pytest.approx(1.75, abs=0.03)
    moving = {JOINTS.index(name) for name in JOINTS if "collar" not in name}
    assert moving - used <= {JOINTS.index("upper_chest"), JOINTS.index("neck")}


def test_quaternions_stay_in_one_hemisphere() -> None:
    file = Gltf.of(glb_bytes([body().repeated(3)]))
    for sampler in file.content["animations"][0]["samplers"]:
        values = file.values(sampler["output"])
        if values.shape[-1] == 4:
            assert bool(((values[1:] * values[:-1]).sum(axis=-1) > 0.0).all())


def test_the_loop_closes() -> None:
    take = body()
    file = Gltf.of(glb_bytes([take]))
    animation = file.content["animations"][0]
    travel = np.array(animation["extras"]["travel_m"])
    assert animation["extras"]["loop"] is True
    assert travel[2] == pytest.approx(3.0 * take.clip.duration, rel=1e-3)
    for channel in animation["channels"]:
        values = file.values(animation["samplers"][channel["sampler"]]["output"]).astype(float)
        shift = travel if channel["target"]["path"] == "translation" else 0.0
        np.testing.assert_allclose(values[-1] - shift, values[0], atol=1e-5)


def test_several_motions_of_one_body_share_it_and_others_have_their_own() -> None:
    first = body()
    second = replace(in_place(first), name="on the spot")
    tall = first.clip.skeleton
    other = replace(first, name="tall", clip=replace(first.clip, skeleton=replace(tall, offsets=1.2 * tall.offsets)))
    file = Gltf.of(glb_bytes([first, second, other]))
    assert [one["name"] for one in file.content["animations"]] == ["run", "on the spot", "tall"]
    assert len(file.content["skins"]) == 2
    # Bones as before, but heavier, is another body.
    assert first.masses is not None
    heavy = replace(first, name="heavy", masses={part: 1.5 * mass for part, mass in first.masses.items()})
    assert len(Gltf.of(glb_bytes([first, heavy, second])).content["meshes"]) == 2
    for take in (first, second, other):
        found = file.places(take.name, 0.0)["left_toe"]
        np.testing.assert_allclose(found, take.clip.joint_positions()[0, JOINTS.index("left_toe")].numpy(), atol=1e-5)


def test_what_makes_no_file_leaves_none(tmp_path: Path) -> None:
    take = body()
    empty = replace(take, clip=replace(take.clip, root_position=take.clip.root_position[:0]))
    broken = take.clip.root_position.clone()
    broken[3, 1] = torch.nan
    cases = {
        "without a motion": [],
        "it has no frames": [empty],
        "not finite": [replace(take, clip=replace(take.clip, root_position=broken))],
        "two motions are called 'run'": [take, take],
    }
    for message, takes in cases.items():
        with pytest.raises(HopdiffError, match=message):
            write_glb(tmp_path / "a.glb", takes)
    with pytest.raises(HopdiffError, match="cannot write"):
        write_glb(tmp_path / "nowhere" / "a.glb", [take])
    assert not list(tmp_path.iterdir())


def test_one_frame_is_a_pose() -> None:
    take = body()
    clip = replace(take.clip, root_position=take.clip.root_position[:1], rotations=take.clip.rotations[:1])
    file = Gltf.of(glb_bytes([replace(take, clip=clip)]))
    found = file.places("run", 0.0)
    np.testing.assert_allclose(found["head"], clip.joint_positions()[0, JOINTS.index("head")].numpy(), atol=1e-5)
