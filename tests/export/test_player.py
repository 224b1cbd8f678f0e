from __future__ import annotations

import base64
import json
import re
import zipfile
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import pytest
import torch

from hopdiff.export import player
from hopdiff.export.full_body import full_body
from hopdiff.export.glb import glb_bytes
from hopdiff.export.player import page, write_player
from hopdiff.export.take import Take
from hopdiff.types import HopdiffError
from tests.export.takes import own, walked


class Elements(HTMLParser):
    """Every element of a page with its attributes, and the texts of its scripts."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.found: list[tuple[str, dict[str, str | None]]] = []
        self.scripts: list[str] = []
        self.open = ""
        self.feed(text)
        self.close()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.found.append((tag, dict(attrs)))
        self.open = tag
        if tag == "script":
            self.scripts.append("")

    def handle_endtag(self, tag: str) -> None:
        self.open = ""

    def handle_data(self, data: str) -> None:
        if self.open == "script":
            self.scripts[-1] += data


def told(text: str) -> dict[str, Any]:
    """The data in a page."""
    return json.loads(Elements(text).scripts[0])


def test_one_file_that_asks_for_nothing(tmp_path: Path) -> None:
    write_player(tmp_path / "motion.html", [own()])
    assert [path.name for path in tmp_path.iterdir()] == ["motion.html"]
    elements = Elements((tmp_path / "motion.html").read_text(encoding="utf-8"))
    assert not [tag for tag, _ in elements.found if tag in ("link", "img", "iframe", "object", "base")]
    for tag, attributes in elements.found:
        assert not {"src", "href", "srcset", "action"} & set(attributes), tag
    policy = next(str(a["content"]) for _, a in elements.found if a.get("http-equiv") == "Content-Security-Policy")
    assert policy.startswith("default-src 'none'")
    assert not re.search(r"https?:|connect-src|\*", policy)
    # Data, library, and what the page does: none ends another.
    assert len(elements.scripts) == 3
    assert "Three.js Authors" in elements.scripts[1]
    assert "SPDX-License-Identifier: MIT" in elements.scripts[1]
    assert elements.scripts[2].rstrip().endswith("})();")
    assert "{{" not in re.sub(r"(?s)<script.*", "", (tmp_path / "motion.html").read_text(encoding="utf-8"))


def test_the_page_knows_the_motion() -> None:
    take = full_body(own())
    (run,) = told(page([take]))["takes"]
    assert base64.b64decode(run["glb"]) == glb_bytes([take])
    assert (run["frames"], run["frameTime"], run["loop"]) == (take.frames, take.clip.frame_time, True)
    assert run["joints"] == list(take.clip.skeleton.names)
    travel = take.clip.root_position[-1] - take.clip.root_position[0]
    gone = torch.tensor(run["again"]["to"]) - torch.tensor(run["again"]["from"])
    torch.testing.assert_close(gone.double(), travel[[0, 2]], atol=1e-6, rtol=0)
    assert run["again"]["yaw"] == pytest.approx(0.0, abs=1e-9)
    assert ["Speed", "3.00", "m/s"] in run["shown"]
    assert ["Briskness β", "0.20", ""] in run["shown"]


def test_footprints_are_below_standing_feet() -> None:
    take = full_body(own())
    assert take.contact is not None
    (run,) = told(page([take]))["takes"]
    assert [step["frame"] for step in run["steps"]] == sorted(step["frame"] for step in run["steps"])
    places = take.clip.joint_positions()
    for side, k in (("left", 0), ("right", 1)):
        starts = (take.contact[1:, k] & ~take.contact[:-1, k]).nonzero().flatten() + 1
        steps = [step for step in run["steps"] if step["side"] == side]
        assert {step["frame"] for step in steps} >= set(starts.tolist())
        for step in steps:
            sole = torch.tensor(step["place"], dtype=torch.float64)
            toe = places[step["frame"], take.clip.skeleton.index(f"{side}_toe")][[0, 2]]
            # The ball is inside the print, ahead of its middle.
            assert 0.0 < float((toe - sole)[1]) < step["size"]
            assert abs(float((toe - sole)[0])) < 0.02


def test_several_motions_and_walks_of_people() -> None:
    takes = [replace(own(), name="a"), walked()]
    data = told(page(takes, "overlaid"))
    assert data["together"] == "overlaid"
    assert [run["name"] for run in data["takes"]] == ["a", takes[1].name]
    assert data["takes"][1]["again"] is None
    assert data["takes"][1]["steps"]
    assert len(data["takes"][1]["drawn"]) <= player.POINTS + 2
    assert data["takes"][1]["drawn"][-1] == data["takes"][1]["way"][-1]


def test_names_and_numbers_cannot_break_out() -> None:
    nasty = '</script><script>alert(1)</script><!-- & " {{style}}'
    take = replace(own(), name=nasty, numbers={"speed": 3.0, "note": nasty, "bad": float("nan"), "list": [1]})
    text = page([take])
    elements = Elements(text)
    assert len(elements.scripts) == 3
    (run,) = told(text)["takes"]
    assert run["name"] == nasty
    assert ["note", nasty, ""] in run["more"]
    assert not any(row[0] == "list" for row in run["more"])
    assert text.count(player._part("page.css")) == 1


@pytest.mark.parametrize("frames", [1, 2])
def test_the_shortest_motions(frames: int) -> None:
    clip = own().clip
    short = replace(clip, root_position=clip.root_position[:frames], rotations=clip.rotations[:frames])
    (run,) = told(page([Take("short", short, False)]))["takes"]
    assert len(run["way"]) == len(run["heading"]) == run["frames"] == frames


def test_what_cannot_be_written_is_one_sentence(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(HopdiffError, match="without a motion"):
        write_player(tmp_path / "motion.html", [])
    with pytest.raises(HopdiffError, match=r"cannot write .*motion\.html"):
        write_player(tmp_path / "nowhere" / "motion.html", [own()])
    other = tmp_path / "viewer.zip"
    with zipfile.ZipFile(other, "w") as archive:
        archive.writestr("viewer.html.template", "<script>import * as THREE from 'three'</script>")
    for library in (other, tmp_path / "gone.zip"):
        monkeypatch.setattr(player, "LIBRARY", str(library))
        with pytest.raises(HopdiffError, match=r"three\.js that trimesh ships, and the trimesh that is installed"):
            write_player(tmp_path / "motion.html", [own()])
    assert [path.name for path in tmp_path.iterdir()] == ["viewer.zip"]
