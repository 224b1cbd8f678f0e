"""The table of CONTRIBUTING.md: how many files something new touches. One of each is added to a copy of the house."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import sys
from collections.abc import Callable
from dataclasses import MISSING, fields, is_dataclass
from pathlib import Path
from typing import get_args, get_type_hints

import pytest

from hopdiff.character import CharacterSettings
from hopdiff.composing import compose
from hopdiff.config import Config, typed
from hopdiff.costs import CostSettings
from hopdiff.doors import TASKS
from hopdiff.editing.solve import SolveSettings
from hopdiff.effort.settings import EffortSettings
from hopdiff.export.settings import ExportSettings, RetargetSettings
from hopdiff.genes import GeneSettings
from hopdiff.grounds import GROUNDS
from hopdiff.models import MODELS
from hopdiff.tasks.edit import EditTask

ROOT = Path(__file__).resolve().parents[1]

SEARCH = """
from dataclasses import dataclass

from hopdiff.search.box import Box


@dataclass(frozen=True)
class Corner:
    name: str = "corner"
    rows: int = 2

    def init(self, problem, generator):
        return Box.of(problem)

    def ask(self, state, generator):
        return state.first(self.rows, generator), False

    def tell(self, state, genes, result, generator):
        return state


SEARCH = Corner
"""
FORMAT = """
from hopdiff.export.format import Format

FORMAT = Format(".count", lambda path, takes, settings: path.write_text(str(takes[0].frames)))
"""
TASK = """
from dataclasses import dataclass

from hopdiff.tasks.base import Task


@dataclass
class Settings:
    greeting: str


TASK = Task(lambda call: lambda folder: (folder.path / "hello.txt").write_text(call.own.greeting), Settings)
"""


class House:
    """A copy of the code and its settings. touched: the files that were changed or added."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.touched = folder, set[str]()
        for part in ("hopdiff", "conf"):
            shutil.copytree(ROOT / part, folder / part, ignore=shutil.ignore_patterns("__pycache__"))

    def add(self, path: str, text: str) -> None:
        assert not (self.folder / path).exists()
        (self.folder / path).write_text(text)
        self.touched.add(path)

    def change(self, path: str, old: str, new: str) -> None:
        text = (self.folder / path).read_text(encoding="utf-8")
        assert text.count(old) == 1, f"{path} has no longer one {old!r}"
        (self.folder / path).write_text(text.replace(old, new), encoding="utf-8")
        self.touched.add(path)

    def run(self, *words: str) -> Path:
        out = self.folder / "out"
        done = subprocess.run(
            [sys.executable, "-m", "hopdiff", "pictures=false", *words, f"hydra.run.dir={out}"],
            cwd=self.folder,
            capture_output=True,
            text=True,
        )
        assert done.returncode == 0, done.stderr
        return out


def numbers(out: Path, name: str = "metrics.json") -> dict[str, object]:
    content: dict[str, object] = json.loads((out / name).read_text())
    return content


QUICK = ("model=smooth", "search=random", "search.population=12", "budget.evaluations=12")


def gene(house: House) -> None:
    row = "  nod: {sense: [-90, 90], unit: deg, low: 0, high: 4, ordinary: 2}\n  neck_flex:"
    house.change("conf/genes/default.yaml", "  neck_flex:", row)
    house.change(
        "hopdiff/models/body.py",
        'zero, genes["neck_flex"], zero',
        'zero, genes["neck_flex"] + genes["nod"], zero',
    )
    found = numbers(house.run(*QUICK), "genes.json")["genes"]
    assert 0.0 <= found["nod"]["value"] <= 4.0  # type: ignore[index]


def cost_term(house: House) -> None:
    house.change(
        "hopdiff/costs.py",
        '        _row("eval", 1.0',
        '        _row("seven", settings.extra.get("seven", 7.0), lambda j: 1.0 + 0.0 * j.energy, "own"),\n'
        '        _row("eval", 1.0',
    )
    out = house.run(*QUICK)
    assert numbers(out)["cost_seven"] == 7.0
    assert "cost_seven" in (out / "history.csv").read_text().splitlines()[0]
    assert numbers(house.run(*QUICK, "costs.seven=2", "overwrite=true"))["cost_seven"] == 2.0


def search(house: House) -> None:
    house.add("hopdiff/search/corner.py", SEARCH)
    house.add("conf/search/corner.yaml", "# One corner of the box.\nname: corner\n")
    found = numbers(house.run("model=smooth", "search=corner", "search.rows=3", "budget.evaluations=12"))
    assert (found["search"], found["evaluations"]) == ("corner", 12)


def character(house: House) -> None:
    house.add("conf/character/tall.yaml", "defaults: [human, _self_]\nname: tall\nheight: 2.0\n")
    assert numbers(house.run("task=body", "character=tall"))["character"] == "tall"


def export(house: House) -> None:
    house.add("hopdiff/export/formats/count.py", FORMAT)
    house.add("conf/export/count.yaml", "# @package exports.count\n# How many frames there are.\nkind: count\n")
    out = house.run(*QUICK, "export=[count]")
    assert int((out / "motion_count.count").read_text()) == numbers(out)["frames"]


def task(house: House) -> None:
    house.add("hopdiff/tasks/hello.py", TASK)
    words = "# @package _global_\n# Says hello.\ntask: {name: hello, label: hello}\ngreeting: good day\n"
    house.add("conf/task/hello.yaml", words)
    assert (house.run("task=hello") / "hello.txt").read_text() == "good day"


@pytest.mark.few(3)
@pytest.mark.parametrize(
    ("what", "addition"),
    [
        ("a gene", gene),
        ("a cost term", cost_term),
        ("a search", search),
        ("a character", character),
        ("an export", export),
        ("a task", task),
    ],
)
def test_something_new_touches_as_many_files_as_the_table_says(
    what: str, addition: Callable[[House], None], tmp_path: Path
) -> None:
    table = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    row = re.search(rf"^\| {what} \| (\d+) \|", table, re.MULTILINE)
    assert row is not None
    house = House(tmp_path)
    addition(house)
    assert len(house.touched) == int(row.group(1))


def settings_classes() -> list[type]:
    """Those whose values stand in files of conf/, with what is inside of them."""
    found: list[type] = [Config, *MODELS.values(), EffortSettings, CostSettings, *GROUNDS.values()]
    found += [TASKS.load(name).settings for name in TASKS.own]
    # A body and a table of genes are data of their user's own, which may leave out what a body need not have.
    left_out = {CharacterSettings, GeneSettings, ExportSettings, RetargetSettings}
    for schema in found:
        for hint in get_type_hints(schema).values():
            for inside in (hint, *get_args(hint)):
                if is_dataclass(inside) and inside not in left_out and inside not in found:
                    found.append(inside)  # type: ignore[arg-type]
    return found


def test_no_default_stands_twice() -> None:
    for schema in settings_classes():
        twice = [entry.name for entry in fields(schema) if not entry.default is entry.default_factory is MISSING]
        assert not twice, f"{schema.__name__}: {twice}"
    for path in (ROOT / "conf" / "search").glob("*.yaml"):
        values = [line for line in path.read_text(encoding="utf-8").splitlines() if not line.startswith("#")]
        assert values == [f"name: {path.stem}"], path


def test_the_path_solver_has_the_same_settings_from_python_as_from_a_command() -> None:
    """`SolveSettings` has defaults of its own: task=navigate and scripts use it without conf/."""
    assert typed(compose(["task=edit"]), EditTask).edit.solver() == SolveSettings()
