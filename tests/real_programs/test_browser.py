"""Pages in a browser: pytest -m real_programs, with a Chromium (HOPDIFF_CHROMIUM or on PATH) and Playwright."""

from __future__ import annotations

from pathlib import Path

import pytest

from hopdiff.export.player import write_player
from hopdiff.export.prepare import prepared
from hopdiff.export.settings import ExportSettings
from hopdiff.export.take import Take
from hopdiff.types import HopdiffError

pytestmark = pytest.mark.real_programs


@pytest.fixture(scope="module")
def takes(from_the_checkout: None) -> list[Take]:
    from experiments.exports.in_browser import find_chromium
    from experiments.exports.runs import own_runs

    try:
        find_chromium()
    except HopdiffError as error:
        pytest.skip(str(error))
    # Mixamo's names have colons, which three.js takes out.
    settings = ExportSettings(kind="html", rest="t", names="mixamo")
    return [prepared(take, settings) for take in own_runs(200, path=False).values()]


@pytest.mark.parametrize("count", [1, 2])
@pytest.mark.parametrize("together", ["side_by_side", "overlaid"])
def test_a_page_plays(tmp_path: Path, takes: list[Take], count: int, together: str) -> None:
    from experiments.exports.in_browser import played

    shown = takes[:count]
    write_player(tmp_path / "motion.html", shown, together)
    last = max(shown, key=lambda take: take.clip.duration).frames - 1
    found = played(tmp_path / "motion.html", shown, (0, 7, last // 2, last))
    assert found.errors == ()
    assert found.requests == ()
    assert found.shades > 500
    assert found.moved > 0.2
    assert all(wanted == frame for wanted, frame in found.shown)
    assert found.worst < 1e-3


def test_keys_and_buttons(tmp_path: Path, takes: list[Take]) -> None:
    from experiments.exports.in_browser import opened

    write_player(tmp_path / "motion.html", takes)
    with opened(tmp_path / "motion.html") as (page, errors, _):
        page.keyboard.press("Space")
        assert not page.evaluate("hopdiff.playing")
        page.keyboard.press("Home")
        page.keyboard.press("ArrowRight")
        page.keyboard.press("ArrowRight")
        assert page.evaluate("hopdiff.frame") == 2
        page.keyboard.press("End")
        assert page.evaluate("hopdiff.frame") == page.evaluate("hopdiff.frames") - 1
        for button in ("#spot", "#overlay", "#bones", "#follow"):
            before = page.get_attribute(button, "aria-pressed")
            page.click(button)
            assert page.get_attribute(button, "aria-pressed") != before
        before = page.locator("#canvas").screenshot()
        page.mouse.move(400, 400)
        page.mouse.down()
        page.mouse.move(520, 380, steps=4)
        page.mouse.up()
        page.wait_for_timeout(300)
        assert page.locator("#canvas").screenshot() != before
        rows = page.locator("#numbers tbody tr").all_inner_texts()
        assert any(row.split() == ["Speed", "3.00", "5.00", "m/s"] for row in rows), rows
        assert errors == []


def test_motion_waits_for_those_who_asked_for_less(tmp_path: Path, takes: list[Take]) -> None:
    from experiments.exports.in_browser import opened

    write_player(tmp_path / "motion.html", takes[:1])
    with opened(tmp_path / "motion.html") as (page, _, _):
        assert page.evaluate("hopdiff.playing")
        page.emulate_media(reduced_motion="reduce")
        page.reload()
        page.wait_for_function("window.hopdiff && window.hopdiff.ready")
        assert not page.evaluate("hopdiff.playing")
