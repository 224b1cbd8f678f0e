from __future__ import annotations

import csv
import math
from dataclasses import replace
from pathlib import Path

import pytest
import torch

from hopdiff.composing import compose
from hopdiff.export.full_body import full_body
from hopdiff.export.prepare import prepared
from hopdiff.export.request import Exports
from hopdiff.export.settings import ExportSettings, RetargetSettings
from hopdiff.export.write import distinct, plain, write_exports
from hopdiff.io.bvh import read_bvh
from hopdiff.types import HopdiffError
from hopdiff.whole_body.skeleton import JOINTS
from tests.export.gltf import Gltf
from tests.export.takes import own, walked

BVH = ("bvh_blender", "bvh_unity", "bvh_unreal")


def preset(name: str, *overrides: str) -> ExportSettings:
    config = compose([f"export=[{name}]", *(f"exports.{name}.{one}" for one in overrides)])
    settings = ExportSettings(**config.exports[name])
    settings.check(name)
    return settings


@pytest.mark.parametrize("name", BVH)
def test_bvh_presets_hold_the_motion(name: str, tmp_path: Path) -> None:
    settings = preset(name)
    [(path, _)] = write_exports([own()], {name: settings}, tmp_path)
    file = read_bvh(path)
    assert (file.unit, file.up) == ((0.01, "z") if name == "bvh_unreal" else (1.0, "y"))
    take = prepared(own(), settings)
    assert file.names[0] == {"bvh_unity": "mixamorig:Hips"}.get(name, "pelvis")
    order = [file.names.index(joint) for joint in take.clip.skeleton.names]
    places = file.clip().joint_positions()[:, order]
    torch.testing.assert_close(places, take.clip.joint_positions(), atol=1e-4, rtol=0)
    assert file.frame_time == pytest.approx(own().clip.frame_time, abs=1e-9)
    torch.testing.assert_close(full_body(own()).clip.joint_positions(), take.clip.joint_positions(), atol=1e-9, rtol=0)


@pytest.mark.parametrize("order", ["XYZ", "ZYX", "YXZ"])
def test_euler_orders(order: str, tmp_path: Path) -> None:
    [(path, _)] = write_exports([own()], {"bvh_blender": preset("bvh_blender", f"order={order}")}, tmp_path)
    file = read_bvh(path)
    assert "".join(channel[0] for channel in file.joints[3].channels) == order
    found = file.clip().joint_positions()[:, file.names.index("left_toe")]
    torch.testing.assert_close(
        found, full_body(own()).clip.joint_positions()[:, JOINTS.index("left_toe")], atol=1e-4, rtol=0
    )


@pytest.mark.few(3)
@pytest.mark.parametrize("fps", [24, 30, 60, 120])
def test_frame_rates_change_no_speed(fps: int, tmp_path: Path) -> None:
    for frames in ("whole", "exact"):
        settings = preset("bvh_blender", f"fps={fps}", f"frames={frames}", "cycles=4")
        clip = read_bvh(write_exports([own()], {"bvh_blender": settings}, tmp_path)[0][0]).clip()
        way = float(clip.root_position[-1, 2] - clip.root_position[0, 2])
        assert way / clip.duration == pytest.approx(3.0, rel=0.01)
        near = {"rel": 0.03} if frames == "whole" else {"abs": 1e-9}
        assert clip.frame_time == pytest.approx(1.0 / fps, **near)


def test_cycles_root_and_mirror(tmp_path: Path) -> None:
    settings = preset("bvh_blender", "cycles=5", "root=in_place", "mirrored=true")
    clip = read_bvh(write_exports([own()], {"a": settings}, tmp_path)[0][0]).clip()
    assert clip.frames == 5 * (own().frames - 1) + 1
    torch.testing.assert_close(clip.root_position[-1], clip.root_position[0], atol=1e-5, rtol=0)
    assert own().contact is not None
    names = clip.skeleton.names
    before, after = full_body(own()).clip.joint_positions(), clip.joint_positions()
    left, right = JOINTS.index("left_wrist"), names.index("right_wrist")
    torch.testing.assert_close(after[: own().frames, right, 1], before[:, left, 1], atol=1e-5, rtol=0)


def test_unreal_gets_a_root_on_the_ground(tmp_path: Path) -> None:
    [(path, _)] = write_exports([own()], {"glb_unreal": preset("glb_unreal")}, tmp_path)
    file = Gltf.of(path.read_bytes())
    names = [file.content["nodes"][node]["name"] for node in file.content["skins"][0]["joints"]]
    assert names[:2] == ["root", "pelvis"]
    assert {"thigh_l", "calf_r", "ball_l", "clavicle_r"} <= set(names)


def test_several_motions_share_files_that_can_hold_them(tmp_path: Path) -> None:
    takes = distinct([own(), replace(own(), numbers={"seed": 1})])
    exports = {name: preset(name) for name in ("glb", "bvh_blender", "csv")}
    written = [path.name for path, _ in write_exports(takes, exports, tmp_path)]
    assert written == [
        *("motion.glb", "motion_blender_run.bvh", "motion_blender_run_seed1.bvh"),
        *("joints_run.csv", "joints_run_seed1.csv"),
    ]
    assert {path.name for path in tmp_path.iterdir()} == set(written)
    clips = Gltf.of((tmp_path / "motion.glb").read_bytes()).content["animations"]
    assert [clip["name"] for clip in clips] == ["run", "run_seed1"]
    assert len(list(csv.reader((tmp_path / "joints_run.csv").read_text().splitlines()))) == own().frames + 1


def test_names_are_told_apart() -> None:
    runs = [("ga", 0), ("gradient", 0), ("gradient", 1), ("gradient", 1)]
    takes = [replace(own(), numbers={"search": search, "seed": seed}) for search, seed in runs]
    names = [take.name for take in distinct(takes)]
    assert names == ["run_ga_seed0", "run_gradient_seed0", "run_gradient_seed1_1", "run_gradient_seed1_2"]
    assert plain("a b/c:d") == "a_b_c_d"
    assert plain("//") == "motion"


@pytest.mark.parametrize(
    ("setting", "message"),
    [
        ("fps=0.5", "exports.glb.fps must lie between 1 and 1000"),
        ("fps=nan", "exports.glb.fps must lie"),
        ("cycles=0", "exports.glb.cycles must lie"),
        ("names=mixammo", "Unknown exports.glb.names 'mixammo'.*Did you mean 'mixamo'"),
        ("rest=x", "Unknown exports.glb.rest"),
        ("unit=mm", "Unknown exports.glb.unit"),
        ("order=XXY", "Unknown exports.glb.order"),
        ("root=fixed", "Unknown exports.glb.root"),
        ("clip='Run{pace}'", r"exports.glb.clip must be a name.*'Run\{pace\}'"),
        ("clip='{speed'", r"exports.glb.clip must be a name.*'\{speed'"),
        ("clip='speed}'", r"exports.glb.clip must be a name.*'speed\}'"),
        ("clip='{{speed}}'", r"exports.glb.clip must be a name.*'\{\{speed\}\}'"),
        ("clip='Run{}'", r"exports.glb.clip must be a name.*'Run\{\}'"),
        ("clip=[Run,2]", r"exports.glb.clip must be a name.*not 2"),
        ("file=a/b", "exports.glb.file must be the name of a file"),
        ("kind=obj", "Unknown exports.glb.kind"),
    ],
)
def test_settings_that_cannot_be_get_one_sentence(setting: str, message: str) -> None:
    with pytest.raises(HopdiffError, match=message):
        preset("glb", setting)


def test_what_a_motion_does_not_allow_leaves_no_file(tmp_path: Path) -> None:
    exports = {"glb": ExportSettings("glb"), "bvh": ExportSettings("bvh", cycles=3)}
    with pytest.raises(HopdiffError, match=r"exports.bvh: cycles=3: run is no loop"):
        write_exports([replace(own(), loop=False)], exports, tmp_path)
    with pytest.raises(HopdiffError, match=r"two exports are called 'motion_glb\.glb'"):
        write_exports([own()], {"glb": ExportSettings("glb"), "b": ExportSettings("glb", "motion_glb")}, tmp_path)
    empty = replace(own(), clip=replace(own().clip, root_position=torch.zeros(0, 3)))
    with pytest.raises(HopdiffError, match=r"exports.glb: cannot write run: it has no frames"):
        write_exports([empty], {"glb": ExportSettings("glb")}, tmp_path)
    with pytest.raises(HopdiffError, match=r"exports.csv: cannot write"):
        write_exports([own()], {"csv": ExportSettings("csv")}, tmp_path / "nowhere")
    assert not list(tmp_path.iterdir())


def test_clips_alone_keep_their_joints_and_names(tmp_path: Path) -> None:
    take = walked()
    [(path, _)] = write_exports([take], {"bvh": ExportSettings("bvh")}, tmp_path)
    found = read_bvh(path)
    order = [found.names.index(name) for name in take.clip.skeleton.names]
    torch.testing.assert_close(found.clip().joint_positions()[:, order], take.clip.joint_positions(), atol=1e-4, rtol=0)
    [(path, _)] = write_exports([take], {"bvh": ExportSettings("bvh", names="mixamo", rest="t", fps=30.0)}, tmp_path)
    other = read_bvh(path)
    assert "mixamorig:LeftUpLeg" in other.names
    assert math.isclose(other.frames * other.frame_time, take.frames * take.clip.frame_time, rel_tol=0.03)


def test_clips_are_called_as_one_likes(tmp_path: Path) -> None:
    takes = distinct([own(), replace(own(), numbers={"speed": 4.5, "beta": 0.7, "seed": 1}, loop=False)])

    def names(*overrides: str) -> list[str]:
        [(path, _)] = write_exports(takes, {"glb": preset("glb", *overrides)}, tmp_path)
        return [one["name"] for one in Gltf.of(path.read_bytes()).content["animations"]]

    assert names("clip=[Jog,Run]") == ["Jog", "Run"]
    assert names("clip='{name}_{speed}_{beta}'") == ["run_3_0.2", "run_seed1_4.5_0.7"]
    # Three digits of a speed, and on another body those of the run.
    run = replace(own(), numbers={"speed": 0.9 * 4.123456, "beta": 0.5, "leg_ratio": 0.9})
    [(path, _)] = write_exports([run], {"glb": preset("glb", "clip='r_{speed}_{beta}'")}, tmp_path)
    assert [one["name"] for one in Gltf.of(path.read_bytes()).content["animations"]] == ["r_4.12_0.5"]
    # Godot takes a loop for one by its name.
    assert names("loop_suffix=true") == ["run-loop", "run_seed1"]
    for setting, message in (
        ("clip=Run", r"exports.glb: clip=Run: two motions are called 'Run'"),
        ("clip=[A,B,C]", r"exports.glb: clip has 3 names for 2 motions"),
    ):
        with pytest.raises(HopdiffError, match=message):
            names(setting)
    with pytest.raises(HopdiffError, match=r"clip=v\{speed\}: speed of unknown is not known"):
        write_exports([replace(own(), name="unknown", numbers={})], {"g": preset("glb", "clip='v{speed}'")}, tmp_path)


@pytest.mark.parametrize(
    ("kind", "file", "own_file"),
    [
        ("events", "metrics.json", "metrics.json"),
        ("events", "Status", "status.json"),
        ("events", "genes.JSON", "genes.json"),
        ("blendspace", "metrics.glb", "metrics.json"),
        ("npz", "motion", "motion.npz"),
        ("frames", "config.yaml", "config.yaml"),
        ("apng", "strip.png", "strip.png"),
    ],
)
def test_no_export_takes_the_name_of_a_file_of_the_run(kind: str, file: str, own_file: str) -> None:
    message = rf"exports\.{kind}\.file={file}[\w.]* needs another name, {own_file} is the run's"
    with pytest.raises(HopdiffError, match=message):
        preset(kind, f"file={file}")


def test_what_is_written_beside_a_file_is_no_other_export() -> None:
    files = {"sprites": preset("sprites", "file=hero.png"), "events": preset("events", "file=hero.json")}
    with pytest.raises(HopdiffError, match=r"two exports are called 'hero\.json'"):
        Exports.build(files, RetargetSettings())
    for name in ("sprites", "events"):
        assert Exports.build({name: files[name]}, RetargetSettings())


def test_names_of_clips_hold_the_turn(tmp_path: Path) -> None:
    takes = [own(), replace(own(), numbers={**own().numbers, "turn": 40.0})]
    settings = preset("glb", "clip='{speed}_{beta}_{turn}'")
    [(path, _)] = write_exports(takes, {"glb": settings}, tmp_path)
    names = [one["name"] for one in Gltf.of(path.read_bytes()).content["animations"]]
    assert names == ["3_0.2_0", "3_0.2_40"]
