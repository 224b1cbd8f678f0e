"""What other packages bring, by entry points: found by name, told by package where it is broken."""

from __future__ import annotations

import importlib
import json
import sys
from collections.abc import Iterator
from copy import deepcopy
from pathlib import Path

import pytest
from hydra.core.config_store import ConfigStore
from hydra.core.plugins import Plugins

from hopdiff.cli import main
from hopdiff.composing import compose, register_choices
from hopdiff.doors import FORMATS, SEARCHES, TASKS
from hopdiff.types import HopdiffError

PACKAGE = """
from dataclasses import dataclass

import torch

from hopdiff.export.format import Format
from hopdiff.objective import Term
from hopdiff.tasks.base import Task


@dataclass(frozen=True)
class Middle:
    name: str = "middle"
    rows: int = 3

    def init(self, problem, generator):
        return problem

    def ask(self, state, generator):
        spread = torch.rand(self.rows, state.dimension, generator=generator, dtype=state.dtype)
        return state.start.expand(self.rows, -1) + 0.01 * spread, False

    def tell(self, state, genes, result, generator):
        return state


HIGH = Term("high", 7.0, lambda judged: 1.0 + 0.0 * judged.energy, "own", view="hopper")
GIANT = {"defaults": ["human", "_self_"], "height": 3.0}


def _write(path, takes, settings):
    path.write_text(f"{takes[0].name} {len(takes[0].clip.root_position)}")


LINE = Format(".line", _write)


@dataclass
class Settings:
    greeting: str


def build(call):
    return lambda folder: (folder.path / "hello.txt").write_text(call.own.greeting)


HELLO = Task(build, Settings, defaults={"greeting": "good day"})
"""
POINTS = """
[hopdiff.searches]
middle = others_things:Middle
missing = others_things:Nothing
ga = others_things:Middle
[hopdiff.cost_terms]
high = others_things:HIGH
[hopdiff.characters]
giant = others_things:GIANT
[hopdiff.exports]
line = others_things:LINE
[hopdiff.tasks]
hello = others_things:HELLO
"""
QUICK = ("model=smooth", "pictures=false", "budget.evaluations=12")


@pytest.fixture
def others(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """An installed package that brings one thing of every kind."""
    site = tmp_path / "site"
    (site / "others-1.0.dist-info").mkdir(parents=True)
    (site / "others_things.py").write_text(PACKAGE)
    (site / "others-1.0.dist-info" / "METADATA").write_text("Metadata-Version: 2.1\nName: others\nVersion: 1.0\n")
    (site / "others-1.0.dist-info" / "entry_points.txt").write_text(POINTS)
    monkeypatch.syspath_prepend(str(site))
    importlib.invalidate_caches()
    Plugins.instance()  # which puts Hydra's own into the store, once
    register_choices.cache_clear()
    before = deepcopy(ConfigStore.instance().repo)
    yield tmp_path
    ConfigStore.instance().repo = before
    register_choices.cache_clear()
    sys.modules.pop("others_things", None)


def run(monkeypatch: pytest.MonkeyPatch, folder: Path, *words: str) -> int:
    monkeypatch.setattr("sys.argv", ["hopdiff", *words, f"hydra.run.dir={folder}"])
    return main()


def test_all_kinds_are_found_by_name(others: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = others / "run"
    words = (*QUICK, "search=middle", "search.rows=4", "character=giant", "costs.high=2", "export=[line]", "speed=6")
    assert run(monkeypatch, folder, *words) == 0
    metrics = json.loads((folder / "metrics.json").read_text())
    assert (metrics["search"], metrics["evaluations"], metrics["character"]) == ("middle", 12, "giant")
    assert metrics["cost_high"] == 2.0
    assert "cost_high" in (folder / "history.csv").read_text().splitlines()[0]
    assert (folder / "motion_line.line").read_text().startswith("run_v6")


def test_a_task_has_settings_of_its_own(
    others: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(monkeypatch, others / "a", "task=hello") == 0
    assert (others / "a" / "hello.txt").read_text() == "good day"
    assert run(monkeypatch, others / "b", "task=hello", "greeting=hi") == 0
    assert (others / "b" / "hello.txt").read_text() == "hi"
    assert json.loads((others / "b" / "status.json").read_text())["task"] == "hello"
    assert run(monkeypatch, others / "c", "task=run", "greeting=hi") == 1
    assert "Unknown setting 'greeting'" in capsys.readouterr().err


def test_our_own_names_stay_ours(others: Path) -> None:
    assert SEARCHES.load("ga").__module__ == "hopdiff.search.ga"
    assert "hello" in TASKS.names()
    assert "line" in FORMATS.names()


def test_a_broken_package_is_named(
    others: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(monkeypatch, others / "run", *QUICK, "search=missing") == 1
    said = capsys.readouterr().err
    assert said.startswith("hopdiff: the search 'missing' of the package others cannot be loaded: AttributeError")
    assert said.count("\n") == 1
    assert not (others / "run").exists()


@pytest.mark.parametrize(
    ("points", "said"),
    [
        ("[hopdiff.tasks]\nhello = others_things:NOTHING", "the task 'hello' of the package others cannot be loaded"),
        ("[hopdiff.characters]\ngiant = others_things:NOTHING", "the character 'giant' of the package others cannot"),
        ("[hopdiff.characters]\ngiant = others_things:HIGH", "the character 'giant' of another package is no table"),
    ],
)
def test_a_broken_package_stops_nobody_else(
    points: str, said: str, others: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (others / "site" / "others-1.0.dist-info" / "entry_points.txt").write_text(points)
    assert run(monkeypatch, others / "run", *QUICK, "search=ordinary", "beta=0.2") == 0
    told = capsys.readouterr().err
    assert told.startswith(f"hopdiff: left out: {said}")
    assert told.count("\n") == 1
    assert run(monkeypatch, others / "no", "character=giant" if "giant" in points else "task=hello") == 1
    assert "Unknown" in capsys.readouterr().err.splitlines()[-1]


def test_an_unknown_setting_of_theirs_is_refused(
    others: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(monkeypatch, others / "run", *QUICK, "search=middle", "search.rowz=4") == 1
    assert "Unknown setting of search middle 'rowz'" in capsys.readouterr().err
    assert run(monkeypatch, others / "run", *QUICK, "costs.high=-1") == 1
    assert "costs.high must be a number of 0 or more" in capsys.readouterr().err
    assert run(monkeypatch, others / "run", "costs.high=1", "budget.evaluations=12") == 1
    assert "'high' judges runs of model=smooth or thesis" in capsys.readouterr().err


def test_no_name_is_code(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    for word in ("search.name=os.system", "task.name=os", "+search._target_=os.system"):
        assert run(monkeypatch, tmp_path / "run", *QUICK, word) == 1
        assert "nknown" in capsys.readouterr().err
    with pytest.raises(HopdiffError, match="Unknown kind of export 'os'"):
        FORMATS.load("os")
    assert compose(["export=[glb]"]).exports.glb.kind == "glb"
