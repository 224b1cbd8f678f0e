"""Running commands in a checkout, and telling what they made in a few digits."""

from __future__ import annotations

import hashlib
import json
import os
import re
import subprocess
import sys
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

DIGITS = 12
MOTIONS = ("*.bvh", "frames.csv", "joints.csv", "*.glb")
# Metrics that tell how long something took, which no two runs share.
TIMED = re.compile(r"(^|_)seconds$|^ms_|^milliseconds")
ONE_THREAD = {"OMP_NUM_THREADS": "1", "MPLBACKEND": "Agg"}


class CommandError(Exception):
    """A command that did not end well; the message is its last line."""


def is_checkout(folder: Path) -> bool:
    """Whether Python finds hopdiff in this folder when started there, and not elsewhere."""
    code = "import pathlib, hopdiff; print(pathlib.Path(hopdiff.__file__).resolve().parents[1])"
    done = _python(folder, ["-c", code])
    return done.returncode == 0 and Path(done.stdout.strip()) == folder.resolve()


def commit(folder: Path) -> str:
    """The commit of a checkout, with a word if tracked files differ from it."""

    def git(*words: str) -> str:
        done = subprocess.run(["git", "-C", str(folder), *words], capture_output=True, text=True, check=True)
        return done.stdout.strip()

    changed = git("status", "--porcelain", "--untracked-files=no", "--", "hopdiff", "conf")
    return git("rev-parse", "--short=8", "HEAD") + (" with changes" if changed else "")


def perform(checkout: Path, words: Sequence[str], folder: Path) -> None:
    """Run `python -m hopdiff` in a checkout, into a folder. Raises CommandError."""
    done = _python(checkout, ["-m", "hopdiff", *words, f"hydra.run.dir={folder}", "pictures=false"])
    if done.returncode:
        lines = (done.stderr or done.stdout).strip().splitlines()
        raise CommandError(lines[-1] if lines else f"status {done.returncode}")


def _python(checkout: Path, words: Sequence[str]) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, *words], cwd=checkout, env={**os.environ, **ONE_THREAD}, capture_output=True, text=True
    )


class Made:
    """What a command left in its folder.

    digests: of whole files, by name. tables: numbers of genes.json and metrics.json, by file and name.
    """

    def __init__(self, folder: Path) -> None:
        found = sorted(path for pattern in MOTIONS for path in folder.glob(pattern))
        self.digests = {path.name: digest(path.read_bytes()) for path in found}
        self.tables: dict[str, dict[str, Any]] = {}
        if (genes := folder / "genes.json").is_file():
            entries = json.loads(genes.read_text(encoding="utf-8"))["genes"]
            self.tables[genes.name] = {name: entry["value"] for name, entry in entries.items()}
        if (metrics := folder / "metrics.json").is_file():
            content = json.loads(metrics.read_text(encoding="utf-8"))
            self.tables[metrics.name] = {name: value for name, value in numbers(content) if not TIMED.search(name)}


def numbers(node: Any, name: str = "") -> Iterator[tuple[str, Any]]:
    """The numbers below a node of JSON, null and truth values included, by dotted name; texts are left out."""
    if isinstance(node, Mapping):
        for key, value in node.items():
            yield from numbers(value, f"{name}.{key}" if name else key)
    elif isinstance(node, list):
        for place, value in enumerate(node):
            yield from numbers(value, f"{name}.{place}")
    elif not isinstance(node, str):
        yield name, node


def digest(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()[:DIGITS]


def digest_of(table: Mapping[str, Any], names: Sequence[str]) -> str:
    """Of the values of these names. A float is written with all the digits that tell it from others."""
    return digest(json.dumps({name: table[name] for name in names}, sort_keys=True).encode())
