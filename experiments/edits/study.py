"""Edits made by the command, and judged from the files that it leaves."""

from __future__ import annotations

import contextlib
import io
import json
import sys
from collections import defaultdict
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from experiments.bvh_reading import Body, body
from experiments.edits.asks import KINDS, NOT_YET, Ask, Way
from experiments.edits.judge import Verdict, judge
from hopdiff.cli import main as hopdiff

FILE = "edited.bvh"
ENDS = {"frame 0", "last pose"}


@dataclass(frozen=True)
class Result:
    """One edit. file: the source. verdict: None where the command, or the judge's reading, refused it. said: the
    sentences that the user was shown. folder: of the run."""

    file: Path
    kind: str
    verdict: Verdict | None
    said: tuple[str, ...]
    folder: Path

    @property
    def clip(self) -> str:
        return self.file.stem

    @property
    def passed_between(self) -> bool:
        """Whether nothing but the first and the last pose is amiss."""
        return self.verdict is not None and set(self.verdict.failed) <= ENDS

    @property
    def passed(self) -> bool:
        return self.verdict is not None and self.verdict.passed

    def words(self) -> str:
        return "refused" if self.verdict is None else self.verdict.words()


def study(
    files: Sequence[Path],
    out: Path,
    kinds: Sequence[str],
    told: Callable[[str], object] = lambda line: None,
) -> list[Result]:
    """Every kind of edit of every file. out: for the runs' folders. told: hears of each edit."""
    results: list[Result] = []
    for file in files:
        try:
            source = body(file)
        except ValueError as error:
            results += [Result(file, kind, None, (str(error),), out) for kind in kinds]
            told(f"{file.stem}: not judged, {error}")
            continue
        for kind in kinds:
            ask = KINDS[kind](Way.of(source))
            result = tried(file, source, kind, ask, out / file.stem / kind.replace(" ", "_"))
            told(f"{result.clip}, {kind}: {result.words()}")
            results.append(result)
    return results


def tried(file: Path, source: Body, kind: str, ask: Ask, folder: Path) -> Result:
    """One edit by the command, judged."""
    words = ("task=edit", f"clip={json.dumps(str(file))}", *ask.words)
    said = commanded(*words, "pictures=false", "overwrite=true", f"hydra.run.dir={json.dumps(str(folder))}")
    verdict = None
    if said is None:
        edited = body(folder / FILE, source)
        verdict = judge(source, edited, ask.bound, ask.ground, ask.frame_0)
        notes = json.loads((folder / "status.json").read_text(encoding="utf-8"))["notes"]
        said = [note["sentence"] for note in notes]
    return Result(file, kind, verdict, tuple(said), folder)


def commanded(*words: str) -> list[str] | None:
    """`python -m hopdiff` in this process. None if it did what was asked, else what it said."""
    before, errors = sys.argv, io.StringIO()
    sys.argv = ["hopdiff", *words]
    try:
        with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(errors):
            status = hopdiff()
    finally:
        sys.argv = before
    return None if status == 0 else errors.getvalue().strip().splitlines()


def asked(only: Sequence[str], ground: bool) -> list[str]:
    """Kinds of edits by the beginnings of their names; all without any. ground: whether uneven ground is built yet."""
    found = [kind for kind in KINDS if not only or any(kind.startswith(one) for one in only)]
    return [kind for kind in found if ground or kind not in NOT_YET]


Row = tuple[str, ...]


def totals(results: Iterable[Result], of: Callable[[Result], str]) -> list[Row]:
    """Rows: edits, those that pass, those of which only the first or last pose is amiss or nothing, and how often each
    bar is missed."""
    groups: dict[str, list[Result]] = defaultdict(list)
    rows: list[Row] = []
    for result in results:
        groups[of(result)].append(result)
    for name, group in groups.items():
        missed: dict[str, int] = defaultdict(int)
        for result in group:
            for bar in result.verdict.failed if result.verdict else ("refused",):
                missed[bar] += 1
        passed = sum(result.passed for result in group)
        between = sum(result.passed_between for result in group)
        often = ", ".join(f"{bar} {count}" for bar, count in sorted(missed.items(), key=lambda one: -one[1]))
        rows.append(
            (name, str(len(group)), str(passed), f"{100 * passed / len(group):.0f} %", str(between), often or "-")
        )
    return rows


def rows(results: Iterable[Result]) -> list[Row]:
    """A row of every edit: what it misses, its numbers, and what the user was told."""
    found: list[Row] = []
    for result in results:
        cells: list[str] = ["-"] * 9
        if result.verdict is not None:
            n, o = result.verdict.numbers, result.verdict.others
            cells = [
                f"{1000 * n['frame 0']:.2f} / {1000 * n['last pose']:.2f}",
                f"{1000 * n['arrival']:.2f} / {n['turn']:.2f}",
                f"{o['slide source']:.3f} / {o['slide']:.3f} / {o['own slide']:.3f}",
                f"{100 * n['drift']:+.1f}",
                f"{100 * n['height']:.1f}",
                f"{100 * n['root drop']:.1f}",
                f"{n['speed']:.2f} / {n['jerk']:.2f} / {o['world speed']:.2f}",
                f"{n['knee']:+.1f}",
                f"{o['share source']:.2f} / {o['share']:.2f}",
            ]
        found.append((result.clip, result.kind, result.words(), *cells, " ".join(result.said) or "-"))
    return found


HEADING = (
    "clip",
    "edit",
    "verdict",
    "first / last mm",
    "arrival mm / deg",
    "slide m/s",
    "drift cm",
    "height cm",
    "drop cm",
    "speed / jerk / world x",
    "knee deg",
    "contact",
    "said",
)
