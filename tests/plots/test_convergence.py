from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from hopdiff.plots.convergence import convergence_figure
from hopdiff.search.loop import HistoryRow


@dataclass
class Made:
    """What a made-up history holds of every step."""

    median: float = 2.0  # times the best
    gamma: float = 0.5  # times the best
    energy: float = 0.3


def history(best: list[float], made: Made | None = None) -> list[HistoryRow]:
    one = made or Made()
    return [
        HistoryRow(
            step=i,
            evaluations=10 * i,
            gradient_evaluations=0,
            spent=10.0 * i,
            seconds=0.1 * i,
            best=value,
            median=one.median * value,
            gamma=one.gamma * value if math.isfinite(value) else math.nan,
            energy=one.energy,
            invalid=0.1,
        )
        for i, value in enumerate(best, start=1)
    ]


def line(figure: Figure, panel: int, label: str) -> Line2D:
    return next(line for line in figure.axes[panel].lines if str(line.get_label()).startswith(label))


def curve(figure: Figure, panel: int, label: str) -> np.ndarray:
    return np.column_stack(line(figure, panel, label).get_data())


def test_cost_against_what_was_spent() -> None:
    figure = convergence_figure(history([4.0, 2.0, 1.0]), "5 m/s")
    np.testing.assert_allclose(curve(figure, 0, "best so far"), [[10, 4], [20, 2], [30, 1]])
    np.testing.assert_allclose(curve(figure, 0, "median of the step")[:, 1], [8, 4, 2])
    np.testing.assert_allclose(curve(figure, 1, "of the best")[:, 1], [0.3, 0.3, 0.3])
    np.testing.assert_allclose(curve(figure, 2, "of the best")[:, 1], [2, 1, 0.5])
    assert figure.axes[0].get_yscale() == "log"
    assert figure.get_suptitle() == "5 m/s"
    assert figure.axes[0].get_xlim()[0] == 0.0


def test_the_best_stays_until_a_step_ends_with_a_better_one() -> None:
    figure = convergence_figure(history([4.0, 2.0, 1.0]))
    for panel, label in ((0, "best so far"), (1, "of the best"), (2, "of the best")):
        assert line(figure, panel, label).get_drawstyle() == "steps-post"


def test_every_axis_says_what_it_shows() -> None:
    labels = [axes.get_ylabel() for axes in convergence_figure(history([4.0, 2.0])).axes]
    assert labels == ["cost", "energy per distance, scaled", "gamma of the best"]


@pytest.mark.parametrize("target", [0.0, 0.25, 2.333])
def test_the_energy_asked_for_is_a_line_in_the_panel_of_the_energy(target: float) -> None:
    figure = convergence_figure(history([4.0, 2.0]), target=target)
    asked = line(figure, 1, "asked for by beta")
    assert set(asked.get_ydata()) == {target}
    assert asked.is_dashed()
    assert f"{target:.3f}" in asked.get_label()
    low, high = figure.axes[1].get_ylim()
    assert low < min(target, 0.3)
    assert max(target, 0.3) < high
    assert not any("asked" in str(one.get_label()) for one in convergence_figure(history([4.0, 2.0])).axes[1].lines)


def test_an_energy_that_hardly_changes_looks_so() -> None:
    low, high = convergence_figure(history([4.0, 2.0]), target=0.3001).axes[1].get_ylim()
    assert high - low >= 0.2


def test_a_model_without_gamma_has_no_panel_for_it() -> None:
    figure = convergence_figure(history([4.0, 2.0], Made(gamma=math.nan)))
    assert [axes.get_ylabel() for axes in figure.axes] == ["cost", "energy per distance, scaled"]
    assert all(text.get_text() != "gamma" for axes in figure.axes for text in axes.get_legend().get_texts())


def test_the_best_is_always_on_the_page() -> None:
    figure = convergence_figure(history([900.0, 3.0, 0.02]))
    low, high = figure.axes[0].get_ylim()
    assert low < 0.02 < 900.0 < high


def test_a_median_beyond_the_axis_is_marked_at_its_edge() -> None:
    rows = history([4.0, 3.0, 2.0])
    rows[1] = rows[1]._replace(median=1e6)
    figure = convergence_figure(rows)
    assert figure.axes[0].get_ylim()[1] < 1e3
    np.testing.assert_allclose(curve(figure, 0, "median beyond")[:, 0], [20.0])
    # A lone median between gaps can be seen: it is a dot.
    assert line(figure, 0, "median of the step").get_marker() == "o"


def test_what_is_not_finite_is_a_gap() -> None:
    figure = convergence_figure(history([math.inf, 2.0, 1.0]))
    assert math.isnan(curve(figure, 0, "best so far")[0, 1])
    assert math.isnan(curve(figure, 2, "of the best")[0, 1])


@pytest.mark.parametrize("best", [[math.inf, math.inf], [1.0], [1.0, 0.0], [1.0, 1.0], [2.0, -1.0]])
@pytest.mark.parametrize("count", [1, 50])
def test_odd_histories_can_be_drawn(best: list[float], count: int) -> None:
    FigureCanvasAgg(convergence_figure(history(best * count))).draw()
