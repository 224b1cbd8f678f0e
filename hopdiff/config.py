# No `from __future__ import annotations`: Hydra reads the types of the settings classes.
"""The settings: their schema, where their files lie, and how they become objects."""

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields, is_dataclass
from functools import cache
from pathlib import Path
from typing import Any

import hydra
import torch
from hydra.core.config_store import ConfigStore
from hydra.core.global_hydra import GlobalHydra
from omegaconf import MISSING, DictConfig, OmegaConf
from omegaconf.errors import OmegaConfBaseException

from hopdiff.character import Character, CharacterSettings
from hopdiff.choices import build_costs, build_search
from hopdiff.costs import CostSettings
from hopdiff.effort.problem import BodyProblem
from hopdiff.effort.settings import EffortSettings
from hopdiff.export.settings import ExportSettings
from hopdiff.genes import GeneSettings, GeneTable
from hopdiff.graph.settings import WaySettings
from hopdiff.messages import choose, near, one_line
from hopdiff.models import build_model
from hopdiff.models.base import ModelSettings
from hopdiff.models.limp import LimpSettings
from hopdiff.plots.film import check_film
from hopdiff.problem import RunProblem
from hopdiff.search import SEARCHES
from hopdiff.search.loop import Budget
from hopdiff.tasks.edit_request import EditSettings, Request, TargetSettings, request_of
from hopdiff.tasks.export import Exports, RetargetSettings
from hopdiff.tasks.hopper import HopperSettings
from hopdiff.tasks.job import Job, threads
from hopdiff.tasks.navigate import GraphSettings
from hopdiff.tasks.path import PathSettings, Route, plan
from hopdiff.types import HopdiffError
from hopdiff.whole_body.genes import BODY_GENES
from hopdiff.whole_body.model import BodyModel

DTYPES = {"float32": torch.float32, "float64": torch.float64}
MAX_FPS = 10_000.0
# What settings with names of the user's own begin with.
NEW = ("search.", "costs.", "genes.fixed.", "genes.fixed=", "edit.joints.", "edit.joints=")

# Hydra 1.4 drops the argument that 1.3 asks for.
HYDRA_BASE: dict[str, Any] = {"version_base": None} if hydra.__version__ < "1.4" else {}

# What a genes file brings along: a replay takes these from the file unless they are typed on the command line.
SAVED = ("speed", "beta", "seed", "fps", "dtype", "model", "character", "costs", "genes", "limp")
# Settings that the run of least cost, which the energy of model=body is told in, depends on.
OF_LEAST = ("speed", "model", "character", "costs", "genes", "limp")


@dataclass
class TaskSettings:
    """name: what to do; label: the last part of the run folder's name."""

    name: str = MISSING
    label: str = MISSING


@dataclass
class BudgetSettings:
    """See `hopdiff.search.loop.Budget`."""

    evaluations: int = 10_000
    gradient_price: float = 3.0
    target: float | None = None


@dataclass
class Config:
    """Everything that can be set. speed [m/s]; beta in [0, 1); fps [frames/s]; the groups are files in conf/."""

    speed: float = 5.0
    beta: float = 0.7
    seed: int = 0
    device: str = "cpu"
    dtype: str = "float64"
    threads: int = 1
    fps: float = 60.0
    run: Any = None
    runs: str | None = None
    genes_file: str | None = None
    pictures: bool = True
    animation: str = "gif"
    budget: BudgetSettings = field(default_factory=BudgetSettings)
    task: TaskSettings = field(default_factory=TaskSettings)
    model: ModelSettings = field(default_factory=ModelSettings)
    search: dict[str, Any] = field(default_factory=dict)
    character: CharacterSettings = field(default_factory=CharacterSettings)
    costs: dict[str, Any] = field(default_factory=dict)
    genes: GeneSettings = field(default_factory=GeneSettings)
    limp: LimpSettings = field(default_factory=LimpSettings)
    path: PathSettings = field(default_factory=PathSettings)
    clip: str | None = None
    target: TargetSettings = field(default_factory=TargetSettings)
    constraints: list[Any] = field(default_factory=list)
    edit: EditSettings = field(default_factory=EditSettings)
    clips: list[str] = field(default_factory=list)
    scene: str = "two_rooms"
    start: Any = "start"
    goal: Any = "goal"
    way: WaySettings = field(default_factory=WaySettings)
    graph: GraphSettings = field(default_factory=GraphSettings)
    hopper: HopperSettings = field(default_factory=HopperSettings)
    exports: dict[str, ExportSettings] = field(default_factory=dict)
    retarget: RetargetSettings = field(default_factory=RetargetSettings)


def with_new_names(words: Sequence[str]) -> list[str]:
    """Words of the command line, those marked "++" whose settings need not be there before they are set.

    A sweep is first composed with the default search and costs, which need not have the setting of others;
    `build_search` and `build_costs` check it. No gene is fixed, and no joint named, until the user does;
    `GeneTable.build` and `find_legs` check that.
    """
    return [f"++{word}" if word.startswith(NEW) else word for word in words]


def as_typed(text: str) -> str:
    """A message without the marks of `with_new_names`."""
    return re.sub(r"\+\+(?=search\.|costs\.|genes\.fixed|edit\.joints)", "", text)


@cache
def register_schema() -> None:
    """Tell Hydra the types, so that a wrong name or type in any file or override is an error."""
    ConfigStore.instance().store(name="schema", node=Config)


def config_folder() -> Path:
    """The folder of the configuration files: inside an installed package, or beside it in a checkout."""
    package = Path(__file__).resolve().parent
    for folder in (package / "conf", package.parent / "conf"):
        if (folder / "config.yaml").is_file():
            return folder
    raise HopdiffError("This installation of hopdiff lacks its configuration folder conf/.")


def compose(overrides: Sequence[str] = ()) -> DictConfig:
    """The settings that a command line with these overrides stands for, outside a Hydra application."""
    register_schema()
    # A Hydra application around this one stays as it is.
    outer = GlobalHydra.instance().hydra
    GlobalHydra.instance().clear()
    try:
        with hydra.initialize_config_dir(str(config_folder()), job_name="hopdiff", **HYDRA_BASE):
            return hydra.compose("config", with_new_names(overrides))
    finally:
        GlobalHydra.instance().hydra = outer


@cache
def known_settings() -> list[str]:
    """The dotted names of all settings and sections, those of every search included."""

    def names(node: Any, prefix: str) -> Iterator[str]:
        if isinstance(node, Mapping):
            for key in node:
                yield f"{prefix}{key}"
                yield from names(node[key], f"{prefix}{key}.")

    searches = {entry.name for search in SEARCHES.values() for entry in fields(search)}
    costs = [*names(OmegaConf.to_container(OmegaConf.structured(CostSettings)), "costs.")]
    presets = [path.stem for path in (config_folder() / "export").glob("*.yaml")]
    exports = [f"exports.{preset}.{entry.name}" for preset in presets for entry in fields(ExportSettings)]
    return [*names(OmegaConf.to_container(compose()), ""), *costs, *(f"search.{name}" for name in searches), *exports]


def checked(config: DictConfig) -> Config:
    """The settings as an object, top-level numbers checked. Raises HopdiffError, or an OmegaConfBaseException."""
    settings: Config = OmegaConf.to_object(config)  # type: ignore[assignment]
    # Hydra takes new names from "+name=value" in spite of the schema.
    for name in _strays(settings, ""):
        raise HopdiffError(f"Unknown setting {name!r}.{near(name, known_settings())}")
    check_numbers(settings)
    return settings


def _strays(node: Any, prefix: str) -> Iterator[str]:
    """Dotted names that the schema does not have."""
    if is_dataclass(node):
        known = {entry.name for entry in fields(node)}
        yield from (f"{prefix}{name}" for name in vars(node) if name not in known)
        node = vars(node)
    if isinstance(node, dict):
        for name, value in node.items():
            yield from _strays(value, f"{prefix}{name}.")


def with_saved(config: DictConfig, saved: Mapping[str, Any], typed: Sequence[str]) -> DictConfig:
    """A config with the settings that a genes file brings along put in, except those typed by the user.

    typed: the dotted names on the command line; a group that was chosen there ("model") replaces the saved one
    whole, a single setting ("model.step") only itself. Raises HopdiffError if the file's settings do not fit.
    """
    plain: Any = OmegaConf.to_container(config, resolve=True)
    try:
        plain |= {name: saved[name] for name in SAVED if name in saved and name not in typed}
        result: DictConfig = OmegaConf.merge(OmegaConf.structured(Config), plain)  # type: ignore[assignment]
    except OmegaConfBaseException as error:
        name = f"{error.full_key}: " if error.full_key else ""
        raise HopdiffError(f"The genes file has settings that do not fit: {name}{one_line(error)}.") from error
    if any(name.split(".")[0] in OF_LEAST for name in typed) and OmegaConf.select(result, "costs.least") is not None:
        # The least run of another body or speed tells nothing here.
        OmegaConf.update(result, "costs.least", {"external_work": None, "contact_time": None})
    for name in typed:
        if name.split(".")[0] in SAVED and "." in name:
            OmegaConf.update(result, name, OmegaConf.select(config, name))
    return result


def build_job(config: DictConfig) -> Job:
    """Check the settings and build what a search or a replay needs.

    Raises HopdiffError, or an OmegaConfBaseException, that names the setting.
    """
    settings = checked(config)
    dtype = DTYPES[choose("dtype", settings.dtype, DTYPES)]
    device = build_device(settings.device, dtype)
    character = Character.build(settings.character, dtype, device)
    limping = settings.limp.amount > 0
    model = build_model(settings.model, character, settings.limp)
    whole = isinstance(model, BodyModel)
    known = BODY_GENES if whole else None
    table = GeneTable.build(settings.genes, character.leg_length, settings.speed, dtype, device, limping, known)
    search, budget = build_search(settings.search), Budget(**vars(settings.budget))
    plain = plain_settings(config)
    costs = build_costs(settings.costs, settings.model.name)
    problem: BodyProblem | RunProblem
    if isinstance(model, BodyModel):
        assert isinstance(costs, EffortSettings)
        with threads(settings.threads):
            problem = BodyProblem(character, table, model, costs, settings.speed, settings.beta)
        plain["costs"] = problem.told(plain["costs"])
    else:
        assert isinstance(costs, CostSettings)
        problem = RunProblem(character, table, model, costs, settings.speed, settings.beta)
    return Job(
        problem=problem,
        table=table,
        search=search,
        budget=budget,
        seed=settings.seed,
        fps=settings.fps,
        threads=settings.threads,
        settings=plain,
        saved={name: plain[name] for name in SAVED},
    )


def plain_settings(config: DictConfig) -> dict[str, Any]:
    """The whole configuration as plain data."""
    plain: dict[str, Any] = OmegaConf.to_container(config, resolve=True)  # type: ignore[assignment]
    return plain


def build_character(config: DictConfig) -> Character:
    """The body of the settings, whatever they ask of it. Raises HopdiffError, naming the setting."""
    return Character.build(checked(config).character)


def build_route(config: DictConfig) -> Route:
    """The path of the settings, checked against what their body can run. Raises HopdiffError, naming the setting."""
    character = build_character(config)
    settings = checked(config)
    return plan(settings.path, character.leg_length, character.name, settings.fps)


def build_request(config: DictConfig) -> tuple[Request, EditSettings]:
    """What an edit is asked for, and how. Raises HopdiffError, naming the setting."""
    settings = checked(config)
    settings.edit.check()
    return request_of(settings.target, settings.constraints, settings.path), settings.edit


def build_exports(config: DictConfig) -> Exports:
    """What is to be written for other programs. Raises HopdiffError, naming the setting."""
    settings = checked(config)
    return Exports.build(settings.exports, settings.retarget)


def check_numbers(settings: Config) -> None:
    """Raises HopdiffError if a top-level setting is out of its range, or asks for a film that nothing here encodes."""
    if not (math.isfinite(settings.speed) and settings.speed > 0):
        raise HopdiffError(f"speed must be a number above 0 [m/s], not {settings.speed:g}.")
    if not 0 <= settings.beta < 1:
        raise HopdiffError(f"beta must be at least 0 and below 1, not {settings.beta:g}.")
    if not 0 < settings.fps <= MAX_FPS:
        raise HopdiffError(f"fps must be above 0 and at most {MAX_FPS:g} frames/s, not {settings.fps:g}.")
    if not 0 <= settings.seed < 2**63:
        raise HopdiffError(f"seed must be a whole number from 0 to 2^63 - 1, not {settings.seed}.")
    check_film(settings.animation, settings.pictures)
    if settings.threads < 1:
        raise HopdiffError(f"threads must be at least 1, not {settings.threads}.")


def build_device(name: str, dtype: torch.dtype) -> torch.device:
    """A device that is there and knows the dtype. Raises HopdiffError otherwise."""
    try:
        device = torch.device(name)
        torch.zeros(1, dtype=dtype, device=device).item()
    except TypeError as error:
        raise HopdiffError(f"device {name!r} has no {dtype}: set dtype=float32.") from error
    except (RuntimeError, AssertionError, NotImplementedError) as error:
        there = ["cpu", *(f"cuda:{i}" for i in range(torch.cuda.device_count()))]
        there += ["mps"] if torch.backends.mps.is_available() else []
        raise HopdiffError(f"device {name!r} cannot be used here: choose one of {', '.join(there)}.") from error
    return device
