"""Damaged BVH files: never anything but a result or one sentence that names the line."""

from __future__ import annotations

import re
import tempfile
from collections.abc import Callable
from pathlib import Path

import pytest
import torch
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from hopdiff.io.bvh import read_bvh
from hopdiff.types import HopdiffError
from tests.io.bvh_files import FILES

# The plain one below a root that stands still.
STILL = FILES["plain"].replace("ROOT Hips", "ROOT World\n{\n OFFSET 0 0 0\n CHANNELS 1 Yrotation\nJOINT Hips")
STILL = re.sub(r"^(?=\d)", "0 ", STILL.replace("\nMOTION", "}\nMOTION"), flags=re.MULTILINE)
WHOLE = [text.encode() for text in (*FILES.values(), STILL, FILES["plain"].replace("\n", "\r\n"))]
WORDS = (
    b"HIERARCHY ROOT JOINT End Site OFFSET CHANNELS MOTION Frames: Frame Time: { } Xposition Zrotation 3 -1 0 1e3 nan"
    b" inf -inf 1e999 1e-999 9999999999999999999999 1,5 1.2.3 -- 0x1F 1_0 \xff \x00 # // \xef\xbb\xbf \xe2\x80\x83"
).split(b" ")

Damage = Callable[[bytes], bytes]


def cut(data: bytes, start: int, length: int) -> bytes:
    start %= len(data) + 1
    return data[:start] + data[start + length :]


def flip(data: bytes, at: int, value: int) -> bytes:
    at %= max(len(data), 1)
    return data[:at] + bytes([value]) + data[at + 1 :]


def drop_line(data: bytes, at: int) -> bytes:
    lines = data.split(b"\n")
    del lines[at % len(lines)]
    return b"\n".join(lines)


def repeat_line(data: bytes, at: int, to: int) -> bytes:
    lines = data.split(b"\n")
    lines.insert(to % (len(lines) + 1), lines[at % len(lines)])
    return b"\n".join(lines)


def swap_lines(data: bytes, at: int, to: int) -> bytes:
    lines = data.split(b"\n")
    at, to = at % len(lines), to % len(lines)
    lines[at], lines[to] = lines[to], lines[at]
    return b"\n".join(lines)


def replace_word(data: bytes, at: int, word: bytes) -> bytes:
    spans = [found.span() for found in re.finditer(rb"\S+", data)]
    if not spans:
        return word
    start, end = spans[at % len(spans)]
    return data[:start] + word + data[end:]


PLACE = st.integers(0, 5000)
ONE_DAMAGE = st.one_of(
    st.tuples(st.just(cut), PLACE, st.one_of(st.just(10**6), st.integers(1, 200))),
    st.tuples(st.just(flip), PLACE, st.integers(0, 255)),
    st.tuples(st.just(drop_line), PLACE),
    st.tuples(st.just(repeat_line), PLACE, PLACE),
    st.tuples(st.just(swap_lines), PLACE, PLACE),
    st.tuples(st.just(replace_word), PLACE, st.sampled_from(WORDS)),
    st.tuples(st.just(replace_word), PLACE, st.floats().map(lambda value: repr(value).encode())),
    st.tuples(st.just(replace_word), PLACE, st.integers().map(lambda value: str(value).encode())),
)
DAMAGED = st.builds(
    lambda data, damages, from_motion: damaged(data, damages, from_motion),
    st.sampled_from(WHOLE),
    st.lists(ONE_DAMAGE, min_size=1, max_size=4),
    st.booleans(),
)


def damaged(data: bytes, damages: list[tuple], from_motion: bool) -> bytes:
    """from_motion: whether the hierarchy stays whole, which is most of these short files."""
    start = data.index(b"MOTION") if from_motion else 0
    good, data = data[:start], data[start:]
    for damage, *how in damages:
        data = damage(data, *how)
    return good + data


def check(data: bytes) -> None:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "a.bvh"
        path.write_bytes(data)
        try:
            file = read_bvh(path)
        except HopdiffError as error:
            message = str(error)
            assert message.startswith(str(path))
            assert message.endswith(".")
            assert "\n" not in message
            line = re.match(r", line (\d+): ", message.removeprefix(str(path)))
            if line is None:
                assert message == f"{path}: the file is empty."
            else:
                assert 1 <= int(line.group(1)) <= len(re.split(rb"\r\n|\r|\n", data))
            return
        # What is read is sound: it means a motion, and comes back.
        clip = file.clip()
        assert bool(torch.isfinite(clip.joint_positions()).all())
        assert len(set(clip.skeleton.names)) == len(clip.skeleton.names) <= len(file.joints)
        assert len(set(file.names)) == len(file.joints)
        torch.testing.assert_close(file.with_motion(clip).values, file.values, atol=1e-6, rtol=1e-9)
        file.write(path)
        again = read_bvh(path)
        assert again.joints == file.joints
        assert torch.equal(again.values, file.values)
        assert again.frame_time == file.frame_time


def test_whole_files_are_read(tmp_path: Path) -> None:
    (tmp_path / "a.bvh").write_text(STILL)
    assert read_bvh(tmp_path / "a.bvh").carrier == 1
    for data in WHOLE:
        check(data)


@settings(max_examples=300, deadline=None)
@given(DAMAGED)
def test_damaged_files_are_read_or_refused_with_the_line(data: bytes) -> None:
    check(data)


@pytest.mark.thorough
@settings(max_examples=10_000, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(DAMAGED)
def test_ten_thousand_damaged_files_are_read_or_refused_with_the_line(data: bytes) -> None:
    check(data)


@settings(max_examples=200, deadline=None)
@given(st.binary(max_size=400))
def test_any_bytes_are_refused_with_the_line(data: bytes) -> None:
    check(data)


@settings(max_examples=100, deadline=None)
@given(st.text(max_size=60), st.text(max_size=60))
def test_any_text_among_good_lines_is_read_or_refused(name: str, row: str) -> None:
    text = FILES["plain"].replace("LeftLeg", name).replace("\n2.5000", f"\n{row}\n2.5000")
    check(text.encode("utf-8", "replace"))
