from __future__ import annotations

import json
import math
import re
import shutil
from pathlib import Path

import pytest
import torch
from PIL import Image

from hopdiff.cli import main
from hopdiff.editing.root_path import root_path
from hopdiff.export.tables import read_npz
from hopdiff.io.bvh import read_bvh, write_bvh
from tests.editing.walks import stride
from tests.people import file_of

FILES = {"edited.bvh", "metrics.json", "config.yaml", "status.json", "versions.json", "git.json"}
PICTURES = {"path.png", "strip.png", "feet.png"}
# A run of our own is made from the ordinary genes: no search, no luck.
OWN = ("search=ordinary", "fps=30", "edit.strides=4")


def command(monkeypatch: pytest.MonkeyPatch, folder: Path, *arguments: str) -> int:
    monkeypatch.setattr("sys.argv", ["hopdiff", "+experiment=edit", *arguments, f"hydra.run.dir={folder}"])
    return main()


def metrics(folder: Path) -> dict:
    return json.loads((folder / "metrics.json").read_text())


@pytest.fixture
def walk(tmp_path: Path) -> Path:
    """A clip of our own as a file: one stride in centimetres."""
    write_bvh(tmp_path / "walk.bvh", stride(), order="XYZ", unit=100.0)
    return tmp_path / "walk.bvh"


def test_a_run_of_our_own_is_led_to_a_target(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "run"
    assert command(monkeypatch, folder, "model=smooth", *OWN, "target.position=[1.0,7.0]", "target.heading=90") == 0
    assert {path.name for path in folder.iterdir() if "tfevents" not in path.name} == FILES | PICTURES | {"motion.npz"}
    assert list(folder.glob("*tfevents*"))
    edited = root_path(read_bvh(folder / "edited.bvh").clip())
    assert edited.place[-1].tolist() == pytest.approx([1.0, 7.0], abs=1e-3)
    assert math.degrees(float(edited.yaw[-1])) == pytest.approx(90.0, abs=0.1)
    assert edited.place[0].tolist() == pytest.approx([0.0, 0.0], abs=1e-6)
    found = metrics(folder)
    assert (found["repeats"], found["converged"], found["start_moved"]) == (4, True, 0.0)
    assert found["slide_speed_cleaned"] < found["slide_speed_source"] + 0.02 < found["slide_speed_edited"]
    for name in PICTURES:
        with Image.open(folder / name) as picture:
            assert min(picture.size) > 300
    assert "edited    1 frame bound" in capsys.readouterr().out


@pytest.mark.parametrize("model", ["smooth", "body"])
def test_a_run_of_our_own_keeps_the_contacts_that_it_was_made_with(
    model: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Through an edit of its file, too, and into what exports begin with."""
    words = ("hopdiff", f"model={model}", "search=ordinary", "pictures=false", "fps=60")
    monkeypatch.setattr("sys.argv", [*words, f"hydra.run.dir={tmp_path / 'run'}"])
    assert main() == 0
    made = read_npz(tmp_path / "run" / "motion.npz")
    clip = f"clip={tmp_path / 'run' / 'motion.bvh'}"
    for name, source in (("again", clip), ("found", f"clip={copied(tmp_path)}")):
        assert command(monkeypatch, tmp_path / name, source, "target.position=[0.2,1.5]", "pictures=false") == 0
    kept = read_npz(tmp_path / "again" / "motion.npz")
    assert made.contact is not None
    assert kept.contact is not None
    assert bool(made.contact.any())
    assert torch.equal(kept.contact, made.contact)
    assert kept.name == "motion_edited"
    # A copy that lies elsewhere is only a clip, of which contacts are found.
    assert not (tmp_path / "found" / "motion.npz").exists()


def copied(folder: Path) -> Path:
    """A run's motion without what lies beside it."""
    (folder / "elsewhere").mkdir()
    return shutil.copy(folder / "run" / "motion.bvh", folder / "elsewhere" / "motion.bvh")


def test_a_file_keeps_all_that_is_not_edited(walk: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = tmp_path / "run"
    wishes = "constraints=[{frame: 20, heading: free, position: [0.2, 1.0]}, {frame: -1, position: [0.5, 1.9]}]"
    assert command(monkeypatch, folder, f"clip={walk}", wishes, "pictures=false") == 0
    before, after = read_bvh(walk), read_bvh(folder / "edited.bvh")
    assert after.joints == before.joints
    assert (after.frames, after.frame_time) == (before.frames, before.frame_time)
    assert after.unit == before.unit == pytest.approx(0.01)
    path = root_path(after.clip())
    assert path.place[20].tolist() == pytest.approx([0.2, 1.0], abs=1e-3)
    assert path.place[-1].tolist() == pytest.approx([0.5, 1.9], abs=1e-3)
    arms = [k for k, joint in enumerate(before.joints) if "shoulder" in joint.name or "elbow" in joint.name]
    own = [3 + 3 * k + axis for k in arms for axis in range(3)]
    assert torch.equal(after.values[:, own], before.values[:, own])


def test_asking_for_what_is_there_gives_the_file_again(
    walk: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    x, z = root_path(read_bvh(walk).clip()).place[-1].tolist()
    folder = tmp_path / "run"
    assert command(monkeypatch, folder, f"clip={walk}", f"target.position=[{x!r},{z!r}]", "pictures=false") == 0
    assert torch.equal(read_bvh(folder / "edited.bvh").values, read_bvh(walk).values)


def test_a_loop_is_laid_along_a_curve_as_often_as_it_fits(
    walk: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "run"
    assert command(monkeypatch, folder, f"clip={walk}", "path.points=[[0,0],[2,5],[0,10]]", "pictures=false") == 0
    path = root_path(read_bvh(folder / "edited.bvh").clip())
    found = metrics(folder)
    way = root_path(stride()).place
    assert found["repeats"] == round(10.9 / float((way[-1] - way[0]).norm()))
    assert 0.8 < found["stretch"] < 1.25
    assert path.place[0].tolist() == pytest.approx([0.0, 0.0], abs=0.05)
    assert path.place[-1].tolist() == pytest.approx([0.0, 10.0], abs=0.05)
    assert float(path.place[:, 0].max()) == pytest.approx(2.0, abs=0.1)


def test_the_paper_s_variant(walk: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    words = ("edit.variant=paper", "target.position=[0.3,1.8]", "target.heading=20", "pictures=false", "edit.repeat=2")
    assert command(monkeypatch, tmp_path / "run", f"clip={walk}", *words, "edit.epsilon=0.001") == 0
    found = metrics(tmp_path / "run")
    assert (found["variant"], found["converged"]) == ("paper", True)
    assert found["error_place"] < 0.001


def test_the_paper_s_variant_raises_the_body_where_asked_and_feet_stay_down(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = file_of("walk", tmp_path)
    words = (f"clip={file}", "edit.variant=paper", "target.position=[0.1,0]", "target.relative=true", "pictures=false")
    clips = {}
    for rise in ("null", "0.04"):
        assert command(monkeypatch, tmp_path / rise, *words, f"edit.rise={rise}") == 0
        clips[rise] = read_bvh(tmp_path / rise / "edited.bvh").clip()
    up = (clips["0.04"].root_position - clips["null"].root_position)[:, 1]
    assert float(up[0]) == pytest.approx(0.0, abs=1e-5)
    assert float(up[-1]) == pytest.approx(0.04, abs=1e-4)
    assert 0.01 < float(up[len(up) // 2]) < 0.03
    assert metrics(tmp_path / "0.04")["foot_float"] < 0.01


def test_feet_may_be_found_over_the_whole_clip(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    words = (f"clip={file_of('walk', tmp_path)}", "target.position=[0.3,0]", "target.relative=true", "pictures=false")
    found = {}
    for by in ("fast", "optimised"):
        assert command(monkeypatch, tmp_path / by, *words, f"edit.feet_by={by}") == 0
        found[by] = read_bvh(tmp_path / by / "edited.bvh").clip().joint_positions()
        assert metrics(tmp_path / by)["slide_speed_cleaned"] < metrics(tmp_path / by)["slide_speed_source"] + 0.02
    assert 0.005 < float((found["fast"] - found["optimised"]).norm(dim=-1).max()) < 0.3


def test_a_part_of_a_clip_is_edited(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = file_of("walk", tmp_path)
    whole = read_bvh(file).clip()
    words = (f"clip={file}", "target.position=[0.1,0]", "target.relative=true", "pictures=false", "edit.repeat=1")
    for frames, first in (("[20,119]", 20), ("[-100,-1]", whole.frames - 100)):
        folder = tmp_path / str(first)
        assert command(monkeypatch, folder, *words, f"edit.frames={frames}") == 0
        part = read_bvh(folder / "edited.bvh").clip()
        assert part.frames == metrics(folder)["frames"] == 100
        assert (part.joint_positions()[0] - whole.joint_positions()[first]).abs().max() < 1e-4


def test_nothing_asked_is_an_eighth_of_a_turn(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert command(monkeypatch, tmp_path / "run", *OWN, "pictures=false") == 0
    path = root_path(read_bvh(tmp_path / "run" / "edited.bvh").clip())
    assert math.degrees(float(path.yaw[-1] - path.yaw[0])) == pytest.approx(45.0, abs=1.0)
    x, z = (path.place[-1] - path.place[0]).tolist()
    assert x == pytest.approx(z, rel=0.01)


def test_a_target_out_of_reach_is_refused_with_the_way_that_is_possible(
    walk: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert command(monkeypatch, tmp_path / "run", f"clip={walk}", "target.position=[1000,4000]") == 1
    said = capsys.readouterr().err
    assert "frame 73 cannot be at [1000, 4000]" in said
    most = float(re.search(r"can get ([0-9.]+) m far", said)[1])  # type: ignore[index]
    assert not (tmp_path / "run" / "edited.bvh").exists()
    possible = f"target.position=[0,{0.9 * most:.1f}]"
    assert command(monkeypatch, tmp_path / "run", f"clip={walk}", possible, "pictures=false") == 0
    told = capsys.readouterr().out
    assert "times as long in the same time" in told
    assert "as fast as anything in the clip" in told
    assert metrics(tmp_path / "run")["error_place"] < 1e-3


THING = """HIERARCHY
ROOT a
{
  OFFSET 0 0 0
  CHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation
  JOINT b
  {
    OFFSET 0 1 0
    CHANNELS 3 Zrotation Xrotation Yrotation
    End Site
    {
      OFFSET 0 1 0
    }
  }
}
MOTION
Frames: 4
Frame Time: 0.1
0 1 0 0 0 0 0 0 0
0 1 1 0 0 0 0 0 0
0 1 2 0 0 0 0 0 0
0 1 3 0 0 0 0 0 0
"""


def test_a_thing_without_feet_is_moved_and_says_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "thing.bvh").write_text(THING)
    words = (f"clip={tmp_path / 'thing.bvh'}", "edit.unit=m", "target.position=[1,3]")
    assert command(monkeypatch, tmp_path / "run", *words) == 0
    assert "no legs were found in the skeleton" in capsys.readouterr().out
    assert not (tmp_path / "run" / "feet.png").exists()
    assert root_path(read_bvh(tmp_path / "run" / "edited.bvh", 1.0).clip()).place[-1].tolist() == pytest.approx([1, 3])


@pytest.mark.few(4)
@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("clip=none.bvh",), "none.bvh"),
        (("clip=WALK", "target.position=[1]"), "target.position must be two finite numbers [x, z], not [1]."),
        (("clip=WALK", "target.position=[1,nan]"), "target.position must be two finite numbers"),
        (
            ("clip=WALK", "target.heading=north"),
            "target.heading must be a number of degrees, keep or free, not 'north'.",
        ),
        (("clip=WALK", "constraints=[{frame: 1000, heading: 3}]"), "frame 1000 lies outside the clip"),
        (
            ("clip=WALK", "constraints=[{frame: 1.5, heading: 3}]"),
            "constraints[0].frame must be a whole number, not 1.5.",
        ),
        (
            ("clip=WALK", "constraints=[{frame: 3}]"),
            "constraints[0] asks for nothing: give a position, a heading, or both.",
        ),
        (("clip=WALK", "constraints=[{frame: 3, headin: 4}]"), "unknown entry 'headin'. Did you mean 'heading'?"),
        (
            ("clip=WALK", "constraints=[7]"),
            "constraints[0] must be {frame: K, position: [x, z], heading: DEGREES}, not 7.",
        ),
        (
            ("clip=WALK", "constraints=[{frame: 9, heading: 3}, {frame: 9, heading: 30}]"),
            "frame 9 shall face 3 and 30 degrees.",
        ),
        (("clip=WALK", "path.points=[[0,0],[0,9]]", "target.heading=3"), "an edit follows either a path or target"),
        (("clip=WALK", "path.points=[[0,0],[0,0]]"), "path.points: a closed path needs at least three"),
        (("clip=WALK", "edit.variant=papr"), "Did you mean 'paper'?"),
        (("clip=WALK", "edit.alpha=0"), "edit.alpha must be a number above 0, not 0."),
        (("clip=WALK", "edit.side=nan"), "edit.side must be a number above 0, not nan."),
        (("clip=WALK", "edit.repeat=0"), "edit.repeat must be from 1 to 1000, not 0."),
        (("clip=WALK", "edit.rise=0.1"), "edit.rise=0.1 goes with edit.variant=paper and must be from -1 to 1 m."),
        (("clip=WALK", "edit.feet_by=slow"), "Unknown edit.feet_by 'slow': choose one of fast, optimised."),
        (("clip=WALK", "edit.frames=[3]"), "edit.frames must be the first and the last frame, not [3]."),
        (("clip=WALK", "edit.frames=[5,6]"), "edit.frames=[5, 6] must be 3 frames at least of the clip's"),
        (("clip=WALK", "edit.frames=[0,99999]"), "edit.frames=[0, 99999] must be 3 frames at least of the clip's"),
        (("clip=WALK", "edit.joints={left_hip: tail}"), "edit.joints.left_hip: there is no joint 'tail'."),
        (("clip=WALK", "edit.unit=furlong"), "furlong"),
        (("clip=WALK", "edit.variant=paper", "constraints=[{frame: 3, heading: 4}]"), "binds the last frame alone"),
        (("clip=BROKEN",), "line 19"),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, tuple) else "",
)
def test_bad_input_is_one_sentence_and_leaves_nothing(
    words: tuple[str, ...],
    said: str,
    walk: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    broken = tmp_path / "broken.bvh"
    broken.write_text(THING.replace("0 1 0 0 0 0 0 0 0\n", "0 1 0 0 nan 0 0 0 0\n"))
    monkeypatch.chdir(tmp_path)
    given = [word.replace("WALK", str(walk)).replace("BROKEN", str(broken)) for word in words]
    assert command(monkeypatch, tmp_path / "out" / "run", *given) == 1
    told = capsys.readouterr().err
    assert said in told
    assert told.startswith("hopdiff: ")
    assert len(told.splitlines()) == 1
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    "name",
    [
        "walk without toes",
        "walk sideways",
        "run",
        "walk_straight_snu_30hz",
        "walk_sideways_snu_cross90",
        "run_cmu_16_35",
    ],
)
def test_clips_of_people(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    words = ("target.position=[0.2,-0.2]", "target.heading=60", "target.relative=true", "pictures=false")
    assert command(monkeypatch, tmp_path / "run", f"clip={file_of(name, tmp_path)}", *words) == 0
    found = metrics(tmp_path / "run")
    assert found["error_place"] < 1e-3
    assert found["error_yaw_deg"] < 0.1
    assert found["slide_speed_cleaned"] < found["slide_speed_source"] + 0.02


def test_an_edit_goes_over_uneven_ground(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    walk = file_of("walk", tmp_path)
    source = read_bvh(walk).clip()
    x, z = source.root_position[-1, [0, 2]].tolist()
    words = ("ground=slope", "ground.angle=8", "ground.start=[0,3]")
    asked = (f"clip={walk}", f"target.position=[{x!r},{z!r}]", "pictures=false")
    assert command(monkeypatch, tmp_path / "hill", *asked, *words) == 0
    assert command(monkeypatch, tmp_path / "level", *asked) == 0
    hill, level = (read_bvh(tmp_path / name / "edited.bvh").clip().root_position for name in ("hill", "level"))
    rise = math.tan(math.radians(8.0)) * (level[:, 2] - 3.0).clamp_min(0.0)
    assert (hill[:, 1] - level[:, 1] - rise).abs().max() < 0.12
    assert rise.max() > 0.5
