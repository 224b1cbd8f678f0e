from __future__ import annotations

import json
from pathlib import Path

import pytest

from hopdiff.cli import main

ABOUT_THE_SEARCH = {"evaluations", "gradient_evaluations", "invalid_fraction", "wall_seconds", "search"}


def replay(folder: Path, source: Path, monkeypatch: pytest.MonkeyPatch, *arguments: str) -> int:
    command = ["hopdiff", "task=replay", f"genes_file={source}", f"hydra.run.dir={folder}", *arguments]
    monkeypatch.setattr("sys.argv", command)
    return main()


def test_the_same_motion_comes_back(finished: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert replay(tmp_path / "again", finished / "genes.json", monkeypatch) == 0
    for name in ("motion.bvh", "motion_in_place.bvh"):
        assert (tmp_path / "again" / name).read_bytes() == (finished / name).read_bytes()
    before, after = (json.loads((folder / "metrics.json").read_text()) for folder in (finished, tmp_path / "again"))
    for name in set(before) - ABOUT_THE_SEARCH:
        same = pytest.approx(before[name], rel=1e-9) if isinstance(before[name], float) else before[name]
        assert after[name] == same, name
    assert after["evaluations"] == 0
    assert not (tmp_path / "again" / "history.csv").exists()
    assert (tmp_path / "again" / "strip.png").exists()


def test_typed_settings_win(finished: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert replay(tmp_path / "fast", finished / "genes.json", monkeypatch, "fps=120", "beta=0.3") == 0
    metrics = json.loads((tmp_path / "fast" / "metrics.json").read_text())
    assert metrics["frame_time"] == pytest.approx(1 / 120, rel=0.02)
    assert metrics["beta"] == 0.3
    assert metrics["speed"] == pytest.approx(4.0)


def test_fixed_genes_come_back(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    words = ("search=ordinary", "genes.fixed.step_width=0.2", "genes.common_eta=true", "genes.fixed.eta=7")
    monkeypatch.setattr("sys.argv", ["hopdiff", *words, "pictures=false", f"hydra.run.dir={tmp_path / 'first'}"])
    assert main() == 0
    assert replay(tmp_path / "again", tmp_path / "first" / "genes.json", monkeypatch, "pictures=false") == 0
    assert (tmp_path / "again" / "motion.bvh").read_bytes() == (tmp_path / "first" / "motion.bvh").read_bytes()
    assert json.loads((tmp_path / "again" / "metrics.json").read_text())["genes"].endswith("+eta=7+step_width=0.2")


def test_genes_that_cannot_run_leave_no_folder(
    finished: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert replay(tmp_path / "no", finished / "genes.json", monkeypatch, "costs.limits.leg_force_bw=0.5") == 1
    assert "is not a possible run with these settings: The stance leg would have to push" in capsys.readouterr().err
    assert not (tmp_path / "no").exists()
