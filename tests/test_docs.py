"""README and docs/: commands compose, examples run, names are there, the README stays short."""

from __future__ import annotations

import importlib
import os
import pydoc
import re
import runpy
import shlex
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

import hopdiff
from hopdiff.choices import build_costs, build_search
from hopdiff.composing import compose, known_settings
from hopdiff.config import checked
from hopdiff.doors import CHARACTERS, FORMATS, SEARCHES, TASKS, TERMS

ROOT = Path(__file__).resolve().parents[1]
PAGES = sorted([ROOT / "README.md", ROOT / "CONTRIBUTING.md", *(ROOT / "docs").glob("*.md")])
LONGEST_README = 150
# Words of the command line that are no settings, and those of them that take the next word too.
FLAGS, VALUED = {"-m", "--help", "--cfg", "--config-dir"}, {"--cfg", "--config-dir"}


def blocks(page: Path, language: str) -> list[str]:
    """The fenced blocks of a page in a language; "" for those without one."""
    found = re.findall(rf"^```{language}\n(.*?)^```$", page.read_text(encoding="utf-8"), re.DOTALL | re.MULTILINE)
    return [str(block) for block in found]


def commands() -> list[tuple[str, str]]:
    """Every line of the pages that begins with, or goes on to, `python -m hopdiff`, after the first page it is on."""
    found: dict[str, str] = {}
    for page in PAGES:
        for block in blocks(page, ""):
            for line in block.splitlines():
                if (at := re.search(r"(?:^|&& )(python -m hopdiff\b.*)", line)) is not None:
                    found.setdefault(at[1], str(page.relative_to(ROOT)))
    return [(page, command) for command, page in found.items()]


def own_files(folder: Path) -> None:
    """Write the settings files that the pages show: YAML blocks with a line `# DIR/GROUP/NAME.yaml`."""
    for page in PAGES:
        for block in blocks(page, "yaml"):
            if (named := re.search(r"^# DIR/(\S+\.yaml)", block, re.MULTILINE)) is not None:
                path = folder / named[1]
                path.parent.mkdir(parents=True, exist_ok=True)
                path.write_text(block, encoding="utf-8")


def overrides_of(command: str, own: Path) -> list[str]:
    """The settings of a command line; of those that a sweep lists the first value of each. own: DIR of the pages."""
    words = shlex.split(re.sub(r"<(\w+)>", r"\1", command), comments=True)[3:]
    settings = []
    while words:
        word = words.pop(0)
        if word in FLAGS:
            if word in VALUED and words.pop(0) == "DIR":
                settings.append(f"hydra.searchpath=[file://{own}]")
        elif not word.startswith("hydra/"):  # of the sweep, which is not composed
            name, sign, value = word.partition("=")
            # Commas inside of braces and brackets belong to one value.
            settings.append(name + sign + (value if value[:1] in ("[", "{") else value.split(",")[0]))
    return settings


@pytest.mark.few(4)
@pytest.mark.parametrize(("page", "command"), commands())
def test_commands_compose(page: str, command: str, tmp_path: Path) -> None:
    """Names, choices and types of every setting are checked; files need not be there."""
    own_files(tmp_path)
    words = overrides_of(command, tmp_path)
    # A body of one's own is not there, and nothing but it may be said of it without it.
    config = compose([word for word in words if not word.startswith("retarget.")])
    task = TASKS.load(config.task.name)
    call = task.call(config, checked(config), tmp_path, words)
    build_search(call.settings.search)
    build_costs(call.settings.costs, config.model.name)


def test_there_are_commands_to_compose() -> None:
    pages = {page for page, _ in commands()}
    assert {"README.md", "docs/start.md", "docs/animators.md", "docs/researchers.md"} <= pages
    assert len(commands()) >= 40


EXAMPLES = [
    (page, block)
    for page in ("start", "extending")
    for block in blocks(ROOT / "docs" / f"{page}.md", "python")
    if block.startswith("# example\n")
]


@pytest.mark.parametrize(("page", "example"), EXAMPLES, ids=[f"{page}-{k}" for k, (page, _) in enumerate(EXAMPLES)])
def test_examples_run(page: str, example: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    script = tmp_path / f"{page}.py"
    script.write_text(example, encoding="utf-8")
    runpy.run_path(str(script), run_name="example")


def test_every_page_of_examples_has_one() -> None:
    assert {page for page, _ in EXAMPLES} == {"start", "extending"}


@pytest.mark.thorough
def test_package_of_the_page_is_found(tmp_path: Path) -> None:
    """The package of extending.md, as an installer would leave it, and its commands with a small budget."""
    page = ROOT / "docs" / "extending.md"
    package, info = tmp_path / "mypackage", tmp_path / "mypackage-0.1.dist-info"
    package.mkdir()
    info.mkdir()
    (package / "__init__.py").touch()
    walk, terms = (one for name in ("class Walk", "long_flight = ") for one in blocks(page, "python") if name in one)
    (package / "walk.py").write_text(walk.split("\nrun = ")[0] + "\n", encoding="utf-8")
    (package / "terms.py").write_text(terms.split("\nrun = ")[0] + "\n", encoding="utf-8")
    for block in blocks(page, "python"):
        if (named := re.match(r"# mypackage/(\w+\.py)\n", block)) is not None:
            (package / named[1]).write_text(block, encoding="utf-8")
    project = tomllib.loads(blocks(page, "toml")[0])["project"]
    lines = [
        line
        for group, points in project["entry-points"].items()
        for line in (f"[{group}]", *(f"{name} = {value}" for name, value in points.items()))
    ]
    (info / "entry_points.txt").write_text("\n".join(lines) + "\n", encoding="utf-8")
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: mypackage\nVersion: 0.1\n", encoding="utf-8")
    paths = os.pathsep.join((str(tmp_path), str(ROOT)))
    for number, command in enumerate(blocks(page, "sh")[0].splitlines()):
        words = shlex.split(command)[1:]
        small = ["budget.evaluations=150", "pictures=false", f"hydra.run.dir={tmp_path / str(number)}"]
        done = subprocess.run(
            [sys.executable, *words, *small], env={**os.environ, "PYTHONPATH": paths}, capture_output=True, text=True
        )
        assert done.returncode == 0, done.stderr
    times = [float(line) for line in (tmp_path / "0" / "motion_touchdowns.txt").read_text().splitlines()]
    assert len(times) == 2
    assert times == sorted(times)
    assert "tall: legs of 1.04 m" in done.stdout


def test_every_setting_is_on_its_page(monkeypatch: pytest.MonkeyPatch) -> None:
    """A row each; what one line of a file holds in braces is one row. Names of choices are no settings to be typed."""
    monkeypatch.syspath_prepend(ROOT / "docs")
    page = importlib.import_module("site_settings").settings_page(ROOT / "conf")
    known = {*known_settings(), *known_settings("search.population"), *known_settings("retarget.fps")}
    known |= {name.replace(".glb.", ".NAME.") for name in known_settings("exports.glb.fps")}
    named = {f"{group}.name" for group in ("task", "model", "costs", "genes", "search", "character")}
    for name in known - named - {"ground.kind"}:
        parts = name.split(".")
        above = {".".join(parts[:count]) for count in range(2, len(parts) + 1)} | {name}
        below = [other for other in known if other.startswith(f"{name}.")]
        assert below or any(f"| `{one}` |" in page for one in above), name


WRITTEN = """\
# @package _global_
# What this file is,
# in two lines.
defaults:
  - /shared/curve@path
  - _self_
speed: 3.0   # m/s
limits:      # felt, and
             # more than that
  # -- feet --
  reach: [0.5, 1]  # of a leg
  wide: {low: 0, high: 1}
  # -- arms --
  swing: 2 # deg
kind: "a # b"
"""


def test_settings_are_read_with_their_comments(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(ROOT / "docs")
    (tmp_path / "shared").mkdir()
    (tmp_path / "config.yaml").touch()
    (tmp_path / "shared" / "curve.yaml").write_text("points: []  # in metres\n", encoding="utf-8")
    (tmp_path / "mine.yaml").write_text(WRITTEN, encoding="utf-8")
    file = importlib.import_module("site_settings").read_file(tmp_path / "mine.yaml", "task")
    assert file.said == "What this file is, in two lines."
    assert [(one.name, one.value, one.comment, one.heading) for one in file.entries] == [
        ("speed", "3.0", "m/s", ""),
        ("limits", "", "felt, and more than that", ""),
        ("limits.reach", "[0.5, 1]", "of a leg", "feet"),
        ("limits.wide", "{low: 0, high: 1}", "", "feet"),
        ("limits.swing", "2", "deg", "arms"),
        ("kind", '"a # b"', "", ""),
        ("path.points", "[]", "in metres", ""),
    ]


def test_readme_is_short() -> None:
    assert len((ROOT / "README.md").read_text(encoding="utf-8").splitlines()) <= LONGEST_README


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_names_of_the_package_are_there(page: Path) -> None:
    groups = {door.points for door in (CHARACTERS, FORMATS, SEARCHES, TASKS, TERMS)}
    for name in set(re.findall(r"\bhopdiff(?:\.\w+)+", page.read_text(encoding="utf-8"))) - groups:
        found, rest = hopdiff, name.split(".")[1:]
        for part in rest:
            try:
                found = getattr(found, part)
            except AttributeError:
                found = importlib.import_module(f"{found.__name__}.{part}")


def test_help_lists_the_api() -> None:
    text = pydoc.plain(pydoc.render_doc(hopdiff))
    assert hopdiff.__version__ in text
    for name in set(hopdiff.__all__) - {"__version__"}:
        assert re.search(rf"^    (?:class )?{name}\b", text, re.MULTILINE), name
