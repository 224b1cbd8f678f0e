from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg

from hopdiff.plots.scaled import can_scale, scaled_convergence_figure
from hopdiff.runs.folders import RunRecord
from hopdiff.runs.groups import grouped

BEST = [8.0, 4.0, 3.0, 2.0]


def record(search: str, seed: int, best: list[float] = BEST, **more: Any) -> RunRecord:
    metrics = {"speed": 5.0, "beta": 0.5, "search": search, "seed": seed, **more}
    spent = [100.0 * (i + 1) for i in range(len(best))]
    return RunRecord(f"{search}_{seed}", metrics, {"spent": spent, "best": best})


def series(records: Sequence[RunRecord]) -> list[RunRecord]:
    return grouped(records).records


def curves(axes: Axes) -> list[tuple[np.ndarray, np.ndarray]]:
    return [(np.asarray(line.get_xdata()), np.asarray(line.get_ydata())) for line in axes.lines]


def test_the_genetic_algorithm_by_generations_as_in_the_thesis() -> None:
    runs = [record("ga", 0), record("ga", 1, [20.0, 14.0, 12.0, 10.0]), record("ga", 2, [1.0, 0.5, 0.25, 0.0])]
    left, _ = scaled_convergence_figure(series(runs)).axes
    ((generation, median),) = curves(left)
    np.testing.assert_allclose(generation, [0, 1, 2, 3])
    # Every run by its own scale: 1, 1/3, 1/6, 0; then 1, 0.4, 0.2, 0; then 1, 1/2, 1/4, 0.
    np.testing.assert_allclose(median, [1, 0.4, 0.2, 0], atol=1e-12)
    band = left.collections[0].get_paths()[0].vertices
    at_one = band[np.isclose(band[:, 0], 1), 1]
    assert at_one.min() == pytest.approx(np.quantile([1 / 3, 0.4, 0.5], 0.1))
    assert at_one.max() == pytest.approx(np.quantile([1 / 3, 0.4, 0.5], 0.9))


def test_all_searches_by_one_scale() -> None:
    runs = [record("ga", 0), record("ga", 1), *(record("cmaes", seed, [5.0, 1.0, 1.0, 0.0]) for seed in (0, 1))]
    _, right = scaled_convergence_figure(series(runs)).axes
    (_, cmaes), (spent, ga) = curves(right)
    # 0 is the best of all, 0; 1 is where the genetic algorithm starts, 8.
    assert (cmaes[0], cmaes[-1]) == (5 / 8, 0)
    assert (ga[0], ga[-1]) == (1, 2 / 8)
    assert (spent[0] - 100.0) < 1.0
    assert spent[-1] == 400.0


@pytest.mark.parametrize("others", [("random", "cmaes"), ("cmaes",)])
def test_without_the_genetic_algorithm_there_is_one_panel(others: tuple[str, ...]) -> None:
    best = {"random": [16.0, 9.0], "cmaes": [4.0, 0.0]}
    runs = [record(search, seed, best[search]) for search in others for seed in (0, 1)]
    (axes,) = scaled_convergence_figure(series(runs)).axes
    # Scaled by the start of random search, or else by that of all.
    assert curves(axes)[0][1][0] == 4.0 / best[others[0]][0]


def test_a_run_that_starts_with_nothing_possible_holds_its_first_value() -> None:
    late = [float("inf"), 6.0, 2.0]
    left, right = scaled_convergence_figure(series([record("ga", 0, late), record("ga", 1, late)])).axes
    np.testing.assert_allclose(curves(left)[0][1], [1, 1, 0])
    assert curves(right)[0][0][0] >= 200.0


def test_a_search_that_gets_nowhere_can_be_drawn() -> None:
    figure = scaled_convergence_figure(series([record("ga", seed, [3.0, 3.0]) for seed in (0, 1)]))
    FigureCanvasAgg(figure).draw()
    np.testing.assert_allclose(curves(figure.axes[0])[0][1], [0, 0])


def test_several_seeds_are_needed() -> None:
    assert not can_scale(series([record("ga", 0), record("cmaes", 1)]))
    assert not can_scale(series([record("ga", 0), record("ga", 1, speed=3.0)]))
    assert not can_scale(series([RunRecord("replay", record("none", seed).metrics, {}) for seed in (0, 1)]))
    assert not can_scale(series([record("ga", 0), replace(record("ga", 1), settings={"genes.common_eta": True})]))
    assert can_scale(series([record("ga", 0), record("ga", 1)]))


def test_speeds_and_betas_have_rows_of_their_own() -> None:
    runs = [record("ga", seed, speed=speed) for speed in (5.0, 3.0) for seed in (0, 1)]
    titles = [axes.get_title() for axes in scaled_convergence_figure(series(runs)).axes]
    assert [title.split(":")[0] for title in titles] == ["3 m/s, beta 0.5"] * 2 + ["5 m/s, beta 0.5"] * 2


def test_of_many_problems_six_have_rows_and_the_title_says_so() -> None:
    runs = [record("ga", seed, speed=float(speed)) for speed in range(1, 12) for seed in (0, 1)]
    figure = scaled_convergence_figure(series(runs))
    assert [axes.get_title().split(",")[0] for axes in figure.axes[::2]] == [f"{v} m/s" for v in (1, 3, 5, 7, 9, 11)]
    assert "6 of 11 speeds and betas" in figure.get_suptitle()


def test_interrupted_searches_do_not_count() -> None:
    assert not can_scale(series([record("ga", 0), replace(record("ga", 1), status="interrupted")]))


def test_many_bands_would_hide_the_lines() -> None:
    for count, bands in ((6, 6), (7, 0)):
        runs = [
            replace(record("ga", seed), settings={"search.name": "ga", "search.population": size})
            for size in range(count)
            for seed in (0, 1)
        ]
        for axes in scaled_convergence_figure(series(runs)).axes:
            assert (len(axes.lines), len(axes.collections)) == (count, bands)


def test_generations_of_both_genetic_algorithms_are_drawn() -> None:
    runs = [record(name, seed) for name in ("ga", "ga_thesis", "random") for seed in (0, 1)]
    left, right = scaled_convergence_figure(series(runs)).axes
    assert (len(left.lines), len(right.lines)) == (2, 3)
