"""The studies of path editing, in small: they need no captured clips."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from experiments.bvh_reading import body
from experiments.edits.asks import KINDS, NOT_YET
from hopdiff.cli import main
from hopdiff.doors import config_folder
from tests.people import CAPTURED, file_of

ROOT = Path(__file__).resolve().parents[2]
NAMES = sorted(path.stem for path in (config_folder() / "experiment" / "kim2021").glob("*.yaml"))
SMALL = ("search=ordinary", "fps=30", "edit.strides=3")
PAPER = ("fig_4a", "fig_4b")
BRIEF = ("fig_4b",)  # of all experiments


@pytest.fixture(autouse=True)
def from_the_checkout(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(ROOT))


@pytest.mark.parametrize(
    "name",
    [pytest.param(name, marks=[] if name in BRIEF else pytest.mark.thorough) for name in NAMES if name != "fig_6"],
)
def test_every_experiment_runs_on_a_run_of_our_own(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    arguments = [f"+experiment=kim2021/{name}", *SMALL, f"hydra.run.dir={tmp_path / 'run'}"]
    monkeypatch.setattr("sys.argv", ["hopdiff", *arguments])
    assert main() == 0
    numbers = json.loads((tmp_path / "run" / "metrics.json").read_text())
    assert numbers["variant"] == ("paper" if name in PAPER or name.startswith("table_1") else "hopdiff")
    assert numbers["converged"] is (name != "fig_4a")
    assert list((tmp_path / "run").glob("*.png"))


@pytest.mark.thorough
def test_the_gallery_is_built_without_captured_clips(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    from experiments.kim2021.__main__ import main as build

    monkeypatch.chdir(ROOT)
    places = ["--runs", str(tmp_path / "runs"), "--out", str(tmp_path / "gallery")]
    build(["--figures", "2", *places, "--set", *SMALL])
    page = (tmp_path / "gallery" / "README.md").read_text(encoding="utf-8")
    assert "python -m hopdiff +experiment=kim2021/fig_2a clip=walk_straight_cmu_16_15.bvh" in page
    assert "`fig_2b`: 1 round, 0.00 mm" in page
    assert {path.name for path in (tmp_path / "gallery" / "pictures").iterdir()} == {"fig_2a.png", "fig_2b.png"}
    assert "1 figures from 4 commands" in capsys.readouterr().out


def test_the_gallery_shows_every_experiment() -> None:
    from experiments.kim2021.entries import ENTRIES

    words = [word for entry in ENTRIES for shot in entry.shots for word in shot.overrides]
    assert {word.rpartition("/")[2] for word in words if word.startswith("+experiment")} == set(NAMES)


def test_rows_of_table_1_take_the_rounds_of_the_paper_with_one_alpha(tmp_path: Path) -> None:
    from experiments.kim2021.table_1 import ALPHA, ROWS, edited, path_of

    for row in ROWS:
        path, frame_time = path_of(row, _clips_of_table_1(tmp_path))
        assert path.frames == row.count == (100 if "straight" in row.name else 450)
        found = edited(row, path, frame_time, "paper, theta the turn", ALPHA)
        assert found.converged
        assert found.rounds == row.rounds
        eased = edited(row, path, frame_time, "the same with a B-spline", ALPHA)
        assert eased.converged


def _clips_of_table_1(folder: Path) -> Path:
    """The captured clips, or a walk that is made in their place, under their names."""
    from experiments.kim2021.table_1 import ROWS

    if all((CAPTURED / row.clip).is_file() for row in ROWS):
        return CAPTURED
    for row in ROWS[::2]:
        file_of("walk", folder).rename(folder / row.clip)
    return folder


def test_the_study_of_edits_prints_its_tables(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    from experiments.edits.__main__ import main as study

    runs = tmp_path / "runs"
    study(["--frames", "50,100", "--rounds", "1", "--out", str(tmp_path), "--runs", str(runs), "--pictures", "1"])
    text = (tmp_path / "results.md").read_text()
    assert "| 0.3 | 21 | 21 |" in text
    assert text.count("| run of our own |") == len(KINDS) - len(NOT_YET) + 1
    assert text.count("\n| all | 11 |") == 1
    lines = {line.split("|")[1].strip(): line for line in text.splitlines() if line.startswith("| ")}
    assert {"50", "100", *KINDS} - set(NOT_YET) <= set(lines)
    assert capsys.readouterr().out.strip().endswith(text.strip())
    assert (runs / "worst_01.png").stat().st_size > 10_000


def test_an_edit_that_the_command_refuses_does_not_pass(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    from experiments.edits.asks import Ask
    from experiments.edits.study import study, totals, tried

    source = body(file_of("walk", tmp_path))
    result = tried(tmp_path / "walk.bvh", source, "position", Ask(("target.position=3",), ()), tmp_path / "run")
    assert not result.passed
    assert result.words() == "refused"
    assert "target.position" in " ".join(result.said)
    assert totals([result], lambda one: one.kind) == [("position", "1", "0", "0 %", "0", "refused 1")]
    (tmp_path / "torn.bvh").write_text("HIERARCHY\nROOT hips\n{")
    torn = study([tmp_path / "torn.bvh"], tmp_path / "runs", ["position", "curve"])
    assert [one.words() for one in torn] == ["refused", "refused"]
    assert "no well-formed BVH file" in torn[0].said[0]
