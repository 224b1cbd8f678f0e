"""The page of all settings, made from the files below conf/: names, defaults and the comments beside them.

Searches and exports have their defaults in a class; those are taken from there.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import MISSING, dataclass, field, fields, replace
from itertools import takewhile
from pathlib import Path
from typing import Any

import yaml
from site_docstrings import said_of_fields
from yaml import MappingNode, Mark, Node, ScalarNode, SequenceNode

from hopdiff.doors import SEARCHES
from hopdiff.export.settings import ExportSettings, RetargetSettings

ASIDE = ("hydra", "scenes", "shared")  # folders of other things than choices of a group
GROUPS = {
    "task": "What is done.",
    "model": "How a run is made from its genes.",
    "costs": "What a run is judged by.",
    "genes": "The free numbers of a run and their ranges.",
    "search": "How the best run is looked for.",
    "character": "The body.",
    "ground": "What feet stand on, of `task=edit`, `task=path` and `task=navigate`; flat unless chosen.",
    "export": "Forms for other programs, as `export=[glb,html]`. Its settings are called `exports.NAME.SETTING`.",
    "hydra/launcher": "Where the runs of a sweep are made; without one, one after the other.",
    "experiment": "Settings that go together, added with a plus: `+experiment=brisk`.",
}


@dataclass(frozen=True)
class Entry:
    """One setting: dotted name, default as it is written, the comment beside it, and the heading it stands under."""

    name: str
    value: str
    comment: str
    heading: str


@dataclass
class File:
    """One file of settings. prefix: what its names begin with on the command line. chosen: of its defaults list.

    told: what its head says of settings that have their defaults in a class, by name.
    """

    name: str
    said: str = ""
    prefix: str = ""
    entries: list[Entry] = field(default_factory=list)
    chosen: list[str] = field(default_factory=list)
    told: dict[str, str] = field(default_factory=dict)


def read_file(path: Path, group: str = "", name: str = "") -> File:
    """The settings of a file of a group, in their order, with those of files that it takes in."""
    text = path.read_text(encoding="utf-8")
    lines = text.splitlines()
    file = File(name or path.stem, prefix=f"{group}." if group else "")
    head = list(takewhile(lambda line: line.startswith("#"), lines))
    if head and (package := re.fullmatch(r"# @package (\S+)", head[0].rstrip())):
        file.prefix = "" if package[1] == "_global_" else f"{package[1]}."
        head = head[1:]
    # Settings that stand in a class are told in lines of their own, further in.
    told = [found for line in head if (found := re.fullmatch(r"#   (\w+): (.*)", line.rstrip()))]
    file.told = {found[1]: found[2] for found in told}
    plain = [line for line in head if not line.startswith(("#   ", "# Settings ("))]
    file.said = " ".join(line.lstrip("# ").rstrip() for line in plain)
    taken: list[str] = []
    tree = yaml.compose(text)
    if isinstance(tree, MappingNode):
        for key, value in tree.value:
            if key.value == "defaults":
                file.chosen = list(_chosen(value))
                taken = [one.value for one in value.value if isinstance(one, ScalarNode)]
        own = _entries(tree, text, lines, file.prefix)
        file.entries = [entry for entry in own if entry.name.split(".")[-1] != "defaults"]
    for one in taken:
        if found := re.fullmatch(r"/?(shared/\w+)@(.+)", one):
            base = read_file(_conf(path) / f"{found[1]}.yaml")
            file.entries += [replace(entry, name=f"{found[2]}.{entry.name}") for entry in base.entries]
    return file


def _conf(path: Path) -> Path:
    """The folder of all settings that a file lies in."""
    return next(folder for folder in path.parents if (folder / "config.yaml").is_file())


def _chosen(node: SequenceNode) -> Iterator[str]:
    """The entries of a defaults list as they would be typed."""
    for one in node.value:
        if isinstance(one, MappingNode):
            for key, value in one.value:
                shown = value.value if isinstance(value, ScalarNode) else "[]"
                yield f"{key.value.removeprefix('override ').lstrip('/')}={shown}"
        elif one.value != "_self_" and "@" not in one.value:
            yield one.value


def _entries(node: MappingNode, text: str, lines: list[str], prefix: str, first: int | None = None) -> Iterator[Entry]:
    """The settings in a node. first: line from which on comments are headings; of a file its first setting."""
    heading = ""
    last = node.value[0][0].start_mark.line if first is None and node.value else first or 0
    for key, value in node.value:
        heading = _heading(lines, last, key.start_mark.line, key.start_mark.column) or heading
        last = _end(value).line + 1
        name = f"{prefix}{key.value}"
        if isinstance(value, MappingNode) and not value.flow_style and value.value:
            said = _comment(lines, key.end_mark.line, key.end_mark.column)
            if said:
                yield Entry(name, "", said, heading)
            for entry in _entries(value, text, lines, f"{name}.", key.start_mark.line + 1):
                yield entry if entry.heading else Entry(entry.name, entry.value, entry.comment, heading)
            continue
        end = _end(value)
        written = " ".join(text[value.start_mark.index : end.index].split())
        yield Entry(name, written, _comment(lines, end.line, end.column), heading)


def _end(node: Node) -> Mark:
    """Where a node ends; a block of lines ends with its last entry, not where the next one begins."""
    if isinstance(node, MappingNode | SequenceNode) and not node.flow_style and node.value:
        last = node.value[-1]
        return _end(last[1] if isinstance(last, tuple) else last)
    return node.end_mark


def _comment(lines: list[str], line: int, column: int) -> str:
    """The comment after a place, with the lines that go on with it in the same column."""
    if line >= len(lines) or (found := re.search(r"(?:^|\s)#", lines[line][column:])) is None:
        return ""
    start = column + found.end() - 1
    said = [lines[line][start + 1 :]]
    for after in lines[line + 1 :]:
        if not (after.lstrip().startswith("#") and after.index("#") == start):
            break
        said.append(after[start + 1 :])
    return " ".join(part.strip() for part in said)


def _heading(lines: list[str], first: int, line: int, column: int) -> str:
    """The comment of its own above a setting, as `# -- time and force --`."""
    said = [one.strip() for one in lines[first:line] if one.startswith(" " * column + "#")]
    return " ".join(one.strip("# -") for one in said)


def read_all(conf: Path) -> dict[str, list[File]]:
    """Every file of settings by group; the file of the general settings under ""."""
    found = {"": [read_file(conf / "config.yaml")]}
    for folder in sorted(path for path in conf.iterdir() if path.is_dir() and path.name not in ASIDE):
        found[folder.name] = [
            read_file(path, folder.name, path.relative_to(folder).with_suffix("").as_posix())
            for path in sorted(folder.rglob("*.yaml"))
        ]
    if launchers := sorted((conf / "hydra" / "launcher").glob("*.yaml")):
        found["hydra/launcher"] = [read_file(path, "hydra.launcher") for path in launchers]
    return {group: found[group] for group in sorted(found, key=_rank)}


def _rank(group: str) -> tuple[int, str]:
    known = ["", *GROUPS]
    return (known.index(group) if group in known else len(known) - 1, group)


def settings_page(conf: Path) -> str:
    """The generated part of the page as Markdown."""
    files = read_all(conf)
    general = files[""][0]
    chosen = dict(choice.split("=", 1) for choice in general.chosen if "=" in choice)
    parts = ["## Groups and their choices", _choices(files, chosen), "## General settings", *_general(general, files)]
    for group, choices in files.items():
        if group and group != "experiment":
            shown = [file for file in choices if not file.name.startswith("of_")]
            parts += [f"## {group}", GROUPS.get(group, ""), _table(("choice", "what it is"), _said(shown, group))]
            if common := [entry for entry in general.entries if entry.name.startswith(f"{group}.")]:
                parts += [f"Of every {group}:", _settings(common)]
            if group == "export":
                parts += ["Of every export:", _settings(list(_of_class(ExportSettings, "exports.NAME.", {})))]
                parts += ["Of motions on another body:", _settings(list(_of_class(RetargetSettings, "retarget.", {})))]
            for file in shown:
                entries = [entry for entry in file.entries if entry.name not in (f"{group}.name", "ground.kind")]
                if group == "search":
                    known = {entry.name for entry in entries}
                    more = _of_class(SEARCHES.load(file.name), "search.", file.told)
                    entries += [entry for entry in more if entry.name not in known]
                if entries:
                    parts += [f"### {group}={file.name}", _settings(entries)]
    parts += ["## experiment", GROUPS["experiment"], _experiments(files.get("experiment", []))]
    scenes = [(file.stem, read_file(file).said) for file in sorted((conf / "scenes").glob("*.yaml"))]
    parts += ["## Scenes", "Of `task=navigate`: `scene=NAME`, or a [file of your own](formats.md#scenes)."]
    parts += [_table(("scene", "what it is"), [(f"`{name}`", _plain(said)) for name, said in scenes])]
    return "\n\n".join(part for part in parts if part)


def _of_class(settings: type, prefix: str, told: dict[str, str]) -> Iterator[Entry]:
    """Settings whose defaults stand in a class. told: what they are, where its docstring does not say it."""
    told = said_of_fields(settings) | told
    for entry in fields(settings):
        default = entry.default if entry.default_factory is MISSING else entry.default_factory()
        if not (entry.name == "name" and prefix == "search."):
            written = yaml.safe_dump(default, default_flow_style=True).removesuffix("...\n").strip()
            yield Entry(f"{prefix}{entry.name}", written, told.get(entry.name, ""), "")


def _choices(files: dict[str, list[File]], chosen: dict[str, str]) -> str:
    rows = []
    for group, choices in files.items():
        if group:
            names = [file.name for file in choices if not file.name.startswith("of_")]
            shown = names if len(names) <= 20 else [name for name in names if "/" not in name] + ["..."]
            default = chosen.get(group, "").replace("${model}", "MODEL")
            rows.append((f"[`{group}`](#{group})", _code(default), ", ".join(f"`{name}`" for name in shown)))
    return _table(("group", "default", "choices"), rows)


def _general(file: File, groups: Mapping[str, Any]) -> Iterator[str]:
    """The general settings: those without a section first, then section by section; those of groups stand there."""
    own = [entry for entry in file.entries if entry.name.split(".")[0] not in groups]
    sections = list(dict.fromkeys(entry.name.split(".")[0] for entry in own if "." in entry.name))
    said = {entry.name: entry.comment for entry in own if entry.name in sections}
    yield _settings([entry for entry in own if "." not in entry.name and entry.name not in said])
    for section in sections:
        yield f"### {section}"
        yield _plain(said.get(section, ""))
        yield _settings([entry for entry in own if entry.name.startswith(f"{section}.")])


def _settings(entries: list[Entry]) -> str:
    """Tables of settings, one a heading; a section without a value of its own is a row with its comment."""
    parts, rows, heading = [], [], ""
    for entry in entries:
        if entry.heading != heading:
            parts += [_table(SETTING, rows)] if rows else []
            parts += [f"**{_plain(entry.heading)}**"] if entry.heading else []
            rows, heading = [], entry.heading
        rows.append((f"`{entry.name}`", _code(entry.value), _plain(entry.comment)))
    return "\n\n".join([*parts, _table(SETTING, rows)])


SETTING = ("setting", "default", "what it is")


def _said(choices: list[File], group: str) -> list[tuple[str, str]]:
    return [(f"`{group}={file.name}`", _plain(file.said)) for file in choices]


def _experiments(files: list[File]) -> str:
    rows = []
    for file in files:
        sets = [*file.chosen, *(f"{entry.name}={entry.value}" for entry in file.entries if entry.value)]
        rows.append((f"`+experiment={file.name}`", _plain(file.said), " ".join(map(_code, sets))))
    return _table(("experiment", "what it is", "sets"), rows)


def _table(head: tuple[str, ...], rows: list[tuple[str, ...]]) -> str:
    return "\n".join(f"| {' | '.join(cells)} |" for cells in (head, ("---",) * len(head), *rows))


def _code(text: str) -> str:
    return f"`{text.replace('|', chr(92) + '|')}`" if text else ""


def _plain(text: str) -> str:
    """Text whose signs mean nothing to Markdown; what stands in back quotes stays code."""
    parts = re.split(r"(`[^`]*`)", text)
    return "".join(part if k % 2 else re.sub(r"([\\*_$|\[\]{}<>#])", r"\\\1", part) for k, part in enumerate(parts))
