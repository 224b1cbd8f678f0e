"""Contacts kept one by one, or by an optimisation over the whole clip: python -m experiments.kim2021.contacts"""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch

from experiments.bvh_reading import body
from experiments.edits.asks import KINDS, Way
from experiments.edits.study import Result, asked, tried
from experiments.gallery import commits
from experiments.report import markdown, origin, words
from hopdiff.feet.planting import FEET_BY
from hopdiff.io.files import write_whole

HERE = Path(__file__).parent
MEANS = (("slide", 100.0, ".2f"), ("drift", 100.0, ".2f"), ("root drop", 100.0, ".1f"), ("speed", 1.0, ".2f"))
HEADING = (
    "feet_by",
    "edits",
    "pass",
    "slide cm/s",
    "drift cm",
    "root drop cm",
    "speed x",
    "jerk x",
    "given up %",
    "ms: 100 frames",
    "missed",
)


@dataclass(frozen=True)
class Judged:
    """An edit and what the command measured of it itself."""

    result: Result
    metrics: dict[str, float]


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(prog="python -m experiments.kim2021.contacts", description=__doc__)
    parser.add_argument("files", nargs="+", type=Path, help="BVH files")
    parser.add_argument("--only", type=words, default=[], metavar="KINDS", help=f"of {', '.join(KINDS)}")
    parser.add_argument("--runs", type=Path, default=Path("outputs/contacts"), help="folder for the edits' run folders")
    parser.add_argument("--out", type=Path, default=HERE / "contacts.md", help="file for the tables")
    given = parser.parse_args(arguments)
    made = origin("kim2021.contacts", ("FILES", *(["--only", ",".join(given.only)] if given.only else [])))
    torch.set_num_threads(1)
    judged = {by: study(by, given.files, asked(given.only, False), given.runs / by) for by in FEET_BY}
    text = f"{made}\n\n{page(judged, [file.stem for file in given.files])}"
    write_whole(given.out, text)
    print(text)


def study(by: str, files: Sequence[Path], kinds: Sequence[str], out: Path) -> list[Judged]:
    """Every kind of edit of every file, feet cleaned in one of the ways."""
    found = []
    for file in files:
        source = body(file)
        for kind in kinds:
            ask = KINDS[kind](Way.of(source))
            ask = replace(ask, words=(*ask.words, f"edit.feet_by={by}"))
            result = tried(file, source, kind, ask, out / file.stem / kind.replace(" ", "_"))
            metrics = {}
            if result.verdict is not None:
                metrics = json.loads((result.folder / "metrics.json").read_text(encoding="utf-8"))
            found.append(Judged(result, metrics))
    return found


def page(judged: dict[str, list[Judged]], clips: Sequence[str]) -> str:
    failing = {
        (one.result.clip, one.result.kind) for group in judged.values() for one in group if not one.result.passed
    }
    rows = [(by, *summary(group)) for by, group in judged.items()]
    made = commits(one.result.folder for group in judged.values() for one in group)
    return "\n".join(
        (
            "# Contacts one by one, or all together",
            "",
            "`edit.feet_by=fast` plants one contact after the other; `edit.feet_by=optimised` finds ankles, places of"
            " contacts and root over the whole clip by least squares, as the paper has it (algorithm 1, line 20)."
            " Judged from the files by [the study of edits](../edits/README.md), on level ground.",
            "",
            f"Clips: {', '.join(clips)}. Made at {made}.",
            "",
            markdown(HEADING, rows),
            "Slide, drift, root drop: mean of what is more than in the source. Speed, jerk: mean, and the largest in"
            " brackets, against the source's. Given up: of the frames in which feet stand in the source. ms: median.",
            "",
            markdown(
                ("clip", "edit", *judged),
                [
                    (clip, kind, *(words_of(group, clip, kind) for group in judged.values()))
                    for clip, kind in sorted(failing)
                ],
            ),
        )
    )


def summary(group: Sequence[Judged]) -> tuple[str, ...]:
    verdicts = [one.result.verdict for one in group if one.result.verdict is not None]
    passed = sum(one.result.passed for one in group)
    means = [f"{scale * np.mean([v.numbers[name] for v in verdicts]):{form}}" for name, scale, form in MEANS]
    jerks = [v.numbers["jerk"] for v in verdicts]
    speeds = [v.numbers["speed"] for v in verdicts]
    means[-1] += f" ({max(speeds):.2f})"
    measured = [one.metrics for one in group if one.metrics]
    given_up = 100.0 * float(np.mean([m.get("given_up", 0.0) for m in measured]))
    took = float(np.median([100.0 * m["ms_feet"] / m["frames"] for m in measured]))
    missed: dict[str, int] = {}
    for one in group:
        for bar in one.result.verdict.failed if one.result.verdict else ("refused",):
            missed[bar] = missed.get(bar, 0) + 1
    often = ", ".join(f"{bar} {count}" for bar, count in sorted(missed.items(), key=lambda item: -item[1]))
    return (
        str(len(group)),
        f"{passed} ({100 * passed / len(group):.0f} %)",
        *means,
        f"{np.mean(jerks):.2f} ({max(jerks):.2f})",
        f"{given_up:.1f}",
        f"{took:.1f}",
        often or "-",
    )


def words_of(group: Sequence[Judged], clip: str, kind: str) -> str:
    return next(one.result.words() for one in group if (one.result.clip, one.result.kind) == (clip, kind))


if __name__ == "__main__":
    main()
