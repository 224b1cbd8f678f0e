from __future__ import annotations

import json
import math
from pathlib import Path

import pytest
import shapely
import torch

from hopdiff.cli import main
from hopdiff.composing import compose
from hopdiff.config import checked
from hopdiff.doors import TASKS, config_folder
from hopdiff.editing.root_path import root_path
from hopdiff.graph.body import Inside
from hopdiff.graph.scene import Scene
from hopdiff.graph.scene_file import read_scene
from hopdiff.io.bvh import read_bvh, write_bvh
from hopdiff.tasks.navigate import ground_of, scene_file
from hopdiff.tasks.navigate_join import inside_said
from hopdiff.terrain.ground import Ground
from tests.editing.walks import stride
from tests.graph.walkers import moved
from tests.io.bvh_files import simple_positions
from tests.people import file_of
from tests.tasks.writings import below

RECORD = {"config.yaml", "status.json", "versions.json", "git.json"}
FILES = {"walk.bvh", "motion.npz", "rooms.png", "strip.png", "metrics.json", *RECORD}

HILL = """\
rooms: {hall: [[0, 0], [9, 0], [9, 9], [0, 9]]}
ground: {kind: slope, angle: 30}
"""


def command(monkeypatch: pytest.MonkeyPatch, folder: Path, *arguments: str) -> int:
    monkeypatch.setattr("sys.argv", ["hopdiff", "+experiment=navigate", *arguments, f"hydra.run.dir={folder}"])
    return main()


@pytest.fixture(scope="module", params=["wander", "wander_snu_93s_30hz"])
def clip(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return file_of(request.param, tmp_path_factory.mktemp("clip"))


@pytest.mark.few(3)
@pytest.mark.parametrize(
    ("scene", "words", "goal"),
    [
        ("two_rooms", (), (2.4, 7.3, -30.0)),
        ("two_rooms", ("start=[1,3,0]", "goal=[3.5,6,90]"), (3.5, 6.0, 90.0)),
        ("flat", ("pictures=false",), (8.2, 8.8, 0.0)),
    ],
)
def test_a_walk_leads_through_the_rooms(
    scene: str,
    words: tuple[str, ...],
    goal: tuple[float, float, float],
    clip: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    folder = tmp_path / "run"
    assert command(monkeypatch, folder, f"clips=[{clip}]", f"scene={scene}", *words) == 0
    made = {path.name for path in folder.iterdir() if "tfevents" not in path.name}
    assert made == (FILES if "pictures=false" not in words else FILES - {"rooms.png", "strip.png"})
    path = root_path(read_bvh(folder / "walk.bvh").clip())
    x, z, heading = goal
    assert path.place[-1].tolist() == pytest.approx([x, z], abs=1e-3)
    assert math.remainder(float(path.yaw[-1]) - math.radians(heading), math.tau) == pytest.approx(0.0, abs=2e-3)
    numbers = json.loads((folder / "metrics.json").read_text())
    assert numbers["clearance"] >= 0.25
    assert 0.0 <= numbers["body_depth"] <= 0.01
    assert numbers["gap"] <= 0.5
    assert numbers["gap_deg"] <= 45.0
    step = path.place.diff(dim=0).norm(dim=-1)
    assert float(step.max()) < 0.1  # no jump from piece to piece


@pytest.mark.few(2)
def test_the_same_settings_give_the_same_walk(clip: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("a", "b"):
        assert command(monkeypatch, tmp_path / name, f"clips=[{clip}]", "pictures=false") == 0
    assert (tmp_path / "a" / "walk.bvh").read_bytes() == (tmp_path / "b" / "walk.bvh").read_bytes()


@pytest.mark.few(4)
@pytest.mark.parametrize(
    ("words", "said"),
    [
        ((), "task=navigate needs clips=[FILE,...]"),
        (("clips=[none.bvh]",), "cannot read none.bvh"),
        (("clips=[CLIP]", "scene=three_rooms"), "Unknown scene 'three_rooms': choose one of flat, two_rooms."),
        (("clips=[CLIP]", "scene=none.yaml"), "cannot read none.yaml"),
        (("clips=[CLIP]", "goal=kitchen"), "scene two_rooms has no place 'kitchen'"),
        (("clips=[CLIP]", "goal=[1,2]"), "goal must be the name of a place in the scene or [x, z, heading in degrees]"),
        (("clips=[CLIP]", "start=[1,nan,0]"), "start must be the name of a place"),
        (("clips=[CLIP]", "start=[0.4,0.9,0]"), "the start [0.4, 0.9] lies inside furniture 'chair'."),
        (("clips=[CLIP]", "goal=[4.49,6,0]"), "goal"),
        (("clips=[CLIP]", "goal=[9,9,0]"), "goal"),
        (("clips=[CLIP]", "scene=HILL", "start=[1,1,0]"), "scene hill: ground.angle must lie between -20 and 20"),
        (("clips=[CLIP]", "scene=HILL", "ground=slope", "ground.angle=21"), "ground.angle must lie between -20 and 20"),
        (("clips=[CLIP]", "way.weight=0.5"), "way.weight must be 1 or more, not 0.5."),
        (("clips=[CLIP]", "graph.threshold=0"), "graph.threshold must be a number of metres above 0, not 0."),
        (("clips=[CLIP]", "start=[2,2,0]", "goal=[3.5,6,0]", "way.half_width=0.7"), "no way leads from the start"),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, tuple) else "",
)
def test_bad_input_is_one_sentence_and_leaves_nothing(
    words: tuple[str, ...],
    said: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    write_bvh(tmp_path / "run.bvh", stride())
    monkeypatch.chdir(tmp_path)
    (tmp_path / "hill.yaml").write_text(HILL)
    given = [word.replace("CLIP", "run.bvh").replace("HILL", "hill.yaml") for word in words]
    assert command(monkeypatch, tmp_path / "out" / "run", *given) == 1
    told = capsys.readouterr().err
    assert said in told
    assert told.startswith("hopdiff: ")
    assert len(told.splitlines()) == 1
    assert not (tmp_path / "out").exists()


def test_a_chosen_ground_goes_before_that_of_the_scene() -> None:
    high = torch.tensor([0.0, 5.0])
    scene = Scene("hill", {}, ground={"kind": "slope", "angle": 5.0, "start": [0, 0]})
    assert float(ground_at(scene).height(high)) == pytest.approx(5.0 * math.tan(math.radians(5.0)))
    typed = ground_at(scene, "ground=slope", "ground.angle=9")
    assert float(typed.height(high)) == pytest.approx(4.0 * math.tan(math.radians(9.0)))
    assert ground_at(scene, "ground=flat").flat
    assert ground_at(Scene("level", {})).flat


def test_only_the_walk_between_two_clips_is_kept_out_of_walls(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The clip before comes in right through the wall."""
    own = file_of("wander", tmp_path)
    walk = read_bvh(own)
    first = walk.clip().part(slice(0, 61))
    path = root_path(first)
    turn = math.radians(90.0) - float(path.yaw[-1])
    turned = moved(first, 0.0, 0.0, turn)
    x, z = root_path(turned).place[-1].tolist()
    first = moved(turned, 0.5 - x, 2.5 - z, 0.0)
    assert float(first.root_position[:, 0].min()) < -0.3
    walk.with_motion(first).write(tmp_path / "first.bvh")
    folder = tmp_path / "run"
    words = (f"clips=[{own}]", f"before={tmp_path / 'first.bvh'}", "pictures=false")
    assert command(monkeypatch, folder, *words) == 0
    clip = read_bvh(folder / "walk.bvh").clip()
    everything = torch.cat([clip.joint_positions(), *(end[:, None] for end in clip.end_positions().values())], dim=1)
    outside = shapely.distance(
        read_scene(scene_file("two_rooms", config_folder() / "scenes")).free(),
        shapely.points(everything[..., [0, 2]].numpy()),
    )
    assert outside[:61].max() > 0.3
    depth = json.loads((folder / "metrics.json").read_text())["body_depth"]
    assert depth == pytest.approx(outside[61:].max(), abs=1e-5)
    assert depth < 0.3


def test_a_walk_is_told_to_be_in_a_wall() -> None:
    assert inside_said(Inside(0.01, 7, "LeftHand", "a wall")) == []
    said = inside_said(Inside(0.034, 7, "LeftHand", "furniture 'bed'"))
    assert said == ["LeftHand is 3.4 cm inside furniture 'bed' in frame 7."]


def ground_at(scene: Scene, *words: str) -> Ground:
    """The ground of task=navigate with these words."""
    config = compose(["task=navigate", *words])
    call = TASKS.load("navigate").call(config, checked(config), Path(), list(words))
    return ground_of(call, scene)


def test_hips_below_a_root_that_stands_still_are_led(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    text = file_of("wander", tmp_path).read_text()
    (tmp_path / "below.bvh").write_text(below(text, ("Root", "Xposition Yposition Zposition Yrotation", "0 0 0 0")))
    folder = tmp_path / "run"
    assert command(monkeypatch, folder, f"clips=[{tmp_path / 'below.bvh'}]", "goal=[3.5,6,90]", "pictures=false") == 0
    names, places, _ = simple_positions((folder / "walk.bvh").read_text())
    assert names[:2] == ["Root", "Hips"]
    assert places[-1, 1, [0, 2]] / 100.0 == pytest.approx([3.5, 6.0], abs=1e-3)
    assert not places[:, 0].any()
    notes = json.loads((folder / "status.json").read_text())["notes"]
    assert [note["sentence"][:38] for note in notes] == ["below.bvh: the way is that of joint 'H"]
    assert "note      below.bvh: the way is that of joint 'Hips'" in capsys.readouterr().out
