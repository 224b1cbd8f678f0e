"""The pictures of the front pages and the commits that pages of pictures name."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from hopdiff.composing import compose

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(autouse=True)
def from_the_checkout(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(ROOT))


def test_the_upper_part_ends_in_the_widest_blank_band() -> None:
    from experiments.pictures.__main__ import upper

    pixels = np.full((100, 30, 3), 255, dtype=np.uint8)
    pixels[5:35], pixels[38:44], pixels[56:90] = 0, 0, 0
    # Between 30 and 70 % of the height: 3 blank rows from 35 on, 12 from 44 on.
    found = np.asarray(upper(Image.fromarray(pixels), (0.3, 0.7)))
    assert 44 <= len(found) <= 56
    np.testing.assert_array_equal(found, pixels[: len(found)])


def test_pictures_lie_beside_or_below_each_other(tmp_path: Path) -> None:
    from experiments.pictures.__main__ import Sheet, save

    files = []
    for name, size, grey in (("a", (40, 20), 50), ("b", (20, 10), 200)):
        Image.new("RGB", size, (grey, grey, grey)).save(tmp_path / f"{name}.png")
        files.append(tmp_path / f"{name}.png")
    save(Sheet("one", (), 30), files, tmp_path / "below.png")
    below = np.asarray(Image.open(tmp_path / "below.png").convert("L")).astype(int)
    assert below.shape == (22, 30)
    assert abs(below[5, 15] - 50) < 9
    assert abs(below[19, 5] - 200) < 9
    save(Sheet("two", (), 40, beside=True), files, tmp_path / "beside.png")
    beside = np.asarray(Image.open(tmp_path / "beside.png").convert("L")).astype(int)
    assert beside.shape == (10, 40)  # both 10 high, each 20 wide
    assert abs(beside[5, 5] - 50) < 9
    assert abs(beside[5, 35] - 200) < 9


def test_every_picture_of_the_front_pages_is_of_a_command_that_composes() -> None:
    from experiments.pictures.__main__ import SHEETS

    for sheet in SHEETS:
        for shot in sheet.shots:
            compose([word for word in shot.overrides if not word.startswith("clip=")])
    shown = {path.stem for path in (ROOT / "experiments" / "pictures").glob("*.png")}
    assert shown == {sheet.name for sheet in SHEETS} | {"export"}


def test_commits_of_runs_and_sweeps_are_told_once(tmp_path: Path) -> None:
    from experiments.gallery import commits

    for place, state in (
        ("run", {"checkout": True, "commit": "a" * 40, "dirty": False}),
        ("sweep/0", {"checkout": True, "commit": "a" * 40, "dirty": False}),
        ("sweep/1", {"checkout": True, "commit": "b" * 40, "dirty": True}),
        ("wheel", {"checkout": False}),
    ):
        (tmp_path / place).mkdir(parents=True)
        (tmp_path / place / "git.json").write_text(json.dumps(state))
    told = commits([tmp_path / "run", tmp_path / "sweep", tmp_path / "wheel"])
    assert told == "aaaaaaa, bbbbbbb with changes, no commit"
