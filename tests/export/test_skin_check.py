"""The second look at a written character: what does not follow the body is seen, and not written."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from hopdiff.export.retarget import read_target, retargeted, write_retargeted
from hopdiff.export.skin_check import check_skin, worst_of
from hopdiff.extras import install
from hopdiff.io.glb_file import GlbFile
from hopdiff.types import HopdiffError
from tests.export.rigs import edited, glb, parted
from tests.export.skins import Played
from tests.export.stand_ins import stand_in
from tests.export.takes import own

CORNERS = np.array([(x, y, z) for x in (-0.05, 0.05) for y in (-0.14, -0.05) for z in (-0.09, 0.2)])  # of a clog


def still(*names: str) -> Callable[[dict[str, Any]], object]:
    """Nodes do not move in the last animation."""

    def change(content: dict[str, Any]) -> None:
        animation = content["animations"][-1]
        nodes = [k for k, node in enumerate(content["nodes"]) if node.get("name") in names]
        animation["channels"] = [one for one in animation["channels"] if one["target"]["node"] not in nodes]

    return change


def made(path: Path, *properties: str) -> tuple[Any, Any, bytes]:
    path.write_bytes(stand_in("mixamo", *properties))
    target = read_target(path)
    take = retargeted(own(), target)
    write_retargeted(path.with_name("out.glb"), [take], target)
    return target, take, path.with_name("out.glb").read_bytes()


def test_a_sound_skin(tmp_path: Path) -> None:
    target, take, data = made(tmp_path / "hero.glb")
    [found] = check_skin(data, [take], target)
    assert not found.torn
    assert found.warnings("hero.glb") == []
    assert found.stretch < 2.0
    assert found.sole is not None
    assert found.sole < 0.005
    assert found.behind == ()


def test_feet_that_stay_where_they_are_tear_the_skin(tmp_path: Path) -> None:
    target, take, data = made(tmp_path / "hero.glb", "ik_feet")
    [found] = check_skin(edited(data, still("mixamorig:LeftFoot", "mixamorig:LeftToeBase")), [take], target)
    assert found.torn
    assert found.stretch > 3.0
    assert any("Left" in name for name in found.between)


def test_a_torn_skin_is_refused_with_the_joints_and_nothing_is_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    target, take, _ = made(tmp_path / "hero.glb", "ik_feet")
    whole = GlbFile.with_animations
    broken = still("mixamorig:LeftFoot", "mixamorig:LeftToeBase")
    monkeypatch.setattr(GlbFile, "with_animations", lambda file, motions: edited(whole(file, motions), broken))
    with pytest.raises(HopdiffError, match=r"would tear its skin at .*Left.*, which does not follow the body") as error:
        write_retargeted(tmp_path / "torn.glb", [take], target)
    assert "\n" not in str(error.value)
    assert not (tmp_path / "torn.glb").exists()


def test_soles_off_the_ground_are_told(tmp_path: Path) -> None:
    target, take, _ = made(tmp_path / "hero.glb")
    up = take.clip.root_position + torch.tensor([0.0, 0.05, 0.0], dtype=torch.float64)
    high = replace(take, clip=replace(take.clip, root_position=up))
    [found] = write_retargeted(tmp_path / "high.glb", [high], target)
    assert found.sole == pytest.approx(0.05, abs=0.005)
    assert found.warnings("hero.glb") == ["hero.glb: its soles are up to 5.1 cm off the ground while they stand."]


def test_several_motions_are_looked_at_one_by_one(tmp_path: Path) -> None:
    target, take, _ = made(tmp_path / "hero.glb")
    up = take.clip.root_position + torch.tensor([0.0, 0.05, 0.0], dtype=torch.float64)
    high = replace(take, name="high", clip=replace(take.clip, root_position=up))
    checks = write_retargeted(tmp_path / "two.glb", [take, high], target)
    assert [check.sole is not None and check.sole > 0.04 for check in checks] == [False, True]
    content, _ = parted((tmp_path / "two.glb").read_bytes())
    assert [one["name"] for one in content["animations"]] == ["run", "high"]
    assert all(one["extras"]["loop"] is True for one in content["animations"])
    assert all(one["extras"]["travel_m"][2] > 0.5 for one in content["animations"])


def draco(content: dict[str, Any]) -> None:
    for mesh in content["meshes"]:
        mesh["primitives"][0]["extensions"] = {"KHR_draco_mesh_compression": {"bufferView": 0, "attributes": {}}}


def meshopt(content: dict[str, Any]) -> None:
    position = content["meshes"][0]["primitives"][0]["attributes"]["POSITION"]
    view = content["bufferViews"][content["accessors"][position]["bufferView"]]
    view["extensions"] = {"EXT_meshopt_compression": {"buffer": 0, "byteLength": 10, "byteStride": 12, "count": 1}}


@pytest.mark.parametrize(
    ("change", "why", "extra"),
    [(draco, "KHR_draco_mesh_compression", "draco"), (meshopt, "EXT_meshopt_compression", "meshopt")],
)
def test_meshes_that_cannot_be_read_are_told(
    tmp_path: Path, change: Callable[[dict[str, Any]], object], why: str, extra: str
) -> None:
    (tmp_path / "hero.glb").write_bytes(edited(stand_in("mixamo"), change))
    target = read_target(tmp_path / "hero.glb")
    assert target.skin is None
    assert target.notes == (
        f"hero.glb: the mesh of Body cannot be read ({why}: {install(extra)} reads it): soles are where joints say, and"
        " how the skin follows was not looked at.",
    )
    take = retargeted(own(), target)
    assert write_retargeted(tmp_path / "out.glb", [take], target) == []


def test_what_is_not_on_the_skeleton_is_told(tmp_path: Path) -> None:
    def hat(content: dict[str, Any]) -> None:
        content["scenes"][0]["nodes"].append(len(content["nodes"]))
        content["nodes"].append({"name": "Hat", "mesh": 0})

    (tmp_path / "hero.glb").write_bytes(edited(stand_in("mixamo"), hat))
    assert read_target(tmp_path / "hero.glb").notes == (
        "hero.glb: not on the skeleton, so that it does not move: Hat.",
    )


def test_limbs_below_an_uneven_scale_are_refused(tmp_path: Path) -> None:
    def hips(content: dict[str, Any]) -> None:
        node = next(one for one in content["nodes"] if one["name"] == "mixamorig:Spine")
        node["scale"] = [1.0, 2.0, 1.0]

    (tmp_path / "hero.glb").write_bytes(edited(stand_in("mixamo"), hips))
    with pytest.raises(HopdiffError, match=r"'mixamorig:Spine' is scaled unevenly, and 'mixamorig:Spine1' \(chest\)"):
        read_target(tmp_path / "hero.glb")


def test_the_worst_of_several_is_told(tmp_path: Path) -> None:
    target, take, _ = made(tmp_path / "hero.glb")
    up = take.clip.root_position + torch.tensor([0.0, 0.05, 0.0], dtype=torch.float64)
    high = replace(take, name="high", clip=replace(take.clip, root_position=up))
    checks = write_retargeted(tmp_path / "two.glb", [take, high], target)
    first = replace(checks[0], stretch=1.9)
    both = worst_of([first, checks[1]])
    assert both is not None
    assert both.stretch == 1.9
    assert both.sole == checks[1].sole


def test_what_stays_behind_is_told(tmp_path: Path) -> None:
    """A sword that hangs on no joint of the body, and whose node does not move."""
    target, take, data = made(tmp_path / "hero.glb", "ik_feet")

    def far(content: dict[str, Any]) -> None:
        still("mixamorig:RightFoot", "mixamorig:RightToeBase")(content)
        node = next(one for one in content["nodes"] if one.get("name") == "mixamorig:RightFoot")
        node["translation"] = [0.0, 0.0, -9.0]

    [found] = check_skin(edited(data, far), [take], target)
    assert "mixamorig:RightFoot" in found.behind
    assert found.torn


def loose_vertex(content: dict[str, Any]) -> None:
    """The first vertex is held by nothing."""
    weights = content["meshes"][0]["primitives"][0]["attributes"]["WEIGHTS_0"]
    accessor = content["accessors"][weights]
    view = len(content["bufferViews"])
    content["bufferViews"].append({"buffer": 0, "byteOffset": 0, "byteLength": 4})
    content["bufferViews"].append({"buffer": 0, "byteOffset": 0, "byteLength": 16})
    accessor["sparse"] = {
        "count": 1,
        "indices": {"bufferView": view, "componentType": 5125},
        "values": {"bufferView": view + 1},
    }


def test_a_vertex_that_nothing_holds_is_not_left_behind(tmp_path: Path) -> None:
    content, binary = parted(stand_in("mixamo"))
    loose_vertex(content)
    # 20 bytes of 0 before the rest: the number of the vertex, and its weights.
    for view in content["bufferViews"][:-2]:
        view["byteOffset"] += 32
    content["buffers"][0]["byteLength"] += 32
    (tmp_path / "hero.glb").write_bytes(glb(content, bytes(32) + binary))
    target = read_target(tmp_path / "hero.glb")
    assert target.skin is not None
    whole = read_target(plain_copy(tmp_path)).skin
    assert whole is not None
    assert len(target.skin.vertices) == len(whole.vertices) - 1
    take = retargeted(own().repeated(4), target)
    [found] = write_retargeted(tmp_path / "out.glb", [take], target)
    assert found.behind == ()


def plain_copy(folder: Path) -> Path:
    (folder / "plain.glb").write_bytes(stand_in("mixamo"))
    return folder / "plain.glb"


@pytest.mark.parametrize("joint", ["mixamorig:Head", "mixamorig:LeftHand", "mixamorig:LeftUpLeg", "mixamorig:LeftFoot"])
def test_a_node_that_is_mirrored_against_its_skin(tmp_path: Path, joint: str) -> None:
    def mirror(content: dict[str, Any]) -> None:
        next(one for one in content["nodes"] if one.get("name") == joint)["scale"] = [-1.0, 1.0, 1.0]

    (tmp_path / "hero.glb").write_bytes(edited(stand_in("mixamo"), mirror))
    target = read_target(tmp_path / "hero.glb")
    take = retargeted(own(), target)
    [found] = write_retargeted(tmp_path / "out.glb", [take], target)
    assert found.stretch < 2.0
    assert found.sole is not None
    assert found.sole < 0.005


def clogs(content: dict[str, Any], data: bytes) -> bytes:
    """Boxes that hang on the feet without a skin, 5 cm deeper than the soles."""
    corners = CORNERS.astype("<f4")
    line = np.array([0, 1, 3, 0, 3, 2, 4, 5, 7, 4, 7, 6, 0, 1, 5, 0, 5, 4], "<u2")
    start = len(data) + (-len(data) % 4)
    whole = data.ljust(start, b"\0") + corners.tobytes() + line.tobytes()
    views, accessors = content["bufferViews"], content["accessors"]
    views.append({"buffer": 0, "byteOffset": start, "byteLength": corners.nbytes})
    views.append({"buffer": 0, "byteOffset": start + corners.nbytes, "byteLength": line.nbytes})
    accessors.append({"bufferView": len(views) - 2, "componentType": 5126, "count": 8, "type": "VEC3"})
    accessors[-1] |= {"min": corners.min(axis=0).tolist(), "max": corners.max(axis=0).tolist()}
    accessors.append({"bufferView": len(views) - 1, "componentType": 5123, "count": len(line), "type": "SCALAR"})
    primitive = {"attributes": {"POSITION": len(accessors) - 2}, "indices": len(accessors) - 1}
    content["meshes"].append({"primitives": [primitive]})
    world = Played(content, whole).worlds(None, 0.0)
    for name in ("mixamorig:LeftFoot", "mixamorig:RightFoot"):
        foot = next(k for k, node in enumerate(content["nodes"]) if node.get("name") == name)
        back = Rotation.from_matrix(world[foot][:3, :3]).inv().as_quat().tolist()
        content["nodes"][foot].setdefault("children", []).append(len(content["nodes"]))
        content["nodes"].append({"name": f"Clog {name}", "mesh": len(content["meshes"]) - 1, "rotation": back})
    content["buffers"][0]["byteLength"] = len(whole)
    return glb(content, whole)


def test_rigid_pieces_follow_their_joints_and_count_as_soles(tmp_path: Path) -> None:
    (tmp_path / "hero.glb").write_bytes(clogs(*parted(stand_in("mixamo"))))
    target = read_target(tmp_path / "hero.glb")
    assert target.notes == ()
    for leg in target.legs:
        assert target.depth(leg) == pytest.approx(0.14, abs=1e-3)
    take = retargeted(own(), target)
    [found] = write_retargeted(tmp_path / "out.glb", [take], target)
    assert found.sole is not None
    assert found.sole < 0.005
    played = Played.of(tmp_path / "out.glb")
    assert take.contact is not None
    for frame in torch.nonzero(take.contact[:, 0])[:, 0].tolist():
        world = played.worlds(take.name, frame * take.clip.frame_time)[played.node("Clog mixamorig:LeftFoot")]
        assert float((CORNERS @ world[:3, :3].T + world[:3, 3])[:, 1].min()) == pytest.approx(0.0, abs=0.005)


def test_bind_matrices_of_joints_that_hold_nothing_count_for_nothing(tmp_path: Path) -> None:
    """As Sketchfab writes them: those joints are at the origin."""
    content, data = parted(stand_in("mixamo"))
    binary = bytearray(data)
    plain = read_target(plain_copy(tmp_path))
    assert plain.skin is not None
    skin = content["skins"][0]
    accessor = content["accessors"][skin["inverseBindMatrices"]]
    start = content["bufferViews"][accessor["bufferView"]]["byteOffset"]
    names = [content["nodes"][node]["name"] for node in skin["joints"]]
    empty = [k for k, name in enumerate(names) if plain.skin.everything(plain.skeleton.index(name)) == 0.0]
    assert any("Neck" not in names[k] and "Hand" in names[k] for k in empty)
    for k in empty:
        binary[start + 64 * k : start + 64 * (k + 1)] = np.eye(4, dtype="<f4").tobytes()
    (tmp_path / "hero.glb").write_bytes(glb(content, bytes(binary)))
    target = read_target(tmp_path / "hero.glb")
    torch.testing.assert_close(target.places, plain.places, atol=1e-5, rtol=0)


def test_loose_vertices_are_told(tmp_path: Path) -> None:
    def light(content: dict[str, Any]) -> None:
        weights = content["meshes"][0]["primitives"][0]["attributes"]["WEIGHTS_0"]
        content["accessors"][weights].pop("bufferView")
        content["accessors"][weights]["sparse"] = {
            "count": 300,
            "indices": {"bufferView": len(content["bufferViews"]), "componentType": 5123},
            "values": {"bufferView": len(content["bufferViews"]) + 1},
        }

    content, binary = parted(stand_in("mixamo"))
    before = Played(content, binary)
    weights = before.skinned[0][3].astype("<f4")
    light(content)
    start = len(binary) + (-len(binary) % 4)
    rows, values = np.arange(300, dtype="<u2").tobytes(), weights[:300].tobytes()
    content["bufferViews"].append({"buffer": 0, "byteOffset": start, "byteLength": len(rows)})
    content["bufferViews"].append({"buffer": 0, "byteOffset": start + len(rows), "byteLength": len(values)})
    whole = binary.ljust(start, b"\0") + rows + values
    content["buffers"][0]["byteLength"] = len(whole)
    (tmp_path / "hero.glb").write_bytes(glb(content, whole))
    count = len(weights) - 300
    assert read_target(tmp_path / "hero.glb").notes[0] == (
        f"hero.glb: {count} vertices of its skin are held by no joint, and stay where they are."
    )
