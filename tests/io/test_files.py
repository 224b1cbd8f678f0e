from __future__ import annotations

import os
import stat
from pathlib import Path

import pytest

from hopdiff.io.files import read_json, read_text, whole_file, whole_folder, write_whole
from hopdiff.types import HopdiffError


def test_text_and_bytes_arrive_as_given(tmp_path):
    write_whole(tmp_path / "a.txt", "höhe\r\n\n")
    write_whole(tmp_path / "b.bin", b"\x00\xff")
    assert (tmp_path / "a.txt").read_bytes() == "höhe\r\n\n".encode()
    assert (tmp_path / "b.bin").read_bytes() == b"\x00\xff"
    assert sorted(os.listdir(tmp_path)) == ["a.txt", "b.bin"]


@pytest.mark.parametrize("failure", [ValueError, KeyboardInterrupt])
def test_failure_leaves_the_old_file_and_nothing_else(tmp_path, failure):
    target = tmp_path / "motion.bvh"
    write_whole(target, "old")

    def fail_half_way():
        with whole_file(target) as file:
            file.write("half of the n")
            file.flush()
            raise failure

    with pytest.raises(failure):
        fail_half_way()
    assert target.read_text() == "old"
    assert os.listdir(tmp_path) == ["motion.bvh"]


def test_file_is_not_seen_before_it_is_whole(tmp_path):
    target = tmp_path / "motion.gif"
    with whole_file(target, "wb") as file:
        file.write(b"x")
        file.flush()
        assert not target.exists()
    assert target.read_bytes() == b"x"


def test_permissions_follow_the_umask(tmp_path):
    (tmp_path / "plain").write_text("")
    write_whole(tmp_path / "whole", "")
    assert stat.S_IMODE((tmp_path / "whole").stat().st_mode) == stat.S_IMODE((tmp_path / "plain").stat().st_mode)


def test_missing_folder_is_named(tmp_path):
    target = tmp_path / "nowhere" / "motion.bvh"
    with pytest.raises(HopdiffError, match=r"cannot write .*nowhere.motion.bvh: no such file or directory"):
        write_whole(target, "x")


def test_folder_in_place_of_the_file(tmp_path):
    (tmp_path / "taken").mkdir()
    with pytest.raises(HopdiffError, match=r"cannot write .*taken: "):
        write_whole(tmp_path / "taken", "x")
    assert os.listdir(tmp_path) == ["taken"]


def test_folder_without_permission(tmp_path):
    locked = tmp_path / "locked"
    locked.mkdir(mode=0o500)
    if os.access(locked, os.W_OK):
        pytest.skip("this user may write anywhere")
    with pytest.raises(HopdiffError, match="permission denied"):
        write_whole(locked / "motion.bvh", "x")


def test_unknown_mode_is_a_programming_error(tmp_path):
    with pytest.raises(ValueError, match="mode"), whole_file(tmp_path / "a", "r"):
        pass


def test_read_json(tmp_path):
    write_whole(tmp_path / "genes.json", '{"a": [1, 2.5]}')
    assert read_json(tmp_path / "genes.json") == {"a": [1, 2.5]}


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b'{\n"a": 1,\n"b": }\n', "genes.json, line 3: not JSON"),
        (b"", "genes.json, line 1: not JSON"),
        (b"\xff\xfe{", "genes.json: it is not UTF-8 text"),
        (b"[" * 200_000, "genes.json"),
    ],
)
def test_bad_json_is_named_with_its_line(tmp_path, content, message):
    (tmp_path / "genes.json").write_bytes(content)
    with pytest.raises(HopdiffError, match=message):
        read_json(tmp_path / "genes.json")


def test_missing_file_is_named(tmp_path):
    with pytest.raises(HopdiffError, match=r"cannot read .*genes.json: no such file"):
        read_text(tmp_path / "genes.json")


def test_folders_appear_whole_or_not_at_all(tmp_path: Path) -> None:
    target = tmp_path / "pictures"
    with whole_folder(target) as folder:
        (folder / "a").write_text("1")
        assert not target.exists()
    for error in (KeyboardInterrupt, ZeroDivisionError):
        with pytest.raises(error), whole_folder(target) as folder:
            (folder / "b").write_text("2")
            raise error
        assert [path.name for path in tmp_path.rglob("*")] == ["pictures", "a"]
    with whole_folder(target) as folder:
        (folder / "c").write_text("3")
    assert [path.name for path in tmp_path.rglob("*")] == ["pictures", "c"]
    with pytest.raises(HopdiffError, match=r"cannot write .*nowhere"), whole_folder(tmp_path / "nowhere" / "b"):
        pass


def test_a_folder_that_cannot_be_replaced_stays_as_it_was(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    target, real = tmp_path / "pictures", os.replace
    target.mkdir()
    (target / "a").write_text("1")

    def refused(source: Path, place: Path) -> None:
        # The drafted folder cannot be moved into place; what was there before can be moved back.
        if (Path(source) / "b").exists():
            raise PermissionError(13, "Permission denied")
        real(source, place)

    monkeypatch.setattr(os, "replace", refused)
    with (
        pytest.raises(HopdiffError, match=r"cannot write .*pictures: permission denied"),
        whole_folder(target) as folder,
    ):
        (folder / "b").write_text("2")
    assert [path.name for path in tmp_path.rglob("*")] == ["pictures", "a"]
