"""The record of a run: metrics, history, settings, and what it was made with."""

from __future__ import annotations

import csv
import json
import math
import os
import platform
import subprocess
import sys
from collections.abc import Iterable, Mapping, Sequence
from importlib.metadata import PackageNotFoundError, version
from io import StringIO
from pathlib import Path
from typing import Any

import yaml

from hopdiff import __version__
from hopdiff.io.files import write_whole
from hopdiff.types import HopdiffError

LIBRARIES = (
    "torch",
    "numpy",
    "hydra-core",
    "omegaconf",
    "matplotlib",
    "tensorboard",
    "pillow",
    "cma",
    "scipy",
    "svgelements",
    "shapely",
    "pyyaml",
    "trimesh",
)


_DUMPER = getattr(yaml, "CSafeDumper", yaml.SafeDumper)


def prepare_folder(folder: Path) -> None:
    """Make a folder and see that files can be written there. Raises HopdiffError otherwise."""
    probe = folder / f".write-test-{os.getpid()}"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        probe.write_bytes(b"")
        probe.unlink()
    except OSError as error:
        raise HopdiffError(f"The run folder {str(folder)!r} cannot be written: {error.strerror or error}.") from error


def write_table(path: Path, columns: Sequence[str], rows: Iterable[Sequence[Any]]) -> None:
    """Write a CSV file with a header; None becomes an empty cell."""
    text = StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(columns)
    for row in rows:
        writer.writerow("" if value is None else value for value in row)
    write_whole(path, text.getvalue())


def write_json(path: Path, content: Mapping[str, Any]) -> None:
    """Write a JSON file that every reader takes: numbers that are not finite become null."""
    write_whole(path, json.dumps(finite(content), indent=2, allow_nan=False) + "\n")


def write_settings(folder: Path, settings: Mapping[str, Any]) -> None:
    """Write the whole configuration."""
    text = yaml.dump(dict(settings), Dumper=_DUMPER, sort_keys=False, allow_unicode=True)
    write_whole(folder / "config.yaml", text)


def write_record(folder: Path, settings: Mapping[str, Any], command: list[str]) -> None:
    """Write what a run was made with: config.yaml, versions.json, git.json.

    settings: the whole configuration as plain data. command: the overrides typed by the user.
    """
    write_settings(folder, settings)
    write_json(folder / "versions.json", versions(command, settings["threads"]))
    write_json(folder / "git.json", git_state(Path(__file__).parents[1]))


def versions(command: Sequence[str], threads: int | None = None) -> dict[str, Any]:
    """What a run was made with, as far as it bears on repeating it. command: the overrides typed by the user.
    threads: of PyTorch."""
    return {
        "command": list(command),
        "hopdiff": __version__,
        "python": platform.python_version(),
        "platform": platform.platform(),
        "machine": platform.machine(),
        "threads": threads,
        "executable": Path(sys.executable).name,
        **{name: _version(name) for name in LIBRARIES},
    }


def git_state(folder: Path) -> dict[str, Any]:
    """The commit of the checkout that holds a folder, and whether tracked files differ from it."""
    commit = _git(folder, "rev-parse", "HEAD")
    # An environment may lie inside the checkout of something else; then nothing of this folder is tracked.
    if commit is None or not _git(folder, "ls-files", "."):
        return {"checkout": False}
    status = _git(folder, "status", "--porcelain", "--untracked-files=no")
    return {
        "checkout": True,
        "commit": commit,
        "branch": _git(folder, "rev-parse", "--abbrev-ref", "HEAD"),
        "dirty": bool(status) if status is not None else None,
    }


def _git(folder: Path, *command: str) -> str | None:
    """What a git command prints, or None where there is no git, no checkout, or a checkout without commits."""
    try:
        done = subprocess.run(
            ["git", "-C", str(folder), *command], capture_output=True, text=True, timeout=10, check=True
        )
    except (OSError, subprocess.SubprocessError):
        return None
    return done.stdout.strip()


def _version(name: str) -> str | None:
    try:
        return version(name)
    except PackageNotFoundError:
        return None


def finite(value: Any) -> Any:
    """Plain data whose numbers that are not finite have become None."""
    if isinstance(value, Mapping):
        return {str(key): finite(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [finite(entry) for entry in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
