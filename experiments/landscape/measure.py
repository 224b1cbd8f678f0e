"""What is measured of a landscape: descents and their ends, lines between these, slopes, curvature."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial

import numpy as np
import torch
from scipy.cluster.hierarchy import fcluster, linkage
from scipy.optimize import minimize
from torch import Tensor

from experiments.searches.cases import AnyProblem
from experiments.searches.lockstep import Ask, lockstep
from experiments.searches.meter import BEYOND
from hopdiff.search.box import Box

BATCH = 64  # candidates priced at once
STEP = 1e-5  # of central differences, in box widths
EDGE = 1e-3  # from a bound at which a gene counts as held there, in box widths


@dataclass(frozen=True)
class Ends:
    """Where descents came to rest, lowest cost first. genes: (N, G). cost: (N,) inf of impossible runs. near: (N,)
    whether a descent began about the problem's start, and not anywhere in the box."""

    genes: np.ndarray
    cost: np.ndarray
    near: np.ndarray


def priced(problem: AnyProblem, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Cost and merit (P,) of points (P, G), infinite where there is none."""
    found = [problem.evaluate(part, False) for part in _genes(problem, points).split(BATCH)]
    cost, merit = (torch.cat([getattr(one, name) for one in found]).double() for name in ("cost", "merit"))
    return tuple(x.where(x.isfinite(), torch.inf).numpy() for x in (cost, merit))  # type: ignore[return-value]


def sloped(problem: AnyProblem, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Merit (P,) and its gradient (P, G) at points (P, G); NaN where there is none."""
    merits, grads = [], []
    for part in _genes(problem, points).split(BATCH):
        found = problem.evaluate(part, True)
        assert found.grad is not None
        lost = ~found.merit.isfinite()
        merits.append(found.merit.double().masked_fill(lost, torch.nan))
        grads.append(found.grad.double().masked_fill(lost[:, None], torch.nan))
    return torch.cat(merits).numpy(), torch.cat(grads).numpy()


def descents(problem: AnyProblem, count: int, iterations: int, seed: int) -> Ends:
    """`count` descents from about the problem's start and as many from anywhere in the box, by SciPy's L-BFGS-B, which
    owes nothing to hopdiff's searches; a descent that ends at no possible run is kept with its infinite cost."""
    generator = torch.Generator().manual_seed(seed)
    box = Box.of(problem)
    starts = np.concatenate([draw(count, generator).double().numpy() for draw in (box.first, box.uniform)])
    ends = starts.copy()
    stock = iter(range(len(starts)))

    def slopes(points: np.ndarray) -> list[tuple[float, np.ndarray]]:
        merit, grad = sloped(problem, points)
        lost = np.isnan(merit)
        return list(zip(np.where(lost, BEYOND, merit).tolist(), np.where(lost[:, None], 0.0, grad), strict=True))

    lockstep(
        slopes,
        [partial(_descend, starts=starts, stock=stock, ends=ends, iterations=iterations)] * min(BATCH, 2 * count),
    )
    cost, _ = priced(problem, ends)
    order = np.argsort(cost, kind="stable")
    return Ends(ends[order], cost[order], (np.arange(len(starts)) < count)[order])


def _descend(ask: Ask, starts: np.ndarray, stock: Iterator[int], ends: np.ndarray, iterations: int) -> None:
    for at in stock:
        bounds = [(0.0, 1.0)] * starts.shape[1]
        options = {"maxiter": iterations, "maxfun": 2 * iterations, "ftol": 1e-11, "gtol": 1e-7, "maxcor": 20}
        found = minimize(ask, starts[at], jac=True, method="L-BFGS-B", bounds=bounds, options=options)
        ends[at] = found.x.clip(0.0, 1.0)


def basins(genes: np.ndarray, apart: float) -> np.ndarray:
    """(N,) number of the group of each end, from 0, in the order in which groups turn up.

    Agglomerative clustering by mean distance, root mean square over the genes; groups lie at least `apart`.
    """
    if len(genes) < 2:
        return np.zeros(len(genes), dtype=int)
    labels = fcluster(linkage(genes / np.sqrt(genes.shape[1]), "average"), apart, "distance")
    first = list(dict.fromkeys(labels.tolist()))
    return np.array([first.index(label) for label in labels.tolist()])


def distance(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Root mean square over the genes, in box widths."""
    found: np.ndarray = np.sqrt(((a - b) ** 2).mean(-1))
    return found


@dataclass(frozen=True)
class Pair:
    """Two ends and the straight line between them. apart: their distance. barrier: what the dearest point of the line
    costs above the dearer end, relative to it; inf where the line leaves what is possible."""

    apart: float
    barrier: float


def pairs(problem: AnyProblem, ends: Ends, within: float, most: int, points: int = 21) -> list[Pair]:
    """Pairs of those ends that cost at most `within` more than the best, relative to it; of the best `most` ends."""
    good = np.flatnonzero(ends.cost <= ends.cost[0] + within * abs(ends.cost[0]))[:most]
    chosen = [(a, b) for at, a in enumerate(good) for b in good[at + 1 :]]
    if not chosen:
        return []
    share = np.linspace(0.0, 1.0, points)[:, None]
    lines = np.concatenate([(1 - share) * ends.genes[a] + share * ends.genes[b] for a, b in chosen])
    cost = priced(problem, lines)[0].reshape(len(chosen), points)
    found = []
    for (a, b), along in zip(chosen, cost, strict=True):
        higher = max(ends.cost[a], ends.cost[b])
        found.append(Pair(float(distance(ends.genes[a], ends.genes[b])), float((along.max() - higher) / abs(higher))))
    return found


@dataclass(frozen=True)
class Slopes:
    """Gradient against central differences at N points. cosine: (N,), error: (N,) length of the difference over that
    of the central differences; NaN where one of the two is not there. lost: share of points without gradient; torn:
    share of those with one whose neighbours are not all there. impossible: share of impossible runs."""

    cosine: np.ndarray
    error: np.ndarray
    lost: float
    torn: float
    impossible: float


def slopes(problem: AnyProblem, points: np.ndarray, step: float = STEP) -> Slopes:
    merit, grad = sloped(problem, points)
    count, genes = points.shape
    inside = points.clip(step, 1.0 - step)
    around = inside[:, None, None] + step * np.array([1.0, -1.0])[:, None, None] * np.eye(genes)  # (N, 2, G, G)
    _, values = priced(problem, around.reshape(-1, genes))
    sides = values.reshape(count, 2, genes)
    with np.errstate(invalid="ignore"):
        central = (sides[:, 0] - sides[:, 1]) / (2 * step)
    whole = np.isfinite(sides).all((1, 2))
    there = ~np.isnan(merit)
    good = whole & there
    length, other = np.linalg.norm(central, axis=1), np.linalg.norm(grad, axis=1)
    with np.errstate(invalid="ignore", divide="ignore"):
        cosine = np.where(good, (central * grad).sum(1) / (length * other), np.nan)
        error = np.where(good, np.linalg.norm(central - grad, axis=1) / length, np.nan)
    impossible = float(np.isinf(priced(problem, points)[0]).mean())
    torn = float((~whole)[there].mean()) if there.any() else float("nan")
    return Slopes(cosine, error, float((~there).mean()), torn, impossible)


@dataclass(frozen=True)
class Curvature:
    """At an optimum. free: (F,) numbers of genes that no bound holds. values: (F,) eigenvalues of the Hessian there,
    largest first, relative to the cost; vectors: (F, F) in columns. reach: (F,) how far along a direction, both ways
    together, the cost stays within `rise` of the optimum's, in box widths RMS over the genes; `told`: what the
    eigenvalue says of that."""

    free: np.ndarray
    values: np.ndarray
    vectors: np.ndarray
    reach: np.ndarray
    told: np.ndarray


def curvature(problem: AnyProblem, best: np.ndarray, rise: float, step: float = 1e-4) -> Curvature:
    """The Hessian by central differences of gradients, and how far its directions really go."""
    genes = len(best)
    free = np.flatnonzero((best > EDGE) & (best < 1.0 - EDGE))
    sides = best + step * np.array([1.0, -1.0])[:, None, None] * np.eye(genes)[free]  # (2, F, G)
    _, grad = sloped(problem, sides.reshape(-1, genes))
    grad = np.nan_to_num(grad).reshape(2, len(free), genes)
    hessian = ((grad[0] - grad[1]) / (2 * step))[:, free]
    cost = float(priced(problem, best[None])[1][0])
    values, vectors = np.linalg.eigh(0.5 * (hessian + hessian.T) / abs(cost))
    values, vectors = values[::-1], vectors[:, ::-1]
    told = 2 * np.sqrt(2 * rise / np.maximum(values, 1e-12)) / np.sqrt(genes)
    spread = np.zeros((len(free), genes))
    spread[:, free] = vectors.T
    ways = np.concatenate([_reach(problem, best, spread * sign, cost, rise)[None] for sign in (1.0, -1.0)])
    return Curvature(free, values, vectors, ways.sum(0) / np.sqrt(genes), told)


def _reach(problem: AnyProblem, best: np.ndarray, ways: np.ndarray, cost: float, rise: float) -> np.ndarray:
    """(F,) distance along each of ways (F, G) at which the run costs `rise` more, or leaves the box or what is
    possible: a geometric row of trials, then halving."""
    top = cost + rise * abs(cost)
    trials = np.geomspace(1e-4, 2.0, 24)
    points = best + trials[:, None, None] * ways  # (T, F, G)
    inside = ((points >= 0) & (points <= 1)).all(-1)
    good = (priced(problem, points.reshape(-1, len(best)))[0].reshape(inside.shape) <= top) & inside
    first = np.where(good.all(0), len(trials), np.argmin(good, axis=0))
    low = np.where(first > 0, trials[first - 1], 0.0)
    high = np.where(first < len(trials), trials[np.minimum(first, len(trials) - 1)], low)
    for _ in range(6):
        middle = 0.5 * (low + high)
        points = best + middle[:, None] * ways
        good = (priced(problem, points)[0] <= top) & ((points >= 0) & (points <= 1)).all(-1)
        low, high = np.where(good, middle, low), np.where(good, high, middle)
    return low


def lines(problem: AnyProblem, best: np.ndarray, points: int) -> tuple[np.ndarray, np.ndarray]:
    """Values of each gene (G, M), that of the best run among them, and the cost (G, M) of that run with the gene moved
    there."""
    genes = len(best)
    grid = np.broadcast_to(np.linspace(0.0, 1.0, points), (genes, points))
    at = np.sort(np.concatenate([grid, best[:, None]], axis=1), axis=1)
    moved = np.broadcast_to(best, (genes, points + 1, genes)).copy()
    moved[np.arange(genes), :, np.arange(genes)] = at
    return at, priced(problem, moved.reshape(-1, genes))[0].reshape(at.shape)


@dataclass(frozen=True)
class Plane:
    """Through three points of the box. x, y: (M,) coordinates, distances in box widths RMS. cost, merit: (M, M), rows
    are y. corners: (3, 2) where the three points lie. Where the plane leaves the box its points are clipped to it:
    optima lie at bounds, and next to nothing would be left."""

    x: np.ndarray
    y: np.ndarray
    cost: np.ndarray
    merit: np.ndarray
    corners: np.ndarray


def plane(problem: AnyProblem, three: np.ndarray, points: int, margin: float = 0.35) -> Plane:
    """The plane through three points (3, G), which do not lie on one line."""
    width = np.sqrt(three.shape[1])
    first = (three[1] - three[0]) / np.linalg.norm(three[1] - three[0])
    second = three[2] - three[0]
    second = second - (second @ first) * first
    second = second / np.linalg.norm(second)
    corners = np.stack([(three - three[0]) @ first, (three - three[0]) @ second], axis=1) / width
    low, high = corners.min(0), corners.max(0)
    room = margin * (high - low).max()
    x, y = (np.linspace(a - room, b + room, points) for a, b in zip(low, high, strict=True))
    over = three[0] + width * (x[None, :, None] * first + y[:, None, None] * second)
    cost, merit = (found.reshape(points, points) for found in priced(problem, over.reshape(-1, three.shape[1])))
    return Plane(x, y, cost, merit, corners)


def apart(ends: Ends, groups: np.ndarray) -> np.ndarray:
    """(3, G) the best ends of the three best groups; of fewer groups, the ends that lie farthest from these."""
    firsts = [int(np.flatnonzero(groups == group)[0]) for group in range(min(3, int(groups.max()) + 1))]
    while len(firsts) < 3:
        far = np.min([distance(ends.genes, ends.genes[one]) for one in firsts], axis=0)
        far[np.isinf(ends.cost)] = 0.0
        firsts.append(int(far.argmax()))
    return ends.genes[firsts]


def _genes(problem: AnyProblem, points: np.ndarray) -> Tensor:
    return torch.from_numpy(points.clip(0.0, 1.0)).to(problem.device, problem.dtype)
