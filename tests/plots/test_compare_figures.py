from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from hopdiff.plots.briskness import style_figure
from hopdiff.plots.compare import MOST_SERIES, Chosen, choose, compare_figures, convergence_overlay, summary_figure
from hopdiff.plots.series import COLOURS, spread
from hopdiff.runs.folders import RunRecord
from hopdiff.runs.groups import grouped


def record(search: str = "ga", speed: float = 3.0, beta: float = 0.2, seed: int = 1, **more: Any) -> RunRecord:
    metrics = {"speed": speed, "beta": beta, "search": search, "seed": seed, "cost": 0.1 + 0.01 * seed}
    metrics |= {"energy_rate": 1.02, "energy_target": 1.0, "wall_seconds": 2.0, "contact_time": 0.2 - 0.05 * beta}
    metrics |= {"flight_share": 0.3 + 0.2 * beta, "com_oscillation": 0.06, "arm_swing_deg": 20.0 + 30.0 * beta}
    history = {"spent": [10.0, 20.0, 40.0], "best": [4.0 + seed, 2.0 + seed, 1.0 + seed]}
    return RunRecord(f"{search}_{seed}", metrics | more, history, settings={"search.name": search})


def series(records: Sequence[RunRecord]) -> list[RunRecord]:
    return grouped(records).records


def figures(records: Sequence[RunRecord]) -> dict[str, Figure]:
    return compare_figures(choose(series(records)))


def many(
    count: int, speed: float = 3.0, beta: float = 0.2, seeds: int = 1, name: str = "search.population"
) -> list[RunRecord]:
    """Runs that differ in a setting, the later the worse."""
    return [
        replace(
            record("ga", speed, beta, seed, cost=1.0 + k + 0.1 * seed),
            settings={"search.name": "ga", name: 10 * (count - k)},
        )
        for k in range(count)
        for seed in range(seeds)
    ]


def rows(axes: Axes) -> list[str]:
    return [label.get_text() for label in axes.get_yticklabels()]


def medians(axes: Axes) -> list[float]:
    return [
        float(line.get_xdata()[0])
        for line in axes.lines
        if len(set(line.get_ydata())) == 2 and len(line.get_xdata()) == 2
    ]


def dots(axes: Axes, hollow: bool = False) -> list[float]:
    return [
        float(x)
        for line in axes.lines
        if line.get_marker() == "o" and (line.get_markerfacecolor() == "none") == hollow
        for x in line.get_xdata()
    ]


def test_which_figures_there_are() -> None:
    replay = RunRecord("again", record().metrics)
    assert set(figures([replay])) == {"summary"}
    assert set(figures([record(), replay])) == {"summary", "convergence"}
    assert set(figures([record(), record(beta=0.7)])) == {"summary", "convergence", "style"}
    # Of nothing but interrupted searches there is no curve.
    assert set(figures([replace(record(beta=beta), status="interrupted") for beta in (0.2, 0.7)])) == {"summary"}


@pytest.mark.parametrize("betas", [(0.5,), (0.0, 0.5)])
@pytest.mark.parametrize("speeds", [(3.0,), (3.0, 5.0)])
@pytest.mark.parametrize("searches", [("ga",), ("ga", "cmaes")])
def test_all_figures_can_be_drawn(
    searches: tuple[str, ...], speeds: tuple[float, ...], betas: tuple[float, ...]
) -> None:
    records = [
        record(search, v, beta, seed) for search in searches for v in speeds for beta in betas for seed in (1, 2)
    ]
    for figure in figures(records).values():
        FigureCanvasAgg(figure).draw()


def test_median_and_band_over_seeds() -> None:
    axes = convergence_overlay(series([record(seed=seed) for seed in (1, 2, 5)])).axes[0]
    (line,) = axes.lines
    np.testing.assert_allclose(line.get_xdata(), [10, 20, 40])
    np.testing.assert_allclose(line.get_ydata(), [6, 4, 3])
    # A best value holds until the next.
    assert line.get_drawstyle() == "steps-post"
    band = axes.collections[0].get_paths()[0].vertices
    at_end = band[np.isclose(band[:, 0], 40), 1]
    assert (at_end.min(), at_end.max()) == (2, 7)
    assert set(band[np.isclose(band[:, 1], 2), 0]) == {40}


def test_the_best_is_held_until_a_better_one() -> None:
    late = replace(record(), history={"spent": [15.0, 40.0], "best": [9.0, 1.0]})
    (line,) = convergence_overlay(series([record(seed=1), late])).axes[0].lines
    # Nothing is known of the later run at 10; at 20 its best is still the one of 15.
    np.testing.assert_allclose(line.get_xdata(), [15, 20, 40])
    np.testing.assert_allclose(line.get_ydata(), [(5 + 9) / 2, (3 + 9) / 2, (2 + 1) / 2])


def test_curves_of_many_steps_are_thinned_but_keep_their_ends() -> None:
    spent = np.arange(1.0, 5001.0)
    long = replace(record(), history={"spent": spent, "best": 1.0 / spent})
    (line,) = convergence_overlay(series([long])).axes[0].lines
    assert len(line.get_xdata()) == 500
    assert (line.get_xdata()[0], line.get_xdata()[-1]) == (1, 5000)
    np.testing.assert_allclose(line.get_ydata(), 1.0 / line.get_xdata())


def test_series_keep_their_colours_and_problems_their_panels() -> None:
    records = series([record("ga"), record("cmaes"), record("cmaes", speed=5.0)])
    first, second = convergence_overlay(records).axes
    assert [axes.get_title() for axes in (first, second)] == ["3 m/s, beta 0.2", "5 m/s, beta 0.2"]
    colours = {line.get_label(): line.get_color() for line in first.lines}
    assert colours["ga"] != colours["cmaes"]
    assert [line.get_color() for line in second.lines] == [colours["cmaes"]]
    others = {line.get_color() for line in summary_figure(records).axes[0].lines}
    assert others == set(colours.values())


def test_a_wild_start_does_not_flatten_the_rest() -> None:
    wild = RunRecord("wild", record().metrics, {"spent": [1.0, 2.0, 3.0], "best": [1e6, 0.3, 0.2]})
    axes = convergence_overlay([wild]).axes[0]
    assert axes.get_yscale() == "log"
    assert axes.get_ylim()[0] < 0.2 < 0.3 < axes.get_ylim()[1] < 10


def test_the_summary_is_sorted_by_result_below_each_problem() -> None:
    records = [record("ga", cost=3.0), record("cmaes", cost=2.0), record("random", cost=9.0)]
    records += [record("ga", beta=0.7, cost=70.0), record("cmaes", beta=0.7, cost=80.0)]
    axes = summary_figure(series(records)).axes[0]
    assert rows(axes) == ["3 m/s, beta 0.2", "cmaes", "ga", "random", "3 m/s, beta 0.7", "ga", "cmaes"]
    assert [label.get_fontweight() for label in axes.get_yticklabels()[:2]] == ["bold", "normal"]
    assert dots(axes) == [2.0, 3.0, 9.0, 70.0, 80.0]
    # The first row is at the top.
    assert axes.get_ylim()[0] > axes.get_ylim()[1]


def test_the_only_problem_is_in_the_title() -> None:
    figure = summary_figure(series([record("ga"), record("cmaes", cost=2.0)]))
    assert rows(figure.axes[0]) == ["ga", "cmaes"]
    assert "3 m/s, beta 0.2" in figure.get_suptitle()


def test_a_median_needs_several_runs_of_one_problem() -> None:
    records = [record(cost=1.0), record(seed=2, cost=3.0), record(beta=0.7, cost=100.0)]
    assert medians(summary_figure(series(records)).axes[0]) == [2.0]


def test_interrupted_searches_are_hollow_and_in_no_median_or_curve() -> None:
    records = [record(cost=1.0), record(seed=2, cost=3.0), replace(record(seed=3, cost=50.0), status="interrupted")]
    records.append(replace(record("cmaes", cost=0.5), status="interrupted"))
    figure = summary_figure(series(records))
    axes = figure.axes[0]
    assert (dots(axes), dots(axes, hollow=True), medians(axes)) == ([1.0, 3.0], [50.0, 0.5], [2.0])
    assert rows(axes) == ["ga", "cmaes"]  # in spite of its cost, since it is not done
    assert "hollow: interrupted" in figure.get_suptitle()
    (line,) = convergence_overlay(series(records)).axes[0].lines
    np.testing.assert_allclose(line.get_ydata(), [5.5, 3.5, 2.5])


def test_energy_error_in_percent_and_none_without_a_target() -> None:
    panels = summary_figure(series([record(), record(beta=0.0, energy_target=0.0)])).axes
    (axes,) = (axes for axes in panels if axes.get_xlabel() == "energy error [%]")
    assert dots(axes) == pytest.approx([2.0])
    without = summary_figure([record(beta=0.0, energy_target=0.0)]).axes
    assert "energy error [%]" not in [axes.get_xlabel() for axes in without]


def test_costs_that_differ_tenfold_are_logarithmic() -> None:
    near, far = (summary_figure([record(cost=1.0), record(cost=cost)]).axes[0] for cost in (9.0, 11.0))
    assert (near.get_xscale(), far.get_xscale()) == ("linear", "log")


def lines(axes: Axes) -> dict[str, list[float]]:
    return {str(line.get_label()): [float(y) for y in line.get_ydata()] for line in axes.lines}


def test_briskness_of_one_series_has_a_line_for_each_speed() -> None:
    records = [record(beta=0.1, contact_time=value) for value in (0.2, 0.3, 0.7)] + [record(beta=0.6)]
    records.append(record(speed=5.0, contact_time=0.1))
    axes = style_figure(series(records)).axes[0]
    assert lines(axes) == {"3 m/s": [0.3, pytest.approx(0.17)], "5 m/s": [0.1]}
    band = axes.collections[0].get_paths()[0].vertices
    assert (band[:, 1].max(), band[:, 1].min()) == (0.7, pytest.approx(0.17))


def test_briskness_of_series_is_never_pooled() -> None:
    records = [
        record(search, beta=beta, contact_time=value)
        for beta in (0.1, 0.6)
        for search, value in (("ga", 0.2), ("cmaes", 0.4))
    ]
    figure = style_figure(series(records))
    assert len(figure.axes) == 4
    assert lines(figure.axes[0]) == {"cmaes": [0.4, 0.4], "ga": [0.2, 0.2]}
    assert "at 3 m/s" in figure.get_suptitle()
    both = style_figure(
        series([*records, record("ga", speed=5.0, contact_time=0.1), record("ga", 5.0, 0.6, contact_time=0.1)])
    )
    slow, fast = both.axes[:2]
    assert (slow.get_title(), fast.get_title()) == ("3 m/s", "5 m/s")
    assert lines(slow) == {"cmaes": [0.4, 0.4], "ga": [0.2, 0.2]}
    assert lines(fast) == {"ga": [0.1, 0.1]}


def test_of_many_speeds_some_are_shown_and_the_title_says_so() -> None:
    records = [
        record(search, float(speed), beta)
        for search in ("ga", "cmaes")
        for speed in range(1, 11)
        for beta in (0.1, 0.6)
    ]
    figure = style_figure(series(records))
    assert [axes.get_title() for axes in figure.axes[:6]] == [f"{speed} m/s" for speed in (1, 3, 5, 6, 8, 10)]
    assert "6 of 10 speeds" in figure.get_suptitle()


def test_of_many_series_the_best_are_drawn_and_a_sentence_says_so() -> None:
    records = series(many(20, seeds=2))
    chosen = choose(records)
    assert len({record.series for record in chosen.records}) == MOST_SERIES == len(set(COLOURS))
    assert max(record.metrics["cost"] for record in chosen.records) < 1.0 + MOST_SERIES
    assert chosen.sentences == [
        "Pictures show the 12 best of 20 series, by their place in median cost at each speed and beta."
    ]
    assert len(convergence_overlay(chosen.records).axes[0].lines) == MOST_SERIES
    # So many bands on one another would hide the lines.
    assert not convergence_overlay(chosen.records).axes[0].collections
    assert choose(series(many(12))).sentences == []


def test_of_many_problems_some_have_panels_and_all_count_for_briskness() -> None:
    records = series(
        [record(search, float(v), beta / 20) for search in ("ga", "cmaes") for v in (2, 4, 6) for beta in range(10)]
    )
    chosen = choose(records)
    assert len(chosen.problems) == 12
    assert (chosen.problems[0], chosen.problems[-1]) == ((2.0, 0.0), (6.0, 0.45))
    assert chosen.sentences == ["Pictures of single speeds and betas show 12 of 30, spread over all of them."]
    drawn = compare_figures(chosen)
    assert len([axes for axes in drawn["convergence"].axes if axes.get_title()]) == 12
    assert len(rows(drawn["summary"].axes[0])) == 12 * 3
    assert len(drawn["style"].axes[0].lines[0].get_xdata()) == 10
    # Many series leave room for few problems.
    crowd = [run for beta in range(10) for run in many(12, beta=beta / 10)]
    assert len(choose(series(crowd)).problems) == 6


def test_values_are_spread_over_their_range() -> None:
    assert spread([1, 2, 3, 4, 5], 3) == [1, 3, 5]
    assert spread([1, 2], 3) == [1, 2]


@pytest.mark.parametrize("count", [3, 12])
def test_legends_keep_to_the_figure_and_off_the_panels(count: int) -> None:
    name = "character.proportions.legs"
    records = series([run for beta in (0.2, 0.7) for run in many(count, beta=beta, seeds=2, name=name)])
    for figure in (convergence_overlay(records), style_figure(records)):
        canvas = FigureCanvasAgg(figure)
        canvas.draw()
        renderer = canvas.get_renderer()
        (legend,) = figure.legends
        box = legend.get_window_extent(renderer)
        assert box.x0 >= 0
        assert box.x1 <= figure.bbox.x1
        assert box.y0 >= 0
        panels = [axes.get_tightbbox(renderer) for axes in figure.axes if axes.get_visible() and axes.axison]
        assert all(panel.y0 >= box.y1 for panel in panels)
        labels = [text.get_text() for text in legend.get_texts()]
        assert labels == [f"ga, character.proportions.legs {10 * k}" for k in range(1, count + 1)]


def test_problems_that_are_not_chosen_have_no_rows() -> None:
    records = series([record(beta=beta) for beta in (0.2, 0.5)])
    drawn = compare_figures(Chosen(records, [(3.0, 0.2)], []))
    assert rows(drawn["summary"].axes[0]) == ["ga"]


def test_a_search_of_one_step_is_a_dot_and_axes_are_named() -> None:
    one = replace(record("ordinary"), history={"spent": [1.0], "best": [1.5]})
    figure = convergence_overlay(series([record("ga"), one]))
    marks = {line.get_label(): (line.get_marker(), len(line.get_xdata())) for line in figure.axes[0].lines}
    assert marks["ordinary"] == ("o", 1)
    assert marks["ga"][0] == ""
    assert figure.axes[0].get_ylabel() == "best cost so far"
