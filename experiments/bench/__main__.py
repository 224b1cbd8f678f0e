"""How fast are an evaluation, its gradient and the frames of a run? python -m experiments.bench"""

from __future__ import annotations

import argparse
import platform
import sys
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from itertools import product
from multiprocessing import get_context
from pathlib import Path

import torch

from experiments.bench.measure import measure
from experiments.bench.playback import play
from experiments.report import integers, markdown, origin, words
from hopdiff.composing import compose
from hopdiff.config import build_job
from hopdiff.io.files import write_whole
from hopdiff.job import search_run

HERE = Path(__file__).parent
FPS = 60.0  # of a played run


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(prog="python -m experiments.bench", description=__doc__)
    parser.add_argument("--models", type=words, default=["body", "smooth"])
    parser.add_argument("--sizes", type=integers, default=[1, 64, 4096], help="candidates a batch")
    parser.add_argument("--rounds", type=int, default=15, help="timings of each kind, interleaved; the median counts")
    parser.add_argument("--evaluations", type=int, default=10_000, help="budget of the timed searches")
    parser.add_argument("--crowds", type=integers, default=[1, 256], help="runs played at once")
    parser.add_argument("--seconds", type=float, default=10.0, help="of every played run, at 60 frames/s")
    parser.add_argument("--out", type=Path, default=HERE, help="folder for results.md")
    typed = list(sys.argv[1:] if arguments is None else arguments)
    options = parser.parse_args(typed)
    made = origin("bench", typed)
    torch.set_num_threads(1)
    text = "\n".join(
        (
            made,
            "",
            f"{processor()}, 1 thread, torch {torch.__version__}, Python {platform.python_version()}; 5 m/s, random"
            f" candidates, medians of {options.rounds} rounds.",
            "",
            "## An evaluation and its gradient",
            "",
            "Memory: what the process grew by. Waits: how often the host asks for a number that is worked out on the"
            " device. Rooflines: the time with gradient over the least that these operations can take on this core,"
            " their matrix products at the speed of its largest one and everything else at the speed at which it adds"
            " tensors in its cache.",
            "",
            evaluations(options.models, options.sizes, options.rounds),
            "",
            f"## Searches with a budget of {options.evaluations}",
            "",
            searches(options.evaluations),
            "",
            "## Playing found genes",
            "",
            f"{options.seconds:g} s of motion at {FPS:g} frames/s. A frame is the place of the root and the rotations"
            " of all joints; multiples of real time count the motion of all runs played at once.",
            "",
            playback(options.crowds, options.rounds, options.seconds),
            "",
        )
    )
    write_whole(options.out / "results.md", text)
    print(text)


def evaluations(models: Sequence[str], sizes: Sequence[int], rounds: int) -> str:
    rows = []
    for model, dtype, size in product(models, ("float64", "float32"), sizes):
        if (model, dtype) == ("body", "float32"):
            continue  # rates of rates of angles on Chebyshev nodes: costs are off by half a per cent
        # A process of its own for each: the peak of its memory is then its own.
        with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
            turns = max(1, min(rounds, 1024 // size)) if model == "body" else rounds
            found = pool.submit(measure, model, dtype, size, turns).result()
        rows.append(
            (
                model,
                dtype,
                str(size),
                f"{1e3 * found.value:.1f}",
                f"{1e3 * found.gradient:.1f}",
                f"{1e3 * found.gradient / size:.2f}",
                f"{found.gradient / found.value:.2f}",
                f"{found.calls:,}",
                str(found.waits),
                f"{found.gradient / found.roofline:.1f}",
                f"{found.memory:.0f}",
            )
        )
    heading = [
        *("model", "dtype", "candidates", "value ms", "with gradient ms", "a candidate ms", "ratio"),
        *("operations", "waits", "rooflines", "peak memory MB"),
    ]
    return markdown(heading, rows)


def searches(budget: int) -> str:
    rows = []
    for search in ("ga", "gradient"):
        asked = ["model=smooth", f"search={search}", f"budget.evaluations={budget}"]
        metrics = search_run(build_job(compose(asked))).metrics
        counted = f"{metrics['evaluations']} + {metrics['gradient_evaluations']} gradients"
        rows.append((search, counted, f"{metrics['wall_seconds']:.1f}", f"{metrics['cost']:.4f}"))
    return markdown(("search", "evaluations", "seconds", "cost"), rows)


def playback(crowds: Sequence[int], rounds: int, seconds: float) -> str:
    rows = []
    for model, size in product(("smooth", "thesis"), crowds):
        taken = play(model, size, rounds, seconds, FPS)
        motion = size * seconds
        multiples = (motion / taken.one_by_one, motion / taken.frames, motion / (taken.solving + taken.frames))
        rows.append((model, str(size), f"{1e3 * taken.solving:.0f}", *(f"{multiple:,.0f}" for multiple in multiples)))
    heading = ("model", "runs", "solving ms", "frame by frame x", "all frames at once x", "solving and all frames x")
    return markdown(heading, rows)


def processor() -> str:
    """The processor's own name where the system tells it."""
    info = Path("/proc/cpuinfo")
    if info.is_file():
        names = [
            line.split(":", 1)[1].strip() for line in info.read_text().splitlines() if line.startswith("model name")
        ]
        if names:
            return names[0]
    return platform.processor() or platform.machine()


if __name__ == "__main__":
    main()
