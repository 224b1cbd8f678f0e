from __future__ import annotations

import json
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from hopdiff.export.glb import glb_bytes
from hopdiff.geometry.rotation import axis_rotation
from hopdiff.io.glb_file import Animation, GlbFile, read_glb
from hopdiff.io.glb_mesh import skinned_meshes
from hopdiff.io.glb_parse import parse_glb
from hopdiff.io.glb_rest import rest_poses
from hopdiff.types import HopdiffError
from tests.export.gltf import Gltf
from tests.export.rigs import armature, edited, glb, skeleton
from tests.export.takes import own


def content_of(data: bytes) -> dict[str, Any]:
    return json.loads(data[20 : 20 + struct.unpack_from("<I", data, 12)[0]])


def at_rest(file: GlbFile) -> Animation:
    """Two frames in which nothing moves."""
    places = torch.from_numpy(file.matrices[:, :3, 3].copy()).repeat(2, 1, 1)
    turns = torch.eye(3, dtype=torch.float64).repeat(2, len(file.names), 1, 1)
    return Animation("a", torch.tensor([0.0, 1.0]), places, turns)


def test_our_own_files_are_read_with_their_skeleton(tmp_path: Path) -> None:
    (tmp_path / "a.glb").write_bytes(glb_bytes([own()]))
    found, ours = read_glb(tmp_path / "a.glb").skeleton(), own().clip.skeleton
    assert (found.names, found.parents) == (ours.names, ours.parents)
    torch.testing.assert_close(found.offsets[1:], ours.offsets[1:], atol=1e-6, rtol=0)


def test_scaled_and_turned_rigs_are_read_in_metres(tmp_path: Path) -> None:
    body = skeleton()
    (tmp_path / "rig.glb").write_bytes(armature(body, matrix_node=3, seed=1))
    found = read_glb(tmp_path / "rig.glb").skeleton()
    assert found.names == body.names
    torch.testing.assert_close(found.offsets[1:], body.offsets[1:], atol=1e-9, rtol=0)


def test_joints_of_one_name_become_two(tmp_path: Path) -> None:
    def same(content: dict[str, Any]) -> None:
        for node in content["nodes"][3:6]:
            node["name"] = "Spine"
        del content["nodes"][7]["name"]

    (tmp_path / "rig.glb").write_bytes(edited(armature(skeleton()), same))
    names = read_glb(tmp_path / "rig.glb").names
    assert [name for name in names if "Spine" in name][-3:] == ["Spine", "Spine_2", "Spine_3"]
    assert "node_7" in names


def test_an_animation_is_added_behind_all_that_is_there(tmp_path: Path) -> None:
    (tmp_path / "rig.glb").write_bytes(armature(skeleton()))
    file = read_glb(tmp_path / "rig.glb")
    frames = 4
    turns = axis_rotation("Y", torch.linspace(0.0, 1.0, frames, dtype=torch.float64))
    rotations = torch.eye(3, dtype=torch.float64).repeat(frames, len(file.names), 1, 1)
    rotations[:, 0] = turns
    way = torch.tensor([[0.0, 1.0, 0.1 * k] for k in range(frames)], dtype=torch.float64)
    times = 0.5 * torch.arange(frames, dtype=torch.float64)
    places, turned = file.skeleton().forward(way, rotations)
    after = Gltf.of(file.with_animations([Animation("idle", times, places, turned, {"loop": True})]))
    assert [clip["name"] for clip in after.content["animations"]] == ["idle", "idle_2"]
    clip = after.content["animations"][1]
    np.testing.assert_allclose(after.values(clip["samplers"][0]["input"])[:, 0], times)
    accessor = after.content["accessors"][clip["samplers"][0]["input"]]
    assert (accessor["min"], accessor["max"]) == ([0.0], [1.5])
    assert clip["extras"] == {"loop": True}
    for frame in range(frames):
        found = after.places("idle_2", 0.5 * frame)
        for joint, name in enumerate(file.names):
            np.testing.assert_allclose(found[name], places[frame, joint], atol=1e-5)
    for wrong in (times[:0], times * float("nan")):
        with pytest.raises(HopdiffError, match="no frames, or numbers that are not finite"):
            file.with_animations([Animation("a", wrong, places, turned)])


def test_data_inside_the_json_stays_inside(tmp_path: Path) -> None:
    """A file whose first buffer brings its own data has no place for a chunk of ours."""
    import base64

    before = armature(skeleton())
    content, binary = content_of(before), Gltf.of(before).data
    text = base64.b64encode(binary).decode()
    content["buffers"][0] = {"byteLength": len(binary), "uri": f"data:application/octet-stream;base64,{text}"}
    (tmp_path / "rig.glb").write_bytes(glb(content))
    file = read_glb(tmp_path / "rig.glb")
    after = content_of(file.with_animations([at_rest(file)]))
    assert after["buffers"][0] == content["buffers"][0]
    assert len(after["buffers"]) == 2
    added = base64.b64decode(after["buffers"][1]["uri"].split(",")[1])
    assert len(added) == after["buffers"][1]["byteLength"]
    assert np.frombuffer(added[:8], "<f4").tolist() == [0.0, 1.0]


def loop(content: dict[str, Any]) -> None:
    content["nodes"][5]["children"] = [1]


BROKEN: dict[str, tuple[Callable[[bytes], bytes], str]] = {
    "empty": (lambda _: b"", "is not a GLB file"),
    "text": (lambda _: b'{"asset": {}}', r"looks like a \.gltf text file"),
    "short": (lambda data: data[:15], "ends within its first 20 bytes"),
    "cut": (lambda data: data[: len(data) // 2], r"should have \d+ bytes and has \d+"),
    "version": (lambda data: data[:4] + struct.pack("<I", 1) + data[8:], "glTF of version 1"),
    "json": (lambda data: data[:20] + b"?" + data[21:], "its JSON chunk cannot be read"),
    "chunk": (lambda data: data[:12] + struct.pack("<I", 2**31) + data[16:], "longer than the file"),
    "no skin": (lambda data: edited(data, lambda c: c.pop("skins")), "has no skin"),
    "no joints": (lambda data: edited(data, lambda c: c["skins"][0].pop("joints")), "a skin without joints"),
    "gone": (lambda data: edited(data, lambda c: c["skins"][0].update(joints=[99])), "it lacks node 99"),
    "outside": (lambda data: edited(data, lambda c: c["buffers"][0].update(uri="a.bin")), "keeps data in another"),
    "less data": (lambda data: edited(data, lambda c: c["buffers"][0].update(byteLength=10**6)), "lacks the data of"),
    "circle": (lambda data: edited(data, loop), "(two parents|in a circle)"),
    "apart": (lambda data: edited(data, lambda c: c["nodes"][1].pop("children")), "hang on no node together"),
    "uneven": (lambda data: edited(data, lambda c: c["nodes"][0].update(scale=[1, 2, 1])), "'Armature'.*unevenly"),
    "zero": (lambda data: edited(data, lambda c: c["nodes"][0].update(scale=[0, 0, 0])), "scaled unevenly"),
    "nan": (lambda data: edited(data, lambda c: c["nodes"][1].update(translation=[float("nan")] * 3)), "JSON chunk"),
    "words": (lambda data: edited(data, lambda c: c["nodes"][1].update(rotation=["a"])), "not 4 sensible numbers"),
    "no turn": (lambda data: edited(data, lambda c: c["nodes"][1].update(rotation=[0, 0, 0, 0])), "no quaternion"),
}


@pytest.mark.parametrize("name", BROKEN)
def test_broken_files_get_one_sentence(tmp_path: Path, name: str) -> None:
    damage, message = BROKEN[name]
    path = tmp_path / "rig.glb"
    path.write_bytes(damage(armature(skeleton())))
    with pytest.raises(HopdiffError, match=message) as found:
        read_glb(path)
    assert str(path) in str(found.value)
    assert "\n" not in str(found.value)


def test_missing_files(tmp_path: Path) -> None:
    with pytest.raises(HopdiffError, match=r"cannot read .*none\.glb: no such file"):
        read_glb(tmp_path / "none.glb")


def check_damaged(tmp_path: Path, data: st.DataObject) -> None:
    whole = bytearray(armature(skeleton()))
    length = struct.unpack_from("<I", whole, 12)[0]
    for _ in range(data.draw(st.integers(1, 6))):
        whole[data.draw(st.integers(0, 20 + length - 1))] = data.draw(st.integers(0, 255))
    path = tmp_path / "rig.glb"
    path.write_bytes(bytes(whole[: data.draw(st.integers(0, len(whole)))] if data.draw(st.booleans()) else whole))
    try:
        file = read_glb(path)
        file.skeleton()
        for matrices in rest_poses(file):
            file.in_pose(matrices).with_animations([at_rest(file)])
        skinned_meshes(file)
    except HopdiffError:
        pass


@settings(max_examples=30, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_damaged_files_are_read_or_refused(tmp_path: Path, data: st.DataObject) -> None:
    check_damaged(tmp_path, data)


@pytest.mark.thorough
@settings(max_examples=300, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_many_damaged_files_are_read_or_refused(tmp_path: Path, data: st.DataObject) -> None:
    check_damaged(tmp_path, data)


ODD: dict[str, Callable[[dict[str, Any]], object]] = {
    "kind": lambda c: c["accessors"][0].update(componentType=[]),
    "type": lambda c: c["accessors"][0].update(type={}),
    "extensions of a view": lambda c: c["bufferViews"][0].update(extensions=3),
    "extension of a buffer": lambda c: c["buffers"][0].update(extensions={"EXT_meshopt_compression": [1]}),
    "extensions of a mesh": lambda c: c["meshes"][0]["primitives"][0].update(extensions=[3]),
    "offset": lambda c: c["bufferViews"][1].update(byteOffset=2**70),
    "null": lambda c: c["nodes"][1].update(scale=None, translation=None, matrix=None),
    "half a letter": lambda c: c["nodes"][4].update(name="a\ud83d"),
    "flat bind pose": lambda c: c["skins"][0].update(inverseBindMatrices=1),
    "joints": lambda c: c["meshes"][0]["primitives"][0]["attributes"].update(JOINTS_0=3),
    "weights": lambda c: c["meshes"][0]["primitives"][0]["attributes"].update(WEIGHTS_0=1),
    "buffers": lambda c: c.update(buffers=[{"byteLength": 0, "uri": "data:application/octet-stream;base64,"}]),
}


@pytest.mark.parametrize("name", ODD)
def test_odd_files_are_read_or_refused_in_one_sentence(tmp_path: Path, name: str) -> None:
    path = tmp_path / "rig.glb"
    path.write_bytes(edited(armature(skeleton()), ODD[name]))
    said = str(path)
    try:
        file = read_glb(path)
        skinned_meshes(file)
        for matrices in rest_poses(file):
            written = file.in_pose(matrices).with_animations([at_rest(file)])
            assert parse_glb(written, "again").content["animations"]
    except HopdiffError as error:
        said = str(error)
    assert str(path) in said
    assert "\n" not in said


def test_endless_numbers_are_refused(tmp_path: Path) -> None:
    data = armature(skeleton())
    text = edited(data, lambda c: c["materials"][0]["extras"].update(far=12345.5)).replace(b"12345.5", b"1.e9999")
    (tmp_path / "rig.glb").write_bytes(text.replace(b"1.e9999", b"1e99999"))
    with pytest.raises(HopdiffError, match="its JSON chunk cannot be read"):
        read_glb(tmp_path / "rig.glb")
