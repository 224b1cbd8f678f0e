"""Pages in a browser: pytest -m real_programs, with a Chromium (HOPDIFF_CHROMIUM or on PATH) and Playwright."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import pytest
import torch

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


def test_space_plays_from_the_slider(tmp_path: Path, takes: list[Take]) -> None:
    from experiments.exports.in_browser import opened

    write_player(tmp_path / "motion.html", takes[:1])
    with opened(tmp_path / "motion.html") as (page, _, _):
        page.evaluate("hopdiff.pause()")
        page.focus("#frame")
        page.keyboard.press("Space")
        assert page.evaluate("hopdiff.playing")


def test_views_find_a_body_that_ran_off(tmp_path: Path, takes: list[Take]) -> None:
    from experiments.exports.in_browser import in_colour, opened

    long = replace(takes[0].repeated(12), loop=False)
    write_player(tmp_path / "motion.html", [long])
    with opened(tmp_path / "motion.html") as (page, _, _):
        page.evaluate("hopdiff.pause(); hopdiff.setFrame(0)")
        page.click("#follow")
        page.keyboard.press("End")
        page.wait_for_timeout(300)
        assert in_colour(page).mean() < 0.01
        for button in ("Side", "Front", "Three-quarter", "Top", "Reset"):
            page.get_by_role("button", name=button, exact=True).click()
            page.wait_for_timeout(300)
            assert in_colour(page).mean() > 0.01, button


def test_bodies_that_part_stay_in_view(tmp_path: Path, takes: list[Take]) -> None:
    from experiments.exports.in_browser import opened

    # Not loops, which would stay on the spot: at the end they are many metres apart.
    long = [replace(take.repeated(12), loop=False) for take in takes[:2]]
    assert abs(float(long[0].clip.root_position[-1, 2] - long[1].clip.root_position[-1, 2])) > 5.0
    write_player(tmp_path / "motion.html", long)
    with opened(tmp_path / "motion.html") as (page, _, _):
        page.evaluate("hopdiff.pause(); hopdiff.setFrame(0)")
        page.get_by_role("button", name="Side", exact=True).click()
        page.keyboard.press("End")
        page.wait_for_timeout(300)
        view = page.locator("#canvas").bounding_box()
        names = page.locator("#names span")
        assert names.count() == 2
        for name in names.all():
            box = name.bounding_box()
            assert box is not None
            assert view["x"] < box["x"] + box["width"] / 2 < view["x"] + view["width"]
            assert view["y"] < box["y"] < view["y"] + view["height"]


def test_a_body_that_has_run_for_hours_looks_the_same(tmp_path: Path, takes: list[Take]) -> None:
    from experiments.exports.in_browser import in_colour, opened

    write_player(tmp_path / "motion.html", takes[:1])
    text = (tmp_path / "motion.html").read_text(encoding="utf-8")
    begins, clip = "time: 0, playing: false", takes[0].clip
    assert text.count(begins) == 1
    seen = []
    for lap in (1, 60_000):
        time = lap * clip.duration + 10 * clip.frame_time
        (tmp_path / "late.html").write_text(text.replace(begins, f"time: {time!r}, playing: false"), encoding="utf-8")
        with opened(tmp_path / "late.html", still=True) as (page, _, _):
            assert page.evaluate("hopdiff.frame") == 10
            seen.append(in_colour(page))
    # Only what little of the ground's grid crosses feet may differ.
    assert seen[0].mean() > 0.03
    assert float((seen[0] != seen[1]).sum()) < 0.005 * float(seen[0].sum())


def test_a_blend_space_shows_what_its_point_says(tmp_path: Path, takes: list[Take]) -> None:
    """Joints of the page against our own blend, at the clips and between them; the point is dragged."""
    from experiments.exports.in_browser import opened
    from hopdiff.export.blend_page import blend_page
    from hopdiff.export.blend_space import BlendSpace, blend
    from hopdiff.export.one_stride import one_stride

    jog, brisk = (one_stride(take, 48) for take in takes)
    second = replace(jog, name="second", numbers={**jog.numbers, "beta": 0.7})
    fourth = replace(brisk, name="fourth", numbers={**brisk.numbers, "beta": 0.2})
    space = BlendSpace.of([jog, brisk, second, fourth])
    clips, file = list(space.clips.values()), tmp_path / "blend.html"
    file.write_text(blend_page(space, space.index()), encoding="utf-8")
    with opened(file) as (page, errors, requests):
        page.wait_for_timeout(500)
        assert page.evaluate("hopdiff.distance") > 0.2
        # Without a graphics card what moves is drawn with fewer pixels, and what stands still with all.
        wide = "document.getElementById('canvas').width"
        moving = page.evaluate(wide)
        page.evaluate("hopdiff.pause()")
        assert moving < 0.8 * page.evaluate(wide)
        for speed, beta, weights in (
            (3.0, 0.2, (1.0, 0.0, 0.0, 0.0)),
            (4.0, 0.45, (0.25, 0.25, 0.25, 0.25)),
            (4.5, 0.6, (0.05, 0.2, 0.15, 0.6)),
        ):
            wanted = {(3.0, 0.2): 0, (3.0, 0.7): 1, (5.0, 0.2): 2, (5.0, 0.7): 3}
            own = [weights[wanted[place[:2]]] for place in space.clips]
            page.evaluate(f"hopdiff.choose({speed}, {beta})")
            assert page.evaluate("hopdiff.weights") == pytest.approx(own)
            for key in (0, 13, 40):
                page.evaluate(f"hopdiff.setPhase({key / 48})")
                found = torch.tensor(page.evaluate("hopdiff.positions()"), dtype=torch.float64)
                ours = blend(clips, own).clip.joint_positions()[key]
                # three.js goes on an arc from clip to clip, not straight to their sum.
                assert float((found - ours).norm(dim=-1).max()) < 0.01
        box = page.locator("#pad .point").bounding_box()
        page.mouse.move(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
        page.mouse.down()
        page.mouse.move(box["x"] - 1000, box["y"] - 1000)
        page.mouse.up()
        corner = page.evaluate("hopdiff.weights")
        assert corner[list(space.clips).index((3.0, 0.7, 0.0))] == pytest.approx(1.0)
        assert errors == []
        assert requests == []


def test_a_blend_space_with_turns_goes_round(tmp_path: Path, takes: list[Take]) -> None:
    from experiments.exports.in_browser import in_colour, opened
    from hopdiff.export.blend_page import blend_page
    from hopdiff.export.blend_space import BlendSpace
    from hopdiff.export.one_stride import one_stride

    straight = one_stride(takes[0], 48)
    bent = replace(straight, name="bent", numbers={**straight.numbers, "turn": 40.0})
    space, file = BlendSpace.of([straight, bent]), tmp_path / "blend.html"
    file.write_text(blend_page(space, space.index()), encoding="utf-8")
    with opened(file, still=True) as (page, errors, _):
        assert page.is_visible("#turn")
        for turn, share in ((0.0, 0.0), (20.0, 0.5), (40.0, 1.0)):
            page.evaluate(f"hopdiff.choose({straight.numbers['speed']}, {straight.numbers['beta']}, {turn})")
            assert page.evaluate("hopdiff.weights") == pytest.approx([1.0 - share, share])
            page.evaluate("hopdiff.setPhase(0)")
            before = page.evaluate("hopdiff.heading")
            page.evaluate("hopdiff.setPhase(0.5)")
            after = page.evaluate("hopdiff.heading")
            assert after - before == pytest.approx(math.radians(0.5 * turn * straight.clip.duration), abs=1e-6)
        seen = []
        for phase in (0, 1):
            # The same pose after a stride that turned by some 30 degrees.
            page.evaluate(f"hopdiff.setPhase({phase})")
            page.click("[data-view=front]")
            page.wait_for_timeout(300)
            seen.append(in_colour(page))
        assert seen[0].mean() > 0.03
        assert float((seen[0] != seen[1]).sum()) < 0.02 * float(seen[0].sum())
        assert errors == []


def test_many_runs_stand_in_rows_with_a_table_of_what_differs(tmp_path: Path, takes: list[Take]) -> None:
    from experiments.exports.in_browser import in_colour, opened

    many = [
        replace(
            takes[k % 2], name=f"run {k}", numbers={"character": "human", "seed": k, "speed": 3.0 + k, "note": "same"}
        )
        for k in range(8)
    ]
    write_player(tmp_path / "motion.html", many)
    for size in ((1280, 800), (390, 844)):
        with opened(tmp_path / "motion.html", size, still=True) as (page, errors, _):
            view = page.locator("#canvas").bounding_box()
            places = [name.bounding_box() for name in page.locator("#names > span").all()]
            middles = [(box["x"] + box["width"] / 2, box["y"] + box["height"]) for box in places]
            assert len(middles) == 8
            assert all(view["x"] < x < view["x"] + view["width"] for x, _ in middles)
            assert all(view["y"] < y < view["y"] + view["height"] for _, y in middles)
            # More than a row, read from the left and from above, and nobody in another's place.
            rows = sorted({round(y / 10) for _, y in middles})
            assert 1 < len(rows) < 8
            assert middles[0][1] < middles[-1][1]
            assert min(abs(a[0] - b[0]) + abs(a[1] - b[1]) for k, a in enumerate(middles) for b in middles[:k]) > 30
            assert in_colour(page).mean() > 0.01
            head = [text.split()[0] for text in page.locator("#numbers thead th").all_inner_texts()]
            assert head == ["Run", "Speed", "Seed", "Duration", "Frames"]
            first = page.locator("#numbers tbody tr").nth(2)
            assert first.inner_text().split()[:5] == ["3", "run", "2", "5.00", "2"]
            same = page.locator("#numbers tfoot tr").all_inner_texts()
            assert same[0] == "The same in all"
            assert [row.split() for row in same[1:]] == [["Character", "human"], ["Joints", "22"]]
            # The page itself is no wider than the screen.
            assert page.evaluate("document.documentElement.scrollWidth") <= size[0]
            assert errors == []


def test_a_row_marks_its_figure(tmp_path: Path, takes: list[Take]) -> None:
    from experiments.exports.in_browser import opened

    write_player(tmp_path / "motion.html", [replace(takes[k % 2], name=f"run {k}") for k in range(8)])
    with opened(tmp_path / "motion.html", still=True) as (page, errors, _):

        def marked() -> list[int]:
            page.wait_for_timeout(300)
            return page.evaluate(
                "[...document.querySelectorAll('#names > span')].flatMap((one, k) => one.matches('.marked') ? [k] : [])"
            )

        rows = page.locator("#numbers tbody tr")
        assert marked() == []
        before = page.locator("#canvas").screenshot()
        rows.nth(3).hover()
        assert marked() == [3]
        assert page.locator("#canvas").screenshot() != before
        rows.nth(5).click()
        page.mouse.move(300, 400)
        assert marked() == [5]
        rows.nth(5).click()
        page.mouse.move(300, 400)
        page.locator("#play").focus()
        assert marked() == []
        rows.nth(1).get_by_role("button").click()
        page.mouse.move(300, 400)
        page.wait_for_timeout(300)
        assert page.locator("#names > span:visible").count() == 7
        assert errors == []


def test_pictures_that_move_are_coarser_where_there_is_no_graphics_card(tmp_path: Path, takes: list[Take]) -> None:
    from experiments.exports.in_browser import opened

    write_player(tmp_path / "motion.html", takes[:1])
    with opened(tmp_path / "motion.html", still=True) as (page, _, _):
        still = page.evaluate("document.getElementById('canvas').width")
        assert still == page.locator("#canvas").bounding_box()["width"]
        page.evaluate("hopdiff.play()")
        page.wait_for_timeout(200)
        assert 0.4 * still < page.evaluate("document.getElementById('canvas').width") < 0.8 * still
        page.evaluate("hopdiff.pause()")
        assert page.evaluate("document.getElementById('canvas').width") == still
