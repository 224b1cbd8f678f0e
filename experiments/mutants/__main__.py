"""Which small wrong changes of the code do the tests see? python -m experiments.mutants"""

from __future__ import annotations

import argparse
import csv
import hashlib
import json
import random
import subprocess
import tempfile
from collections.abc import Iterable, Sequence
from functools import cache
from itertools import chain, islice, zip_longest
from pathlib import Path
from typing import NamedTuple

import yaml

from experiments.mutants.operators import Mutant, in_turn, is_sound, mutants_of
from experiments.mutants.server import SURVIVED, Copy, Test
from experiments.mutants.tables import report
from experiments.report import read_table, words

HERE = Path(__file__).parent
ROOT = HERE.parents[1]
CACHE = ROOT / "outputs" / "mutants" / "tests.json"


class Part(NamedTuple):
    """files: patterns of what is changed. tests: files and folders of tests that shall see it."""

    files: tuple[str, ...]
    tests: tuple[str, ...]


def _package(name: str, *more: str) -> Part:
    return Part((f"hopdiff/{name}/*.py",), (f"tests/{name}", *more))


PARTS = {
    "physics": _package("physics", "tests/models"),
    "models": _package("models"),
    "costs": Part(
        ("hopdiff/costs.py", "hopdiff/limits.py", "hopdiff/problem.py", "hopdiff/metrics.py"),
        ("tests/test_costs.py", "tests/test_problem.py", "tests/test_metrics.py"),
    ),
    "search": _package("search"),
    "editing": _package("editing", "tests/feet"),
    "feet": _package("feet"),
    "graph": _package("graph"),
    "whole_body": _package("whole_body"),
    "effort": _package("effort"),
}
COLUMNS = ("part", "kind", "name", "line", "operator", "code", "changed", "result", "by", "seconds", "commit")
NAMED = "named"


def main(arguments: Sequence[str] | None = None) -> None:
    options = parser().parse_args(arguments)
    options.out.mkdir(parents=True, exist_ok=True)
    table = options.out / "results.csv"
    if not options.report:
        run(options, table)
    text = report(read_table(table), equivalents())
    (options.out / "results.md").write_text(text, encoding="utf-8")
    print(text)


def parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m experiments.mutants", description=__doc__)
    parser.add_argument("--package", type=words, default=list(PARTS), help=f"some of {','.join(PARTS)}")
    parser.add_argument("--count", type=int, default=30, help="mutants of each, drawn evenly from its files")
    parser.add_argument("--seed", type=int, default=0, help="of the draw")
    parser.add_argument(
        "--longest", type=float, default=5.0, help="s of computing; tests that take longer are left out"
    )
    parser.add_argument("--named", action="store_true", help="only the changes of named.yaml")
    parser.add_argument("--resume", action="store_true", help="keep what results.csv holds, and go on")
    parser.add_argument("--again", action="store_true", help="with --resume: try those that survived once more")
    parser.add_argument("--report", action="store_true", help="only results.md again, from results.csv")
    parser.add_argument("--out", type=Path, default=HERE, help="folder for results.csv and results.md")
    return parser


def run(options: argparse.Namespace, table: Path) -> None:
    """Try what was asked for, one after the other, and add each to the table at once."""
    asked = list(wanted(options.package, options.named, options.count, options.seed))
    rows = read_table(table) if options.resume else []
    if options.again:
        rows = [row for row in rows if row["result"] != SURVIVED or row["part"] not in options.package]
    known = {row["name"] for row in rows}
    write(table, rows, "w")
    commit = _git("rev-parse", "--short", "HEAD") + ("+" if _git("status", "--porcelain", "hopdiff", "tests") else "")
    with tempfile.TemporaryDirectory(prefix="mutants_") as folder:
        copy = Copy(ROOT, Path(folder).resolve())
        for part, kind, mutant in asked:
            if mutant.name in known:
                continue
            known.add(mutant.name)
            tests = order(measured(copy, PARTS[part].tests), mutant, options.longest)
            text = (ROOT / mutant.file).read_text(encoding="utf-8")
            with copy.changed(mutant.file, mutant.applied(text)):
                outcome = copy.tried(tests)
            code, changed = shown(text, mutant)
            row = (part, kind, mutant.name, mutant.line, mutant.operator, code, changed)
            row = (*row, outcome.result, outcome.by, f"{outcome.seconds:.1f}", commit)
            write(table, [dict(zip(COLUMNS, row, strict=True))], "a")
            print(
                f"{outcome.result:8} {outcome.seconds:5.1f} s  {mutant.file}:{mutant.line}: {code} -> {changed}",
                flush=True,
            )


def wanted(parts: Iterable[str], named_only: bool, count: int, seed: int) -> Iterable[tuple[str, str, Mutant]]:
    """The changes to try, with their part of the code and where they come from; those of named.yaml first."""
    for part in parts:
        files = sorted(path for pattern in PARTS[part].files for path in ROOT.glob(pattern))
        names = [path.relative_to(ROOT).as_posix() for path in files]
        for mutant in named(HERE / "named.yaml", ROOT, names):
            yield part, NAMED, mutant
        if not named_only:
            for mutant in drawn(names, count, seed):
                yield part, f"seed {seed}", mutant


def drawn(files: Sequence[str], count: int, seed: int, root: Path = ROOT) -> list[Mutant]:
    """`count` mutants, one of each file in turn; those of a file do not depend on the others."""
    columns = []
    for file in files:
        text = (root / file).read_text(encoding="utf-8")
        ranked = in_turn(mutants_of(file, text), random.Random(f"{seed} {file}"))
        columns.append(list(islice((m for m in ranked if is_sound(m, text)), count)))
    return [m for m in chain.from_iterable(zip_longest(*columns)) if m is not None][:count]


def named(path: Path, root: Path, files: Sequence[str]) -> list[Mutant]:
    """The changes of some files that a YAML file lists by name, file, find and put.

    Raises ValueError if `find` is not in the file exactly once, or nothing is changed.
    """
    found, sites = [], cache(mutants_of)
    for entry in yaml.safe_load(path.read_text(encoding="utf-8")):
        if entry["file"] not in files:
            continue
        text = (root / entry["file"]).read_text(encoding="utf-8")
        if text.count(entry["find"]) != 1 or entry["find"] == entry["put"]:
            raise ValueError(f"{path.name}, {entry['name']}: {entry['file']} holds this not once: {entry['find']}")
        start = len(text[: text.index(entry["find"])].encode())
        stop = start + len(entry["find"].encode())
        line = text[: text.index(entry["find"])].count("\n") + 1
        inside = [m for m in sites(entry["file"], text) if m.start < stop and start < m.stop]
        about = min(inside, key=lambda m: m.stop - m.start) if inside else None
        function, defined = (about.function, about.defined) if about else ("", 0)
        place = (entry["file"], line, function, defined)
        found.append(Mutant(*place, NAMED, entry["name"], entry["put"], start, stop))
    return found


def measured(copy: Copy, places: Iterable[str]) -> dict[str, Test]:
    """The tests of files and folders, run unchanged; kept below outputs/ until code or tests change."""
    kept = json.loads(CACHE.read_text()) if CACHE.exists() else {}
    tests: dict[str, Test] = {}
    for place in places:
        path = copy.folder / place
        for file in sorted(path.glob("test_*.py")) if path.is_dir() else [path]:
            name = file.relative_to(copy.folder).as_posix()
            key = _digest(copy.folder, file)
            if kept.get(name, {}).get("key") != key:
                print(f"unchanged: {name}", flush=True)
                found = copy.measured(name)
                rows = {n: (t.seconds, t.shared, sorted(t.functions)) for n, t in found.items()}
                kept[name] = {"key": key, "tests": rows}
                CACHE.parent.mkdir(parents=True, exist_ok=True)
                CACHE.write_text(json.dumps(kept))
            tests |= {n: Test(*seconds, frozenset(calls)) for n, (*seconds, calls) in kept[name]["tests"].items()}
    return tests


def order(tests: dict[str, Test], mutant: Mutant, longest: float) -> dict[str, Test]:
    """The tests that call the function of a mutant, quick ones first; outside of functions, those that use its file."""

    def concerned(test: Test) -> bool:
        if mutant.defined:
            return f"{mutant.file}:{mutant.defined}" in test.functions
        return any(call.startswith(f"{mutant.file}:") for call in test.functions)

    found = {name: test for name, test in tests.items() if test.seconds <= longest and concerned(test)}
    return dict(sorted(found.items(), key=lambda pair: pair[1].seconds + pair[1].shared))


def shown(text: str, mutant: Mutant) -> tuple[str, str]:
    """The lines that change, before and after."""
    source, after = text.encode(), mutant.after.encode()
    first = source.rfind(b"\n", 0, mutant.start) + 1
    last = source.find(b"\n", mutant.stop)
    whole = source[first:last]
    changed = source[first : mutant.start] + after + source[mutant.stop : last]
    return " ".join(whole.decode().split()), " ".join(changed.decode().split())


def equivalents() -> dict[str, str]:
    """Mutants that change nothing, with the reason."""
    return yaml.safe_load((HERE / "equivalent.yaml").read_text(encoding="utf-8")) or {}


def write(table: Path, rows: Iterable[dict[str, str]], mode: str) -> None:
    with table.open(mode, encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, COLUMNS)
        if mode == "w":
            writer.writeheader()
        writer.writerows(rows)


def _digest(root: Path, test: Path) -> str:
    """Of a test file and all that it may rest on."""
    helpers = (path for path in (root / "tests").rglob("*.py") if not path.name.startswith("test_"))
    files = [test, *helpers, *(root / "hopdiff").rglob("*.py"), *(root / "conf").rglob("*.yaml")]
    digest = hashlib.sha256()
    for path in sorted(files):
        digest.update(path.relative_to(root).as_posix().encode() + path.read_bytes())
    return digest.hexdigest()


def _git(*words: str) -> str:
    return subprocess.run(("git", *words), cwd=ROOT, capture_output=True, text=True, check=False).stdout.strip()


if __name__ == "__main__":
    main()
