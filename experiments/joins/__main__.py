"""Are walks between two clips smooth at their seams? python -m experiments.joins --clips FOLDER"""

from __future__ import annotations

import argparse
import contextlib
import io
import shutil
import sys
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import torch

from experiments.joins.cases import Case, cases
from experiments.joins.judge import Verdict, judge
from experiments.report import markdown, origin
from hopdiff.cli import main as hopdiff
from hopdiff.io.files import write_whole

HERE = Path(__file__).parent
HEADING = ("before / walk / after", "verdict", "acceleration", "speed", "skate, clips' m/s", "sunk cm")


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(prog="python -m experiments.joins", description=__doc__)
    parser.add_argument("--clips", type=Path, required=True, help="folder of BVH files, some of one skeleton")
    parser.add_argument("--clip", default="", help="part of the walk's name: that alone; writes nothing")
    parser.add_argument("--each", type=int, default=6, help="joins of every clip as the walk")
    parser.add_argument("--runs", type=Path, default=Path("outputs/joins"), help="folder for cut clips and runs")
    parser.add_argument("--out", type=Path, default=HERE, help="folder for results.md")
    # Before any join is made: that takes the command line.
    came = origin("joins", sys.argv[1:] if arguments is None else arguments)
    given = parser.parse_args(arguments)
    torch.set_num_threads(1)
    files = sorted(given.clips.glob("*.bvh"))
    rows, counted = [], Counter[str]()
    for number, case in enumerate(cases(files, given.each, given.runs / "clips")):
        if given.clip not in case.walk.stem:
            continue
        verdict, words = joined(case, given.runs / f"{case.walk.stem}")
        counted.update(["joins", *(["pass"] if verdict and not verdict.failed else [])])
        counted.update(verdict.failed if verdict else ["refused"])
        rows.append(_row(case, verdict, words))
        print(number, *rows[-1], flush=True)
    text = f"{came}\n\n{', '.join(f'{name} {count}' for name, count in counted.items())}\n\n{markdown(HEADING, rows)}"
    if not given.clip:
        write_whole(given.out / "results.md", text)
    print(text)


def joined(case: Case, run: Path) -> tuple[Verdict | None, str]:
    """The verdict on a join that the command makes, None with its words if it refuses."""
    shutil.rmtree(run, ignore_errors=True)
    words = (f"clip={case.walk}", f"before={case.before}", f"after={case.after}", "pictures=false")
    sys.argv = ["hopdiff", "+experiment=edit", *words, f"hydra.run.dir={run}"]
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()) as err:
        code = hopdiff()
    return (None, err.getvalue().strip().splitlines()[-1]) if code else (judge(case, run), "")


def _row(case: Case, verdict: Verdict | None, words: str) -> tuple[object, ...]:
    if verdict is None:
        return (case.name, words, *[""] * 4)
    return (
        case.name,
        ", ".join(verdict.failed) or "pass",
        f"{verdict.acceleration:.2f}",
        f"{verdict.speed:.2f}",
        f"{verdict.skate:.3f} / {verdict.skate_own:.3f}",
        f"{100 * verdict.sunk:.1f}",
    )


if __name__ == "__main__":
    main()
