"""A front by gradients: many weights, many descents side by side, each from the best run known for its weights."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

import numpy as np
import torch
from scipy.optimize import minimize

from experiments.front.objectives import Counted
from experiments.searches.lockstep import Ask, lockstep
from hopdiff.search.box import Box

FAR = 1e6  # where nothing can be computed
SIDE_BY_SIDE = 32
OTHERS = 0.02  # weight of the other two objectives where one is sought alone


def simplex(divisions: int) -> np.ndarray:
    """(n, 3) weights that add up to 1, evenly over the triangle (Das and Dennis 1998): n = (d + 1) (d + 2) / 2."""
    pairs = [(i, j) for i in range(divisions + 1) for j in range(divisions + 1 - i)]
    return np.array([(i, j, divisions - i - j) for i, j in pairs], dtype=float) / divisions


def anchors(counted: Counted, seed: int, starts: int, iterations: int) -> np.ndarray:
    """(3, G) the best run found for each objective nearly alone.

    Descents begin about the problem's start. Raises ValueError if one finds no possible run.
    """
    objectives = counted.objectives
    points = Box.of(counted.problem).first(starts, torch.Generator().manual_seed(seed)).double().numpy()
    # rough units, of a run as people run
    objectives.ideal, objectives.span = torch.zeros(3).double(), torch.tensor([1.0, 50.0, 3.0]).double()
    weights = np.full((3, 3), OTHERS) + (1 - OTHERS) * np.eye(3)
    _descend_all(counted, np.repeat(points, 3, axis=0), np.tile(weights, (starts, 1)), iterations)
    values, genes = counted.possible()
    if not len(values):
        raise ValueError("no possible run was found: raise --starts or --anchor-iterations")
    return genes[values.argmin(0)]


def measure_by(counted: Counted) -> None:
    """Take the ideal and the span of the front, which the scalar is told in, from what is known of it."""
    values, _ = counted.possible()
    best = values[values.argmin(0)]
    counted.objectives.ideal = torch.from_numpy(values.min(0))
    counted.objectives.span = torch.from_numpy(np.maximum(best.max(0) - values.min(0), 1e-6))


def sweep(counted: Counted, weights: np.ndarray, iterations: int) -> np.ndarray:
    """(n, G) ends of descents, one for each of weights (n, 3). A wave at a time, which begins at what is known by then:
    of all possible runs so far the one whose scalar is lowest."""
    measure_by(counted)
    order = np.random.default_rng(0).permutation(len(weights))
    ends = np.empty((len(weights), counted.problem.dimension))
    for wave in np.array_split(order, max(1, round(len(weights) / SIDE_BY_SIDE))):
        values, genes = counted.possible()
        known = torch.from_numpy(values)
        # no weight is nothing: along an edge of the triangle the third objective would be free
        asked = (1 - 3 * OTHERS) * weights[wave] + OTHERS
        scalars = [counted.objectives.scalar(known, torch.from_numpy(one).expand(len(known), 3)) for one in asked]
        starts = genes[[int(scalar.argmin()) for scalar in scalars]]
        ends[wave] = _descend_all(counted, starts, asked, iterations)
    return ends


def _descend_all(counted: Counted, starts: np.ndarray, weights: np.ndarray, iterations: int) -> np.ndarray:
    ends, stock = starts.copy(), iter(range(len(starts)))
    # beside each point its number comes along, by which its weights are known
    numbered = np.concatenate([starts, np.arange(len(starts))[:, None]], axis=1)

    def slopes(points: np.ndarray) -> list[tuple[float, np.ndarray]]:
        found = counted.evaluate(points[:, :-1], weights[points[:, -1].astype(int)])
        assert found.grad is not None
        there = found.merit.isfinite()
        merit = found.merit.double().where(there, FAR).tolist()
        grad = found.grad.double().where(there[:, None], 0.0).numpy()
        return list(zip(merit, grad, strict=True))

    job = partial(_descend, numbered=numbered, stock=stock, ends=ends, iterations=iterations)
    lockstep(slopes, [job] * min(SIDE_BY_SIDE, len(starts)))
    return ends


def _descend(ask: Ask, numbered: np.ndarray, stock: Iterator[int], ends: np.ndarray, iterations: int) -> None:
    for at in stock:

        def one(x: np.ndarray, number: float = numbered[at, -1]) -> tuple[float, np.ndarray]:
            found: tuple[float, np.ndarray] = ask(np.append(x, number))
            return found

        bounds = [(0.0, 1.0)] * (numbered.shape[1] - 1)
        options = {"maxiter": iterations, "maxfun": 2 * iterations, "ftol": 1e-7}
        result = minimize(one, numbered[at, :-1], jac=True, method="L-BFGS-B", bounds=bounds, options=options)
        ends[at] = result.x.clip(0.0, 1.0)
