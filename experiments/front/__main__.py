"""What does a run of less energy, more smoothness or a smaller peak force cost in the other two?

python -m experiments.front
"""

from __future__ import annotations

import argparse
import json
import shutil
import sys
from collections.abc import Callable, Sequence
from dataclasses import replace
from io import BytesIO
from pathlib import Path

import numpy as np
import torch

from experiments.front.objectives import NAMES, Batch, Counted, build
from experiments.front.pictures import fronts_figure
from experiments.front.population import best_of, course, hypervolume, nsga2
from experiments.front.sweep import anchors, simplex, sweep
from experiments.report import markdown, origin
from experiments.searches.cases import gradient_prices
from experiments.searches.traces import commit, machine, price_of
from hopdiff.composing import compose
from hopdiff.config import checked
from hopdiff.export.request import Exports
from hopdiff.io.files import write_whole
from hopdiff.job import Job, Run, make_run
from hopdiff.plots.save import save_figure
from hopdiff.search.box import Box
from hopdiff.tasks.export import write_all

HERE = Path(__file__).parent
METRICS = ("contact_time", "flight_share", "stride_time", "step_length", "peak_force_bw")
SEEDED_SPREAD = 0.05  # about the ends of the front, of the first population of the seeded NSGA-II, in box widths

Outcome = tuple[list[Batch], np.ndarray]  # all batches, and (n, G) what the method itself calls its front


def main(arguments: Sequence[str] | None = None) -> None:
    arguments = sys.argv[1:] if arguments is None else list(arguments)
    options = parser().parse_args(arguments)
    torch.set_num_threads(1)
    if options.fresh:
        shutil.rmtree(options.keep, ignore_errors=True)
    for folder in (options.out, options.keep):
        folder.mkdir(parents=True, exist_ok=True)
    job, objectives = build(options.character, options.speed)
    price = price_of(gradient_prices(job.problem, options.repeats))  # type: ignore[arg-type]
    generator = torch.Generator().manual_seed(options.seed)
    box = Box.of(job.problem)

    def after(before: Sequence[Batch]) -> Counted:
        """A count that goes on from batches that are charged for."""
        counted = Counted(job, objectives)
        if before:
            counted.batches, last = list(before), before[-1]
            counted.evaluations, counted.gradient_evaluations = last.evaluations, last.gradient_evaluations
            counted.started -= last.seconds
        return counted

    def ends_of_front() -> Outcome:
        counted = after([])
        found = anchors(counted, options.seed, options.starts, options.anchor_iterations)
        return counted.batches, found

    def by_gradients(before: Sequence[Batch]) -> Outcome:
        counted = after(before)
        ends = sweep(counted, simplex(options.divisions), options.iterations)
        return counted.batches, ends

    def by_population(first: np.ndarray, before: Sequence[Batch]) -> Outcome:
        counted = after(before)
        left = budget - counted.evaluations - price * counted.gradient_evaluations
        ends = nsga2(counted, first, max(2, round(left / len(first))), options.seed)
        return counted.batches, ends

    keep = Kept(options)
    before, three = keep("anchors", ends_of_front)
    found = {"gradients": keep("gradients", lambda: by_gradients(before))}
    last = found["gradients"][0][-1]
    budget = options.evaluations or last.evaluations + price * last.gradient_evaluations
    about = box.first(options.population, generator).double().numpy()
    found["NSGA-II"] = keep("nsga2", lambda: by_population(about, []))
    # The same with the ends of the front in its first population, the descents to them charged for.
    noise = SEEDED_SPREAD * box.normal(options.population, generator).double().numpy()
    noise[: len(three)] = 0.0
    seeded = np.clip(np.resize(three, noise.shape) + noise, 0.0, 1.0)
    found["NSGA-II from the front's ends"] = keep("nsga2_seeded", lambda: by_population(seeded, before))
    write(arguments, options, job, found, price, keep.commits)


def write(
    arguments: Sequence[str],
    options: argparse.Namespace,
    job: Job,
    found: dict[str, Outcome],
    price: float,
    commits: Sequence[str],
) -> None:
    archives = {name: _archive(batches) for name, (batches, _) in found.items()}
    every = np.concatenate([values for values, _ in archives.values()])
    union = every[best_of(every)]
    ideal, nadir = union.min(0), union.max(0)
    courses = {name: course(batches, ideal, nadir) for name, (batches, _) in found.items()}
    values, genes = archives["gradients"]
    chosen = five(values, ideal, nadir)
    runs = {name: make_run(job, torch.from_numpy(genes[at]).to(job.table.low)) for name, at in chosen.items()}
    fronts = {name: _thinned(values, ideal, nadir) for name, (values, _) in archives.items()}
    title = f"{options.character}, {options.speed:g} m/s: energy, smoothness and peak force"
    figure = fronts_figure(fronts, {name: values[at] for name, at in chosen.items()}, courses, price, title)
    save_figure(figure, options.out / "fronts.png", dpi=85)
    write_glb(runs, options.out)
    text = report(arguments, options, commits, found, archives, courses, price, (ideal, nadir), values, chosen, runs)
    write_whole(options.out / "results.md", text)
    print(text)


def _archive(batches: Sequence[Batch]) -> tuple[np.ndarray, np.ndarray]:
    """Values (n, 3) and genes (n, G) of the possible runs that no other of the same method is better than."""
    values, genes = (np.concatenate([getattr(batch, name) for batch in batches]) for name in ("values", "genes"))
    good = best_of(values)
    return values[good], genes[good]


def _thinned(values: np.ndarray, ideal: np.ndarray, nadir: np.ndarray, most: int = 200) -> np.ndarray:
    """Up to `most` of values (n, 3) that lie farthest from one another."""
    scaled = (values - ideal) / (nadir - ideal)
    chosen = list(dict.fromkeys(scaled.argmin(0).tolist()))
    far = np.min([np.linalg.norm(scaled - scaled[at], axis=1) for at in chosen], axis=0)
    while len(chosen) < min(most, len(values)):
        chosen.append(int(far.argmax()))
        far = np.minimum(far, np.linalg.norm(scaled - scaled[chosen[-1]], axis=1))
    return values[chosen]


def five(values: np.ndarray, ideal: np.ndarray, nadir: np.ndarray) -> dict[str, int]:
    """Numbers of five runs along a front (n, 3): the best of each kind, the one nearest to all, and the one farthest
    from these."""
    scaled = (values - ideal) / (nadir - ideal)
    chosen: dict[str, int] = {}
    for name, rank in [
        *((f"least_{name}", scaled[:, at]) for at, name in enumerate(NAMES)),
        ("middle", np.linalg.norm(scaled, axis=1)),
    ]:
        taken = list(chosen.values())
        chosen[name] = next(at for at in np.argsort(rank, kind="stable").tolist() if at not in taken)
    away = np.min([np.linalg.norm(scaled - scaled[at], axis=1) for at in chosen.values()], axis=0)
    chosen["between"] = int(away.argmax())
    return chosen


def write_glb(runs: dict[str, Run], folder: Path) -> Path:
    """front.glb, a clip a run."""
    takes = [replace(run.take(), name=name) for name, run in runs.items()]
    asked = checked(compose(["export=[glb]", "exports.glb.file=front.glb"]))
    return write_all(takes, Exports.build(asked.exports, asked.retarget), folder).files[0][0]


class Kept:
    """What each method came to, in a file of its own, made only where it lacks or is of another command. commits: that
    what is told was found at."""

    def __init__(self, options: argparse.Namespace) -> None:
        self.folder = options.keep
        self.asked = json.dumps({k: v for k, v in vars(options).items() if k not in ("out", "keep", "fresh")})
        self.commits: list[str] = []

    def __call__(self, name: str, make: Callable[[], Outcome]) -> Outcome:
        path = self.folder / f"{name}.npz"
        if path.is_file():
            with np.load(path) as kept:
                if str(kept["asked"]) == self.asked:
                    self.commits.append(str(kept["commit"]))
                    return _unpacked(kept)
        batches, ends = make()
        data = BytesIO()
        counts = np.array([(b.evaluations, b.gradient_evaluations, b.seconds, len(b.values)) for b in batches])
        values, genes = (np.concatenate([getattr(b, part) for b in batches]) for part in ("values", "genes"))
        np.savez(data, asked=self.asked, commit=commit(), counts=counts, values=values, genes=genes, ends=ends)
        write_whole(path, data.getvalue())
        self.commits.append(commit())
        print(f"{name}: {batches[-1].evaluations} evaluations, {batches[-1].seconds:.0f} s", flush=True)
        return batches, ends


def _unpacked(kept: np.lib.npyio.NpzFile) -> Outcome:
    stops = np.cumsum(kept["counts"][:, 3]).astype(int)
    values, genes = (np.split(kept[name], stops[:-1]) for name in ("values", "genes"))
    rows = zip(kept["counts"].tolist(), values, genes, strict=True)
    return [Batch(int(e), int(g), s, v, x) for (e, g, s, _), v, x in rows], kept["ends"]


def report(
    arguments: Sequence[str],
    options: argparse.Namespace,
    commits: Sequence[str],
    found: dict[str, Outcome],
    archives: dict[str, tuple[np.ndarray, np.ndarray]],
    courses: dict[str, list[tuple[int, int, float, float]]],
    price: float,
    box: tuple[np.ndarray, np.ndarray],
    values: np.ndarray,
    chosen: dict[str, int],
    runs: dict[str, Run],
) -> str:
    parts = [
        "# Energy, smoothness, peak force\n",
        f"- {origin('front', arguments, ('--keep', '--out'))}",
        f"- Found at commit {', '.join(f'`{one}`' for one in dict.fromkeys(commits))}",
        f"- Machine: {machine()}; a gradient costs {price:.2f} values more, at 16 side by side",
        f"- Objective: {', '.join(NAMES)} and the limits of what is possible; no other term of the cost, no wish,"
        f" no prior. {options.character}, {options.speed:g} m/s, beta .2\n",
        "Hypervolume: share of the box from the best values of the joint front to 1.1 times its span that lies behind"
        " some run. Whole: of all possible runs that a method priced; 200: of the 200 of these farthest apart.\n",
    ]
    rows = []
    total = courses["gradients"][-1][3]
    for name, (batches, ends) in found.items():
        last = batches[-1]
        front = archives[name][0]
        half = next((row for row in courses[name] if row[3] >= 0.95 * total), None)
        rows.append(
            (
                name,
                last.evaluations,
                last.gradient_evaluations,
                f"{last.evaluations + price * last.gradient_evaluations:.0f}",
                f"{last.seconds:.0f}",
                len(ends),
                len(front),
                f"{hypervolume(front, *box):.4f}",
                f"{hypervolume(_thinned(front, *box), *box):.4f}",
                "never" if half is None else f"{half[0] + price * half[1]:.0f}; {half[2]:.0f} s",
            )
        )
    heading = ("method", "evaluations", "gradients", "priced", "seconds", "ends", "front", "hypervolume, whole", "200")
    parts.append(markdown((*heading, "priced; seconds to 95 % of the gradients' hypervolume"), rows))
    parts.append("![The fronts](fronts.png)\n")
    parts.append("Five runs along the gradients' front, clips of `front.glb`:\n")
    shown = [name for name in METRICS if all(name in run.metrics for run in runs.values())]
    rows = [
        (at + 1, name, *(f"{x:.3g}" for x in values[number]), *(f"{runs[name].metrics[m]:.3g}" for m in shown))
        for at, (name, number) in enumerate(chosen.items())
    ]
    parts.append(markdown(("star", "run", *NAMES, *shown), rows))
    return "\n".join(parts)


def parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m experiments.front", description=__doc__)
    parser.add_argument("--speed", type=float, default=3.5, help="m/s")
    parser.add_argument("--character", default="human")
    parser.add_argument("--divisions", type=int, default=18, help="of the triangle of weights: 18 gives 190 of them")
    parser.add_argument("--iterations", type=int, default=25, help="of each descent, at most")
    parser.add_argument("--starts", type=int, default=4, help="descents to each end of the front")
    parser.add_argument("--anchor-iterations", type=int, default=120, help="of each of these, at most")
    parser.add_argument("--population", type=int, default=200, help="of NSGA-II")
    parser.add_argument("--evaluations", type=int, default=0, help="of NSGA-II; 0: what the gradients were worth")
    parser.add_argument("--repeats", type=int, default=5, help="timings, of which the least gives a gradient's price")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--keep", type=Path, default=Path("outputs/front"), help="where what the methods found is kept")
    parser.add_argument("--fresh", action="store_true", help="throw what is kept away first")
    parser.add_argument("--out", type=Path, default=HERE, help="folder of the table, the picture and the GLB")
    return parser


if __name__ == "__main__":
    main()
