"""Are motions unchanged between two checkouts? python -m experiments.unchanged --before FOLDER --after FOLDER"""

from __future__ import annotations

import argparse
import fnmatch
import platform
import shlex
import sys
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

import torch

from experiments.report import markdown
from experiments.unchanged.cases import Case, cases
from experiments.unchanged.running import CommandError, Made, commit, digest_of, is_checkout, perform
from hopdiff.io.files import write_whole

HERE = Path(__file__).parent
ROOT = HERE.parents[1]
CLIPS = ROOT.parent / "shared" / "mocap"
MISSING = "-"


class Row(NamedTuple):
    case: str
    what: str
    before: str
    after: str

    @property
    def same(self) -> bool:
        return self.before == self.after != MISSING


class Side:
    """One of the two checkouts, and how commands are typed there."""

    def __init__(self, folder: Path, renamed: Sequence[str], instead: Sequence[str]) -> None:
        self.folder = folder.resolve()
        self.renamed = [pair.split(":", 1) for pair in renamed]
        self.instead = {name: tuple(shlex.split(words)) for name, words in (text.split(":", 1) for text in instead)}

    def words(self, case: Case, places: Mapping[str, Path]) -> list[str]:
        """The words of a case as they are typed here. Raises KeyError if the folder of another case is missing."""
        typed = []
        for word in self.instead.get(case.name, case.words):
            for old, new in self.renamed:
                if word.startswith(old):
                    word = new + word.removeprefix(old)
                    break
            typed.append(word.format_map(places))
        return typed


def main(arguments: Sequence[str] | None = None) -> int:
    options = parser().parse_args(arguments)
    sides = {
        "before": Side(options.before, options.before_renamed, options.before_instead),
        "after": Side(options.after, options.after_renamed, options.after_instead),
    }
    for name, side in sides.items():
        if not is_checkout(side.folder):
            print(f"--{name} {side.folder} is no checkout that Python imports hopdiff from.", file=sys.stderr)
            return 2
    chosen = [case for case in cases() if any(fnmatch.fnmatch(case.name, pattern) for pattern in options.only)]
    rows: list[Row] = []
    notes: list[str] = []
    with TemporaryDirectory() as place, ThreadPoolExecutor(1 if options.one_by_one else 2) as pool:
        folders: dict[str, dict[str, Path]] = {name: {"clips": options.clips.resolve()} for name in sides}
        for case in chosen:
            if any("{clips}" in word for word in case.words) and not options.clips.is_dir():
                notes.append(f"{case.name}: skipped, there are no clips in --clips")
                continue
            tasks = [pool.submit(_made, side, case, Path(place), folders[name], name) for name, side in sides.items()]
            made = [task.result() for task in tasks]
            found = [*_compared(case, *made)]
            notes += _notes(case, *made)
            for row in found:
                print(f"{case.name:<16} {row.what:<20} {row.before:<12} {row.after:<12} {_word(row)}", flush=True)
            rows += found
    text = _report(sides, rows, notes, sys.argv[1:] if arguments is None else arguments)
    write_whole(options.out / "results.md", text)
    different = sum(not row.same for row in rows)
    print("\n".join([*notes, f"{len(rows) - different} of {len(rows)} are the same."]))
    return 1 if different or not rows else 0


def parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m experiments.unchanged", description=__doc__)
    parser.add_argument("--before", type=Path, required=True, help="a checkout")
    parser.add_argument("--after", type=Path, default=ROOT, help="another one; this one if not given")
    parser.add_argument("--only", nargs="+", default=["*"], metavar="CASE", help="names of cases, with * and ?")
    parser.add_argument(
        "--clips", type=Path, default=CLIPS, help="folder of captured clips; without it some are left out"
    )
    parser.add_argument("--one-by-one", action="store_true", help="not both checkouts at once")
    for side in ("before", "after"):
        parser.add_argument(
            f"--{side}-renamed", action="append", default=[], metavar="OLD:NEW", help="how words begin in that checkout"
        )
        parser.add_argument(
            f"--{side}-instead", action="append", default=[], metavar="CASE:WORDS", help="other words for a case there"
        )
    parser.add_argument("--out", type=Path, default=HERE, help="folder for results.md")
    return parser


def _made(side: Side, case: Case, place: Path, folders: dict[str, Path], name: str) -> Made | CommandError:
    """Run a case on one side; folders: those of the cases before it there, to which it adds its own."""
    folder = place / name / case.name
    try:
        perform(side.folder, side.words(case, folders), folder)
    except CommandError as failed:
        return failed
    except KeyError as error:
        return CommandError(f"needs the case {error.args[0]}")
    folders[case.name] = folder
    return Made(folder)


def _compared(case: Case, before: Made | CommandError, after: Made | CommandError) -> Iterator[Row]:
    """The files of both sides, and the numbers that both have."""
    if isinstance(before, CommandError) or isinstance(after, CommandError):
        yield Row(
            case.name, "all", *(MISSING if isinstance(made, CommandError) else "made" for made in (before, after))
        )
        return
    for name in sorted({*before.digests, *after.digests}):
        yield Row(case.name, name, before.digests.get(name, MISSING), after.digests.get(name, MISSING))
    for name in sorted({*before.tables, *after.tables}):
        tables = [made.tables.get(name) for made in (before, after)]
        both = sorted(set.intersection(*(set(table or ()) for table in tables)))
        digests = (digest_of(table, both) if table and both else MISSING for table in tables)
        yield Row(case.name, f"{name}, {len(both)} numbers", *digests)


def _notes(case: Case, before: Made | CommandError, after: Made | CommandError) -> Iterator[str]:
    for side, made in (("before", before), ("after", after)):
        if isinstance(made, CommandError):
            yield f"{case.name}, {side}: {made}"
    if isinstance(before, CommandError) or isinstance(after, CommandError):
        return
    for name in sorted({*before.tables} & {*after.tables}):
        old, new = before.tables[name], after.tables[name]
        if gone := sorted(set(old) - set(new)):
            yield f"{case.name}: {name} has no more {', '.join(gone)}"
        if added := sorted(set(new) - set(old)):
            yield f"{case.name}: {name} also has {', '.join(added)}"
        if other := [key for key in sorted(set(old) & set(new)) if old[key] != new[key]]:
            yield f"{case.name}: {name} differs in {', '.join(other)}"


def _word(row: Row) -> str:
    return "same" if row.same else "DIFFERENT"


def _report(sides: Mapping[str, Side], rows: Sequence[Row], notes: Sequence[str], typed: Sequence[str]) -> str:
    same = sum(row.same for row in rows)
    known = {case.name: case for case in cases()}
    commands = []
    for name in dict.fromkeys(row.case for row in rows):
        commands.append(f"- {name}: `{shlex.join(known[name].words)}`")
        for label, side in sides.items():
            other = side.words(known[name], _Names())
            if other != [word.format_map(_Names()) for word in known[name].words]:
                commands.append(f"  - {label}: `{shlex.join(other)}`")
    heading = ("command", "of", "before", "after", "same")
    table = markdown(heading, [(row.case, row.what, row.before, row.after, _word(row)) for row in rows])
    # Folders are of one machine alone.
    shown = " ".join(shlex.quote("FOLDER" if "/" in word and Path(word).is_dir() else word) for word in typed)
    return "\n".join(
        (
            f"{same} of {len(rows)} are the same: before {commit(sides['before'].folder)}, after"
            f" {commit(sides['after'].folder)}; torch {torch.__version__}, Python {platform.python_version()}.",
            "",
            f"`python -m experiments.unchanged {shown}`",
            "",
            *(["Notes:", "", *(f"- {note}" for note in notes), ""] if notes else []),
            table,
            "Commands, after `python -m hopdiff` and before `pictures=false`; {NAME} is the folder of that command:",
            "",
            *commands,
            "",
        )
    )


class _Names(dict[str, Path]):
    """Places that stand for themselves."""

    def __missing__(self, name: str) -> Path:
        return Path(f"{{{name}}}")


if __name__ == "__main__":
    sys.exit(main())
