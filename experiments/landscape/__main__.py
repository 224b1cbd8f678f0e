"""What do the searches walk on: how many basins, how true are slopes, how free are equal runs?

python -m experiments.landscape
"""

from __future__ import annotations

import argparse
import json
import math
import shutil
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import torch

from experiments.landscape import measure, pictures
from experiments.landscape.measure import Curvature, Ends, Pair, Plane, Slopes
from experiments.report import markdown, origin
from experiments.searches.cases import AnyProblem, Case, build_problem, objective, settings
from experiments.searches.traces import commit, machine
from hopdiff.io.files import read_json, write_whole
from hopdiff.plots.save import save_figure
from hopdiff.search.box import Box

HERE = Path(__file__).parent
# Problems by name: a model of experiments.searches.cases, and settings on top.
VARIANTS: dict[str, tuple[str, tuple[str, ...]]] = {
    "body": ("body", ()),
    "smooth": ("smooth", ()),
    "smooth without prior": ("smooth", ("costs.ordinary=0",)),
    "thesis": ("thesis", ()),
}
DEFAULT = ["body", "smooth", "smooth without prior"]
EQUAL = (0.001, 0.01)  # excesses within which runs are called equal
NEAR = 0.01  # about the best run, in box widths, that slopes are asked for
PAIRED = 12  # ends of equal cost, at most, that lines are drawn between

Found = TypeVar("Found")


def main(arguments: Sequence[str] | None = None) -> None:
    arguments = sys.argv[1:] if arguments is None else list(arguments)
    options = parser().parse_args(arguments)
    torch.set_num_threads(1)
    options.out.mkdir(parents=True, exist_ok=True)
    if options.fresh:
        shutil.rmtree(options.keep, ignore_errors=True)
    parts, planes, lowest, commits = [], {}, {}, list[str]()
    slopes: dict[str, dict[str, Slopes]] = {}
    ends: dict[str, tuple[Ends, np.ndarray]] = {}
    curves: dict[str, Curvature] = {}
    for name in options.problems:
        model, more = VARIANTS[name]
        case = Case(model, options.speed, options.beta, options.character)
        folder = options.keep / f"{name.replace(' ', '_')}_{case.label}"
        folder.mkdir(parents=True, exist_ok=True)
        problem = build_problem(case, options.keep, more)
        found = Kept(folder, options)
        came = found("ends", Ends, lambda p=problem: measure.descents(p, options.descents, options.iterations, 0))  # type: ignore[misc]
        if not math.isfinite(came.cost[0]):
            sys.exit(f"{name}: no descent ended at a possible run; raise --descents or --iterations.")
        good = np.isfinite(came.cost)
        ends[name] = came, measure.basins(came.genes[good], options.apart)
        best = came.genes[0]
        lowest[name] = float(came.cost[0])
        slopes[name] = {
            kind: found(f"slopes_{kind.split()[-1]}", Slopes, lambda p=problem, x=points: measure.slopes(p, x))  # type: ignore[misc]
            for kind, points in samples(problem, best, options.samples).items()
        }
        curves[name] = found("curvature", Curvature, lambda p=problem, x=best: measure.curvature(p, x, EQUAL[0]))  # type: ignore[misc]
        three = measure.apart(came, ends[name][1])
        planes[name] = found("plane", Plane, lambda p=problem, x=three: measure.plane(p, x, options.points))  # type: ignore[misc]
        at, costs = found("lines", tuple, lambda p=problem, x=best: measure.lines(p, x, options.points))  # type: ignore[misc]
        between = {
            within: found(f"pairs_{within:g}", list, lambda p=problem, e=came, w=within: measure.pairs(p, e, w, PAIRED))  # type: ignore[misc]
            for within in EQUAL
        }
        label = name.replace(" ", "_")
        figure = pictures.lines_figure(
            f"{name}: cost along each gene through the best run", problem.table.names, best, at, costs
        )
        save_figure(figure, options.out / f"lines_{label}.png", dpi=75)
        commits += found.commits
        parts += [*page(name, case, more, options, problem, *ends[name], slopes[name], curves[name], between)]
        parts += [f"![Cost along each gene](lines_{label}.png)\n"]
    save_figure(pictures.ends_figure(ends), options.out / "ends.png", dpi=90)
    save_figure(pictures.planes_figure(planes, lowest), options.out / "planes.png", dpi=90)
    save_figure(pictures.slopes_figure(slopes), options.out / "slopes.png", dpi=90)
    save_figure(pictures.spectrum_figure(curves, EQUAL[0]), options.out / "curvature.png", dpi=90)
    write_whole(options.out / "results.md", "\n".join([*head(arguments, options, commits), *parts]))
    print("\n".join(parts))


class Kept:
    """Measures that are kept in a folder, a file each, written whole, and made only where they lack. commits: that what
    is told was measured at."""

    def __init__(self, folder: Path, options: argparse.Namespace) -> None:
        names = ("descents", "iterations", "samples", "points", "apart")
        self.folder, self.commits = folder, list[str]()
        self.asked = {name: getattr(options, name) for name in names}

    def __call__(self, name: str, kind: Any, make: Callable[[], Found]) -> Found:
        path = self.folder / f"{name}.json"
        if path.is_file():
            kept = read_json(path)
            if kept["asked"] == self.asked:
                self.commits.append(kept["commit"])
                return _made(kind, kept["found"])
        found = make()
        content = {"asked": self.asked, "commit": commit(), "found": _plain(found)}
        write_whole(path, json.dumps(content) + "\n")
        self.commits.append(commit())
        print(f"{self.folder.name}: {name}", flush=True)
        return found


def _plain(found: Any) -> Any:
    if isinstance(found, np.ndarray):
        return found.tolist()
    if isinstance(found, list | tuple):
        return [_plain(one) for one in found]
    if isinstance(found, float | int | np.generic):
        return found if isinstance(found, int | float) else found.item()
    return {entry.name: _plain(getattr(found, entry.name)) for entry in fields(found)}


def _made(kind: Any, plain: Any) -> Any:
    if kind is tuple:
        return tuple(np.array(one, dtype=float) for one in plain)
    if kind is list:
        return [Pair(**one) for one in plain]
    arrays = {name: np.array(value) if isinstance(value, list) else value for name, value in plain.items()}
    return kind(**arrays)


def samples(problem: AnyProblem, best: np.ndarray, count: int) -> dict[str, np.ndarray]:
    """Points (count, G) to ask for slopes at. best: (G,) the best run, about which descents end."""
    box, generator = Box.of(problem), torch.Generator().manual_seed(0)
    spread = getattr(problem, "spread", None) or 0.05
    about = (problem.start + spread * box.normal(count, generator)).clamp(0.0, 1.0)
    near = best + NEAR * box.normal(count, generator).double().numpy()
    return {
        "anywhere in the box": box.uniform(count, generator).double().numpy(),
        "about the start": about.double().numpy(),
        "about the best run": near.clip(0.0, 1.0),
    }


def head(arguments: Sequence[str], options: argparse.Namespace, commits: Sequence[str]) -> list[str]:
    return [
        "# Landscapes\n",
        f"- {origin('landscape', arguments, ('--keep', '--out'))}",
        f"- Measured at commit {', '.join(f'`{one}`' for one in dict.fromkeys(commits))}",
        f"- Machine: {machine()}",
        f"- {options.character}, {options.speed:g} m/s, beta {options.beta:g}; descents: L-BFGS-B of SciPy,"
        f" {options.iterations} iterations at most\n",
        "Distances are root mean squares over the genes, in box widths: two uniform points lie .41 apart.\n",
        "![Ends of descents](ends.png)\n",
        "![Planes through three ends](planes.png)\n",
        "![Gradients against central differences](slopes.png)\n",
        "![Curvature at the best run](curvature.png)\n",
    ]


def page(
    name: str,
    case: Case,
    more: Sequence[str],
    options: argparse.Namespace,
    problem: AnyProblem,
    ends: Ends,
    groups: np.ndarray,
    slopes: dict[str, Slopes],
    curve: Curvature,
    between: dict[float, list[Pair]],
) -> Iterator[str]:
    yield f"## {name}\n"
    words = [word for word in [*settings(case, options.keep), *more] if "least" not in word]
    terms = ", ".join(f"{term} {weight:g} ({kind})" for term, weight, kind in objective(problem))
    yield f"`{' '.join(words)}`; {problem.dimension} genes; terms, weights and what they put in: {terms}.\n"
    yield "### Basins\n"
    excess = (ends.cost - ends.cost[0]) / abs(ends.cost[0])
    rows = [(kind, *(f"{np.mean(excess[ends.near == near] <= one):.0%}" for one in (*EQUAL, 0.1)),
             f"{np.mean(np.isinf(ends.cost[ends.near == near])):.0%}")
            for kind, near in (("about the start", True), ("anywhere in the box", False))]  # fmt: skip
    yield f"{len(ends.cost)} descents, best cost {ends.cost[0]:.6f}.\n"
    yield markdown(("begun", "end within 0.1 %", "1 %", "10 %", "at no possible run"), rows)
    yield f"Groups at least {options.apart:g} apart, by agglomerative clustering of the ends that are possible runs:\n"
    rows = []
    for group in range(int(groups.max()) + 1):
        mine = np.flatnonzero(groups == group)
        wide = float(measure.distance(ends.genes[mine], ends.genes[mine].mean(0)).max())
        away = float(measure.distance(ends.genes[mine[0]], ends.genes[0]))
        rows.append((group + 1, len(mine), f"{100 * excess[mine[0]]:.3f} %", f"{away:.3f}", f"{wide:.3f}"))
    heading = ("group", "ends", "its best above the best of all", "distance from there", "radius")
    yield markdown(heading, rows[:12]) + (f"\n{len(rows) - 12} more groups.\n" if len(rows) > 12 else "")
    yield "### Equal runs\n"
    yield "Pairs of ends that cost the same within a share of the best, and the straight line between them.\n"
    rows = [(f"{100 * within:g} %", len(found), *_told(found, within)) for within, found in between.items()]
    yield markdown(
        ("within", "pairs", "median distance", "largest", "barrier within the same share", "median barrier"), rows
    )
    yield f"At the best run {len(curve.free)} genes are free of their bounds. {_flat(curve, problem)}\n"
    yield "### Slopes\n"
    rows = [
        (kind, f"{s.impossible:.0%}", f"{s.lost:.0%}", f"{s.torn:.0%}", *_quantiles(s)) for kind, s in slopes.items()
    ]
    heading = ("points", "impossible", "no gradient", "neighbours missing", "median 1 - cosine", "95 % below")
    yield markdown((*heading, "cosine < 0", "median relative error"), rows)


def _told(found: Sequence[Pair], within: float) -> tuple[str, ...]:
    if not found:
        return "-", "-", "-", "-"
    apart, barrier = (np.array([getattr(one, name) for one in found]) for name in ("apart", "barrier"))
    middle = float(np.quantile(barrier, 0.5, method="nearest"))
    told = f"{100 * middle:.2g} %" if math.isfinite(middle) else "impossible"
    return f"{np.median(apart):.3f}", f"{apart.max():.3f}", f"{np.mean(barrier <= within):.0%}", told


def _flat(curve: Curvature, problem: AnyProblem) -> str:
    """How many directions are nearly flat, and which genes the flattest moves."""
    wide = int((curve.reach > 0.05).sum())
    flattest = int(curve.reach.argmax())
    weights = np.abs(curve.vectors[:, flattest])
    order = np.argsort(-weights)[:4]
    names = ", ".join(f"{problem.table.names[curve.free[at]]} {weights[at]:.2f}" for at in order)
    negative = int((curve.values < -1e-6 * abs(curve.values[0])).sum())
    return (
        f"Along {wide} of {len(curve.free)} eigenvectors of the Hessian the cost stays within {100 * EQUAL[0]:g} % for"
        f" more than .05 box widths, both ways together; one gene from end to end of its box is"
        f" {1 / math.sqrt(problem.dimension):.2f}. The longest such way is {curve.reach[flattest]:.3f}, mostly {names}."
        f" Condition number {curve.values[0] / max(abs(curve.values[-1]), 1e-300):.2g};"
        f" {negative} eigenvalues below zero."
    )


def _quantiles(slopes: Slopes) -> tuple[str, ...]:
    there = np.isfinite(slopes.cosine)
    if not there.any():
        return "-", "-", "-", "-"
    off = 1 - slopes.cosine[there]
    error = slopes.error[there]
    return (
        f"{np.median(off):.1e}",
        f"{np.quantile(off, 0.95):.1e}",
        f"{np.mean(off > 1):.1%}",
        f"{np.median(error):.1e}",
    )


def parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m experiments.landscape", description=__doc__)
    parser.add_argument("--problems", nargs="+", choices=list(VARIANTS), default=DEFAULT, metavar="NAME",
                        help=f"of {', '.join(VARIANTS)}")  # fmt: skip
    parser.add_argument("--speed", type=float, default=5.0, help="m/s")
    parser.add_argument("--beta", type=float, default=0.5)
    parser.add_argument("--character", default="human")
    parser.add_argument("--descents", type=int, default=32, help="from about the start, and as many from anywhere")
    parser.add_argument("--iterations", type=int, default=400, help="of a descent, at most")
    parser.add_argument("--samples", type=int, default=128, help="points that gradients are checked at, of each kind")
    parser.add_argument("--points", type=int, default=61, help="along a line, and along each side of a plane")
    parser.add_argument("--apart", type=float, default=0.05, help="least distance of two basins, in box widths")
    parser.add_argument("--keep", type=Path, default=Path("outputs/landscape"), help="where what is measured is kept")
    parser.add_argument("--fresh", action="store_true", help="throw what is kept away first")
    parser.add_argument("--out", type=Path, default=HERE, help="folder of the page and its pictures")
    return parser


if __name__ == "__main__":
    main()
