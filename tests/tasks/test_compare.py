from __future__ import annotations

import csv
import json
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator
from tensorboard.plugins.hparams.metadata import parse_session_start_info_plugin_data

from hopdiff.cli import main
from hopdiff.tasks.compare import as_text, compare
from hopdiff.types import HopdiffError
from tests.runs.run_folders import make_failed, make_run, state


@pytest.fixture(scope="session")
def sweep(finished: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A sweep of four runs, and the run of the other tests below it."""
    folder = tmp_path_factory.mktemp("sweep")
    tiny = ("search.population=10", "budget.evaluations=40", "pictures=false", f"hydra.sweep.dir={folder}")
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


def on_command_line(runs: Path, folder: Path, monkeypatch: pytest.MonkeyPatch) -> int:
    monkeypatch.setattr("sys.argv", ["hopdiff", "task=compare", f"runs={runs}", f"hydra.run.dir={folder}"])
    return main()


def table(folder: Path) -> list[dict[str, str]]:
    return list(csv.DictReader((folder / "comparison.csv").read_text().splitlines()))


def test_a_sweep_is_overlaid(
    sweep: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert on_command_line(sweep, tmp_path / "out", monkeypatch) == 0
    rows = table(tmp_path / "out")
    assert sorted((row["search"], float(row["beta"]), row["status"]) for row in rows) == [
        ("ga", 0.2, "complete"),
        ("ga", 0.5, "complete"),
        ("ga", 0.7, "complete"),
        ("random", 0.2, "complete"),
        ("random", 0.7, "complete"),
    ]
    assert {row["model.name"] for row in rows} == {"body", "smooth"}
    said = capsys.readouterr().out.splitlines()
    pictures = {path.stem for path in (tmp_path / "out").glob("*.png")}
    assert pictures == {"summary", "convergence", "style"}
    events = EventAccumulator(str(tmp_path / "out"))
    events.Reload()
    assert set(events.Tags()["images"]) == pictures
    assert said[1].split()[:4] == ["speed", "beta", "search", "model"]
    assert all(len(line.split()) == len(said[1].replace("median cost", "cost").split()) for line in said[2:7])
    assert {"Left out: body: no run, but task=body.", "Left out: hopper: no run, but task=hopper."} <= set(said)
    assert said[-1].startswith("5 runs in 5 groups")


def test_replayed_runs_compare_too(finished: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    command = ["hopdiff", "task=replay", f"genes_file={finished / 'genes.json'}", f"hydra.run.dir={tmp_path / 'runs'}"]
    monkeypatch.setattr("sys.argv", command)
    assert main() == 0
    assert on_command_line(tmp_path / "runs", tmp_path / "out", monkeypatch) == 0
    assert "convergence.png" not in {path.name for path in (tmp_path / "out").iterdir()}


def test_populations_are_groups_and_seeds_are_not(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for k, (size, seed) in enumerate((size, seed) for size in (20, 40) for seed in (0, 1, 2)):
        make_run(tmp_path / "runs" / str(k), {"search.population": size, "seed": seed}, cost=size / 20 + seed)
    compare(tmp_path / "runs", tmp_path / "out")
    said = capsys.readouterr().out.splitlines()
    assert said[0] == "All: 5 m/s, beta 0.2, search ga, model smooth, costs default, character human, genes default."
    assert said[1].split()[:4] == ["search.population", "runs", "median", "cost"]
    assert [line.split()[:5] for line in said[2:4]] == [
        ["20", "3", "2.0000", "1.0000", "3.0000"],
        ["40", "3", "3.0000", "2.0000", "4.0000"],
    ]
    assert said[-1].startswith("6 runs in 2 groups")
    assert {path.name for path in (tmp_path / "out").glob("*.png")} == {"summary.png", "convergence.png", "scaled.png"}


def test_broken_failed_and_foreign_folders_are_left_out_and_told(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    runs = tmp_path / "runs"
    for k in range(6):
        make_run(runs / str(k), {"seed": k}, status=state())
    (runs / "1" / "metrics.json").write_text("{")
    (runs / "2" / "config.yaml").unlink()
    (runs / "3" / "history.csv").write_text("step,spent,best\n0,1,two\n")
    notes = [{"flag": "energy_off_target", "sentence": "."}]
    (runs / "4" / "status.json").write_text(json.dumps(state("interrupted", notes=notes)))
    for name in ("6", "7"):
        make_failed(runs / name, "No run at 0.2 m/s.", ("speed=0.2",))
    (runs / "8").mkdir()
    (runs / "8" / "status.json").write_text(json.dumps(state("running", ended=None)))
    make_run(runs / "edit", {"task.name": "edit"})
    make_run(runs / "compare", status=state(task="compare"))
    compare(runs, tmp_path / "out")
    said = capsys.readouterr().out
    assert "3 runs in 1 group;" in said
    told = [line.removeprefix("Left out: ") for line in said.splitlines() if line.startswith("Left out: ")]
    assert len(told) == 6
    assert "1/metrics.json, line 1: not JSON" in told[0]
    assert told[1].endswith("2/config.yaml is missing.")
    assert told[2].endswith("3/history.csv, line 2: not 3 numbers.")
    assert told[3:] == [
        "6, 7: failed (No run at 0.2 m/s).",
        "8: still running, or ended from outside.",
        "edit: no run, but task=edit.",
    ]
    assert "Noted: energy_off_target in 4." in said
    rows = table(tmp_path / "out")
    assert list(rows[0])[:6] == ["run", "status", "sentence", "notes", "speed", "seed"]
    assert [row["run"] for row in rows] == [str(k) for k in range(9)]
    states = ["complete", "broken", "broken", "broken", "interrupted", "complete", "failed", "failed", "running"]
    assert [row["status"] for row in rows] == states
    assert (rows[6]["sentence"], rows[6]["speed"], rows[6]["cost"]) == ("No run at 0.2 m/s.", "0.2", "")
    assert "history.csv" in rows[3]["sentence"]


def test_many_reasons_are_not_all_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    make_run(tmp_path / "runs" / "good")
    for k in range(30):
        make_failed(tmp_path / "runs" / f"bad{k}", f"No run at {k} m/s." if k < 15 else "Other.")
    compare(tmp_path / "runs", tmp_path / "out")
    said = [line for line in capsys.readouterr().out.splitlines() if line.startswith("Left out: ")]
    assert len(said) == 11
    assert said[-1] == "Left out: and 6 more, see comparison.csv."


def test_it_stops_only_if_nothing_is_left(tmp_path: Path) -> None:
    make_failed(tmp_path / "runs" / "0", "No run at 0.2 m/s.")
    make_run(tmp_path / "runs" / "1", status=state(task="body"))
    with pytest.raises(HopdiffError, match=r"holds no run that can be compared: 0: failed \(No run at 0.2 m/s\); 1: "):
        compare(tmp_path / "runs", tmp_path / "out")
    (tmp_path / "empty").mkdir()
    with pytest.raises(HopdiffError, match="holds no run that can be compared: there is no run folder in it"):
        compare(tmp_path / "empty", tmp_path / "out")
    with pytest.raises(HopdiffError, match=r"runs=.*nowhere is not a folder"):
        compare(tmp_path / "nowhere", tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_a_command_that_finds_nothing_ends_in_one_sentence(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    make_run(tmp_path / "runs" / "one")
    (tmp_path / "runs" / "one" / "metrics.json").write_text("{")
    assert on_command_line(tmp_path / "runs", tmp_path / "out", monkeypatch) == 1
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert "one/metrics.json" in said


def test_nothing_but_interrupted_runs_is_compared_too(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for k in range(2):
        make_run(tmp_path / "runs" / str(k), {"beta": 0.2 + k / 2}, cost=k + 1.5, status=state("interrupted"))
    compare(tmp_path / "runs", tmp_path / "out")
    said = capsys.readouterr().out.splitlines()
    assert said[1].split() == [
        "beta",
        "median",
        "cost",
        "interrupted",
        "energy",
        "target",
        "contact",
        "flight",
        "steps/s",
        "seconds",
    ]
    assert [line.split()[:3] for line in said[2:4]] == [["0.2", "1.5000", "1"], ["0.7", "2.5000", "1"]]


def test_costs_of_different_models_come_with_a_caution(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    make_run(tmp_path / "runs" / "0")
    make_run(tmp_path / "runs" / "1", {"costs.energy": 2.0})
    compare(tmp_path / "runs", tmp_path / "out")
    assert "Costs compare only where costs.energy are the same." in capsys.readouterr().out


def test_more_groups_than_one_reads_are_told_by_series(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    sizes, speeds = range(10, 90, 10), range(1, 8)
    for k, (size, speed) in enumerate((size, speed) for size in sizes for speed in speeds):
        make_run(tmp_path / "runs" / str(k), {"search.population": size, "speed": float(speed)}, cost=float(size))
    compare(tmp_path / "runs", tmp_path / "out")
    said = capsys.readouterr().out.splitlines()
    assert len(said) < 20
    assert said[1].split() == ["search.population", "runs", "problems", "best", "at", "mean", "place"]
    assert said[2].split() == ["10", "7", "7", "7", "0.00"]
    assert said[9].split() == ["80", "7", "7", "0", "1.00"]
    assert "56 groups are not listed" in said[11]


def test_of_one_problem_no_more_lines_than_one_reads(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for k in range(45):
        make_run(tmp_path / "runs" / str(k), {"search.population": k}, cost=float(k))
    compare(tmp_path / "runs", tmp_path / "out")
    said = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in said[2:42]] == [str(k) for k in range(40)]
    assert said[42] == "and 5 more: see comparison.csv."
    assert "Pictures show the 12 best of 45 series" in said[43]


def test_hparams_have_their_columns_from_a_comparison_among_the_runs(tmp_path: Path) -> None:
    words = ("search=ga", "budget.evaluations=400")
    for k, size in enumerate((20, 40)):
        typed = state(overrides=[*words, f"search.population={size}"])
        make_run(tmp_path / "runs" / str(k), {"search.population": size}, status=typed)
    tag = "_hparams_/experiment"
    for folder, expected in ((tmp_path / "runs" / "compare", True), (tmp_path / "out", False)):
        compare(tmp_path / "runs", folder)
        events = EventAccumulator(str(folder))
        events.Reload()
        plugins = events.summary_metadata
        assert (tag in plugins) == expected
        assert "_hparams_/session_start_info" not in plugins
        if expected:
            content = plugins[tag].plugin_data.content
            assert b"search.population" in content
            assert b"result/cost" in content
            assert b"budget.evaluations" not in content
            assert b"friction_needed" not in content


def test_a_run_tells_tensorboard_what_was_typed_and_what_came_out(finished: Path) -> None:
    events = EventAccumulator(str(finished))
    events.Reload()
    assert {tag.split("/")[0] for tag in events.Tags()["scalars"]} == {"search", "result"}
    metrics = json.loads((finished / "metrics.json").read_text())
    assert events.Scalars("result/cost")[0].value == pytest.approx(metrics["cost"])
    row = parse_session_start_info_plugin_data(
        events.summary_metadata["_hparams_/session_start_info"].plugin_data.content
    ).hparams
    assert (row["search"].string_value, row["search.population"].number_value) == ("ga", 40.0)
    assert "character" not in row
    # Columns are told by a comparison, once for all runs.
    assert "_hparams_/experiment" not in events.summary_metadata


def test_loading_the_task_loads_nothing_that_draws() -> None:
    code = "import sys, hopdiff.tasks.compare; print({'matplotlib', 'tensorboard'} & set(sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "set()"


def test_columns_line_up() -> None:
    assert as_text([["a", "bb"], ["1.5", "x"]]) == "  a  bb\n1.5   x"
