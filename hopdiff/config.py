# No `from __future__ import annotations`: OmegaConf reads the types of the settings classes.
"""The settings that every task shares: their types, their checks, and the objects made from them.

Their defaults stand in conf/ and nowhere else.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass
from typing import Any

import torch
from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import OmegaConfBaseException

from hopdiff.character import Character, CharacterSettings
from hopdiff.choices import build_costs, build_model, build_search, with_floats
from hopdiff.composing import known_settings, no_export, of_tasks, task_of, tasks_with
from hopdiff.costs import CostSettings
from hopdiff.effort.problem import BodyProblem
from hopdiff.effort.settings import EffortSettings
from hopdiff.export.settings import ExportSettings, RetargetSettings
from hopdiff.genes import GeneSettings, GeneTable, senses
from hopdiff.job import Job, threads
from hopdiff.kernels.choose import CHOICES
from hopdiff.messages import choose, near, one_line
from hopdiff.models import MODELS, gene_table
from hopdiff.models.limp import LimpSettings
from hopdiff.objective import Term
from hopdiff.problem import RunProblem
from hopdiff.search.base import Search
from hopdiff.search.loop import Budget
from hopdiff.types import HopdiffError
from hopdiff.whole_body.model import BodyModel

DTYPES = {"float32": torch.float32, "float64": torch.float64}
MAX_FPS = 10_000.0
MAX_THREADS = 1024
MAX_SPEED = 1000.0  # m/s; far beyond any body's
LONGEST_NUMBER = 30  # characters of a number in a message

# What a genes file brings along: a replay takes these from the file unless they are typed on the command line.
SAVED = ("speed", "beta", "seed", "fps", "dtype", "model", "character", "costs", "genes", "limp")
# What runs were made with before these settings were there.
OLDER_MODELS = {"thesis": {"knee": "flexion", "impulse": False}}
# Settings that the run of least cost, which the energy of model=body is told in, depends on.
OF_LEAST = ("speed", "model", "character", "costs", "genes", "limp")


@dataclass
class TaskSettings:
    """name: what to do; label: the last part of the run folder's name."""

    name: str
    label: str


@dataclass
class BudgetSettings:
    """See `hopdiff.search.loop.Budget`."""

    evaluations: int
    gradient_price: float
    target: float | None


@dataclass
class Config:
    """What every task shares. speed [m/s]; beta in [0, 1); fps [frames/s]; the groups are files in conf/."""

    speed: float
    beta: float
    seed: int
    device: str
    dtype: str
    compile: str
    threads: int
    fps: float
    pictures: bool
    animation: str
    overwrite: bool
    budget: BudgetSettings
    task: TaskSettings
    model: dict[str, Any]
    search: dict[str, Any]
    character: CharacterSettings
    costs: dict[str, Any]
    genes: GeneSettings
    limp: LimpSettings
    exports: dict[str, ExportSettings]
    retarget: RetargetSettings


def checked(config: DictConfig) -> Config:
    """The shared settings as an object, top-level numbers and names of exports checked.

    Raises HopdiffError, naming the setting.
    """
    settings: Config = typed(config, Config)
    check_numbers(settings)
    for name, export in settings.exports.items():
        if not export.kind:
            raise HopdiffError(no_export(name))
    return settings


def typed(config: DictConfig, schema: type) -> Any:
    """The settings of a config that a settings class has, as an object of it; others are left alone.

    Raises HopdiffError for an unknown name inside of them, or an OmegaConfBaseException, naming the setting, for a
    wrong value.
    """
    plain: Any = OmegaConf.to_container(config, resolve=True)
    own = {entry.name: plain[entry.name] for entry in fields(schema) if entry.name in plain}
    merged = OmegaConf.merge(OmegaConf.structured(schema), with_floats(schema, own))
    result = OmegaConf.to_object(merged)
    # Hydra takes new names from "+name=value", whatever the schema.
    for name in _strays(result, ""):
        raise HopdiffError(unknown_setting(name))
    return result


def check_names(config: DictConfig, *schemas: type) -> None:
    """Raises HopdiffError for a top-level name that none of the settings classes has."""
    known = {entry.name for schema in schemas for entry in fields(schema)}
    for name in config:
        if name not in known:
            raise HopdiffError(unknown_setting(str(name)))


def unknown_setting(name: str) -> str:
    """The sentence for a setting that there is not."""
    if package := {"experiment": "_global_", "export": "exports.NAME"}.get(name):
        return f"A file of {name}/ lacks its first line: # @package {package}"
    if task := task_of(name):
        return f"{name} is a setting of task={task}: add task={task}."
    if tasks := tasks_with(name):
        return of_tasks(name, tasks)
    return f"Unknown setting {name!r}.{near(name, known_settings(name))}"


def _strays(node: Any, prefix: str) -> Iterator[str]:
    """Dotted names that the schema does not have."""
    if is_dataclass(node):
        known = {entry.name for entry in fields(node)}
        yield from (f"{prefix}{name}" for name in vars(node) if name not in known)
        node = vars(node)
    if isinstance(node, dict):
        for name, value in node.items():
            yield from _strays(value, f"{prefix}{name}.")


def with_saved(config: DictConfig, saved: Mapping[str, Any], typed_names: Sequence[str]) -> DictConfig:
    """A config with the settings that a genes file brings along put in, except those typed by the user.

    typed_names: the dotted names on the command line; a group that was chosen there ("model") replaces the saved one
    whole, a single setting ("model.step") only itself. Raises HopdiffError if the file's settings do not fit.
    """
    plain: Any = OmegaConf.to_container(config, resolve=True)
    own = dict(plain)
    plain |= {name: saved[name] for name in SAVED if name in saved and name not in typed_names}
    for name in ("character", "genes", "limp"):
        if isinstance(plain[name], Mapping):
            plain[name] = {**own[name], **plain[name]}  # what older files do not have yet
    if "model" in saved and "model" not in typed_names:
        plain["model"] = _model_of(saved["model"], own["model"])
    result = OmegaConf.create(plain)
    try:
        typed(result, Config)
    except OmegaConfBaseException as error:
        name = f"{error.full_key}: " if error.full_key else ""
        raise HopdiffError(f"it has settings that do not fit: {name}{one_line(error)}.") from error
    if any(name.split(".")[0] in OF_LEAST for name in typed_names) and OmegaConf.select(result, "costs.least"):
        # The least run of another body or speed tells nothing here.
        OmegaConf.update(result, "costs.least", {"external_work": None, "contact_time": None})
    for name in typed_names:
        if name.split(".")[0] in SAVED and "." in name:
            OmegaConf.update(result, name, OmegaConf.select(config, name), force_add=True)
    found: DictConfig = result
    return found


def _model_of(saved: Any, own: Mapping[str, Any]) -> Any:
    """The saved settings of a model; older files hold those of all models."""
    if not isinstance(saved, Mapping):
        return saved
    name = saved.get("name", own["name"])
    others = {entry.name for schema in MODELS.values() for entry in fields(schema)}
    mine = {entry.name for entry in fields(MODELS[name])} if name in MODELS else set()
    older = OLDER_MODELS.get(name, {})
    return {"name": name, **older, **{key: value for key, value in saved.items() if key in mine or key not in others}}


def build_job(
    config: DictConfig, search: Search | None = None, terms: Sequence[Term] = (), settings: Config | None = None
) -> Job:
    """Check the settings and build what a search or a replay needs.

    search: in place of the settings'. terms: on top of the costs that they name. settings: of this config, where they
    have been checked before.
    Raises HopdiffError, or an OmegaConfBaseException, that names the setting.
    """
    settings = settings or checked(config)
    compiling = choose("compile", settings.compile.lower(), CHOICES)
    dtype = DTYPES[choose("dtype", settings.dtype, DTYPES)]
    device = build_device(settings.device, dtype)
    character = Character.build(settings.character, dtype, device)
    limping = settings.limp.amount > 0
    model = build_model(settings.model, character, settings.limp)
    known = senses(gene_table(str(settings.model["name"]), settings.genes))
    table = GeneTable.build(settings.genes, character.leg_length, settings.speed, dtype, device, limping, known)
    chosen, budget = search or build_search(settings.search), Budget(**vars(settings.budget))
    plain = plain_settings(config)
    costs = build_costs(settings.costs, str(settings.model["name"]))
    problem: BodyProblem | RunProblem
    if isinstance(model, BodyModel):
        assert isinstance(costs, EffortSettings)
        with threads(settings.threads):
            problem = BodyProblem(character, table, model, costs, settings.speed, settings.beta, terms, compiling)
        plain["costs"] = problem.told(plain["costs"])
    else:
        assert isinstance(costs, CostSettings)
        problem = RunProblem(character, table, model, costs, settings.speed, settings.beta, terms)
    plain["search"] = _told(chosen)
    return Job(
        problem=problem,
        table=table,
        search=chosen,
        budget=budget,
        seed=settings.seed,
        fps=settings.fps,
        threads=settings.threads,
        settings=plain,
        saved={name: plain[name] for name in SAVED},
    )


def _told(search: Search) -> dict[str, Any]:
    """A search with those of its settings that are plain data."""
    inside: dict[str, Any] = (
        {entry.name: getattr(search, entry.name) for entry in fields(search)} if is_dataclass(search) else {}
    )
    plain = {name: value for name, value in inside.items() if value is None or isinstance(value, str | int | float)}
    return {**plain, "name": search.name}


def plain_settings(config: DictConfig) -> dict[str, Any]:
    """The whole configuration as plain data."""
    plain: dict[str, Any] = OmegaConf.to_container(config, resolve=True)  # type: ignore[assignment]
    return plain


def check_numbers(settings: Config) -> None:
    """Raises HopdiffError if a top-level number is out of its range."""
    if not (math.isfinite(settings.speed) and settings.speed > 0):
        raise HopdiffError(f"speed must be a number above 0 [m/s], not {told(settings.speed)}.")
    if settings.speed > MAX_SPEED:
        raise HopdiffError(f"speed must be at most {MAX_SPEED:g} m/s, not {told(settings.speed)}.")
    if not 0 <= settings.beta < 1:
        raise HopdiffError(f"beta must be at least 0 and below 1, not {told(settings.beta)}.")
    if not 0 < settings.fps <= MAX_FPS:
        raise HopdiffError(f"fps must be above 0 and at most {MAX_FPS:g} frames/s, not {told(settings.fps)}.")
    if not 0 <= settings.seed < 2**63:
        raise HopdiffError(f"seed must be a whole number from 0 to 2^63 - 1, not {told(settings.seed)}.")
    if settings.threads < 1:
        raise HopdiffError(f"threads must be at least 1, not {told(settings.threads)}.")
    if settings.threads > MAX_THREADS:
        raise HopdiffError(f"threads must be at most {MAX_THREADS}, not {told(settings.threads)}.")


def told(number: float) -> str:
    """A number as a message shows it: short, however many digits were typed."""
    text = f"{number:g}" if isinstance(number, float) else str(number)
    return text if len(text) <= LONGEST_NUMBER else f"{text[:12]}... ({len(text)} digits)"


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
