"""What is written is, byte for byte, what was read, but for what changed."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import pytest
import torch

from hopdiff.io.bvh import BvhFile, read_bvh
from tests.io.bvh_files import FILES, PLAIN
from tests.io.test_bvh_read import WRITINGS, saved, yawed

ODD_HEAD = (
    PLAIN.replace("  ", "\t")
    .replace("Zposition", "zPosition ")
    .replace("Frames: 3", "Frames:\t3 ")
    .replace("Frame Time: 0.0333333", "Frame Time:  .03333330")
    .replace("Head\n", "Head \n")
    .replace("-42.0000", "-4.2e+01")
    .replace("\n", "\r\n")
)
MORE: dict[str, bytes] = {
    "all at once": ODD_HEAD.encode(),
    "mixed line ends": PLAIN.replace("\n", "\r\n", 9).encode(),
    "old code page": PLAIN.encode().replace(b"Hips", "Hüfte".encode("latin-1")),
    "big-endian UTF-16": b"\xfe\xff" + PLAIN.encode("utf-16-be"),
}
SOURCES = {name: text if isinstance(text, bytes) else text.encode() for name, text in WRITINGS.items()} | MORE
# Rows in which a line is no frame are written anew.
OTHER_ROWS = ("a number a line", "a frame on two lines", "all frames on a line", "seven numbers a line", "comments")


def plain(data: bytes) -> bytes:
    """One byte a letter."""
    codec = {b"\xff\xfe": "utf-16-le", b"\xfe\xff": "utf-16-be"}.get(data[:2])
    return data if codec is None else data.decode(codec).encode()


def head(data: bytes) -> tuple[bytes, bytes]:
    """All up to the number of frames, and from there to the end of the line of the frame time."""
    found = re.fullmatch(
        rb"(.*MOTION.*?frames\s*:?\s*)\d+(.*?frame *time[^\r\n]*(?:\r\n|\r|\n)).*",
        plain(data),
        re.DOTALL | re.IGNORECASE,
    )
    assert found
    return found.group(1), found.group(2)


def longer(file: BvhFile) -> BvhFile:
    clip = file.clip()
    index = torch.arange(12) % clip.frames
    return file.with_motion(replace(clip, root_position=clip.root_position[index], rotations=clip.rotations[index]))


@pytest.mark.parametrize("name", SOURCES)
def test_all_above_the_numbers_stays_byte_for_byte(tmp_path: Path, name: str) -> None:
    file = read_bvh(saved(tmp_path, SOURCES[name]))
    for edited in (yawed(file, 40.0), longer(file)):
        edited.write(tmp_path / "b.bvh")
        written = (tmp_path / "b.bvh").read_bytes()
        assert head(written) == head(SOURCES[name])
        assert written[:2] == SOURCES[name][:2]
        found = read_bvh(tmp_path / "b.bvh")
        assert (found.joints, found.frame_time, found.notes) == (file.joints, file.frame_time, ())
        assert torch.equal(found.values, edited.values)
        line_end = re.search(rb"\r\n|\r|\n", head(SOURCES[name])[1][-2:])
        assert line_end
        assert plain(written).count(line_end.group()) >= edited.frames


@pytest.mark.parametrize("name", [name for name in SOURCES if name not in OTHER_ROWS])
def test_a_file_that_is_not_edited_is_the_same_file(tmp_path: Path, name: str) -> None:
    file = read_bvh(saved(tmp_path, SOURCES[name]))
    for one in (file, file.with_motion(file.clip())):
        one.write(tmp_path / "b.bvh")
        written = (tmp_path / "b.bvh").read_bytes()
        # But for blank lines below the numbers.
        lines = [line for line in plain(SOURCES[name]).splitlines(keepends=True)[-3:] if line.strip()]
        assert plain(written).rstrip() == plain(SOURCES[name]).rstrip() or name in ("blank lines", "many line ends")
        assert plain(written).endswith(lines[-1]) if lines else True


def test_frames_that_are_not_edited_keep_their_text(tmp_path: Path) -> None:
    text = PLAIN.replace("2.5000 91.0000", "2.5  9.1E1")
    file = read_bvh(saved(tmp_path, text))
    yawed(file, 50.0).write(tmp_path / "b.bvh")
    before, after = text.splitlines(), (tmp_path / "b.bvh").read_text().splitlines()
    assert after[-3] == before[-3]
    assert after[-2] != before[-2]
    assert after[-1] != before[-1]
    values = file.values.clone()
    values[2, 0] += 1.0
    replace(file, values=values).write(tmp_path / "b.bvh")
    after = (tmp_path / "b.bvh").read_text().splitlines()
    assert after[:-1] == before[:-1]
    assert after[-1].startswith("4.5")


def test_another_frame_time_is_written_in_the_place_of_the_old_one(tmp_path: Path) -> None:
    file = read_bvh(saved(tmp_path, ODD_HEAD))
    replace(file, frame_time=0.04).write(tmp_path / "b.bvh")
    assert (tmp_path / "b.bvh").read_bytes() == ODD_HEAD.replace("  .03333330", "  0.04").encode()


def test_other_joints_are_written_in_our_own_way(tmp_path: Path) -> None:
    file = read_bvh(saved(tmp_path, ODD_HEAD))
    joints = (replace(file.joints[0], name="Pelvis"), *file.joints[1:])
    replace(file, joints=joints).write(tmp_path / "b.bvh")
    assert (tmp_path / "b.bvh").read_text().splitlines()[1] == "ROOT Pelvis"
    assert read_bvh(tmp_path / "b.bvh").joints == joints


@pytest.mark.parametrize("name", FILES)
def test_files_by_hand_come_back_whole(tmp_path: Path, name: str) -> None:
    file = read_bvh(saved(tmp_path, FILES[name]))
    file.with_motion(file.clip()).write(tmp_path / "b.bvh")
    assert (tmp_path / "b.bvh").read_text() == FILES[name]
