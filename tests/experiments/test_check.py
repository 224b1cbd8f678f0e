"""Committed tables: each says where it comes from, and is caught when it no longer holds."""

from __future__ import annotations

import csv
import shutil
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
STUDIES = ROOT / "experiments"


@pytest.fixture(autouse=True)
def from_the_checkout(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(ROOT))
    monkeypatch.chdir(ROOT)


def test_every_committed_page_of_results_is_checked_and_names_commit_and_command() -> None:
    from experiments.check import PAGES
    from experiments.provenance import origin_of

    known = {page.page for page in PAGES}
    assert {str(path.relative_to(STUDIES)) for path in STUDIES.glob("*/results.md")} <= known
    for page in PAGES:
        assert (STUDIES / page.entry).is_file(), page
        if page.page != "searches/results.md" or (STUDIES / page.page).is_file():
            origin = origin_of(STUDIES / page.page)
            missing = [word for word, value in (("commit", origin.commit), ("command", origin.command)) if not value]
            # What is written by a study that does not name them yet.
            allowed = {"searches/results.md": 2, "unchanged/results.md": 1}.get(page.page, 0)
            assert len(missing) <= allowed, (page.page, missing)


@pytest.mark.parametrize(
    ("head", "commit", "changed", "command"),
    [
        ("Commit `1a2b3c4d5e6f`, with changes; `python -m experiments.reach --seeds 0`.", "1a2b3c4d5e6f", True, True),
        ("# Title\n\nCommit `1a2b3c4d5e6f`; `python -m experiments.reach`.", "1a2b3c4d5e6f", False, True),
        ("# Title\n\n- commit dbdc20fdb15e\n- `python -m experiments.realism`", "dbdc20fdb15e", False, True),
        ("Made at 805930f.", "805930f", False, False),
        ("# Title\n\nNothing of the kind: the committee met.", None, False, False),
    ],
)
def test_the_origin_of_a_page_is_read(
    head: str, commit: str | None, changed: bool, command: bool, tmp_path: Path
) -> None:
    from experiments.provenance import origin_of

    page = tmp_path / "results.md"
    page.write_text(head + "\n\nrest\n", encoding="utf-8")
    found = origin_of(page)
    assert (found.commit, found.changed, found.command is not None) == (commit, changed, command)


def some_of_reach(folder: Path, keep: int) -> None:
    """A copy of the study's tables with the first few of its runs."""
    folder.mkdir(parents=True)
    shutil.copy(STUDIES / "reach" / "results.md", folder)
    for name in ("runs.csv", "genes.csv"):
        lines = (STUDIES / "reach" / name).read_text(encoding="utf-8").splitlines()
        (folder / name).write_text("\n".join(lines[: keep + 1]) + "\n", encoding="utf-8")


def test_the_table_of_reach_holds_until_a_number_is_altered(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    from experiments.check import main

    folder = tmp_path / "reach"
    some_of_reach(folder, 6)
    arguments = ["--only", "reach", "--folder", str(tmp_path)]
    assert main(arguments) == 0
    assert "| holds | 30 numbers priced again" in capsys.readouterr().out

    with (folder / "runs.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    true = float(rows[4]["cost"])
    rows[4]["cost"] = f"{1.001 * true:.6g}"
    with (folder / "runs.csv").open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)
    assert main(arguments) == 1
    said = capsys.readouterr().out
    assert "**no longer holds**" in said
    assert f"1 of 30 numbers differ: speed {rows[4]['speed']}, beta {rows[4]['beta']}, seed 1 cost" in said


def test_numbers_that_are_no_longer_there_differ() -> None:
    from experiments.provenance import compared

    same = compared([("a", {"x": 1.0, "y": 2.0}, {"x": 1.0, "y": 2.00001})])
    assert (same.compared, same.gaps) == (2, [])
    gone = compared([("a", {"x": 1.0}, {"x": float("nan")})])
    assert [gap.column for gap in gone.gaps] == ["x"]


def test_a_study_depends_on_what_it_imports_and_reaches_by_name() -> None:
    from experiments.provenance import changed_since, sources

    found = {str(path.relative_to(ROOT)) for path in sources(STUDIES / "reach" / "__main__.py")}
    assert {"experiments/reach/bars.py", "experiments/report.py", "hopdiff/costs.py", "conf", "hopdiff/search"} <= found
    assert "experiments/ways/judge.py" not in found
    assert changed_since("0" * 40, [ROOT / "hopdiff"]) is None


def test_the_departures_of_the_thesis_are_measured(tmp_path: Path) -> None:
    from experiments.kang1999.departures import main
    from experiments.kang1999.variants import VARIANTS, measured

    main(["--count", "24", "--evaluations", "60", "--out", str(tmp_path)])
    text = (tmp_path / "departures.md").read_text(encoding="utf-8")
    assert "`python -m experiments.kang1999.departures --count 24 --evaluations 60" in text
    assert (tmp_path / "take_off.png").stat().st_size > 10_000
    with (tmp_path / "departures.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    assert [row["variant"] for row in rows] == [variant.name for variant in VARIANTS]
    today = measured(VARIANTS[0], 24)
    assert {name: float(rows[0][name]) for name in today} == pytest.approx(today, rel=1e-7)
    below = [line.split("|")[2].strip() for line in text.splitlines() if line.startswith("| 5 m/s")]
    assert below[:2] == [one for one in below[:2] if one.startswith("0 of ")]
    assert not below[2].startswith("0 of ")
