"""How fast is one evaluation, and what does a gradient cost? python -m experiments.bench"""

from __future__ import annotations

import argparse
import platform
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from itertools import product
from multiprocessing import get_context
from pathlib import Path

import torch

from experiments.bench.measure import measure
from experiments.report import integers, markdown
from hopdiff.config import build_job, compose
from hopdiff.io.files import write_whole
from hopdiff.tasks.job import search_run

HERE = Path(__file__).parent


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(prog="python -m experiments.bench", description=__doc__)
    parser.add_argument("--sizes", type=integers, default=[1, 64, 4096], help="candidates a batch")
    parser.add_argument("--rounds", type=int, default=15, help="timings of each kind, interleaved; the median counts")
    parser.add_argument("--evaluations", type=int, default=10_000, help="budget of the timed searches")
    parser.add_argument("--out", type=Path, default=HERE, help="folder for results.md")
    options = parser.parse_args(arguments)
    torch.set_num_threads(1)
    rows = []
    for dtype, size in product(("float32", "float64"), options.sizes):
        # A process of its own for each: the peak of its memory is then its own.
        with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
            value, gradient, memory = pool.submit(measure, dtype, size, options.rounds).result()
        rows.append(
            (
                dtype,
                str(size),
                f"{1e3 * value:.1f}",
                f"{size / value:,.0f}",
                f"{1e3 * gradient:.1f}",
                f"{size / gradient:,.0f}",
                f"{gradient / value:.2f}",
                f"{memory:.0f}",
            )
        )
    heading = [
        *("dtype", "candidates", "value ms", "value candidates/s", "with gradient ms", "with gradient candidates/s"),
        *("ratio", "peak memory MB"),
    ]
    searches = []
    for search in ("ga", "gradient"):
        job = build_job(compose([f"search={search}", f"budget.evaluations={options.evaluations}"]))
        run = search_run(job)
        metrics = run.metrics
        counted = f"{metrics['evaluations']} + {metrics['gradient_evaluations']} gradients"
        searches.append((search, counted, f"{metrics['wall_seconds']:.1f}", f"{metrics['cost']:.4f}"))
    text = "\n".join(
        (
            f"{processor()}, 1 thread, torch {torch.__version__}, Python {platform.python_version()}; `model=smooth`,"
            f" 5 m/s, random candidates, medians of {options.rounds} rounds. Memory: what the process grew by.",
            "",
            markdown(heading, rows),
            "",
            f"Searches with a budget of {options.evaluations}:",
            "",
            markdown(("search", "evaluations", "seconds", "cost"), searches),
            "",
        )
    )
    write_whole(options.out / "results.md", text)
    print(text)


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
