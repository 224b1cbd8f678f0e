from __future__ import annotations

import base64
import json
import re
import zipfile
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from hopdiff.export import player
from hopdiff.export.full_body import full_body
from hopdiff.export.player import page, write_player
from hopdiff.export.prepare import with_ground_root
from hopdiff.export.take import Take
from hopdiff.types import HopdiffError
from tests.export.gltf import Gltf
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


def unpacked(text: str, width: int) -> np.ndarray:
    """(T, width) numbers of every frame."""
    return np.frombuffer(base64.b64decode(text), "<f4").reshape(-1, width).astype(float)


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
    data = told(page([take]))
    (run,), (body,) = data["takes"], data["bodies"]
    file = Gltf.of(base64.b64decode(body))
    assert [file.content["nodes"][joint]["name"] for joint in file.content["skins"][0]["joints"]] == run["joints"]
    assert "animations" not in file.content
    assert run["body"] == 0
    np.testing.assert_allclose(unpacked(run["root"], 3), take.clip.root_position.numpy(), atol=1e-6)
    np.testing.assert_allclose(unpacked(run["way"], 2)[:, 1], take.clip.root_position[:, 2].numpy(), atol=0.3)
    assert len(unpacked(run["heading"], 1)) == take.frames
    assert (run["frames"], run["frameTime"], run["loop"]) == (take.frames, take.clip.frame_time, True)
    assert run["joints"] == list(take.clip.skeleton.names)
    travel = take.clip.root_position[-1] - take.clip.root_position[0]
    gone = torch.tensor(run["again"]["to"]) - torch.tensor(run["again"]["from"])
    torch.testing.assert_close(gone.double(), travel[[0, 2]], atol=1e-6, rtol=0)
    assert run["again"]["yaw"] == pytest.approx(0.0, abs=1e-9)
    assert ["Speed", "3.00", "m/s"] in run["shown"]
    assert ["Briskness β", "0.20", ""] in run["shown"]


def test_turns_are_kept_within_what_is_said_of_them() -> None:
    for take in (full_body(own()), walked()):
        (run,) = told(page([take]))["takes"]
        stored = np.frombuffer(base64.b64decode(run["turns"]), "<i2").reshape(take.frames, -1, 4) / 32767.0
        ours = Rotation.from_matrix(take.clip.rotations.reshape(-1, 3, 3).numpy()).as_quat().reshape(stored.shape)
        alike = np.sign((stored * ours).sum(axis=-1, keepdims=True))
        assert np.abs(alike * stored - ours).max() <= 0.5 / 32767.0 + 1e-9
        # Neighbours are on the same side, so that what is between them is.
        assert float((stored[1:] * stored[:-1]).sum(axis=-1).min()) > 0.0
        turned = Rotation.from_quat(stored.reshape(-1, 4)).as_matrix().reshape(take.clip.rotations.shape)
        root = torch.from_numpy(unpacked(run["root"], 3))
        places, _ = take.clip.skeleton.forward(root, torch.from_numpy(turned))
        assert float((places - take.clip.joint_positions()).norm(dim=-1).max()) < 2e-4


def test_bodies_that_are_alike_are_in_a_page_once() -> None:
    run = full_body(own())
    many = [replace(run, name=f"run {k}") for k in range(20)]
    one, twenty = (len(page(takes)) for takes in (many[:1], many))
    motion = sum(len(str(told(page(many[:1]))["takes"][0][part])) for part in ("root", "turns", "way", "heading"))
    assert twenty < 1.6 * one + 20 * motion
    assert twenty < one + 20 * 1.5 * len(json.dumps(told(page(many[:1]))["takes"][0]))
    assert run.masses is not None
    heavy = replace(run, name="heavy", masses={part: 1.5 * mass for part, mass in run.masses.items()})
    data = told(page([*many[:2], heavy, walked(), replace(heavy, name="again")]))
    assert [take["body"] for take in data["takes"]] == [0, 0, 1, 2, 1]
    assert len(data["bodies"]) == 3


def test_joints_that_move_against_their_parents() -> None:
    take = with_ground_root(full_body(own()), "root")
    assert take.clip.offsets is not None
    (run,) = told(page([take]))["takes"]
    stored = unpacked(run["offsets"], 3).reshape(take.frames, -1, 3)
    np.testing.assert_allclose(stored, take.clip.offsets.numpy(), atol=1e-6)
    assert told(page([own()]))["takes"][0]["offsets"] is None


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
    assert takes[1].frames / data["takes"][1]["drawn"] <= player.POINTS


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
    assert len(unpacked(run["way"], 2)) == len(unpacked(run["heading"], 1)) == run["frames"] == frames


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
