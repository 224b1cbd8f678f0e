from __future__ import annotations

import csv
import shutil
from pathlib import Path

import pytest
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

from hopdiff.cli import main
from hopdiff.tasks.compare import as_text, find_runs
from hopdiff.types import HopdiffError


def compare(runs: Path, folder: Path, monkeypatch: pytest.MonkeyPatch) -> int:
    monkeypatch.setattr("sys.argv", ["hopdiff", "task=compare", f"runs={runs}", f"hydra.run.dir={folder}"])
    return main()


@pytest.fixture(scope="session")
def sweep(finished: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A sweep of four runs, and the run of the other tests below it."""
    folder = tmp_path_factory.mktemp("sweep")
    tiny = ("search.population=10", "budget.evaluations=40", f"hydra.sweep.dir={folder}")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("hopdiff.tasks.results.write_pictures", lambda *_: {})
        patch.setattr("hopdiff.tasks.results.write_moving", lambda *_: None)
        patch.setattr("sys.argv", ["hopdiff", "-m", "model=smooth", "search=random,ga", "beta=0.2,0.7", *tiny])
        assert main() == 0
    shutil.copytree(finished, folder / "more" / "ga")
    # A body and a hopper among the runs are passed over.
    for task in ("body", "hopper"):
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr("sys.argv", ["hopdiff", f"task={task}", "pictures=false", f"hydra.run.dir={folder / task}"])
            assert main() == 0
    return folder


def test_a_sweep_is_overlaid(
    sweep: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert compare(sweep, tmp_path / "out", monkeypatch) == 0
    rows = list(csv.DictReader((tmp_path / "out" / "compare.csv").read_text().splitlines()))
    assert len(rows) == 5
    assert sorted((row["search"], float(row["beta"])) for row in rows) == [
        ("ga", 0.2),
        ("ga", 0.5),
        ("ga", 0.7),
        ("random", 0.2),
        ("random", 0.7),
    ]
    table = capsys.readouterr().out.splitlines()
    pictures = {path.stem for path in (tmp_path / "out").glob("*.png")}
    assert {"summary", "convergence", "style"} <= pictures
    events = EventAccumulator(str(tmp_path / "out"))
    events.Reload()
    assert set(events.Tags()["images"]) == pictures
    assert table[0].split()[:4] == ["speed", "beta", "search", "model"]
    assert len(table[1].split()) == len(table[0].split())
    assert "5 runs" in table[-1]


def test_replayed_runs_compare_too(finished: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    command = ["hopdiff", "task=replay", f"genes_file={finished / 'genes.json'}", f"hydra.run.dir={tmp_path / 'runs'}"]
    monkeypatch.setattr("sys.argv", command)
    assert main() == 0
    assert compare(tmp_path / "runs", tmp_path / "out", monkeypatch) == 0
    assert "convergence.png" not in {path.name for path in (tmp_path / "out").iterdir()}


def test_a_damaged_run_is_named(
    finished: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    shutil.copytree(finished, tmp_path / "runs" / "one")
    (tmp_path / "runs" / "one" / "metrics.json").write_text("{")
    assert compare(tmp_path / "runs", tmp_path / "out", monkeypatch) == 1
    assert "one/metrics.json" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_runs_come_in_the_order_of_their_numbers(tmp_path: Path) -> None:
    for name in ("10_b", "9_a", "9_b", "1"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "metrics.json").write_text("{}")
    assert [path.name for path in find_runs(tmp_path)] == ["1", "9_a", "9_b", "10_b"]
    with pytest.raises(HopdiffError, match="is not a folder"):
        find_runs(tmp_path / "none")


def test_columns_line_up() -> None:
    assert as_text([["a", "bb"], ["1.5", "x"]]) == "  a  bb\n1.5   x"
