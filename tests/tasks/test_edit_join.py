"""task=edit and task=navigate with clips before and after, by the command, judged from their files."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from experiments.bvh_reading import Bvh, read
from hopdiff.cli import main
from hopdiff.geometry.clip import Clip
from hopdiff.io.bvh import read_bvh, write_bvh
from tests.joins.neighbours import laid, lie, rise, walk
from tests.people import file_of


def command(monkeypatch: pytest.MonkeyPatch, folder: Path, *arguments: str, task: str = "edit") -> int:
    words = ("hopdiff", f"+experiment={task}", *arguments, f"hydra.run.dir={folder}")
    monkeypatch.setattr("sys.argv", [*words, *(() if "pictures=true" in arguments else ("pictures=false",))])
    return main()


@pytest.fixture
def files(tmp_path: Path) -> dict[str, Path]:
    clips = {"walk": walk(), "before": laid(rise(), 50.0, 1.0, 2.0), "after": laid(lie(), 80.0, 4.8, 4.2)}
    for name, clip in clips.items():
        write_bvh(tmp_path / f"{name}.bvh", clip, unit=100.0)
    return {name: tmp_path / f"{name}.bvh" for name in clips}


def jolts(bvh: Bvh, here: slice = slice(None)) -> float:
    """Largest second difference of any joint."""
    return float(np.linalg.norm(np.diff(bvh.forward()[0][here], n=2, axis=0), axis=-1).max())


@pytest.mark.parametrize("words", [("before", "after"), ("before",), ("after",)])
def test_one_file_comes_out_with_both_clips_as_they_are(
    words: tuple[str, ...], files: dict[str, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "run"
    asked = [f"{word}={files[word]}" for word in words]
    assert command(monkeypatch, folder, f"clip={files['walk']}", *asked) == 0
    made, own = read(folder / "edited.bvh"), {name: read(path) for name, path in files.items()}
    numbers = json.loads((folder / "metrics.json").read_text())
    count = len(made.values)
    most = max(jolts(own[name]) for name in ("walk", *words))
    seams = []
    if "before" in words:
        head = len(own["before"].values)
        assert np.array_equal(made.values[:head], own["before"].values)
        seams.append(head - 1)
    if "after" in words:
        tail = len(own["after"].values)
        assert np.array_equal(made.values[-tail:], own["after"].values)
        seams.append(count - tail)
    assert numbers["seam_frames"] == seams
    for seam in seams:
        assert jolts(made, slice(max(0, seam - 20), seam + 20)) < 1.2 * most
    assert numbers["seam_acceleration_ratio"] < 1.2
    assert numbers["seam_pose_error"] < 1e-6


def test_the_strip_shows_the_seams(
    files: dict[str, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "run"
    words = (f"clip={files['walk']}", f"before={files['before']}", "pictures=true")
    assert command(monkeypatch, folder, *words) == 0
    assert (folder / "strip.png").is_file()
    assert "seams     frame 29: speed x" in capsys.readouterr().out


def test_a_target_is_met_after_a_clip(files: dict[str, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    words = (f"clip={files['walk']}", f"before={files['before']}", "target.position=[4.5,5]", "target.heading=60")
    assert command(monkeypatch, tmp_path / "run", *words) == 0
    root = read(tmp_path / "run" / "edited.bvh").forward()[0][-1, 0]
    assert root[[0, 2]] == pytest.approx([450.0, 500.0], abs=0.1)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("clip={walk}", "after={after}", "target.position=[1,4]"), "is bound, which leaves no 0.5 s"),
        (("clip={walk}", "before={before}", "ground=slope"), "joined on level ground only"),
        (("before={before}",), "before and after need clip=FILE"),
        (("clip={walk}", "before=nowhere.bvh"), "nowhere.bvh"),
    ],
)
def test_what_cannot_be_joined_is_refused_in_a_sentence(
    words: tuple[str, ...],
    said: str,
    files: dict[str, Path],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    given = [word.format(**{name: str(path) for name, path in files.items()}) for word in words]
    assert command(monkeypatch, tmp_path / "run", *given) != 0
    assert said in capsys.readouterr().err
    assert not (tmp_path / "run" / "edited.bvh").exists()


def test_a_way_goes_from_clip_to_clip(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    source = file_of("wander", tmp_path)
    file = read_bvh(source)

    def cut(name: str, first: int, count: int, at: int, degrees: float, x: float, z: float) -> Path:
        clip = laid(file.clip().part(slice(first, first + count)), degrees, 0.0, 0.0)
        here = clip.root_position[at]
        moved: Clip = laid(clip, 0.0, x - float(here[0]), z - float(here[2]))
        file.with_motion(moved).write(tmp_path / name)
        return tmp_path / name

    before = cut("before.bvh", 0, 40, -1, 20.0, 3.6, 3.3)
    after = cut("after.bvh", 100, 40, 0, 60.0, 5.0, 5.3)
    words = (f"clips=[{source}]", "scene=flat", f"before={before}", f"after={after}")
    assert command(monkeypatch, tmp_path / "run", *words, task="navigate") == 0
    made = read(tmp_path / "run" / "walk.bvh")
    assert np.array_equal(made.values[:40], read(before).values)
    assert np.array_equal(made.values[-40:], read(after).values)
    numbers = json.loads((tmp_path / "run" / "metrics.json").read_text())
    assert numbers["seam_frames"] == [39, len(made.values) - 40]
    most = jolts(read(source))
    for seam in numbers["seam_frames"]:
        assert jolts(made, slice(seam - 20, seam + 20)) < 1.5 * most
