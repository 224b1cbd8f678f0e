"""The gallery of the thesis: every experiment runs, in small, and the page tells what came out."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from hopdiff.cli import main
from hopdiff.doors import config_folder

ROOT = Path(__file__).resolve().parents[2]
NAMES = sorted(path.stem for path in (config_folder() / "experiment" / "kang1999").glob("*.yaml"))
# What makes each small enough for a test.
SEARCHED = ("search=random", "search.population=100", "budget.evaluations=300", "fps=30")
SWEPT = (*SEARCHED, "seed=0,1")
SMALL: dict[str, tuple[str, ...]] = {
    **dict.fromkeys(("fig_5_1", "fig_5_2", "fig_5_3", "fig_5_4", "fig_5_5", "fig_5_6"), SEARCHED),
    "fig_5_7": ("search=ga,random", "search.population=50", "budget.evaluations=200", "seed=0,1"),
    "eta": SWEPT,
    "fig_2_2": (*SEARCHED, "character.proportions.legs=1,1.1"),
}
BRIEF = ("fig_2_1", "fig_3_4", "fig_5_5")  # a body, a hopper and a search


@pytest.fixture(autouse=True)
def from_the_checkout(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(ROOT))


@pytest.mark.few(3)
@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[] if name in BRIEF else pytest.mark.thorough) for name in NAMES]
)
def test_every_experiment_runs_in_small(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = tmp_path / "run"
    places = (f"hydra.run.dir={folder}", f"hydra.sweep.dir={folder}")
    monkeypatch.setattr("sys.argv", ["hopdiff", f"+experiment=kang1999/{name}", *SMALL.get(name, ()), *places])
    assert main() == 0
    assert list(folder.rglob("metrics.json"))
    assert list(folder.rglob("*.png"))


def test_the_gallery_shows_every_experiment_and_takes_pictures_that_are_made() -> None:
    from experiments.kang1999.entries import ENTRIES

    shots = [shot for entry in ENTRIES for shot in entry.shots]
    assert len({shot.name for shot in shots}) == len(shots)
    used = {word.removeprefix("+experiment=kang1999/") for shot in shots for word in shot.overrides if "kang" in word}
    assert used == set(NAMES)


@pytest.mark.thorough
def test_the_gallery_is_built_from_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from experiments.kang1999.__main__ import main as build

    monkeypatch.chdir(ROOT)
    runs, out = tmp_path / "runs", tmp_path / "gallery"
    arguments = ["--figures", "3.4,3.13", "--runs", str(runs), "--out", str(out)]
    build(arguments)
    page = (out / "README.md").read_text(encoding="utf-8")
    assert "python -m hopdiff +experiment=kang1999/fig_3_4" in page
    assert "contact 0.283 s, flight 0.576 s" in page
    assert "the trunk leans" in page
    assert "right, the sound leg's side" in page
    assert {path.name for path in (out / "pictures").iterdir()} == {
        "fig_3_4.png",
        "fig_3_13.png",
        "fig_3_13_smooth.png",
    }
    # What is there is not made again, and the page follows the numbers of the folders.
    numbers = json.loads((runs / "fig_3_4" / "metrics.json").read_text())
    (runs / "fig_3_4" / "metrics.json").write_text(json.dumps(numbers | {"contact_time": 0.111}))
    build(arguments)
    assert "contact 0.111 s" in (out / "README.md").read_text(encoding="utf-8")


def test_the_gallery_names_an_unknown_figure(capsys: pytest.CaptureFixture[str]) -> None:
    from experiments.kang1999.__main__ import main as build

    with pytest.raises(SystemExit):
        build(["--figures", "9.9"])
    assert "no figure 9.9" in capsys.readouterr().err
