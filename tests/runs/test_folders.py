from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hopdiff.runs.folders import find_runs, read_run, survey, with_history
from hopdiff.types import HopdiffError
from tests.runs.run_folders import make_failed, make_run, state


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return make_run(tmp_path / "run", cost=0.2, status=state(overrides=["search=ga", "seed=0"]))


def test_a_run_is_read(folder: Path) -> None:
    read = read_run(folder)
    assert (read.label, read.status, read.sentence, read.task) == ("run", "complete", None, "run")
    assert read.metrics["cost"] == 0.2
    assert read.settings["search.population"] == 100
    assert read.typed == {"search": "ga", "seed": 0}
    history = with_history(read).history
    np.testing.assert_array_equal(history["spent"], [100, 200, 300])
    np.testing.assert_array_equal(history["best"], [3, 2, 1])


def test_a_history_may_begin_without_a_possible_run(folder: Path) -> None:
    (folder / "history.csv").write_text("step,spent,median,best\n0,10.0,nan,inf\n1,20.0,1.0,0.5\n")
    np.testing.assert_array_equal(with_history(read_run(folder)).history["best"], [np.inf, 0.5])


def test_a_replay_has_no_history(folder: Path) -> None:
    (folder / "history.csv").unlink()
    read = with_history(read_run(folder))
    assert (read.status, read.history) == ("complete", {})


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("metrics.json", "[1]", "metrics.json does not hold"),
        ("metrics.json", "{", "metrics.json, line 1"),
        ("metrics.json", '{"speed": 3.0}', "metrics.json lacks 'beta'"),
        ("metrics.json", None, "metrics.json is missing"),
        (
            "metrics.json",
            '{"speed": "fast", "beta": 0, "search": "ga", "cost": 1, "energy_rate": 1, "energy_target": 1}',
            "metrics.json: 'speed' must be a number, not 'fast'",
        ),
        ("status.json", "{", "status.json, line 1"),
        ("status.json", '{"status": "done", "task": "run"}', "status.json: 'done' is no status"),
        ("config.yaml", "speed: [", "config.yaml, line 2: not YAML"),
        ("config.yaml", None, "config.yaml is missing"),
        ("history.csv", "", "history.csv is not the history"),
        ("history.csv", "step,spent,best\n", "history.csv is not the history"),
        ("history.csv", "step,best\n0,1\n", "history.csv is not the history"),
        ("history.csv", "step,spent,best\n0,1,2\n1,2\n", "history.csv, line 3"),
        ("history.csv", "step,spent,best\n0,1,two\n", "history.csv, line 2"),
        ("history.csv", "step,spent,best,gamma\n0,1,2\n", "history.csv, line 2: not 4 numbers"),
    ],
)
def test_a_damaged_file_is_named(folder: Path, name: str, text: str | None, message: str) -> None:
    (folder / name).unlink() if text is None else (folder / name).write_text(text)
    read = with_history(read_run(folder))
    assert read.status == "broken"
    assert read.sentence is not None
    assert message in read.sentence


def test_a_run_of_an_older_version_is_complete(folder: Path) -> None:
    (folder / "status.json").unlink()
    (folder / "versions.json").write_text(json.dumps({"command": ["search.population=20"]}))
    read = read_run(folder)
    assert (read.status, read.typed) == ("complete", {"search.population": 20})


def test_an_interrupted_run_keeps_its_numbers_and_notes(tmp_path: Path) -> None:
    notes: list[Any] = [{"flag": "energy_off_target", "sentence": "Energy 9 % off."}, "?"]
    read = read_run(make_run(tmp_path / "run", status=state("interrupted", notes=notes)))
    assert (read.status, read.notes, read.metrics["cost"]) == ("interrupted", ("energy_off_target",), 1.0)


def test_a_failed_job_has_what_was_typed(tmp_path: Path) -> None:
    read = read_run(make_failed(tmp_path / "run", "No run at 0.2 m/s.", ("speed=0.2", "search=ga")))
    assert (read.status, read.sentence, read.whole) == ("failed", "No run at 0.2 m/s.", False)
    assert read.settings == {"speed": 0.2, "search.name": "ga"}


def test_the_name_of_an_experiment_is_kept(tmp_path: Path) -> None:
    run = make_run(tmp_path / "run", status=state(overrides=["+experiment=brisk", "seed=0"]))
    assert read_run(run).settings["experiment"] == "brisk"


def test_folders_of_other_tasks_are_told_by_task(tmp_path: Path) -> None:
    make_run(tmp_path / "10_b")
    make_run(tmp_path / "9_a", {"task.name": "replay"})
    make_run(tmp_path / "more" / "path", status=state(task="path"))
    make_run(tmp_path / "edit", {"task.name": "edit"})
    make_run(tmp_path / "hopper", status=state(task="hopper"))
    make_failed(tmp_path / "failed")
    (tmp_path / "old" / "body").mkdir(parents=True)
    (tmp_path / "old" / "body" / "metrics.json").write_text('{"mass": 70.0}')
    (tmp_path / ".hidden").mkdir()
    (tmp_path / ".hidden" / "metrics.json").write_text("{}")
    found = survey(tmp_path)
    assert [record.label for record in found.runs] == ["9_a", "10_b", "failed", "more/path"]
    assert found.foreign == {"edit": ["edit"], "hopper": ["hopper"], "unknown": ["old/body"]}


def test_the_folder_itself_may_be_the_run(folder: Path) -> None:
    assert [record.label for record in survey(folder).runs] == ["run"]


def test_motions_come_in_the_order_of_their_numbers(tmp_path: Path) -> None:
    for name in ("10_b", "9_a", "9_b", "1", "body", "hopper"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "metrics.json").write_text("{}")
    (tmp_path / "body" / "body.csv").touch()
    (tmp_path / "hopper" / "frames.csv").touch()
    make_failed(tmp_path / "failed")
    assert [path.name for path in find_runs(tmp_path)] == ["1", "9_a", "9_b", "10_b"]
    with pytest.raises(HopdiffError, match="is not a folder"):
        find_runs(tmp_path / "none")
    with pytest.raises(HopdiffError, match="holds no run"):
        find_runs(tmp_path / "failed")
