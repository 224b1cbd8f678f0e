"""Sweeps that end in their comparison."""

from __future__ import annotations

import csv
from pathlib import Path

import pytest

from hopdiff.cli import main

TINY = ("model=smooth", "budget.evaluations=60", "search=random", "search.population=20")


def sweep(monkeypatch: pytest.MonkeyPatch, folder: Path, *words: str) -> int:
    command = ["hopdiff", "+experiment=kang1999/eta", *TINY, f"hydra.sweep.dir={folder}", *words]
    monkeypatch.setattr("sys.argv", command)
    return main()


def rows(folder: Path) -> list[dict[str, str]]:
    return list(csv.DictReader((folder / "compare" / "comparison.csv").read_text().splitlines()))


def test_a_sweep_is_compared_and_can_be_cut(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert sweep(monkeypatch, tmp_path, "seed=3,4") == 0
    found = [(row["genes"], row["seed"]) for row in rows(tmp_path)]
    assert found == [(genes, seed) for genes in ("default", "default+common_eta") for seed in ("3", "4")]
    assert {path.stem for path in (tmp_path / "compare").glob("*.png")} == {"summary", "convergence", "scaled"}
    # pictures=false: only the comparison is drawn.
    assert not list(tmp_path.glob("[0-9]*/*.png"))
    assert not list(tmp_path.glob("[0-9]*/*.gif"))


def test_failed_jobs_are_left_out_and_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as done:
        sweep(monkeypatch, tmp_path, "speed=0.2,5", "seed=0", "genes.common_eta=false")
    assert done.value.code == 1
    assert [(row["speed"], row["status"]) for row in rows(tmp_path)] == [("0.2", "failed"), ("5.0", "complete")]
    said = capsys.readouterr().err.splitlines()
    assert said[0].startswith("hopdiff: job 0 (")
    assert "no ordinary run exists at speed=0.2" in said[0]
    assert said[1].startswith("hopdiff: 0_v0.2_beta0.5_random_seed0: no ordinary run exists at speed=0.2")
    assert said[2].startswith("hopdiff: 1 of the runs are not complete: their status.json says why.")


def test_nothing_to_compare_is_one_sentence(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as done:
        sweep(monkeypatch, tmp_path, "speed=0.2", "seed=0", "genes.common_eta=false")
    assert done.value.code == 1
    assert "holds no run" in capsys.readouterr().err.splitlines()[-1]
    assert not (tmp_path / "compare").exists()


def test_a_mistake_of_ours_is_not_swallowed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(*_: object, **__: object) -> bool:
        raise ZeroDivisionError("ours")

    monkeypatch.setattr("hopdiff.perform.perform", broken)
    with pytest.raises(ZeroDivisionError):
        sweep(monkeypatch, tmp_path, "seed=0")
