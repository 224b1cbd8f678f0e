from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg

from hopdiff.plots.compare import RunRecord, compare_figures, convergence_overlay, read_run, summary_figure
from hopdiff.types import HopdiffError


def record(search: str = "ga", speed: float = 3.0, beta: float = 0.2, seed: int = 1, **more: Any) -> RunRecord:
    metrics = {"speed": speed, "beta": beta, "search": search, "seed": seed, "cost": 0.1 + 0.01 * seed}
    metrics |= {"energy_rate": 1.02, "energy_target": 1.0, "wall_seconds": 2.0, "contact_time": 0.2 - 0.05 * beta}
    metrics |= {"flight_share": 0.3 + 0.2 * beta, "com_oscillation": 0.06, "arm_swing_deg": 20.0 + 30.0 * beta}
    history = {"spent": [10.0, 20.0, 40.0], "best": [4.0 + seed, 2.0 + seed, 1.0 + seed]}
    return RunRecord(f"{search}_{seed}", metrics | more, history)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    metrics = {"speed": 3.0, "beta": 0.2, "search": "ga", "cost": 0.2, "energy_rate": 1.0, "energy_target": 1.0}
    (tmp_path / "metrics.json").write_text(json.dumps(metrics))
    (tmp_path / "history.csv").write_text("step,spent,best\n0,10.0,inf\n1,20.0,0.5\n")
    return tmp_path


def test_a_run_is_read(folder: Path) -> None:
    read = read_run(folder)
    assert read.label == folder.name
    assert read.metrics["cost"] == 0.2
    assert read.history == {"step": [0.0, 1.0], "spent": [10.0, 20.0], "best": [float("inf"), 0.5]}


def test_a_replay_has_no_history(folder: Path) -> None:
    (folder / "history.csv").unlink()
    assert read_run(folder).history == {}


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("metrics.json", "[1]", r"metrics\.json does not hold"),
        ("metrics.json", "{", r"metrics\.json, line 1"),
        ("metrics.json", '{"speed": 3.0}', r"metrics\.json lacks 'beta'"),
        (
            "metrics.json",
            '{"speed": "fast", "beta": 0, "search": "ga", "cost": 1, "energy_rate": 1, "energy_target": 1}',
            r"metrics\.json: 'speed' must be a number, not 'fast'",
        ),
        ("history.csv", "", r"history\.csv is not the history"),
        ("history.csv", "step,spent,best\n", r"history\.csv is not the history"),
        ("history.csv", "step,best\n0,1\n", r"history\.csv is not the history"),
        ("history.csv", "step,spent,best\n0,1,2\n1,2\n", r"history\.csv, line 3"),
        ("history.csv", "step,spent,best\n0,1,two\n", r"history\.csv, line 2"),
    ],
)
def test_a_damaged_file_is_named(folder: Path, name: str, text: str, message: str) -> None:
    (folder / name).write_text(text)
    with pytest.raises(HopdiffError, match=message):
        read_run(folder)


def test_a_missing_folder(tmp_path: Path) -> None:
    with pytest.raises(HopdiffError, match=r"metrics\.json"):
        read_run(tmp_path / "gone")


def test_which_figures_there_are() -> None:
    replay = RunRecord("again", record().metrics, {})
    assert set(compare_figures([replay])) == {"summary"}
    assert set(compare_figures([record(), replay])) == {"summary", "convergence"}
    assert set(compare_figures([record(), record(beta=0.7)])) == {"summary", "convergence", "style"}


def test_all_figures_can_be_drawn() -> None:
    records = [
        record(search, speed, beta, seed)
        for search in ("ga", "cmaes")
        for speed in (3.0, 5.0)
        for beta in (0.0, 0.5)
        for seed in (1, 2)
    ]
    for figure in compare_figures(records).values():
        FigureCanvasAgg(figure).draw()


def test_median_and_band_over_seeds() -> None:
    axes = convergence_overlay([record(seed=seed) for seed in (1, 2, 5)]).axes[0]
    (line,) = axes.lines
    np.testing.assert_allclose(line.get_xdata(), [10, 20, 40])
    np.testing.assert_allclose(line.get_ydata(), [6, 4, 3])
    band = axes.collections[0].get_paths()[0].vertices
    at_end = band[np.isclose(band[:, 0], 40), 1]
    assert (at_end.min(), at_end.max()) == (2, 6)


def test_the_best_is_held_until_a_better_one() -> None:
    late = RunRecord("late", record().metrics, {"spent": [15.0, 40.0], "best": [9.0, 1.0]})
    axes = convergence_overlay([record(seed=1), late]).axes[0]
    (line,) = axes.lines
    # Nothing is known of the later run at 10; at 20 its best is still the one of 15.
    np.testing.assert_allclose(line.get_xdata(), [15, 20, 40])
    np.testing.assert_allclose(line.get_ydata(), [(5 + 9) / 2, (3 + 9) / 2, (2 + 1) / 2])


def test_searches_keep_their_colours_and_problems_their_panels() -> None:
    records = [record("ga"), record("cmaes"), record("cmaes", speed=5.0)]
    first, second = convergence_overlay(records).axes
    assert [axes.get_title() for axes in (first, second)] == ["3 m/s, beta 0.2", "5 m/s, beta 0.2"]
    colours = {line.get_label(): line.get_color() for line in first.lines}
    assert colours["ga"] != colours["cmaes"]
    assert [line.get_color() for line in second.lines] == [colours["cmaes"]]


def test_a_wild_start_does_not_flatten_the_rest() -> None:
    wild = RunRecord("wild", record().metrics, {"spent": [1.0, 2.0, 3.0], "best": [1e6, 0.3, 0.2]})
    axes = convergence_overlay([wild]).axes[0]
    assert axes.get_yscale() == "log"
    assert axes.get_ylim()[0] < 0.2 < 0.3 < axes.get_ylim()[1] < 10


def test_runs_on_different_genes_are_told_apart() -> None:
    records = [record(genes="default"), record(genes="default+common_eta", eval=0.3), record()]
    names = ["ga, default", "ga, default+common_eta"]
    assert {line.get_label() for line in convergence_overlay(records).axes[0].lines} == set(names)
    axes = summary_figure(records).axes
    assert [label.get_text() for label in axes[0].get_yticklabels()] == [f"3 m/s, beta 0.2: {name}" for name in names]
    (panel,) = (panel for panel in axes if "eval" in panel.get_xlabel())
    assert [float(x) for line in panel.lines if line.get_marker() == "o" for x in line.get_xdata()] == [0.3]


def test_costs_of_different_problems_are_not_pooled() -> None:
    records = [record(cost=1.0), record(seed=2, cost=3.0), record(beta=0.7, cost=100.0)]
    axes = summary_figure(records).axes[0]
    assert [label.get_text() for label in axes.get_yticklabels()] == ["3 m/s, beta 0.2: ga", "3 m/s, beta 0.7: ga"]
    medians = [line.get_xdata()[0] for line in axes.lines if len(set(line.get_ydata())) == 2]
    assert medians == [2.0, 100.0]


def test_energy_error_in_percent_and_none_without_a_target() -> None:
    panels = summary_figure([record(), record(beta=0.0, energy_target=0.0)]).axes
    (axes,) = (axes for axes in panels if axes.get_xlabel() == "energy error [%]")
    dots = [float(x) for line in axes.lines if line.get_marker() == "o" for x in line.get_xdata()]
    assert dots == pytest.approx([2.0])


def test_briskness_is_averaged_over_the_runs_of_a_speed() -> None:
    records = [record(beta=0.1, contact_time=0.2), record(beta=0.1, seed=2, contact_time=0.3), record(beta=0.6)]
    axes = compare_figures(records)["style"].axes[0]
    (line,) = axes.lines
    np.testing.assert_allclose(line.get_xdata(), [0.1, 0.6])
    np.testing.assert_allclose(line.get_ydata(), [0.25, 0.17])
