"""A front by NSGA-II (Deb, Pratap, Agarwal and Meyarivan 2002) of pymoo (Blank and Deb 2020), and how fronts are
measured."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from pymoo.algorithms.moo.nsga2 import NSGA2
from pymoo.core.problem import Problem
from pymoo.indicators.hv import HV
from pymoo.optimize import minimize
from pymoo.util.nds.non_dominated_sorting import NonDominatedSorting

from experiments.front.objectives import Batch, Counted, objectives_of

CHUNK = 64
BEYOND = 1e6  # violation of what cannot be computed at all
MARGIN = 1.1  # of the reference point, in spans of the front from the ideal


class Runs(Problem):  # type: ignore[misc]
    """The three objectives over the unit box; an impossible run violates one constraint by its penalty."""

    def __init__(self, counted: Counted) -> None:
        super().__init__(n_var=counted.problem.dimension, n_obj=3, n_ieq_constr=1, xl=0.0, xu=1.0)
        self.counted = counted

    def _evaluate(self, x: np.ndarray, out: dict[str, Any], *args: Any, **kwargs: Any) -> None:
        values, over = [], []
        for part in np.array_split(x, max(1, -(-len(x) // CHUNK))):
            found = self.counted.evaluate(part, None)
            values.append(np.nan_to_num(objectives_of(found), nan=BEYOND, posinf=BEYOND))
            impossible = found.cost.isinf().numpy()
            penalty = found.terms["penalty"].double().nan_to_num(BEYOND, BEYOND).clamp(max=BEYOND).numpy()
            over.append(np.where(impossible, 1e-6 + penalty, 0.0))
        out["F"], out["G"] = np.concatenate(values), np.concatenate(over)[:, None]


def nsga2(counted: Counted, first: np.ndarray, generations: int, seed: int) -> np.ndarray:
    """(n, G) of the last population's possible runs that none of the others is better than in everything. first: (P, G)
    genes of the first population."""
    algorithm = NSGA2(pop_size=len(first), sampling=first)
    result = minimize(Runs(counted), algorithm, ("n_gen", generations), seed=seed)
    found: np.ndarray = np.empty((0, first.shape[1])) if result.X is None else np.atleast_2d(result.X)
    return found


def best_of(values: np.ndarray) -> np.ndarray:
    """(n,) numbers of those of values (N, 3) that no other is better than in everything."""
    if not len(values):
        return np.zeros(0, dtype=int)
    found: np.ndarray = NonDominatedSorting().do(values, only_non_dominated_front=True)
    return found


def hypervolume(values: np.ndarray, ideal: np.ndarray, nadir: np.ndarray) -> float:
    """Share of the box from the ideal to the reference point that lies behind some of values (N, 3)."""
    scaled = (values - ideal) / (nadir - ideal)
    scaled = scaled[(scaled < MARGIN).all(1)]
    return float(HV(ref_point=np.full(3, MARGIN))(scaled)) / MARGIN**3 if len(scaled) else 0.0


def course(
    batches: Sequence[Batch], ideal: np.ndarray, nadir: np.ndarray, points: int = 40
) -> list[tuple[int, int, float, float]]:
    """(evaluations, gradient evaluations, seconds, hypervolume of everything found so far), at up to `points` batches
    that lie evenly on a logarithmic scale."""
    counts = np.array([batch.evaluations for batch in batches])
    asked = np.unique(np.searchsorted(counts, np.geomspace(counts[0], counts[-1], points)))
    found, front, at = [], np.empty((0, 3)), 0
    for stop in asked.tolist():
        values = np.concatenate([front, *(batch.values for batch in batches[at : stop + 1])])
        front, at = values[best_of(values)], stop + 1
        batch = batches[stop]
        told = hypervolume(front, ideal, nadir)
        found.append((batch.evaluations, batch.gradient_evaluations, batch.seconds, told))
    return found
