"""What many tests start from: a problem or a body, built from the project's own settings."""

from __future__ import annotations

from copy import deepcopy
from dataclasses import replace
from functools import cache
from typing import Any

import torch
from omegaconf import OmegaConf
from torch import Tensor

from hopdiff.character import Character, CharacterSettings
from hopdiff.choices import build_costs
from hopdiff.composing import compose
from hopdiff.config import Config, build_job, checked, typed
from hopdiff.costs import CostSettings
from hopdiff.effort.settings import EffortSettings
from hopdiff.graph.settings import WaySettings
from hopdiff.models.limp import LimpSettings
from hopdiff.problem import RunProblem
from hopdiff.tasks.navigate import NavigateTask


@cache
def make_problem(*overrides: str) -> RunProblem:
    """The problem that these overrides of the command line stand for, of the smooth model if they choose no other.

    Problems hold no state, so one serves all.
    """
    problem = build_job(compose(("model=smooth", *overrides))).problem
    assert isinstance(problem, RunProblem)
    return problem


SCHEMAS = {"character": OmegaConf.structured(CharacterSettings)}


@cache
def _settings(group: str, name: str) -> Any:
    chosen = compose([f"{group}={name}"])[group]
    # Characters leave out what has a value of its own.
    return OmegaConf.to_container(OmegaConf.merge(SCHEMAS[group], chosen) if group in SCHEMAS else chosen)


def settings_of(group: str, name: str) -> dict[str, Any]:
    """A fresh plain copy of one settings file."""
    return deepcopy(_settings(group, name))


@cache
def cost_settings(name: str = "default") -> CostSettings:
    """The costs of one settings file of the smooth and the thesis model."""
    costs = build_costs(settings_of("costs", name), "smooth")
    assert isinstance(costs, CostSettings)
    return costs


@cache
def effort_settings(name: str = "effort") -> EffortSettings:
    """The costs of one settings file of the whole-body model."""
    costs = build_costs(settings_of("costs", name), "body")
    assert isinstance(costs, EffortSettings)
    return costs


def limp_settings(leg: str = "left", amount: float = 0.0, **changed: float) -> LimpSettings:
    """A limp of the project's own settings, changed."""
    return replace(_shared().limp, leg=leg, amount=amount, **changed)


def way_settings(**changed: Any) -> WaySettings:
    """How a way is looked for by the project's own settings, changed."""
    return replace(_walk().way, **changed)


@cache
def _shared() -> Config:
    return checked(compose())


@cache
def _walk() -> NavigateTask:
    walk: NavigateTask = typed(compose(["task=navigate"]), NavigateTask)
    return walk


@cache
def make_character(name: str = "human", dtype: torch.dtype = torch.float64) -> Character:
    return Character.build(OmegaConf.create(_settings("character", name)), dtype)


def random_genes(problem: RunProblem, count: int, seed: int = 0) -> Tensor:
    """(count, G) candidates spread evenly over the unit box, in the problem's dtype."""
    generator = torch.Generator().manual_seed(seed)
    return torch.rand(count, problem.dimension, generator=generator, dtype=torch.float64).to(problem.dtype)


def valid_genes(problem: RunProblem, count: int, seed: int = 0) -> Tensor:
    """(count, G) random candidates that are possible runs."""
    genes = random_genes(problem, 4 * count + 20, seed)
    genes = genes[torch.isfinite(problem.evaluate(genes, with_grad=False).cost)]
    assert len(genes) >= count
    return genes[:count]
