from __future__ import annotations

import csv
import json
import subprocess
from pathlib import Path

import pytest
import torch

from hopdiff.io.record import git_state, prepare_folder, versions, write_json, write_table
from hopdiff.types import HopdiffError


def git(folder: Path, *command: str) -> str:
    identity = ["-c", "user.name=x", "-c", "user.email=x@localhost"]
    return subprocess.run(
        ["git", *identity, "-C", str(folder), *command], check=True, capture_output=True, text=True
    ).stdout.strip()


def test_prepare_folder_leaves_nothing(tmp_path: Path) -> None:
    prepare_folder(tmp_path / "a" / "b")
    assert list((tmp_path / "a" / "b").iterdir()) == []


def test_a_folder_below_a_file_is_refused(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(HopdiffError, match=r"file/run.* cannot be written"):
        prepare_folder(tmp_path / "file" / "run")


def test_table_has_blanks_for_what_is_not_there(tmp_path: Path) -> None:
    write_table(tmp_path / "t.csv", ("a", "b", "c"), [(1, float("nan"), "x,y"), (2, None, float("inf"))])
    rows = list(csv.DictReader((tmp_path / "t.csv").read_text().splitlines()))
    assert rows == [{"a": "1", "b": "nan", "c": "x,y"}, {"a": "2", "b": "", "c": "inf"}]


def test_json_holds_no_nan(tmp_path: Path) -> None:
    write_json(tmp_path / "m.json", {"a": float("nan"), "b": [1.5, float("inf")], "c": {0.4: True}})
    text = (tmp_path / "m.json").read_text()

    def refuse(name: str) -> None:
        raise AssertionError(name)

    assert json.loads(text, parse_constant=refuse) == {"a": None, "b": [1.5, None], "c": {"0.4": True}}


def test_versions_name_the_command_and_torch() -> None:
    made_with = versions(["speed=3"], threads=1)
    assert made_with["command"] == ["speed=3"]
    assert made_with["torch"].split("+")[0] == torch.__version__.split("+")[0]
    assert made_with["threads"] == 1


def test_git_state_follows_the_checkout(tmp_path: Path) -> None:
    assert git_state(tmp_path) == {"checkout": False}
    git(tmp_path, "init", "-q", "-b", "trunk")
    assert git_state(tmp_path) == {"checkout": False}
    (tmp_path / "a").write_text("1")
    git(tmp_path, "add", "a")
    git(tmp_path, "commit", "-q", "-m", "one")
    state = git_state(tmp_path)
    assert state == {"checkout": True, "commit": git(tmp_path, "rev-parse", "HEAD"), "branch": "trunk", "dirty": False}
    (tmp_path / "site-packages").mkdir()
    assert git_state(tmp_path / "site-packages") == {"checkout": False}
    (tmp_path / "a").write_text("2")
    assert git_state(tmp_path)["dirty"] is True


def test_git_state_without_git(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    assert git_state(Path(__file__).parent) == {"checkout": False}
