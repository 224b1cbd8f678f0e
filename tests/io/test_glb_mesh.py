"""Skins as they lie in files: packed in any of the ways that exporters have, they are the same skin."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from hopdiff.io.glb_file import GlbFile, read_glb
from hopdiff.io.glb_mesh import SkinnedMesh, skinned_meshes
from tests.export.rigs import glb, parted
from tests.export.skins import Played
from tests.export.stand_ins import stand_in


def mesh_of(path: Path, data: bytes) -> SkinnedMesh:
    path.write_bytes(data)
    found = skinned_meshes(read_glb(path))
    assert found.unread == ()
    [mesh] = found.meshes
    return mesh


@pytest.mark.parametrize("name", ["quantised", "sparse", "morphs", "matrices", "fallback"])
def test_the_same_skin_however_it_is_packed(tmp_path: Path, name: str) -> None:
    """Against a reading of the file by the specification's words alone."""
    mesh = mesh_of(tmp_path / "hero.glb", stand_in("unreal_5", name))
    [(vertices, edges, joints, weights, inverse, nodes)] = Played.of(tmp_path / "hero.glb").skinned
    np.testing.assert_allclose(mesh.vertices, vertices, atol=1e-12)
    np.testing.assert_array_equal(mesh.edges, edges)
    order = read_glb(tmp_path / "hero.glb").nodes
    for k in range(len(vertices)):
        ours = {order[j]: w for j, w in zip(mesh.joints[k], mesh.weights[k], strict=True) if w > 0.0}
        theirs = {nodes[j]: w for j, w in zip(joints[k], weights[k], strict=True) if w > 0.0}
        assert ours == pytest.approx(theirs, abs=1e-6)
    for k, node in enumerate(nodes):
        np.testing.assert_allclose(mesh.inverse[order.index(node)], inverse[k])


def test_parts_in_several_skins_are_one(tmp_path: Path) -> None:
    (tmp_path / "hero.glb").write_bytes(stand_in("mixamo", "skins"))
    file = read_glb(tmp_path / "hero.glb")
    assert len(file.skins) == 3
    found = skinned_meshes(file)
    assert [mesh.name for mesh in found.meshes] == ["Legs", "Trunk", "Head"]
    assert {joint for skin in file.skins for joint in skin.joints} <= set(range(len(file.nodes)))


def test_meshopt(tmp_path: Path) -> None:
    meshoptimizer = pytest.importorskip("meshoptimizer", reason="the extra `meshopt` is not installed")
    plain = stand_in("mixamo")
    content, data = parted(plain)
    whole = bytearray(data)
    primitive = content["meshes"][0]["primitives"][0]

    def packed(accessor: int, encoded: bytes, stride: int, count: int, mode: str) -> None:
        view = content["bufferViews"][content["accessors"][accessor]["bufferView"]]
        whole.extend(b"\0" * (-len(whole) % 4))
        own = {"buffer": 0, "byteOffset": len(whole), "byteLength": len(encoded), "byteStride": stride}
        view["extensions"] = {"EXT_meshopt_compression": {**own, "count": count, "mode": mode}}
        view |= {"buffer": 1, "byteOffset": 0}
        whole.extend(encoded)

    for name, kind, width in (("POSITION", "<f4", 3), ("WEIGHTS_0", "<f4", 4)):
        accessor = primitive["attributes"][name]
        view = content["bufferViews"][content["accessors"][accessor]["bufferView"]]
        rows = np.frombuffer(data, kind, offset=view["byteOffset"], count=view["byteLength"] // 4).reshape(-1, width)
        encoded = meshoptimizer.encode_vertex_buffer(np.ascontiguousarray(rows), len(rows), 4 * width)
        packed(accessor, bytes(encoded), 4 * width, len(rows), "ATTRIBUTES")
    view = content["bufferViews"][content["accessors"][primitive["indices"]]["bufferView"]]
    line = np.frombuffer(data, "<u2", offset=view["byteOffset"], count=view["byteLength"] // 2).astype(np.uint32)
    encoded = meshoptimizer.encode_index_buffer(line, len(line), int(line.max()) + 1)
    packed(primitive["indices"], bytes(encoded), 2, len(line), "TRIANGLES")
    content["buffers"] = [
        {"byteLength": len(whole)},
        {"byteLength": 10**6, "extensions": {"EXT_meshopt_compression": {"fallback": True}}},
    ]
    one = mesh_of(tmp_path / "packed.glb", glb(content, bytes(whole)))
    other = mesh_of(tmp_path / "plain.glb", plain)
    np.testing.assert_array_equal(one.vertices, other.vertices)
    np.testing.assert_array_equal(one.weights, other.weights)
    np.testing.assert_array_equal(one.edges, other.edges)


def test_draco(tmp_path: Path) -> None:
    draco = pytest.importorskip("DracoPy", reason="the extra `draco` is not installed")
    plain = stand_in("mixamo")
    content, data = parted(plain)
    other = mesh_of(tmp_path / "plain.glb", plain)
    [(vertices, _, joints, weights, *_)] = Played.of(tmp_path / "plain.glb").skinned
    primitive = content["meshes"][0]["primitives"][0]
    view = content["bufferViews"][content["accessors"][primitive["indices"]]["bufferView"]]
    faces = np.frombuffer(data, "<u2", offset=view["byteOffset"], count=view["byteLength"] // 2).reshape(-1, 3)
    encoded = draco.encode(
        vertices.astype(np.float32),
        faces.astype(np.uint32),
        quantization_bits=24,
        preserve_order=True,
        generic_attributes={7: joints.astype(np.uint8), 8: weights.astype(np.float32)},
    )
    number = next(one["unique_id"] for one in draco.decode(encoded).attributes if one["attribute_type"] == 0)
    start = len(data) + (-len(data) % 4)
    content["bufferViews"].append({"buffer": 0, "byteOffset": start, "byteLength": len(encoded)})
    for name in ("POSITION", "JOINTS_0", "WEIGHTS_0"):
        content["accessors"][primitive["attributes"][name]].pop("bufferView")
    content["accessors"][primitive["indices"]].pop("bufferView")
    primitive["extensions"] = {
        "KHR_draco_mesh_compression": {
            "bufferView": len(content["bufferViews"]) - 1,
            "attributes": {"POSITION": number, "JOINTS_0": 7, "WEIGHTS_0": 8},
        }
    }
    whole = data.ljust(start, b"\0") + encoded
    content["buffers"] = [{"byteLength": len(whole)}]
    one = mesh_of(tmp_path / "packed.glb", glb(content, whole))
    np.testing.assert_allclose(one.vertices, other.vertices, atol=1e-6)
    np.testing.assert_allclose(one.weights, other.weights, atol=1e-6)
    np.testing.assert_array_equal(one.edges, other.edges)


@pytest.mark.parametrize("missing", ["meshoptimizer", "DracoPy"])
def test_without_the_package_the_mesh_is_unread(tmp_path: Path, missing: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, missing, None)
    content, data = parted(stand_in("mixamo"))
    primitive = content["meshes"][0]["primitives"][0]
    if missing == "DracoPy":
        primitive["extensions"] = {"KHR_draco_mesh_compression": {"bufferView": 0, "attributes": {"POSITION": 0}}}
    else:
        view = content["bufferViews"][content["accessors"][primitive["attributes"]["POSITION"]]["bufferView"]]
        own = {"buffer": 0, "byteLength": 10, "byteStride": 12, "count": 2, "mode": "ATTRIBUTES"}
        view["extensions"] = {"EXT_meshopt_compression": own}
    (tmp_path / "hero.glb").write_bytes(glb(content, data))
    file: GlbFile = read_glb(tmp_path / "hero.glb")
    found = skinned_meshes(file)
    assert found.meshes == ()
    assert found.unread == ("Body",)
    assert found.why == ({"DracoPy": "KHR_draco_mesh_compression"}.get(missing, "EXT_meshopt_compression"),)
