"""From the words of a command line to settings, as Hydra composes them. Everything here is quick: no PyTorch."""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import fields
from functools import cache
from importlib.metadata import EntryPoint
from pathlib import Path
from typing import Any

import hydra
import yaml
from hydra.core.config_store import ConfigStore
from hydra.core.global_hydra import GlobalHydra
from hydra.core.hydra_config import HydraConfig
from hydra.core.plugins import Plugins
from omegaconf import BooleanNode, DictConfig, FloatNode, IntegerNode, OmegaConf

from hopdiff.doors import CHARACTERS, FORMATS, SEARCHES, TASKS, Door, config_folder, files_of, load, loaded
from hopdiff.extras import missing_extras
from hopdiff.messages import near, typed_names
from hopdiff.types import HopdiffError

# What settings begin with that need not be there before they are set.
NEW = (
    *("search.", "costs.", "model.", "exports.", "retarget.", "genes.fixed.", "genes.fixed=", "edit.joints."),
    "edit.joints=",
)
MARK = "++"

# Shared settings that are one number or word: 3 becomes 3.0 where that is meant, in names of folders too.
KINDS: dict[str, type] = {
    **dict.fromkeys(("speed", "beta", "fps"), FloatNode),
    **dict.fromkeys(("seed", "threads"), IntegerNode),
    **dict.fromkeys(("pictures", "overwrite"), BooleanNode),
}

# Hydra 1.4 drops the argument that 1.3 asks for.
HYDRA_BASE: dict[str, Any] = {"version_base": None} if hydra.__version__ < "1.4" else {}


# Of a path in the name of a folder; here, so that processes that a sweep starts know it too.
OmegaConf.register_new_resolver("stem", lambda text: Path(str(text)).stem, replace=True)


def with_new_names(words: Sequence[str]) -> list[str]:
    """Words of the command line, those marked "++" whose settings need not be there before they are set.

    A sweep is first composed with the default search and costs, which need not have the setting of others, and a
    preset of an export names only what departs from the rest; whoever builds these checks their names. No gene is
    fixed, and no joint named, until the user does; `GeneTable.build` and `find_legs` check that.
    """
    return [f"{MARK}{word}" if word.startswith(NEW) else word for word in words]


def as_typed(text: str) -> str:
    """A message without the marks of `with_new_names`."""
    return re.sub(r"\+\+(?=search\.|costs\.|model\.|exports\.|retarget\.|genes\.fixed|edit\.joints)", "", text)


@cache
def register_choices() -> None:
    """Tell Hydra of what kind the shared settings are, and what installed packages bring, to be chosen like our files.

    A character or task of another package that cannot be loaded is left out, with a line on stderr.
    """
    store = ConfigStore.instance()
    store.store(name="schema", node=OmegaConf.create({name: kind("???") for name, kind in KINDS.items()}))
    OmegaConf.register_new_resolver("missing_extras", missing_extras, replace=True)  # of the page of --help
    Plugins.instance()
    for path in (config_folder() / "hydra" / "launcher").glob("*.yaml"):
        # Launchers bring settings of their own by these names. Hydra would hold our files against them, and warn.
        store.repo["hydra"].get("launcher", {}).pop(path.name, None)
    for name in SEARCHES.brought:
        store.store(group="search", name=name, node={"name": name})
    for name in FORMATS.brought:
        store.store(group="export", name=name, package=f"exports.{name}", node={"kind": name})
    for name, point in CHARACTERS.brought.items():
        body = _brought(CHARACTERS, point)
        if isinstance(body, Mapping):
            store.store(group="character", name=name, node={"name": name, **body})
        elif body is not None:
            _warn(f"the character {name!r} of another package is no table of settings: {body!r}.")
    for name, point in TASKS.brought.items():
        if (task := _brought(TASKS, point)) is None:
            continue
        own = getattr(task, "defaults", {})
        store.store(group="task", name=name, package="_global_", node={"task": {"name": name, "label": name}, **own})


def _brought(door: Door, point: EntryPoint) -> Any:
    """What a package brings; None, with a line on stderr, where it is broken, which stops nobody else's commands."""
    try:
        return loaded(door.what, point)
    except HopdiffError as error:
        _warn(str(error))
        return None


def _warn(sentence: str) -> None:
    print(f"hopdiff: left out: {sentence}", file=sys.stderr)


def compose(overrides: Sequence[str] = ()) -> DictConfig:
    """The settings that a command line with these overrides stands for, outside a Hydra application."""
    register_choices()
    # A Hydra application around this one stays as it is.
    outer = GlobalHydra.instance().hydra
    GlobalHydra.instance().clear()
    try:
        with hydra.initialize_config_dir(str(config_folder()), job_name="hopdiff", **HYDRA_BASE):
            return hydra.compose("config", with_new_names(overrides))
    finally:
        GlobalHydra.instance().hydra = outer


def choices_of(group: str) -> list[str]:
    """The names of a group, those of installed packages included."""
    return sorted({*files_of(group), *(Path(name).stem for name in ConfigStore.instance().repo.get(group, {}))})


def no_export(name: str) -> str:
    """The sentence for settings of an export that is not chosen, or that there is not."""
    if name in (names := choices_of("export")):
        return f"exports.{name} is there once it is chosen: add export=[{name}]."
    guess = near(name, names) or " python -m hopdiff --help lists the exports."
    return f"exports.{name}: there is no export of that name.{guess}"


def known_settings(key: str = "") -> list[str]:
    """The dotted names of settings and sections that a key may have been meant for, those of all tasks included."""
    if key.startswith("search."):
        classes = [SEARCHES.load(name) for name in SEARCHES.own]
        return sorted({f"search.{entry.name}" for search in classes for entry in fields(search)})
    if found := re.match(r"exports\.(\w+)", key):
        settings = load("hopdiff.export.settings", "ExportSettings")
        return [f"exports.{found.group(1)}.{entry.name}" for entry in fields(settings)]
    if key.startswith("retarget."):
        return [f"retarget.{entry.name}" for entry in fields(load("hopdiff.export.settings", "RetargetSettings"))]
    return [*_in_files()]


@cache
def _in_files() -> dict[str, str]:
    """Dotted names of all settings in the files of conf/, each with the task that it belongs to, if to one."""
    found: dict[str, str] = {}
    for name in _names(OmegaConf.to_container(compose()), ""):
        found[name] = ""
    for path in sorted((config_folder() / "task").glob("*.yaml")):
        for name in _names(_read(path), ""):
            found.setdefault(name, path.stem)
    for group in ("model", "costs", "ground"):
        for path in sorted((config_folder() / group).glob("*.yaml")):
            content = _read(path)
            inside = content if group in content else {group: content}
            for name in _names(inside, ""):
                found.setdefault(name, "")
    return found


def defaults_of(group: str, name: str) -> dict[str, Any]:
    """The settings in a file of a group of conf/."""
    return _read(config_folder() / group / f"{name}.yaml")


def tasks_with(group: str) -> list[str]:
    """The tasks that choose from a group which is not there for all."""
    found = []
    for path in sorted((config_folder() / "task").glob("*.yaml")):
        defaults = (yaml.safe_load(path.read_text(encoding="utf-8")) or {}).get("defaults", [])
        if any(isinstance(one, Mapping) and f"/{group}" in one for one in defaults):
            found.append(path.stem)
    return found


def of_tasks(key: str, tasks: Sequence[str]) -> str:
    """The sentence for a setting that only some tasks have."""
    return f"{key} is a setting of task={', task='.join(tasks)}: add one of these."


def choices_with(key: str) -> list[str]:
    """The choices of a group, as ground=slope, whose file has a setting of this dotted name."""
    group, _, name = key.partition(".")
    if group != "ground" or not name:
        return []
    return [f"{group}={choice}" for choice in files_of(group) if name in defaults_of(group, choice)]


def task_of(key: str) -> str | None:
    """The task that a setting belongs to, if it belongs to one alone that is not chosen by default."""
    return _in_files().get(key) or None


def _read(path: Path) -> dict[str, Any]:
    content = yaml.safe_load(path.read_text(encoding="utf-8"))
    return {name: value for name, value in (content or {}).items() if name != "defaults"}


def _names(node: Any, prefix: str) -> Iterator[str]:
    if isinstance(node, Mapping):
        for key in node:
            yield f"{prefix}{key}"
            yield from _names(node[key], f"{prefix}{key}.")


def own_file(words: Sequence[str]) -> str | None:
    """The file of the user's own, among those chosen for the run under way, that sets one of these dotted names.

    None if no such file does, or if the name was typed on the command line, which then is at fault.
    """
    if not HydraConfig.initialized():
        return None
    runtime, overrides = HydraConfig.get().runtime, HydraConfig.get().overrides.task
    typed = set(typed_names(list(overrides)))
    folders = [Path(one.path) for one in runtime.config_sources if one.schema == "file"]
    for folder in folders:
        if folder.resolve() == config_folder():
            continue
        for group, chosen in runtime.choices.items():
            for name in [chosen] if isinstance(chosen, str) else list(chosen or []):
                path = folder / group / f"{name}.yaml"
                if path.is_file() and (
                    ((_set_in(path, group) - typed) & set(words)) or _lacking(path, group, set(words) - typed)
                ):
                    return f"{group}/{name}.yaml"
    return None


def _lacking(path: Path, group: str, words: set[str]) -> bool:
    """Whether a file of a group leaves out one of these settings, which all others of its group have."""
    return any(word.startswith(f"{group}.") and word not in _set_in(path, group) for word in words)


def _set_in(path: Path, group: str) -> set[str]:
    """The dotted names that a file sets."""
    text = path.read_text(encoding="utf-8")
    package = re.match(r"\s*#\s*@package\s+(\S+)", text)
    inside = group.replace("/", ".") if package is None else package.group(1)
    content: Any = _read(path)
    return set(_names(content, "" if inside == "_global_" else f"{inside}."))
