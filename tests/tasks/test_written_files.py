"""A walk in the ways in which it is written down: read as what it is and edited, or refused in one true sentence."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest

from hopdiff.cli import main
from hopdiff.editing.leg_joints import find_legs
from hopdiff.io.bvh import read_bvh
from tests.tasks.writings import PLAIN, REFUSED, WRITINGS, Written

LATER = ("a first frame in T pose", "a child with z up", "no toes", "no head", "no arms")  # of other places or joints


def edited(monkeypatch: pytest.MonkeyPatch, clip: Path, folder: Path, *arguments: str) -> int:
    words = ["hopdiff", "+experiment=edit", f"clip={clip}", *arguments, "pictures=false", f"hydra.run.dir={folder}"]
    monkeypatch.setattr("sys.argv", words)
    return main()


def text_of(data: bytes) -> str:
    return data.decode("utf-16") if data[:2] in (b"\xff\xfe", b"\xfe\xff") else data.decode("latin-1")


def test_there_are_many() -> None:
    assert len(WRITINGS) + len(REFUSED) > 60
    assert len({written.data for written in WRITINGS.values()}) == len(WRITINGS)


@pytest.mark.parametrize("name", WRITINGS)
def test_it_is_read_as_what_it_is(tmp_path: Path, name: str) -> None:
    written = WRITINGS[name]
    (tmp_path / "a.bvh").write_bytes(written.data)
    file = read_bvh(tmp_path / "a.bvh")
    assert (file.up, file.frames) == (written.up, written.frames)
    assert file.unit == pytest.approx(written.unit)
    clip = file.clip()
    known = written.positions()
    np.testing.assert_allclose(clip.joint_positions().numpy(), known, atol=2e-8)
    # What is written differently is the same walk.
    if name not in LATER:
        np.testing.assert_allclose(known, Written(b"", PLAIN).positions(), atol=1e-5)
    assert len(find_legs(clip.skeleton)) == 2
    assert bool(file.notes) == written.notes


@pytest.mark.few(4)
@pytest.mark.parametrize("name", WRITINGS)
def test_it_is_edited_and_stays_as_it_is_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], name: str
) -> None:
    written = WRITINGS[name]
    (tmp_path / "a.bvh").write_bytes(written.data)
    before = written.positions()
    x, z = before[-1, 0, [0, 2]] + (0.3, -0.1)
    target = f"target.position=[{x:.6f},{z:.6f}]"
    assert edited(monkeypatch, tmp_path / "a.bvh", tmp_path / "run", target, "edit.repeat=1") == 0
    told = capsys.readouterr().out
    data = (tmp_path / "run" / "edited.bvh").read_bytes()
    rows = [line for line in re.split("[\r\n]+", text_of(data)) if line.strip()][-written.frames :]
    after = written.positions(rows)
    assert after.shape == before.shape
    assert after[-1, 0, [0, 2]] == pytest.approx([x, z], abs=1e-3)
    np.testing.assert_allclose(after[0, 0, [0, 2]], before[0, 0, [0, 2]], atol=1e-4)
    # Bones keep their lengths.
    new, old = (np.linalg.norm(one[:, 1] - one[:, 0], axis=-1) for one in (after, before))
    np.testing.assert_allclose(new, old, atol=1e-5)
    head = re.compile(r"(?si)(.*frames\s*:?\s*)\d+(.*?frame time[^\r\n]*)")
    heads = [head.match(text_of(one)) for one in (data, written.data)]
    assert heads[0]
    assert heads[1]
    assert heads[0].groups() == heads[1].groups()
    notes = json.loads((tmp_path / "run" / "status.json").read_text())["notes"]
    assert any("line" in note["sentence"] or "'Hips'" in note["sentence"] for note in notes) == written.notes
    assert ("note " in told) == bool(notes)


@pytest.mark.parametrize("name", REFUSED)
def test_it_is_refused_in_one_sentence(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], name: str
) -> None:
    data, sentence = REFUSED[name]
    (tmp_path / "a.bvh").write_bytes(data if isinstance(data, bytes) else data.encode())
    assert edited(monkeypatch, tmp_path / "a.bvh", tmp_path / "run") == 1
    told = capsys.readouterr().err.strip()
    assert sentence in told
    assert "a.bvh" in told
    assert told.endswith(".")
    assert len(told.splitlines()) == 1
    assert not (tmp_path / "run" / "edited.bvh").exists()
