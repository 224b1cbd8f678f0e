from __future__ import annotations

import json
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(autouse=True)
def from_the_checkout(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(ROOT))


def left(folder: Path, motion: str = "motion", gene: float = 0.1, **metrics: object) -> Path:
    """A folder such as a command leaves it."""
    folder.mkdir()
    (folder / "motion.bvh").write_text(motion)
    (folder / "genes.json").write_text(json.dumps({"settings": {}, "genes": {"lean": {"value": gene, "unit": "rad"}}}))
    (folder / "metrics.json").write_text(
        json.dumps({"contact_time": 0.2, "wall_seconds": 1.0, "ms_feet": 3, **metrics})
    )
    return folder


def test_a_change_of_the_last_bit_is_seen_and_told(tmp_path: Path) -> None:
    from experiments.unchanged.__main__ import _compared, _notes
    from experiments.unchanged.cases import Case
    from experiments.unchanged.running import Made

    case = Case("some", ())
    before = Made(left(tmp_path / "before"))

    def words(**changes: object) -> tuple[list[bool], list[str]]:
        place = tmp_path / str(len(list(tmp_path.iterdir())))
        after = Made(left(place, **changes))  # type: ignore[arg-type]
        return [row.same for row in _compared(case, before, after)], [*_notes(case, before, after)]

    assert words() == ([True, True, True], [])
    assert words(wall_seconds=2.0, ms_feet=4) == ([True, True, True], [])
    assert words(motion="motion ") == ([False, True, True], [])
    assert words(gene=0.1 + 2**-56) == ([True, False, True], ["some: genes.json differs in lean"])
    assert words(contact_time=0.25) == ([True, True, False], ["some: metrics.json differs in contact_time"])
    assert words(hops=[1, 2]) == ([True, True, True], ["some: metrics.json also has hops.0, hops.1"])


def test_a_file_that_is_missing_or_a_command_that_failed_is_not_the_same(tmp_path: Path) -> None:
    from experiments.unchanged.__main__ import _compared, _notes
    from experiments.unchanged.cases import Case
    from experiments.unchanged.running import CommandError, Made

    case, before = Case("some", ()), Made(left(tmp_path / "before"))
    (left(tmp_path / "after") / "motion.bvh").unlink()
    assert [row.same for row in _compared(case, before, Made(tmp_path / "after"))] == [False, True, True]
    broken = CommandError("hopdiff: no such thing.")
    for pair in ((before, broken), (broken, before), (broken, broken)):
        assert [row.same for row in _compared(case, *pair)] == [False]
    assert [*_notes(case, before, broken)] == ["some, after: hopdiff: no such thing."]


def test_words_may_differ_between_the_checkouts(tmp_path: Path) -> None:
    from experiments.unchanged.__main__ import Side
    from experiments.unchanged.cases import Case

    case = Case("replay", ("task=replay", "genes_file={body}/genes.json", "fps=120"))
    places = {"body": Path("/there")}
    side = Side(tmp_path, ["genes_file=:genes="], [])
    assert side.words(case, places) == ["task=replay", "genes=/there/genes.json", "fps=120"]
    side = Side(tmp_path, [], ["replay:task=again 'run={body}'"])
    assert side.words(case, places) == ["task=again", "run=/there"]
    with pytest.raises(KeyError):
        side.words(case, {})


def test_only_a_checkout_will_do(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    from experiments.unchanged.__main__ import main

    assert main(["--before", str(tmp_path), "--after", str(ROOT), "--out", str(tmp_path)]) == 2
    assert "is no checkout" in capsys.readouterr().err
    assert not (tmp_path / "results.md").exists()


@pytest.mark.thorough
def test_a_checkout_is_the_same_as_itself(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    from experiments.unchanged.__main__ import main

    arguments = ["--before", str(ROOT), "--after", str(ROOT), "--only", "hopper", "--out", str(tmp_path)]
    assert main(arguments) == 0
    assert "2 of 2 are the same." in capsys.readouterr().out
    text = (tmp_path / "results.md").read_text()
    assert "| hopper | frames.csv |" in text
    assert "`task=hopper`" in text
    assert str(tmp_path) not in text
    instead = ["--after-instead", "hopper:task=hopper speed=4"]
    assert main([*arguments, *instead]) == 1
    assert "DIFFERENT" in (tmp_path / "results.md").read_text()
