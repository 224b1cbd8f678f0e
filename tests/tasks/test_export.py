from __future__ import annotations

import json
import os
import re
from pathlib import Path

import pytest
import torch
from PIL import Image

from hopdiff.cli import main
from hopdiff.export.tables import read_npz
from hopdiff.io.bvh import read_bvh
from tests.export.gltf import Gltf
from tests.export.rigs import armature, skeleton, write_rest
from tests.people import file_of

PRESETS = "export=[glb,glb_unreal,glb_mixamo,bvh_blender,bvh_unity,bvh_unreal,csv,npz]"
FILES = {
    *("motion.glb", "motion_unreal.glb", "motion_mixamo.glb", "motion_blender.bvh", "motion_unity.bvh"),
    *("motion_unreal.bvh", "joints.csv", "joints.npz"),
}


def call(monkeypatch: pytest.MonkeyPatch, folder: Path, *words: str) -> int:
    monkeypatch.setattr("sys.argv", ["hopdiff", *words, f"hydra.run.dir={folder}"])
    return main()


def test_a_finished_run_in_every_form(
    finished: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    before = {path.name: path.read_bytes() for path in finished.iterdir() if path.is_file()}
    assert call(monkeypatch, tmp_path / "out", "task=export", f"run={finished}", PRESETS) == 0
    found = {path.name for path in (tmp_path / "out").iterdir()}
    assert found == FILES | {"config.yaml", "status.json", "versions.json", "git.json"}
    # The run's own folder is left as it is.
    assert {path.name: path.read_bytes() for path in finished.iterdir() if path.is_file()} == before
    said = capsys.readouterr().out
    assert all(name in said for name in FILES)
    assert "loops" in said
    metrics = json.loads((finished / "metrics.json").read_text())
    file = Gltf.of((tmp_path / "out" / "motion.glb").read_bytes())
    [clip] = file.content["animations"]
    assert clip["name"] == f"run_v{metrics['speed']:.3g}_beta{metrics['beta']:g}"
    assert clip["extras"]["speed"] == metrics["speed"]
    take, source = read_npz(tmp_path / "out" / "joints.npz"), read_npz(finished / "motion.npz")
    assert take.masses == source.masses
    assert take.numbers["cost"] == metrics["cost"]


def test_exports_at_once_are_those_made_afterwards(
    finished: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    words = ("task=replay", f"genes_file={finished / 'genes.json'}", "pictures=false")
    assert call(monkeypatch, tmp_path / "once", *words, "export=[glb,bvh_unreal]", "exports.glb.cycles=2") == 0
    words = ("task=export", f"run={tmp_path / 'once'}", "export=[glb,bvh_unreal]", "exports.glb.cycles=2")
    assert call(monkeypatch, tmp_path / "later", *words) == 0
    for name in ("motion.glb", "motion_unreal.bvh"):
        assert (tmp_path / "once" / name).read_bytes() == (tmp_path / "later" / name).read_bytes()


def test_a_sweep_goes_into_one_file_with_a_clip_for_each_run(
    finished: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for k, beta in enumerate((0.2, 0.3)):
        words = ("task=replay", f"genes_file={finished / 'genes.json'}", f"beta={beta}", "pictures=false")
        assert call(monkeypatch, tmp_path / "sweep" / f"{k}_a", *words) == 0
    assert call(monkeypatch, tmp_path / "out", "task=export", f"runs={tmp_path / 'sweep'}", "export=glb") == 0
    clips = Gltf.of((tmp_path / "out" / "motion.glb").read_bytes()).content["animations"]
    assert [clip["name"].split("_")[-1] for clip in clips] == ["beta0.2", "beta0.3"]
    both = f"run=[{tmp_path / 'sweep' / '0_a'},{tmp_path / 'sweep' / '1_a'}]"
    assert call(monkeypatch, tmp_path / "again", "task=export", both, "export=[glb,bvh_unity]") == 0
    assert (tmp_path / "again" / "motion.glb").read_bytes() == (tmp_path / "out" / "motion.glb").read_bytes()
    assert len(list((tmp_path / "again").glob("motion_unity_run_*.bvh"))) == 2


def test_edits_are_exported_too(finished: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    clip = f"clip={finished / 'motion.bvh'}"
    words = ("task=edit", clip, "target.position=[0.5,3]", "pictures=false", "export=[glb,bvh_unreal,csv]")
    assert call(monkeypatch, tmp_path / "edit", *words) == 0
    edited = read_bvh(tmp_path / "edit" / "edited.bvh").clip()
    [clip_there] = Gltf.of((tmp_path / "edit" / "motion.glb").read_bytes()).content["animations"]
    assert clip_there["name"] == "motion_edited"
    assert clip_there["extras"]["duration_s"] == pytest.approx(edited.duration, rel=1e-6)
    # A BVH file alone will do, too.
    words = ("task=export", f"run={tmp_path / 'edit' / 'edited.bvh'}", "export=glb")
    assert call(monkeypatch, tmp_path / "alone", *words) == 0
    assert (tmp_path / "alone" / "motion.glb").is_file()


@pytest.mark.few(4)
@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("task=export",), "needs run=DIR"),
        (("task=export", "run=nowhere", "export=glb"), "run=nowhere: there is no such folder"),
        (("task=export", "run=EMPTY", "export=glb"), "holds no motion"),
        (("task=export", "run=RUN"), "needs export=[...]"),
        (("task=export", "run={a: 1}", "export=glb"), "run must be a folder"),
        (("task=export", "run=RUN/metrics.json", "export=glb"), "BVH and NPZ files"),
        (("task=export", "run=RUN", "export=gbl"), "Unknown export 'gbl': choose one of apng, blendspace, bvh_blender"),
        (("task=export", "run=RUN", "export=[glb,gbl]"), "Unknown export 'gbl'"),
        (("task=export", "run=RUN", "exports.glb.fps=30"), "exports.glb is there once it is chosen: add export=[glb]"),
        (
            ("task=export", "run=RUN", "export=glb", "exports.glbb.fps=30"),
            "there is no export of that name. Did you mean",
        ),
        (
            ("task=export", "run=RUN", "export=glb", "exports.qq.fps=30"),
            "exports.qq: there is no export of that name. py",
        ),
        (
            ("task=export", "run=RUN", "export=glb", "retarget.fps=30"),
            "retarget.fps has no effect without retarget.skel",
        ),
        (
            ("task=export", "run=RUN", "export=glb", "retarget.clip=a"),
            "retarget.clip has no effect without retarget.ske",
        ),
        (("task=export", "run=RUN", "export=glb", "exports.glb.fsp=30"), "Did you mean 'exports.glb.fps'?"),
        (("task=export", "run=RUN", "export=[glb]", "exports.glb.cycles=0"), "exports.glb.cycles must lie between"),
        (("task=compare", "runs=RUN", "export=glb"), "export has no effect with task=compare"),
        (("task=export", "run=RUN", "export=glb", "retarget.skeleton=none.bvh"), "none.bvh"),
    ],
)
def test_what_cannot_be_gets_one_sentence_and_leaves_nothing(
    words: tuple[str, ...],
    message: str,
    finished: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    (tmp_path / "empty").mkdir()
    places = {"RUN": str(finished), "EMPTY": str(tmp_path / "empty")}
    for name, place in places.items():
        words = tuple(word.replace(name, place) for word in words)
    assert call(monkeypatch, tmp_path / "out", *words) == 1
    captured = capsys.readouterr()
    assert message in captured.err
    assert captured.err.count("\n") == 1
    assert "Traceback" not in captured.err
    assert not (tmp_path / "out").exists()


@pytest.mark.skipif(os.name != "posix" or os.geteuid() == 0, reason="the administrator may write everywhere")
def test_places_that_cannot_be_written(
    finished: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "shut").mkdir(mode=0o500)
    assert call(monkeypatch, tmp_path / "shut" / "out", "task=export", f"run={finished}", "export=glb") == 1
    assert "cannot be written" in capsys.readouterr().err


def test_exports_that_a_motion_does_not_allow_leave_no_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    clip = f"clip={file_of('walk', tmp_path)}"
    words = ("task=edit", clip, "target.position=[2,5]", "target.heading=90", "pictures=false")
    assert call(monkeypatch, tmp_path / "edit", *words) == 0
    words = ("task=export", f"run={tmp_path / 'edit'}", "export=[csv,glb]", "exports.glb.cycles=3")
    assert call(monkeypatch, tmp_path / "out", *words) == 1
    assert "exports.glb: cycles=3: walk_edited is no loop" in capsys.readouterr().err
    assert {path.suffix for path in (tmp_path / "out").iterdir()} == {".json", ".yaml"}  # the record, with the sentence
    assert json.loads((tmp_path / "out" / "status.json").read_text())["status"] == "failed"


def test_motions_on_another_body_are_clips_as_asked_for(
    finished: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    hero = write_rest(tmp_path / "hero.bvh", skeleton())
    words = ("task=export", f"run={finished}", f"retarget.skeleton={hero}")
    assert call(monkeypatch, tmp_path / "plain", *words) == 0
    asked = ("retarget.fps=30", "retarget.frames=exact", "retarget.root=in_place", "retarget.cycles=4")
    assert call(monkeypatch, tmp_path / "asked", *words, *asked, "retarget.mirrored=true", "retarget.clip=Run") == 0
    before, after = (read_bvh(tmp_path / name / "retargeted.bvh").clip() for name in ("plain", "asked"))
    assert after.frame_time == pytest.approx(1.0 / 30.0, abs=1e-6)
    assert after.duration == pytest.approx(4.0 * before.duration, abs=1.0 / 30.0)
    way = [clip.root_position[-1, 2] - clip.root_position[0, 2] for clip in (before, after)]
    assert float(way[0]) > 1.0
    assert abs(float(way[1])) < 0.05
    # What the left foot did the right foot does: heights, as they are at the same times.
    left, right = before.skeleton.index("mixamorig:LeftToeBase"), before.skeleton.index("mixamorig:RightToeBase")
    time = torch.arange(8) / 30.0
    ours = before.joint_positions()[(time / before.frame_time).round().long(), left, 1]
    assert float((after.joint_positions()[:8, right, 1] - ours).abs().max()) < 0.05
    assert float((after.joint_positions()[:8, left, 1] - ours).abs().max()) > 0.1


def test_what_retarget_cannot_be_is_told_by_its_name(
    finished: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    hero = write_rest(tmp_path / "hero.bvh", skeleton())
    for word, message in (("retarget.fps=0", "retarget.fps must lie"), ("retarget.cycle=2", "retarget.cycles")):
        words = ("task=export", f"run={finished}", f"retarget.skeleton={hero}", word)
        assert call(monkeypatch, tmp_path / "none", *words) != 0
        assert message in capsys.readouterr().err


def test_a_name_with_the_speed_is_that_of_the_run_on_another_body(
    finished: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    hero, body = tmp_path / "hero.glb", skeleton()
    small = type(body)(body.names, body.parents, 0.77 * body.offsets, body.end_sites)
    hero.write_bytes(armature(small))
    words = ("task=export", f"run={finished}", f"retarget.skeleton={hero}", "export=[glb]")
    names = ("retarget.clip='q_{speed}'", "exports.glb.clip='r_{speed}'")
    assert call(monkeypatch, tmp_path / "out", *words, *names) == 0
    speed = json.loads((finished / "metrics.json").read_text())["speed"]
    for file, name in (("retargeted.glb", "q"), ("motion.glb", "r")):
        clips = Gltf.of((tmp_path / "out" / file).read_bytes()).content["animations"]
        assert f"{name}_{speed:g}" in [clip["name"] for clip in clips]


@pytest.mark.parametrize("keys", [True, False])
def test_several_strides_on_another_body_are_no_blend_space_and_nothing_is_written(
    finished: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], keys: bool
) -> None:
    hero = tmp_path / "hero.glb"
    hero.write_bytes(armature(skeleton()))
    words = ("task=export", f"run={finished}", f"retarget.skeleton={hero}", "export=[html,events,blendspace]")
    more = ("retarget.keys=64",) if keys else ()
    assert call(monkeypatch, tmp_path / "out", *words, "retarget.cycles=3", *more) == 1
    said = capsys.readouterr().err
    assert "exports.blendspace is of single strides, of which retarget.cycles=3" in said
    assert ("retarget.keys" in said) is not keys
    assert not (tmp_path / "out").exists()


def test_what_cannot_be_blended_leaves_no_other_files(
    finished: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    both = f"run=[{finished},{finished}]"
    assert call(monkeypatch, tmp_path / "out", "task=export", both, "export=[html,events,blendspace]") == 1
    assert "leave one of them out" in capsys.readouterr().err
    assert not list((tmp_path / "out").glob("motion*"))


def test_the_lines_of_files_count_what_is_in_them(
    finished: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    small = ("export=[sprites,apng,frames,glb]", *(f"exports.{name}.size=16" for name in ("sprites", "apng", "frames")))
    words = ("task=export", f"run={finished}", *small, "exports.sprites.view=four")
    assert call(monkeypatch, tmp_path / "one", *words, "exports.apng.view=[front,side]") == 0
    rows: dict[str, str] = {}
    files = ("sprites.png", "motion_apng.png", "motion_frames", "motion.glb")
    for row in capsys.readouterr().out.splitlines():
        if name := next((file for file in files if f" {file} " in row), None):
            rows[name] = row.split("B ")[1].split(" at ")[0].strip()
    index = json.loads((tmp_path / "one" / "sprites.json").read_text())
    with Image.open(tmp_path / "one" / "motion_apng.png") as apng:
        pictures = apng.n_frames
    assert rows["sprites.png"] == f"{len(index['frames'])} pictures"
    assert rows["motion_apng.png"] == f"{pictures} pictures"
    assert rows["motion_frames"] == f"{len(list((tmp_path / 'one' / 'motion_frames').iterdir()))} pictures"
    # The frame on which a loop begins again is a key of clips.
    assert rows["motion.glb"].endswith("frames")
    assert call(monkeypatch, tmp_path / "two", "task=export", f"run=[{finished},{finished}]", *small[:2]) == 0
    out = capsys.readouterr().out
    index = json.loads((tmp_path / "two" / "sprites.json").read_text())
    assert f"2 motions, {len(index['frames'])} pictures" in out
    assert re.search(r"motion\.glb .* 2 motions, \d+ frames", out)
