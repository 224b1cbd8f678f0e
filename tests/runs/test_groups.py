from __future__ import annotations

from typing import Any

import pytest

from hopdiff.runs.folders import RunRecord
from hopdiff.runs.groups import Groups, grouped, names_of, shown, standings
from hopdiff.runs.settings import typed_values
from tests.runs.run_folders import metrics_of, with_values


def record(
    values: dict[str, Any] | None = None, *words: str, task: str = "run", cost: float = 1.0, status: str = "complete"
) -> RunRecord:
    """A run with some settings. words: those that were typed, if it matters."""
    settings = with_values({"task.name": task, **(values or {})})
    metrics = metrics_of(settings, cost) | ({"search": "none"} if task == "replay" else {})
    return RunRecord(
        "run", metrics, task=task, settings=dict(_flat(settings)), typed=typed_values(words), status=status
    )


def _flat(node: dict[str, Any], prefix: str = "") -> list[tuple[str, Any]]:
    return [
        pair
        for key, value in node.items()
        for pair in (_flat(value, f"{prefix}{key}.") if isinstance(value, dict) else [(f"{prefix}{key}", value)])
    ]


def names(groups: Groups) -> list[str]:
    return [record.series.name for record in groups.records]


def test_runs_that_differ_in_seed_speed_and_beta_are_one_series() -> None:
    runs = [
        record({"seed": seed, "speed": speed, "beta": beta}, f"seed={seed}", f"speed={speed}", f"beta={beta}")
        for seed in (0, 1)
        for speed in (3, 5)
        for beta in (0, 1)
    ]
    groups = grouped(runs)
    assert (set(names(groups)), groups.told) == ({"ga"}, ())


def test_any_setting_makes_series_named_by_its_values() -> None:
    runs = [record({"search.population": size, "seed": seed}) for size in (100, 20, 40) for seed in (0, 1)]
    groups = grouped(runs)
    assert groups.told == ("search.population",)
    # In the order of numbers, not of letters.
    assert names_of(groups.records) == [
        "ga, search.population 20",
        "ga, search.population 40",
        "ga, search.population 100",
    ]
    assert names(groups)[:2] == ["ga, search.population 100"] * 2


@pytest.mark.parametrize(
    "values",
    [
        {"budget.evaluations": 800},
        {"character.proportions.legs": 1.2},
        {"costs.energy": 2.0},
        {"genes.common_eta": True},
        {"genes.fixed.duty": 0.3},
        {"model.step": 0.01},
        {"limp.amount": 0.3},
        {"threads": 4},
        {"dtype": "float32"},
    ],
    ids=str,
)
def test_what_can_change_a_result_makes_groups(values: dict[str, Any]) -> None:
    groups = grouped([record(), record(values)])
    assert groups.told == tuple(values)
    assert len(names_of(groups.records)) == 2


@pytest.mark.parametrize(
    "values",
    [
        {"pictures": False},
        {"animation": "mp4"},
        {"fps": 30.0},
        {"task.label": "other"},
        {"exports.glb.cycles": 4},
        {"retarget.skeleton": "hero.bvh"},
        {"overwrite": True},
        {"hopper.legs": 2},
        {"path.time": 4.0},
        {"genes_file": "genes.json"},
        {"experiment": "brisk"},
    ],
    ids=str,
)
def test_what_cannot_change_a_run_makes_none(values: dict[str, Any]) -> None:
    assert names(grouped([record(), record(values)])) == ["ga", "ga"]


def test_what_follows_from_another_setting_is_not_told() -> None:
    body = {"model.name": "body", "costs.name": "human", "genes.name": "body", "budget.evaluations": 1000}
    groups = grouped([record(), record(body)])
    assert names(groups) == ["ga, smooth", "ga, body"]
    # But what was typed is, even if no other run is told from this by it alone.
    groups = grouped([record(), record(body, "model=body", "costs=human", "budget.evaluations=1000")])
    assert names(groups) == ["ga, smooth, default, budget.evaluations 400", "ga, body, human, budget.evaluations 1000"]


def test_what_follows_from_the_speed_is_not_told() -> None:
    slow, fast = record({"speed": 3.0, "budget.evaluations": 100}), record({"speed": 5.0})
    assert names(grouped([slow, fast])) == ["ga", "ga"]
    assert len(set(names(grouped([slow, fast, record({"speed": 3.0})])))) == 2


def test_a_setting_of_one_search_is_told_of_that_search() -> None:
    runs = [record({"search.population": size}) for size in (20, 40)]
    runs += [
        record({"search": {"name": "gradient", "starts": None}}),
        record({"search": {"name": "random", "population": 7}}),
    ]
    groups = grouped(runs)
    assert names(groups) == ["ga, search.population 20", "ga, search.population 40", "gradient", "random"]
    assert groups.values["gradient"] == {"search.name": "gradient"}
    assert groups.values["random"]["search.population"] == 7


def test_a_gene_that_is_held_is_told_of_the_run_that_holds_it() -> None:
    assert names(grouped([record(), record({"genes.fixed.duty": 0.3})])) == ["ga", "ga, genes.fixed.duty 0.3"]


def test_replays_are_told_by_their_file_and_not_by_a_search_that_was_not() -> None:
    replays = [
        record({"genes_file": f"{k}.json", "budget.evaluations": k}, "task=replay", task="replay") for k in (1, 2)
    ]
    groups = grouped([record({}, "budget.evaluations=400"), *replays])
    assert names(groups) == ["ga", "replay, genes_file 1.json", "replay, genes_file 2.json"]


def test_paths_are_told_from_straight_runs() -> None:
    points = [record({"path.points": text}, task="path") for text in ("[[0,0],[2,6]]", "[[0,0],[4,6]]")]
    groups = grouped([record(), *points])
    assert names(groups)[0] == "ga, run"
    assert names(groups)[1:] == [f"ga, path, path.points {text}" for text in ("[[0,0],[2,6]]", "[[0,0],[4,6]]")]


def test_long_values_are_cut_and_names_stay_different() -> None:
    files = [f"/{'long/' * 10}{name}/genes.json" for name in "ab"]
    assert shown(files[0]).endswith("/a/genes.json")
    assert len(shown(files[0])) == 32
    lists = [f"[{'[0,0],' * 10}[{k},0]]" for k in range(3)]
    groups = grouped([record({"path.points": text}, task="path") for text in lists])
    assert len(set(names(groups))) == 3
    assert len({record.series.place for record in groups.records}) == 3


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (None, "null"),
        (True, "true"),
        (20, "20"),
        (0.2, "0.2"),
        (400.0, "400"),
        (1 / 3, "0.3333333333333333"),
        ("x", "x"),
    ],
)
def test_values_as_typed(value: Any, text: str) -> None:
    assert shown(value) == text


def test_standings_are_places_in_median_cost() -> None:
    def runs(size: int, beta: float, *costs: float, **more: Any) -> list[RunRecord]:
        return [record({"search.population": size, "beta": beta}, cost=cost, **more) for cost in costs]

    found = (
        runs(20, 0.2, 1.0, 9.0, 2.0)
        + runs(40, 0.2, 3.0)
        + runs(60, 0.2, 1.0)
        + runs(20, 0.7, 50.0)
        + runs(40, 0.7, 40.0)
    )
    found += runs(80, 0.2, 0.1, status="interrupted")
    places = standings(grouped(found).records)
    assert {name[-2:]: (s.problems, s.first, s.place) for name, s in places.items()} == {
        "20": (2, 0, 0.75),
        "40": (2, 1, 0.5),
        "60": (1, 1, 0.0),
        "80": (0, 0, float("inf")),
    }
