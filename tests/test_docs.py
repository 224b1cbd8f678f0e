"""README and docs/: commands compose, examples run, names are there, the README stays short."""

from __future__ import annotations

import importlib
import pydoc
import re
import shlex
from pathlib import Path

import pytest

import hopdiff
from hopdiff.composing import compose

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


@pytest.mark.parametrize(("page", "command"), commands())
def test_commands_compose(page: str, command: str, tmp_path: Path) -> None:
    own_files(tmp_path)
    compose(overrides_of(command, tmp_path))


def test_there_are_commands_to_compose() -> None:
    pages = {page for page, _ in commands()}
    assert {"README.md", "docs/start.md", "docs/animators.md", "docs/researchers.md"} <= pages
    assert len(commands()) > 40


EXAMPLES = [
    (page, block)
    for page in ("start", "extending")
    for block in blocks(ROOT / "docs" / f"{page}.md", "python")
    if block.startswith("# example\n")
]


@pytest.mark.parametrize(("page", "example"), EXAMPLES, ids=[f"{page}-{k}" for k, (page, _) in enumerate(EXAMPLES)])
def test_examples_run(page: str, example: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    exec(compile(example, f"docs/{page}.md", "exec"), {"__name__": "example"})


def test_every_page_of_examples_has_one() -> None:
    assert {page for page, _ in EXAMPLES} == {"start", "extending"}


def test_readme_is_short() -> None:
    assert len((ROOT / "README.md").read_text(encoding="utf-8").splitlines()) <= LONGEST_README


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_names_of_the_package_are_there(page: Path) -> None:
    for name in set(re.findall(r"\bhopdiff(?:\.\w+)+", page.read_text(encoding="utf-8"))):
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
