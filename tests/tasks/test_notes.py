"""What is said of a run that is not what was asked for."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest

import hopdiff
from hopdiff.cli import main
from hopdiff.job import Run
from hopdiff.tasks.notes import notes_of


@pytest.fixture(scope="module")
def run() -> Run:
    return hopdiff.generate(model="smooth", search="ordinary", beta=0.2)


@pytest.mark.parametrize(
    ("beta", "target", "reached", "says"),
    [
        (0.7, 2.0, 2.09, None),
        (0.7, 2.0, 1.54, "energy 23 % off its target: raise budget.evaluations or lower the speed."),
        (0.7, 2.0, 2.5, "energy 25 % off its target: raise budget.evaluations or raise the speed."),
        (0.1, 0.1, 0.2, "energy 100 % off its target: below beta 0.2 the target lies under what the body needs"),
        (0.0, 0.0, 0.2, None),
    ],
)
def test_energy_off_its_target(run: Run, beta: float, target: float, reached: float, says: str | None) -> None:
    asked = {"beta": beta, "energy_target": target, "energy_rate": reached, "evaluations": 100}
    notes = notes_of(replace(run, metrics=run.metrics | asked))
    assert [note.flag for note in notes] == ([] if says is None else ["energy_off_target"])
    assert says is None or notes[0].sentence.startswith(says)


def test_a_miss_is_printed_and_flagged(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ("model=smooth", "beta=0.8", "search=ordinary", "pictures=false", f"hydra.run.dir={tmp_path / 'run'}")
    monkeypatch.setattr("sys.argv", ["hopdiff", *words])
    assert main() == 0
    (note,) = json.loads((tmp_path / "run" / "status.json").read_text())["notes"]
    assert note["flag"] == "energy_off_target"
    assert f"note      {note['sentence']}" in capsys.readouterr().out


def test_too_few_frames_are_found_before_the_search(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def search(*_: object, **__: object) -> None:
        raise AssertionError("searched all the same")

    monkeypatch.setattr("hopdiff.job.run_search", search)
    monkeypatch.setattr("sys.argv", ["hopdiff", "model=smooth", "fps=5", f"hydra.run.dir={tmp_path / 'run'}"])
    assert main() == 1
    assert "fps=5 is too low: at this speed a stride may take" in capsys.readouterr().err
    assert not (tmp_path / "run").exists()


@pytest.mark.parametrize("evaluations", [0, 1])
def test_no_search_is_advised_where_there_was_none(run: Run, evaluations: int) -> None:
    """Of a replay, and of the ordinary genes as they are."""
    asked = {"beta": 0.7, "energy_target": 2.0, "energy_rate": 1.0, "evaluations": evaluations}
    (note,) = notes_of(replace(run, metrics=run.metrics | asked))
    assert note.sentence == "energy 50 % off its target: these genes were not searched for at this briskness."
