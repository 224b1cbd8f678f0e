"""Bodies in files that say themselves which joint is which part: VRM characters."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hopdiff.cli import main
from hopdiff.export.retarget import read_target
from hopdiff.io.bvh import write_bvh
from hopdiff.whole_body.skeleton import JOINTS
from tests.export.rigs import armature, glb, parted, skeleton
from tests.people import clip_of

# As VRM calls the parts, in the order of ours.
VRM = (
    *("hips", "spine", "chest", "upperChest", "neck", "head"),
    *(f"left{part}" for part in ("Shoulder", "UpperArm", "LowerArm", "Hand")),
    *(f"right{part}" for part in ("Shoulder", "UpperArm", "LowerArm", "Hand")),
    *(f"left{part}" for part in ("UpperLeg", "LowerLeg", "Foot", "Toes")),
    *(f"right{part}" for part in ("UpperLeg", "LowerLeg", "Foot", "Toes")),
)


def character(path: Path, version: int, change: dict[str, Any] | None = None, names: bool = False) -> Path:
    """A VRM file whose joints have names that say nothing, or those of Mixamo. change: other nodes of bones, None for
    none."""
    content, data = parted(armature(skeleton()))
    nodes: dict[str, Any] = {bone: 1 + k for k, bone in enumerate(VRM)} | (change or {})
    nodes = {bone: node for bone, node in nodes.items() if node is not None}
    if not names:
        for k, node in enumerate(content["nodes"][1:23]):
            node["name"] = f"b{(7 * k) % 23}"
    if version == 0:
        bones: Any = [{"bone": bone, "node": node} for bone, node in nodes.items()]
        content["extensions"] = {"VRM": {"specVersion": "0.0", "humanoid": {"humanBones": bones}}}
    else:
        bones = {bone: {"node": node} for bone, node in nodes.items()}
        content["extensions"] = {"VRMC_vrm": {"specVersion": "1.0", "humanoid": {"humanBones": bones}}}
    content["extensionsUsed"] = list(content["extensions"])
    path.write_bytes(glb(content, data))
    return path


@pytest.mark.parametrize("version", [0, 1])
@pytest.mark.parametrize("suffix", [".vrm", ".glb"])
def test_the_map_of_the_file_is_the_answer(version: int, suffix: str, tmp_path: Path) -> None:
    target = read_target(character(tmp_path / f"hero{suffix}", version))
    assert target.parts == {part: k for k, part in enumerate(JOINTS)}
    assert target.suffix == suffix


def test_it_counts_more_than_names(tmp_path: Path) -> None:
    """What is called the toe is said to be no part, and the joint called Spine1 is the spine."""
    bones = {"leftToes": None, "spine": 3, "chest": None}
    parts = read_target(character(tmp_path / "hero.vrm", 1, bones, names=True)).parts
    assert parts["waist"] == JOINTS.index("chest")
    assert "left_toe" not in parts
    assert "right_toe" in parts


@pytest.mark.parametrize("version", [0, 1])
@pytest.mark.parametrize(
    ("bones", "said"),
    [
        ({"leftHand": 999}, "its VRM map has leftHand at 999, which is no joint of its skeleton"),
        ({"leftHand": -1}, "leftHand at -1, which"),
        ({"leftHand": "x"}, "leftHand at 'x', which"),
        ({"leftHand": True}, "leftHand at True, which"),
        ({"head": 0}, "head at 0, which is no joint"),
        ({"hips": None}, "its VRM map lacks hips"),
        ({"leftUpperLeg": 16, "leftLowerLeg": 15}, "leftLowerLeg of its VRM map does not hang on leftUpperLeg"),
    ],
)
def test_a_broken_map_is_told_and_names_count(version: int, bones: dict[str, Any], said: str, tmp_path: Path) -> None:
    target = read_target(character(tmp_path / "hero.vrm", version, bones, names=True))
    assert target.parts == {part: k for k, part in enumerate(JOINTS)}
    assert said in " ".join(target.notes)
    assert target.notes[0].endswith("so that names and shape count.")


@pytest.mark.parametrize(
    "extensions",
    [None, [], "VRM", {"VRM": None}, {"VRM": {"humanoid": 1}}, {"VRMC_vrm": {"humanoid": {"humanBones": [1, None]}}}],
)
def test_a_map_that_is_none_is_none(extensions: Any, tmp_path: Path) -> None:
    content, data = parted(armature(skeleton()))
    path = tmp_path / "hero.vrm"
    path.write_bytes(glb({**content, "extensions": extensions}, data))
    assert read_target(path).report().sentence() == "hero.vrm: 22 of 22 parts found"


def weighted(path: Path, change: dict[str, Any]) -> Path:
    """A file whose skin hangs on joints 0 and 5, by a weight of a tenth on 7, and not on 3. change: of the accessor of
    the weights."""
    content, data = parted(armature(skeleton()))
    joints, weights = (content["accessors"][k] for k in (2, 3))
    values = bytearray(data)
    for k, own in enumerate(([0, 0, 0, 0], [5, 0, 0, 3], [7, 5, 3, 0])):
        at = content["bufferViews"][joints["bufferView"]]["byteOffset"] + 4 * k
        values[at : at + 4] = bytes(own)
    table = np.array([[1.0, 0, 0, 0], [0.6, 0.4, 0, 0], [0.1, 0.9, 0, 0]], "<f4").tobytes()
    at = content["bufferViews"][weights["bufferView"]]["byteOffset"]
    values[at : at + len(table)] = table
    weights |= change
    path.write_bytes(glb(content, bytes(values)))
    return path


def test_the_joints_that_carry_the_skin_are_read(tmp_path: Path) -> None:
    skin = read_target(weighted(tmp_path / "hero.glb", {})).skin
    assert skin is not None
    assert skin.carriers() == {0, 5, 7}


@pytest.mark.parametrize(
    "change", [{"componentType": 5130}, {"count": 10**9}, {"byteOffset": 10**9}, {"count": "x"}, {"sparse": {}}]
)
def test_weights_that_cannot_be_read_say_nothing(change: dict[str, Any], tmp_path: Path) -> None:
    path = weighted(tmp_path / "hero.glb", change)
    target = read_target(path)
    assert target.skin is None
    assert target.report().count == "22 of 22"


def test_a_motion_is_written_into_a_vrm_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    source, out = tmp_path / "walk.bvh", tmp_path / "out"
    write_bvh(source, clip_of("walk"), "ZYX", 100.0)
    hero = character(tmp_path / "hero.vrm", 1)
    words = ["task=export", f"run={source}", "export=[]", f"retarget.skeleton={hero}", f"hydra.run.dir={out}"]
    monkeypatch.setattr("sys.argv", ["hopdiff", *words])
    assert main() == 0
    content, _ = parted((out / "retargeted.vrm").read_bytes())
    before, _ = parted(hero.read_bytes())
    assert content["extensions"] == before["extensions"]
    assert len(content["animations"]) == len(before["animations"]) + 1
