from __future__ import annotations

import json
import os
import select
import shutil
import stat
import struct
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from hopdiff.export import blender_fbx
from hopdiff.export.fbx import VARIABLE, find_blender, write_fbx
from hopdiff.export.glb import glb_bytes
from hopdiff.types import HopdiffError
from tests.export.takes import own

GLB = b"glTF as bytes"
SAYS_BLENDER = 'if [ "$1" = --version ]; then echo "Blender 9.9"; exit 0; fi\n'
SAYS_PYTHON = 'if [ "$1" = --version ]; then echo "Python 3.99"; exit 0; fi\n'
pytestmark = pytest.mark.skipif(os.name == "nt", reason="the stand-ins for Blender are shell scripts")


@pytest.fixture(autouse=True)
def programs(monkeypatch: pytest.MonkeyPatch, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The only folder on PATH: what the stand-ins need, and no Blender."""
    folder = tmp_path_factory.mktemp("bin")
    for name in ("cat", "sleep"):
        (folder / name).symlink_to(str(shutil.which(name)))
    monkeypatch.delenv(VARIABLE, raising=False)
    monkeypatch.setenv("PATH", str(folder))
    return folder


def program(path: Path, script: str) -> str:
    path.write_text(f"#!/bin/sh\n{script}")
    path.chmod(path.stat().st_mode | stat.S_IXUSR)
    return str(path)


def test_without_blender_one_sentence_says_how_to_get_it(tmp_path: Path) -> None:
    with pytest.raises(HopdiffError) as raised:
        write_fbx(tmp_path / "motion.fbx", GLB)
    assert "pip install bpy" in str(raised.value)
    assert VARIABLE in str(raised.value)
    assert list(tmp_path.iterdir()) == []


def test_a_blender_that_is_not_there_is_named_by_its_setting(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(HopdiffError, match=r"^blender=/no/blender: there is no such program"):
        find_blender("/no/blender")
    monkeypatch.setenv(VARIABLE, "/no/such/python")
    with pytest.raises(HopdiffError, match=f"^{VARIABLE}=/no/such/python: "):
        find_blender()


def test_the_setting_goes_before_the_variable_and_that_before_the_path(
    programs: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    found = program(programs / "blender", "exit 0\n")
    assert find_blender() == found
    named = program(tmp_path / "named", "exit 0\n")
    monkeypatch.setenv(VARIABLE, named)
    assert find_blender() == named
    chosen = program(tmp_path / "chosen", "exit 0\n")
    assert find_blender(chosen) == chosen


@pytest.mark.parametrize(
    ("says", "source", "before"),
    [
        (SAYS_BLENDER, "eval source=\\${$(($# - 1))}\n", "--background --factory-startup"),
        (SAYS_PYTHON, "source=$2\n", ""),
    ],
)
def test_the_file_is_what_blender_made_of_the_glb_file(tmp_path: Path, says: str, source: str, before: str) -> None:
    # Copies its last argument but one to its last, and tells what it was called with.
    script = f'{says}{source}eval target=\\${{$#}}\n(cat "$source"; echo " $*") > "$target"\n'
    blender = program(tmp_path / "blender", script)
    glb = tmp_path / "motion.glb"
    glb.write_bytes(GLB)
    write_fbx(tmp_path / "motion.fbx", glb, blender)
    made = (tmp_path / "motion.fbx").read_bytes()
    assert made.startswith(GLB + b" " + before.encode())
    assert b"blender_fbx.py" in made
    assert (b" -- " in made) == bool(before)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["blender", "motion.fbx", "motion.glb"]


@pytest.mark.parametrize(
    ("script", "message"),
    [
        ("echo working\necho 'Error: out of bones' >&2\nexit 1\n", "failed: Error: out of bones."),
        ("exit 7\n", "it ended with 7"),
        ("echo \"ModuleNotFoundError: No module named 'bpy'\" >&2\nexit 1\n", "pip install bpy"),
        ("exit 0\n", "made no FBX file"),
        # Half a file, and then it fails.
        ('eval target=\\${$#}\necho half > "$target"\nexit 1\n', "failed"),
    ],
)
def test_what_fails_leaves_an_older_file_as_it_was(tmp_path: Path, script: str, message: str) -> None:
    blender = program(tmp_path / "blender", SAYS_PYTHON + script)
    target = tmp_path / "motion.fbx"
    target.write_bytes(b"older")
    with pytest.raises(HopdiffError) as raised:
        write_fbx(target, GLB, blender)
    assert message in str(raised.value)
    assert "\n" not in str(raised.value)
    assert target.read_bytes() == b"older"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["blender", "motion.fbx"]


def test_a_blender_that_hangs_is_stopped_with_all_that_it_started(tmp_path: Path) -> None:
    # The shell's child holds its output open, and a pipe of ours: the pipe ends when the last of them has.
    os.mkfifo(tmp_path / "held")
    pipe = os.open(tmp_path / "held", os.O_RDONLY | os.O_NONBLOCK)
    blender = program(tmp_path / "blender", f"{SAYS_PYTHON}exec 3>'{tmp_path / 'held'}'\nsleep 60\necho never\n")
    try:
        with pytest.raises(HopdiffError, match=r"was not done after 0\.5 s and was stopped"):
            write_fbx(tmp_path / "motion.fbx", GLB, blender, seconds=0.5)
        assert select.select([pipe], [], [], 20.0)[0]
        assert os.read(pipe, 1) == b""
    finally:
        os.close(pipe)
    assert not (tmp_path / "motion.fbx").exists()


def test_a_program_that_cannot_be_run_and_a_file_that_cannot_be_read(tmp_path: Path) -> None:
    broken = tmp_path / "blender"
    broken.write_bytes(b"\x7fELF no program")
    broken.chmod(0o755)
    with pytest.raises(HopdiffError, match="cannot be run"):
        write_fbx(tmp_path / "motion.fbx", GLB, str(broken))
    with pytest.raises(HopdiffError, match=r"cannot read .*none\.glb: no such file"):
        write_fbx(tmp_path / "motion.fbx", tmp_path / "none.glb", program(tmp_path / "fine", "exit 0\n"))


class Curve:
    """A curve as Blender has it."""

    def __init__(self, path: str, keys: list[float]) -> None:
        self.data_path = path
        self.keys = keys
        self.keyframe_points = self

    def __len__(self) -> int:
        return len(self.keys) // 2

    def __iter__(self) -> Any:
        return iter([SimpleNamespace(interpolation="") for _ in range(len(self))])

    def foreach_get(self, _: str, into: list[float]) -> None:
        into[:] = self.keys

    def foreach_set(self, _: str, values: list[float]) -> None:
        self.keys = list(values)

    def update(self) -> None:
        pass


def test_keys_come_onto_whole_frames_whatever_rate_the_importer_believed_in() -> None:
    # 0.5 s in 30 steps of 60 frames/s and 0.75 s in 30 of 40, read at 24 frames/s; a still curve has two keys.
    moving = [value for k in range(31) for value in (0.4 * k, 0.01 * k)]
    slower = [value for k in range(31) for value in (0.6 * k, 1.0)]
    turned, placed = Curve("rotation_quaternion", moving), Curve('pose.bones["a"].location', [0.0, 0.5, 12.0, 0.5])
    actions = [
        SimpleNamespace(name="a", fcurves=[turned, placed]),
        SimpleNamespace(name="b", fcurves=[Curve("", slower)]),
    ]
    assert blender_fbx.retime(actions, 0.75) == {"a": 60.0, "b": 40.0}
    assert turned.keys[::2] == [float(k) for k in range(31)]
    assert turned.keys[1::2] == moving[1::2]
    assert placed.keys == [0.0, 50.0, 30.0, 50.0]


def test_the_longest_animation_of_a_glb_file(tmp_path: Path) -> None:
    content = {
        "accessors": [{"max": [0.7]}, {"max": [1.25]}, {"max": [9.0]}],
        "animations": [{"samplers": [{"input": 0}]}, {"samplers": [{"input": 0}, {"input": 1}]}],
    }
    text = json.dumps(content).encode()
    file = tmp_path / "a.glb"
    file.write_bytes(struct.pack("<4sIII4s", b"glTF", 2, 20 + len(text), len(text), b"JSON") + text)
    assert blender_fbx.duration(str(file)) == 1.25


def test_contacts_of_every_animation_are_told_as_json(tmp_path: Path) -> None:
    file = tmp_path / "a.glb"
    file.write_bytes(glb_bytes([own(), replace(own(), name="again")]))
    told = {name: json.loads(events) for name, events in blender_fbx.told(str(file)).items()}
    assert list(told) == ["run", "again"]
    assert [event["name"] for event in told["again"]] == ["LeftDown", "LeftUp", "RightDown", "RightUp"]
