from __future__ import annotations

import math

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg

from hopdiff.plots.convergence import convergence_figure
from hopdiff.search.loop import HistoryRow


def history(best: list[float]) -> list[HistoryRow]:
    return [
        HistoryRow(
            step=i,
            evaluations=10 * i,
            gradient_evaluations=0,
            spent=10.0 * i,
            seconds=0.1 * i,
            best=value,
            median=2 * value,
            gamma=0.5 * value if math.isfinite(value) else math.nan,
            energy=0.3,
            invalid=0.1,
        )
        for i, value in enumerate(best, start=1)
    ]


def curve(figure, panel: int, label: str) -> np.ndarray:
    return next(np.column_stack(line.get_data()) for line in figure.axes[panel].lines if line.get_label() == label)


def test_cost_against_what_was_spent() -> None:
    figure = convergence_figure(history([4.0, 2.0, 1.0]), "5 m/s")
    np.testing.assert_allclose(curve(figure, 0, "best so far"), [[10, 4], [20, 2], [30, 1]])
    np.testing.assert_allclose(curve(figure, 0, "median of the step")[:, 1], [8, 4, 2])
    np.testing.assert_allclose(curve(figure, 1, "gamma")[:, 1], [2, 1, 0.5])
    assert figure.axes[0].get_yscale() == "log"
    assert figure.get_suptitle() == "5 m/s"


def test_the_best_is_always_on_the_page() -> None:
    figure = convergence_figure(history([900.0, 3.0, 0.02]))
    low, high = figure.axes[0].get_ylim()
    assert low < 0.02 < 900.0 < high


def test_what_is_not_finite_is_a_gap() -> None:
    figure = convergence_figure(history([math.inf, 2.0, 1.0]))
    assert math.isnan(curve(figure, 0, "best so far")[0, 1])
    assert math.isnan(curve(figure, 1, "gamma")[0, 1])


@pytest.mark.parametrize("best", [[math.inf, math.inf], [1.0], [1.0, 0.0], [1.0, 1.0], [2.0, -1.0]])
def test_odd_histories_can_be_drawn(best: list[float]) -> None:
    FigureCanvasAgg(convergence_figure(history(best))).draw()
