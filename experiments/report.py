"""What the studies share: reading numbers off a command line, reading tables back, and writing them as Markdown."""

from __future__ import annotations

import csv
import shlex
from collections.abc import Iterable, Sequence
from pathlib import Path

from hopdiff.io.record import git_state


def floats(text: str) -> list[float]:
    """Numbers separated by commas, as typed on a command line."""
    return [float(part) for part in text.split(",")]


def integers(text: str) -> list[int]:
    """Whole numbers separated by commas; "0-4" stands for 0,1,2,3,4."""
    numbers: list[int] = []
    for part in text.split(","):
        first, _, last = part.partition("-")
        numbers += range(int(first), int(last or first) + 1)
    return numbers


def words(text: str) -> list[str]:
    return text.split(",")


def read_table(path: Path) -> list[dict[str, str]]:
    """The rows of a CSV file by column; none if there is no such file."""
    if not path.is_file():
        return []
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def origin(study: str, arguments: Sequence[str], folders: Sequence[str] = ("--clips",)) -> str:
    """Commit and command that a table comes from. folders: options whose values are places on one machine, left out."""
    state = git_state(Path(__file__).parent)
    commit = f"`{state['commit'][:12]}`{', with changes' if state['dirty'] else ''}" if state["checkout"] else "unknown"
    hidden = {*folders, "--out", "--runs"}
    shown = ["FOLDER" if before in hidden else word for before, word in zip(("", *arguments), arguments, strict=False)]
    return f"Commit {commit}; `{shlex.join(['python', '-m', f'experiments.{study}', *shown])}`."


def first_line(page: Path) -> str:
    """The line of a page that `origin` wrote, for a page that is written again from kept numbers."""
    lines = page.read_text(encoding="utf-8").splitlines() if page.is_file() else []
    return lines[0] if lines and lines[0].startswith("Commit ") else "Commit and command unknown."


def markdown(heading: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """A Markdown table; the first column to the left, the others to the right."""
    lines = [list(heading), ["---"] + ["---:"] * (len(heading) - 1), *([str(cell) for cell in row] for row in rows)]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines) + "\n"
