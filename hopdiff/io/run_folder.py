"""The folder of a run: who is writing in it, what it holds, and how that ended.

`status.json` tells it: running, complete, interrupted or failed with its sentence, beside the words that were typed.
A lock that the operating system takes back from whoever dies tells a run that is going on from one that was killed.
"""

from __future__ import annotations

import hashlib
import json
import shutil
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from filelock import FileLock, Timeout

from hopdiff.io.files import read_json
from hopdiff.io.record import finite, prepare_folder, write_json
from hopdiff.types import HopdiffError

STATUS, LOCK = "status.json", ".lock"
VERSION = 1
RUNNING, COMPLETE, INTERRUPTED, FAILED = STATES = ("running", "complete", "interrupted", "failed")
# Whoever holds none of these holds no run.
SIGNS = (STATUS, "metrics.json", "genes.json", "config.yaml")
# What tasks write, for folders that were killed before they could tell; exports are named by the status.
WRITTEN = (
    *("genes.json", "metrics.json", "history.csv", "config.yaml", "versions.json", "git.json", STATUS),
    *("motion.bvh", "motion_in_place.bvh", "motion.npz", "motion.gif", "motion.webp", "motion.mp4", "path.csv"),
    *("strip.png", "com_track.png", "angles.png", "front.png", "convergence.png", "path.png", "along.png"),
    *("edited.bvh", "feet.png", "walk.bvh", "rooms.png", "frames.csv", "hopper.png", "body.csv", "body.png"),
)
DRAFTS = ("events.out.tfevents.*", ".*.part", ".events-*")


class RefusedError(HopdiffError):
    """A run may not have the folder that it was given."""


@dataclass(frozen=True)
class Note:
    """Something of a finished run that its user should know. flag: for programs. sentence: for people."""

    flag: str
    sentence: str


@dataclass
class RunFolder:
    """A folder that this process writes in, until the block of `opened` ends. notes: as they turn up.

    others: names of files that lay there before, which are not the run's. folders: names of folders that it made.
    """

    path: Path
    task: str
    command: Sequence[str]
    identity: str
    notes: list[Note] = field(default_factory=list)
    interrupted: bool = False
    others: frozenset[str] = frozenset()
    folders: list[str] = field(default_factory=list)
    started: str = field(default_factory=lambda: _now())

    def write(self, status: str, sentence: str | None = None) -> None:
        """Write `status.json`."""
        ended = None if status == RUNNING else _now()
        files = sorted(name for name in _files_in(self.path) if name in WRITTEN or name not in self.others)
        content = {
            "version": VERSION,
            "status": status,
            "sentence": sentence,
            "task": self.task,
            "overrides": list(self.command),
            "settings": self.identity,
            "started": self.started,
            "ended": ended,
            "notes": [vars(note) for note in self.notes],
            "files": [] if status == RUNNING else [name for name in files if name != STATUS],
            "folders": sorted(self.folders),
        }
        write_json(self.path / STATUS, content)


def identity_of(settings: Mapping[str, Any]) -> str:
    """A short word for settings (plain data): equal for the same ones only."""
    plain = {name: value for name, value in settings.items() if name != "overwrite"}
    return hashlib.sha256(json.dumps(finite(plain), sort_keys=True).encode()).hexdigest()[:16]


def read_status(folder: Path) -> dict[str, Any] | None:
    """What `status.json` says, None where there is none; a run that was killed is told as interrupted.

    Raises HopdiffError if the file is broken.
    """
    path = folder / STATUS
    if not path.is_file():
        return None
    content = read_json(path)
    if not isinstance(content, dict) or content.get("status") not in STATES:
        raise HopdiffError(f"{path} is not the status of a run.")
    if content["status"] == RUNNING and not _in_use(folder):
        content |= {"status": INTERRUPTED, "sentence": "The run was killed before it could end."}
    return content


def is_complete(folder: Path, settings: Mapping[str, Any]) -> bool:
    """Whether the run of these settings is there already, whole. Raises HopdiffError if a run of others is there."""
    found = read_status(folder)
    if found is None:
        return False
    if found.get("settings") != identity_of(settings):
        raise RefusedError(_held(folder, f"a run with other settings ({found['status']})"))
    return bool(found["status"] == COMPLETE)


@contextmanager
def opened(
    folder: Path, task: str, command: Sequence[str], settings: Mapping[str, Any], overwrite: bool = False
) -> Iterator[RunFolder]:
    """Take a folder for one run: make it, lock it, say so in `status.json`, and at the end say how it ended.

    A run of the same settings that was interrupted or failed is made anew in its place; overwrite: whatever run is
    there is cleared away. settings: the whole configuration as plain data.
    Raises HopdiffError if the folder cannot be written, is in use, or holds another run.
    """
    identity = identity_of(settings)
    fresh = not folder.exists()
    prepare_folder(folder)
    lock = FileLock(folder / LOCK, timeout=0)
    try:
        lock.acquire()
    except Timeout as error:
        raise RefusedError(f"The run folder {str(folder)!r} is in use: another run is writing in it.") from error
    try:
        if not fresh:
            _make_room(folder, identity, overwrite)
        run = RunFolder(folder, task, command, identity, others=frozenset(_files_in(folder)))
        run.write(RUNNING)
        try:
            yield run
        except KeyboardInterrupt:
            found = any((folder / name).is_file() for name in ("genes.json", "metrics.json"))
            run.write(INTERRUPTED, _HALF if found else "Interrupted before anything was found.")
            raise
        except BaseException as error:
            said = str(error) if isinstance(error, HopdiffError) else f"{type(error).__name__}: {error}"
            run.write(FAILED, said)
            raise
        run.write(INTERRUPTED if run.interrupted else COMPLETE, _BEST if run.interrupted else None)
    finally:
        (folder / LOCK).unlink(missing_ok=True)
        lock.release()


_BEST = "The search was broken off: this is the best run that it had found."
_HALF = "Interrupted while its files were written: what has a name here is whole, others are missing."


def record_failure(folder: Path, task: str, command: Sequence[str], settings: Mapping[str, Any], said: str) -> None:
    """Say in the folder of a job why it could not begin."""
    prepare_folder(folder)
    others = frozenset(_files_in(folder))
    RunFolder(folder, task, command, identity_of(settings), others=others).write(FAILED, said)


def _make_room(folder: Path, identity: str, overwrite: bool) -> None:
    """Clear the run of a folder away, if that may be done."""
    if not any((folder / name).exists() for name in SIGNS):
        return
    try:
        # The lock is ours, so that nothing here is running.
        found = read_json(folder / STATUS) if (folder / STATUS).is_file() else None
    except HopdiffError:
        found = None
    status = found.get("status") if isinstance(found, dict) else None
    if not overwrite:
        if found is None:
            raise RefusedError(_held(folder, "another run"))
        if found.get("settings") != identity:
            raise RefusedError(_held(folder, "a run with other settings"))
        if status == COMPLETE:
            raise RefusedError(_held(folder, "this very run, complete"))
    names = {*WRITTEN, *(found.get("files", ()) if isinstance(found, dict) else ())}
    for name in names:
        if Path(str(name)).name == name:  # nothing outside of the folder
            (folder / name).unlink(missing_ok=True)
    made = found.get("folders") if isinstance(found, dict) else None
    for name in made if isinstance(made, list) else ():
        if Path(str(name)).name == name and name not in ("", ".", ".."):
            _remove(folder / name)
    for pattern in DRAFTS:
        for path in folder.glob(pattern):
            if path.is_file():
                path.unlink()
            elif path.suffix == ".part":
                _remove(path)


def _remove(folder: Path) -> None:
    """Remove a folder that holds nothing but files."""
    if folder.is_dir() and not folder.is_symlink() and all(path.is_file() for path in folder.iterdir()):
        shutil.rmtree(folder, ignore_errors=True)


def _held(folder: Path, what: str) -> str:
    return (
        f"The run folder {str(folder)!r} holds {what}: set overwrite=true to clear it, or another folder"
        " (hydra.run.dir, of a sweep hydra.sweep.dir)."
    )


def _in_use(folder: Path) -> bool:
    if not (folder / LOCK).exists():
        return False
    lock = FileLock(folder / LOCK, timeout=0)
    try:
        lock.acquire()
    except Timeout:
        return True
    except OSError:
        return False
    lock.release()
    return False


def _files_in(folder: Path) -> list[str]:
    return [path.name for path in folder.iterdir() if path.is_file() and not path.name.startswith(".")]


def _now() -> str:
    return datetime.now(UTC).isoformat(timespec="seconds")
