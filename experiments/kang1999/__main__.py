"""Build the gallery: `python -m experiments.kang1999`. Makes the runs that lack, then README.md and pictures/."""

from __future__ import annotations

import argparse
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

from tqdm import tqdm

from experiments.kang1999.entries import ENTRIES, Shot
from experiments.kang1999.gallery import write_gallery
from experiments.report import words

HERE = Path(__file__).parent
RUNS = Path("outputs/kang1999")


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(prog="python -m experiments.kang1999", description=__doc__)
    parser.add_argument("--figures", type=words, help="only these, such as 3.4,5.1; the gallery then holds no others")
    parser.add_argument("--runs", type=Path, default=RUNS, help="folder of the run folders; finished ones are kept")
    parser.add_argument("--out", type=Path, default=HERE, help="folder of the gallery")
    parser.add_argument("--set", nargs="*", default=[], metavar="NAME=VALUE", help="settings put to every command")
    given = parser.parse_args(arguments)
    entries = [entry for entry in ENTRIES if not given.figures or entry.figure in given.figures]
    if unknown := set(given.figures or ()) - {entry.figure for entry in entries}:
        parser.error(f"no figure {', '.join(sorted(unknown))}; there are {', '.join(e.figure for e in ENTRIES)}")
    folders: dict[str, Path] = {}
    for shot in tqdm([shot for entry in entries for shot in entry.shots], unit="run", disable=None):
        folders[shot.name] = make(shot, given.runs, given.set)
    write_gallery(given.out, entries, folders)
    print(f"{len(entries)} figures from {len(folders)} commands: {given.out / 'README.md'}")


def make(shot: Shot, runs: Path, settings: Sequence[str] = ()) -> Path:
    """The run folder of a shot; runs its command unless it is there and whole."""
    folder = runs / shot.name
    if not (folder / "done").is_file():
        overrides = [word.format_map(_Folders(runs)) for word in shot.overrides]
        places = [f"hydra.run.dir={folder}", f"hydra.sweep.dir={folder}"]
        command = [sys.executable, "-m", "hopdiff", *overrides, *settings, *places]
        done = subprocess.run(command, capture_output=True, text=True)
        if done.returncode:
            sys.exit(f"{shot.name}: python -m hopdiff {' '.join(overrides)}\n{done.stderr.strip()}")
        (folder / "summary.txt").write_text(done.stdout, encoding="utf-8")
        (folder / "done").touch()
    return folder


class _Folders(dict[str, str]):
    """The run folder of a shot by its name."""

    def __init__(self, runs: Path) -> None:
        self.runs = runs

    def __missing__(self, name: str) -> str:
        return str(self.runs / name)


if __name__ == "__main__":
    main()
