"""What do launchers gain, and what do they add to a run? python -m experiments.scale"""

from __future__ import annotations

import argparse
import json
import os
import platform
import sys
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from importlib.util import find_spec
from multiprocessing import get_context
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory

from experiments.report import markdown, origin, words
from experiments.scale.inside import inside
from experiments.scale.measure import HYDRA_OWN, Taken, sweep, wait_for_quiet
from hopdiff.io.files import write_whole

HERE = Path(__file__).parent
KEPT = "taken.json"
PACKAGES = {"joblib": "hydra_plugins.hydra_joblib_launcher", "ray": "hydra_plugins.hydra_ray_launcher"}
KINDS = ("model=smooth budget.evaluations=2000", "model=smooth", "model=body")
TINY = ["model=smooth", "search=ordinary", "beta=0.2", "pictures=false"]
FEW = 20  # runs of the small sweep, whose time is nearly all of starting
ROUNDS = 20


def main(arguments: Sequence[str] | None = None) -> None:
    typed = list(sys.argv[1:] if arguments is None else arguments)
    options = parser().parse_args(typed)
    made = origin("scale", typed)
    options.out.mkdir(parents=True, exist_ok=True)
    kept = options.out / KEPT
    taken = json.loads(kept.read_text()) if kept.is_file() and not options.fresh else {"pairs": {}, "tiny": {}}
    engines = [name for name in options.engines if name == HYDRA_OWN or find_spec(PACKAGES[name])]

    def note(table: dict[str, list[list[float]]], name: str, found: Taken) -> None:
        print(f"{name}: {found.wall:.1f} s, cpu {found.cpu:.1f} s, others {found.others:.0%}", flush=True)
        table.setdefault(name, []).append([round(number, 3) for number in found])
        write_whole(kept, json.dumps(taken, indent=1) + "\n")

    with TemporaryDirectory() as place:
        folder = Path(place) / "sweep"
        for kind in [kind for kind in options.of or KINDS for _ in range(options.pairs)]:
            many = [*kind.split(), "beta=0.2", f"seed=range(0,{options.jobs})"]
            if options.quiet < 1.0 and not wait_for_quiet(options.quiet, options.patience):
                print("The machine did not become quiet.", flush=True)
                break
            found = {engine: sweep(engine, many, options.jobs, folder) for engine in engines}
            if max(one.others for one in found.values()) > options.quiet:
                print(f"Not kept, others worked: {found}", flush=True)
                continue
            for engine, one in found.items():
                note(taken["pairs"].setdefault(kind, {}), engine, one)
        if options.tiny:
            for engine in engines:
                for runs in (FEW, options.tiny):
                    found = sweep(engine, [*TINY, f"seed=range(0,{runs})"], runs, folder)
                    note(taken["tiny"], f"{engine}, {runs}", found)
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
        own = pool.submit(inside, TINY, ROUNDS).result()
    text = f"{made}\n\n{report(taken['pairs'], taken['tiny'], own, options.jobs)}"
    write_whole(options.out / "results.md", text)
    print(text)


def parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m experiments.scale", description=__doc__)
    parser.add_argument(
        "--engines", type=words, default=[HYDRA_OWN, "joblib", "ray"], help="without those not installed"
    )
    parser.add_argument("--pairs", type=int, default=5, help="rounds of the sweep of jobs, each of all engines")
    parser.add_argument("--jobs", type=int, default=16, help="of such a sweep")
    parser.add_argument(
        "--of", action="append", metavar="WORDS", help=f"settings of such jobs; else {', '.join(KINDS)}"
    )
    parser.add_argument("--tiny", type=int, default=1000, help="runs of the sweep of tiny runs; 0 for none")
    parser.add_argument("--quiet", type=float, default=1.0, help="share of the cores that others may use in a round")
    parser.add_argument("--patience", type=float, default=600.0, help="seconds to wait for such a moment")
    parser.add_argument("--fresh", action="store_true", help="forget what was measured before")
    parser.add_argument("--out", type=Path, default=HERE, help=f"folder for results.md and {KEPT}")
    return parser


def report(
    pairs: dict[str, dict[str, list[list[float]]]],
    tiny: dict[str, list[list[float]]],
    own: tuple[float, float, list[tuple[str, float, float]]],
    jobs: int,
) -> str:
    """All tables.

    pairs: what sweeps of jobs took, by their settings and launcher. tiny: of tiny runs, by launcher and size. own: of
    one run in a process of its own.
    """
    composed, ran, parts = own
    cores = os.cpu_count() or 1
    lines = [
        f"{cores} cores, Python {platform.python_version()}. Others: share of the cores that other programs used"
        " meanwhile; where it is not about 0, seconds tell little, and processor time is somewhat too long.",
        "",
        *(f"## {jobs} jobs of `{kind}`, without pictures\n\n{_pairs(taken)}" for kind, taken in pairs.items()),
        "## Tiny runs: one candidate, no pictures",
        "",
        _tiny(tiny, cores, ran),
        "## One tiny run, in a process that has imported everything",
        "",
        f"{ran:.0f} ms of processor time, and {composed:.0f} ms for Hydra to compose its settings. Of the run itself,"
        " under the profiler (what is called by another of these counts in both):",
        "",
        markdown(
            ("part", "calls a run", "share"), [(use, f"{calls:g}", f"{share:.0%}") for use, calls, share in parts]
        ),
    ]
    return "\n".join(lines)


def _pairs(taken: dict[str, list[list[float]]]) -> str:
    """Engines beside each other; how many times as fast is told of rounds, each with its own serial sweep."""
    rows = []
    serial = [Taken(*values) for values in taken.get(HYDRA_OWN, [])]
    for engine, values in taken.items():
        found = [Taken(*numbers) for numbers in values]
        gains = [one.wall / other.wall for one, other in zip(serial, found, strict=False)]
        rows.append(
            (
                engine,
                str(len(found)),
                f"{median(one.wall for one in found):.1f}",
                f"{median(one.cpu for one in found):.1f}",
                f"{median(gains):.2f} ({min(gains):.2f} to {max(gains):.2f})" if gains else "",
                f"{median(one.others for one in found):.0%}",
            )
        )
    return markdown(("launcher", "rounds", "s", "processor s", "times as fast", "others"), rows)


def _tiny(taken: dict[str, list[list[float]]], cores: int, ran: float) -> str:
    """What starting takes and what a run takes, of two sweeps of different size."""
    rows = []
    for name, values in taken.items():
        engine, _, size = name.partition(", ")
        runs, small = int(size), taken.get(f"{engine}, {FEW}")
        if runs <= FEW or not small:
            continue
        most, least = Taken(*values[-1]), Taken(*small[-1])
        each = (most.cpu - least.cpu) / (runs - FEW)
        rows.append(
            (
                engine,
                f"{runs:,}",
                f"{most.wall:.0f}",
                f"{1e3 * most.wall / runs:.0f}",
                f"{1e3 * each:.0f}",
                f"{1e3 * each - ran:.0f}",
                f"{least.cpu - FEW * each:.1f}",
                f"{most.others:.0%}",
            )
        )
    heading = ("launcher", "runs", "s", "ms a run", "processor ms a run", "added to the run", "processor s of starting")
    return markdown((*heading, "others"), rows)


if __name__ == "__main__":
    main()
