from __future__ import annotations

from typing import Any

import pytest
import yaml

from hopdiff.runs.settings import Differences, _flat_block, as_settings, flat_settings, typed_values
from hopdiff.types import HopdiffError
from tests.runs.run_folders import SETTINGS, with_values


def test_settings_are_read_flat_with_lists_as_texts() -> None:
    text = "speed: 5.0\npath:\n  points:\n  - [0, 0]\n  - [2, 6]\n  time: null\nclips:\n- a.bvh\n- b.bvh\nexports: {}\n"
    assert flat_settings(text, "config.yaml") == {
        "speed": 5.0,
        "path.points": "[[0,0],[2,6]]",
        "path.time": None,
        "clips": '["a.bvh","b.bvh"]',
    }


@pytest.mark.parametrize(
    "text",
    [
        "a: &x [1]\nb: *x\n",  # a block that needs another
        "a: one\n  two\n'b': \"three\n\n  four\"\n# c: 3\nc: |\n  d: 4\n",
        "{a: 1, b: {c: 2}}",
        yaml.safe_dump(SETTINGS),
        yaml.safe_dump(SETTINGS, default_flow_style=True),
    ],
)
def test_blocks_are_read_as_the_whole_is(text: str) -> None:
    def flat(node: dict[str, Any], prefix: str = "") -> dict[str, Any]:
        found = {}
        for key, value in node.items():
            found |= flat(value, f"{prefix}{key}.") if isinstance(value, dict) else {f"{prefix}{key}": value}
        return found

    known = flat(yaml.safe_load(text))
    read = flat_settings(text, "config.yaml")
    assert list(read) == list(known)
    assert all(read[name] == value for name, value in known.items() if not isinstance(value, list))


def test_what_many_files_have_in_common_is_read_once() -> None:
    """Which is what makes a thousand of them a matter of a second."""
    _flat_block.cache_clear()
    for seed in range(50):
        assert flat_settings(yaml.safe_dump(with_values({"seed": seed})), "config.yaml")["seed"] == seed
    assert _flat_block.cache_info().misses == len(SETTINGS) + 1 + 49


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("speed: 5.0\nbeta: [0.2\nseed: 0\n", r"config\.yaml, line \d: not YAML"),
        ("- 1\n- 2\n", r"config\.yaml does not hold the settings"),
        ("", r"config\.yaml does not hold the settings"),
    ],
)
def test_a_damaged_file_is_named(text: str, message: str) -> None:
    with pytest.raises(HopdiffError, match=message):
        flat_settings(text, "config.yaml")


def test_typed_words() -> None:
    words = [
        "search=ga",
        "+experiment=kang1999/eta",
        "search.population=20",
        "pictures=False",
        "++genes.fixed.duty=0.3",
    ]
    words += ["path.points=[[0,0],[2,6]]", "~limp", "budget.target=null", "title='a=b'", "strange=[1"]
    assert typed_values(words) == {
        "search": "ga",
        "experiment": "kang1999/eta",
        "search.population": 20,
        "pictures": False,
        "genes.fixed.duty": 0.3,
        "path.points": "[[0,0],[2,6]]",
        "budget.target": None,
        "title": "a=b",
        "strange": "[1",
    }
    assert as_settings({"search": "ga", "speed": 3}) == {"search.name": "ga", "speed": 3}


def names(*runs: dict[str, Any], typed: tuple[dict[str, Any], ...] = (), whole: tuple[bool, ...] = ()) -> list[str]:
    return Differences(runs, typed or [{}] * len(runs), whole or [True] * len(runs)).names()


def test_what_differs_in_the_order_of_the_file() -> None:
    runs = [{"speed": 5.0, "seed": seed, "budget.target": None, "threads": 1 + seed % 2} for seed in (0, 1)]
    assert names(*runs) == ["seed", "threads"]
    assert names({"limp.leg": "left"}, {"limp.leg": "left", "genes.fixed.duty": 0.3}) == ["genes.fixed.duty"]


def test_settings_that_come_with_a_choice_are_told_by_it() -> None:
    ga, cmaes = {"search.name": "ga", "search.population": 100}, {"search.name": "cmaes", "search.population": 0}
    assert names(ga, cmaes) == ["search.name"]
    assert names(ga, ga | {"search.population": 20}, cmaes) == ["search.name", "search.population"]
    assert names(ga, cmaes, typed=({}, {"search.population": 0})) == ["search.name", "search.population"]
    # Typed for a search that the other run has not got.
    assert names(ga, {"search.name": "ordinary"}, typed=({"search.population": 100}, {})) == ["search.name"]


def test_what_a_run_finds_for_itself_is_no_setting_of_it() -> None:
    slow, fast = (
        {"costs.name": "human", "costs.least.external_work": work, "task.label": str(work)} for work in (1, 2)
    )
    assert names(slow, fast) == []
    assert names(slow, fast, typed=({"costs.least.external_work": 1}, {})) == ["costs.least.external_work"]
    # The choice alone is not all that belongs to it.
    assert names(slow, fast, typed=({"costs": "human"}, {})) == []


def test_of_a_run_without_all_its_settings_the_known_ones_count() -> None:
    assert names({"speed": 5.0, "fps": 60.0}, {"speed": 0.2}, whole=(True, False)) == ["speed"]
    assert names({"speed": 5.0, "fps": 60.0}, {"speed": 0.2}) == ["speed", "fps"]
