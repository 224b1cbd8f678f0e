"""Do edits arrive, pass for takes, and how fast are they made? python -m experiments.edits --clips FOLDER"""

from __future__ import annotations

import argparse
import platform
import sys
from collections.abc import Sequence
from pathlib import Path

import torch

from experiments.bench.__main__ import processor
from experiments.edits.asks import KINDS
from experiments.edits.cases import clips
from experiments.edits.measure import arrivals, timings
from experiments.edits.memory import peak
from experiments.edits.pictures import draw_worst
from experiments.edits.study import HEADING, asked, rows, study, totals
from experiments.report import integers, markdown, origin, words
from hopdiff.editing.root_path import root_path
from hopdiff.geometry.clip import Clip
from hopdiff.io.bvh import write_bvh
from hopdiff.io.files import write_whole

HERE = Path(__file__).parent
TIMED = "walk_straight_cmu_07_01"


def main(arguments: Sequence[str] | None = None) -> None:
    given = parsed(arguments)
    torch.set_num_threads(1)
    files = files_of(given)
    if not files:
        raise SystemExit(f"{given.clips or given.runs} has no BVH file whose name has {given.clip!r} in it")
    text = judged(files, given)
    if not (given.only or given.clip):
        found = clips(given.clips)
        text = "\n".join(
            (
                origin("edits", sys.argv[1:] if arguments is None else arguments),
                "",
                head(found),
                text,
                arrived(found),
                timed(found, given),
            )
        )
        write_whole(given.out / "results.md", text)
    print(text)


def parsed(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m experiments.edits", description=__doc__)
    parser.add_argument("--clips", type=Path, help="folder of BVH files; without it a run of our own")
    parser.add_argument(
        "--only", type=words, default=[], metavar="KINDS", help=f"of {', '.join(KINDS)}; writes nothing"
    )
    parser.add_argument("--clip", default="", help="part of a clip's name: that alone; writes nothing")
    parser.add_argument("--ground", action="store_true", help="edits over uneven ground too")
    parser.add_argument(
        "--pictures", type=int, default=0, metavar="N", help="strips of the N worst edits, below --runs"
    )
    parser.add_argument("--runs", type=Path, default=Path("outputs/edits"), help="folder for the edits' run folders")
    parser.add_argument("--frames", type=integers, default=[100, 316, 450, 2798, 10_000, 100_000], help="to be timed")
    parser.add_argument("--rounds", type=int, default=7, help="timings of each kind, in turns; the median counts")
    parser.add_argument("--out", type=Path, default=HERE, help="folder for results.md")
    return parser.parse_args(arguments)


def files_of(given: argparse.Namespace) -> list[Path]:
    """The files that are edited; a run of our own is written into one."""
    folder = given.clips
    if folder is None:
        folder = given.runs
        folder.mkdir(parents=True, exist_ok=True)
        for name, clip in clips(None).items():
            write_bvh(folder / f"{name}.bvh", clip)
    return [file for file in sorted(folder.glob("*.bvh")) if given.clip in file.stem]


def judged(files: list[Path], given: argparse.Namespace) -> str:
    """The verdicts on all edits, by kind, by clip, and each."""
    kinds = asked(given.only, given.ground)
    results = study(files, given.runs, kinds, lambda line: print(line, flush=True))
    if given.pictures:
        draw_worst(results, given.pictures, given.runs)
    counted = ("edits", "pass", "", "but for the ends' poses", "missed")
    missing = [kind for kind in asked(given.only, True) if kind not in kinds]
    return "\n".join(
        (
            "## Verdicts",
            "",
            "Judged from the files alone ([judge.py](judge.py) has the bars)."
            + (f" Not yet: {', '.join(missing)}." if missing else ""),
            "",
            markdown(("edit", *counted), totals(results, lambda one: one.kind) + totals(results, lambda one: "all")),
            markdown(("clip", *counted), totals(results, lambda one: one.clip)),
            "Verdict: the bars that are missed. First and last pose, arrival: off. Slide: of the source / of the edit"
            " in the same frames / of the edit in the contacts found in it. Drift, drop, knee: more than in the source."
            " Height: farthest that a foot in contact floats or sinks. Speed and jerk of joints against the root, times"
            " the source's largest, and speed in the world. Contact: share of the frames in the source / in the edit.",
            "",
            markdown(HEADING, rows(results)),
        )
    )


def head(found: dict[str, Clip]) -> str:
    return (
        f"{processor()}, 1 thread, torch {torch.__version__}, Python {platform.python_version()}; clips:"
        f" {', '.join(found)}.\n"
    )


def arrived(found: dict[str, Clip]) -> str:
    paths = {name: (root_path(clip), clip.frame_time) for name, clip in found.items()}
    heading = ("alpha", "edits", "arrive", "rounds (median)", "most", "place off mm", "yaw off deg", "start moved mm")
    return "\n".join(
        (
            "## Arrival",
            "",
            "Turns of -90 to 180 degrees by 45, each at the same place, 30 % of the way aside and 10 % ahead.",
            "",
            markdown(heading, arrivals(paths)),
        )
    )


def timed(found: dict[str, Clip], given: argparse.Namespace) -> str:
    name = TIMED if TIMED in found else next(iter(found))
    most = max(given.frames)
    memory = peak(most, None if given.clips is None else given.clips / f"{name}.bvh")
    heading = ("frames", "ours ms", "dense ms", "dense / ours", "clean-up ms", "clean-up / ours")
    return "\n".join(
        (
            "## Time",
            "",
            f"Position and 90 degrees, set-up included, on {name} repeated; beside a dense pseudo-inverse. Clean-up: of"
            " the feet.",
            "",
            markdown(heading, timings(found[name], given.frames, given.rounds)),
            f"Memory of the whole edit at {most:,} frames, beyond what is loaded before: {memory:.0f} MB.",
            "",
        )
    )


if __name__ == "__main__":
    main()
