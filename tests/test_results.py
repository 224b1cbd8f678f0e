"""hopdiff.results: many runs as one table."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

import hopdiff
from hopdiff.runs import frame
from hopdiff.types import HopdiffError
from tests.runs.run_folders import make_failed, make_run, state

# Stands for the library, which the tests must not need.
FAKE = """
class DataFrame:
    def __init__(self, rows):
        self.rows = rows
"""


@pytest.fixture
def sweep(tmp_path: Path) -> Path:
    folder = tmp_path / "sweep"
    typed = {"overrides": ["search=ga", "beta=0.2"]}
    note = {"notes": [{"flag": "energy_off_target", "sentence": "."}, {"flag": "slow", "sentence": "."}]}
    make_run(folder / "0", {"search.population": 20}, status=state(**typed))
    make_run(
        folder / "10", {"search.population": 40, "seed": 1}, cost=0.5, status=state("interrupted", **typed, **note)
    )
    make_run(folder / "2", {"search.population": 20, "pictures": False}, status=state(**typed))
    make_failed(folder / "3", "No run at 0.1 m/s.", ("speed=0.1", "seed=7"))
    make_run(folder / "4", {"search.population": 20})
    (folder / "4" / "metrics.json").write_text("{")
    make_run(folder / "hopper", {"task.name": "hopper"})
    return folder


@pytest.fixture
def rows(sweep: Path, monkeypatch: pytest.MonkeyPatch) -> list[dict[str, Any]]:
    monkeypatch.setattr(frame, "pandas", None)
    return hopdiff.results(sweep)


def test_one_row_a_run_in_the_order_of_numbers(rows: list[dict[str, Any]]) -> None:
    assert [row["run"] for row in rows] == ["0", "2", "3", "4", "10"]
    assert [row["status"] for row in rows] == ["complete", "complete", "failed", "broken", "interrupted"]
    assert [row["cost"] for row in rows] == [1.0, 1.0, None, None, 0.5]


def test_columns_are_the_same_in_all_rows(rows: list[dict[str, Any]]) -> None:
    first = list(rows[0])
    assert first[:8] == ["run", "status", "sentence", "notes", "speed", "pictures", "search.population", "seed"]
    assert first[8:] == ["beta", "cost", *first[10:]]
    assert all(list(row) == first for row in rows)


def test_what_a_run_lacks_is_none(rows: list[dict[str, Any]]) -> None:
    failed, broken = rows[2], rows[3]
    assert (failed["sentence"], failed["speed"], failed["seed"]) == ("No run at 0.1 m/s.", 0.1, 7)
    assert failed["search.population"] is None
    assert "metrics.json" in broken["sentence"]
    assert (broken["search.population"], broken["contact_time"]) == (20, None)
    assert rows[0]["sentence"] is None


def test_notes_are_flags(rows: list[dict[str, Any]]) -> None:
    assert [row["notes"] for row in rows] == ["", "", "", "", "energy_off_target slow"]


@pytest.mark.parametrize("name", ["nowhere", "empty"])
def test_a_folder_without_runs(tmp_path: Path, name: str) -> None:
    (tmp_path / "empty").mkdir()
    with pytest.raises(HopdiffError, match=name):
        hopdiff.results(str(tmp_path / name))


@pytest.mark.parametrize("installed", [True, False])
def test_a_data_frame_where_pandas_is_installed(sweep: Path, tmp_path: Path, installed: bool) -> None:
    """In a process of its own, so that it is found as it is anywhere; and the generator need not be loaded."""
    (tmp_path / "site").mkdir()
    if installed:
        (tmp_path / "site" / "pandas.py").write_text(FAKE)
    code = f"""
import importlib.util, sys
sys.path.insert(0, {str(tmp_path / "site")!r})
if not {installed}:
    find = importlib.util.find_spec
    importlib.util.find_spec = lambda name, *more: None if name == "pandas" else find(name, *more)
import hopdiff
table = hopdiff.results({str(sweep)!r})
table = hopdiff.results({str(sweep)!r})
print(type(table).__name__, len(table.rows if {installed} else table))
assert not {{"torch", "matplotlib", "tensorboard"}} & set(sys.modules)
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.stdout.split() == ["DataFrame" if installed else "list", "5"], done.stderr
