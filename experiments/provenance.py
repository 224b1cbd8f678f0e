"""Where the committed tables come from, and whether today's code still gives them.

A page names the commit and the command that made it (`experiments.report.origin`). A study that keeps what its numbers
are made from, such as the genes of its runs, prices some of it again (a `Recheck`): that decides whether the table
holds. Of the others it is only told which files that they depend on have changed since.
"""

from __future__ import annotations

import ast
import math
import re
import subprocess
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parent.parent
# What studies reach by name and not by an import: searches, tasks, settings.
BY_NAME = ("conf", "hopdiff/search", "hopdiff/tasks")
TOLERANCE = 1e-4  # relative, of numbers written with six digits and found by an optimum that is told with ten
HEAD = 20  # lines of a page in which its origin is looked for


class Origin(NamedTuple):
    """commit: hexadecimal, or None. changed: whether the checkout had changes. command: None if the page has none."""

    commit: str | None
    changed: bool
    command: str | None


class Gap(NamedTuple):
    """A number that today's code gives another value. row: which; column: of it."""

    row: str
    column: str
    committed: float
    today: float


class Recheck(NamedTuple):
    """What came out of pricing kept rows again. compared: numbers. worst: largest relative difference."""

    compared: int
    worst: float
    gaps: list[Gap]


def origin_of(page: Path) -> Origin:
    """What the head of a page says of itself."""
    head = "\n".join(page.read_text(encoding="utf-8").splitlines()[:HEAD])
    commit = re.search(r"\b[Cc]ommit `?([0-9a-f]{7,40})\b`?,?( with changes)?", head)
    commit = commit or re.search(r"\bMade at ([0-9a-f]{7,40})\b( with changes)?", head)
    command = re.search(r"`(python -m experiments[^`]*)`", head)
    return Origin(
        commit.group(1) if commit else None, bool(commit and commit.group(2)), command.group(1) if command else None
    )


def compared(pairs: Iterable[tuple[str, Mapping[str, float], Mapping[str, float]]]) -> Recheck:
    """Rows held against each other. pairs: name of the row, its committed numbers, those of today (same names)."""
    count, worst, gaps = 0, 0.0, []
    for row, before, today in pairs:
        for column, value in before.items():
            off = abs(today[column] - value) / max(abs(value), 1e-12)
            # What is not a number, or not there any more, differs without end.
            off = off if math.isfinite(off) else math.inf
            count, worst = count + 1, max(worst, off)
            if off > TOLERANCE:
                gaps.append(Gap(row, column, value, today[column]))
    return Recheck(count, worst, gaps)


def sources(entry: Path) -> set[Path]:
    """The files of ours that a study's module takes, by imports and their imports, and the folders of BY_NAME."""
    found: set[Path] = set()
    waiting = [entry, *(path for path in entry.parent.glob("*.py"))]
    while waiting:
        path = waiting.pop()
        if path in found or not path.is_file():
            continue
        found.add(path)
        waiting += _imported(path)
    return found | {ROOT / name for name in BY_NAME}


def _imported(path: Path) -> Iterator[Path]:
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        names: list[str] = []
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.module:
            names = [node.module, *(f"{node.module}.{alias.name}" for alias in node.names)]
        for name in names:
            if name.split(".")[0] in ("hopdiff", "experiments"):
                place = ROOT.joinpath(*name.split("."))
                yield from (place.with_suffix(".py"), place / "__init__.py")


def changed_since(commit: str, files: Iterable[Path]) -> list[str] | None:
    """Those of the files that differ from what they were at a commit, or None if git does not know it."""
    names = [str(path.relative_to(ROOT)) for path in sorted(files)]
    done = subprocess.run(
        ["git", "diff", "--name-only", commit, "--", *names], cwd=ROOT, capture_output=True, text=True
    )
    return done.stdout.split() if done.returncode == 0 else None


class Verdict(NamedTuple):
    """What is said of a page. holds: False if a number is no longer what the code gives, None if that is not known."""

    page: Path
    origin: Origin
    holds: bool | None
    text: str


def judge(page: Path, entry: Path, recheck: Callable[[Path], Recheck] | None) -> Verdict:
    """One page. entry: the module of its study. recheck: prices kept rows again, from the folder of the page."""
    origin = origin_of(page)
    if recheck is not None:
        found = recheck(page.parent)
        same = f"{found.compared} numbers priced again, at most {found.worst:.1g} off"
        if not found.gaps:
            return Verdict(page, origin, True, same)
        worst = "; ".join(f"{g.row} {g.column} {g.committed:g}, today {g.today:g}" for g in found.gaps[:3])
        return Verdict(page, origin, False, f"{len(found.gaps)} of {found.compared} numbers differ: {worst}")
    if origin.commit is None:
        return Verdict(page, origin, None, "names no commit")
    changes = changed_since(origin.commit, sources(entry))
    if changes is None:
        return Verdict(page, origin, None, "its commit is not in this checkout's history")
    if not changes:
        return Verdict(page, origin, None, "nothing that it depends on has changed")
    return Verdict(page, origin, None, f"{len(changes)} files that it depends on have changed")
