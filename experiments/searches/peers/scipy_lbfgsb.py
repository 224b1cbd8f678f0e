"""L-BFGS-B of SciPy (Byrd, Lu, Nocedal and Zhu 1995) from many starts, several side by side."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

import numpy as np
import torch
from scipy.optimize import minimize

from experiments.searches.lockstep import Ask, lockstep
from experiments.searches.meter import BEYOND, Meter
from hopdiff.search.box import best_first


def run(meter: Meter, generator: torch.Generator, starts: int | None = None, screened: bool = False) -> None:
    """Follows the merit, as hopdiff's descents do; a point without merit counts as twice BEYOND, without slope.

    starts: descents side by side, None: what suits the problem. screened: whether starts are the best of as many random
    points as hopdiff's own would be taken from, which are paid for.
    """
    rows = meter.starts if starts is None else starts
    screen = int(getattr(meter.problem, "screen", 128)) if screened else 0
    while True:
        # without screening the stock is one that no budget outlives
        points = meter.first(screen or max(rows, meter.budget // 4), generator)
        if screen:
            found = meter.evaluate(points, False)
            points = points[best_first(found.cost, found.merit)[:rows].cpu().numpy()]
        descents = partial(_descend, stock=iter(points))
        lockstep(lambda genes: _slopes(meter, genes), [descents] * min(rows, len(points)))


def _descend(ask: Ask, stock: Iterator[np.ndarray]) -> None:
    """Descents, one after the other, for as long as there are starts."""
    for start in stock:
        minimize(ask, start, jac=True, method="L-BFGS-B", bounds=[(0.0, 1.0)] * len(start))


def _slopes(meter: Meter, genes: np.ndarray) -> list[tuple[float, np.ndarray]]:
    found = meter.evaluate(genes, True)
    assert found.grad is not None
    sound = found.merit.isfinite()
    values = found.merit.double().where(sound, 2.0 * BEYOND).tolist()
    grads = found.grad.double().where(sound[:, None], 0.0).nan_to_num(0.0, 0.0, 0.0).cpu().numpy()
    return list(zip(values, grads, strict=True))
