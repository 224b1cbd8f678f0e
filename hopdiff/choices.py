"""Groups of settings whose schema depends on what was chosen: searches by their names, costs by the model."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from typing import Any

from omegaconf import OmegaConf
from omegaconf.errors import OmegaConfBaseException

from hopdiff.costs import CostSettings
from hopdiff.effort.settings import EffortSettings
from hopdiff.messages import choose, one_line
from hopdiff.search import SEARCHES
from hopdiff.search.base import Search
from hopdiff.types import HopdiffError


def build_search(settings: Mapping[str, Any]) -> Search:
    """The search that `name` stands for. Raises HopdiffError for an unknown name or setting, or a wrong value."""
    name = choose("search.name", str(settings.get("name")), SEARCHES)
    search: Search = _structured("search", name, SEARCHES[name], settings)
    return search


def build_costs(settings: Mapping[str, Any], model: str) -> CostSettings | EffortSettings:
    """The costs of a model. Raises HopdiffError for those of another one, an unknown setting, or a wrong value."""
    name, whole = str(settings.get("name")), "positive_work" in settings
    if whole != (model == "body"):
        fitting = "human or effort" if model == "body" else "default or thesis"
        raise HopdiffError(f"costs={name} cannot judge runs of model={model}: take costs={fitting}.")
    costs: CostSettings | EffortSettings = _structured(
        "costs", name, EffortSettings if whole else CostSettings, settings
    )
    return costs


def _structured(group: str, name: str, schema: type, settings: Mapping[str, Any]) -> Any:
    """Settings of a group as an object of its class. Raises HopdiffError, naming the setting."""
    known = [entry.name for entry in fields(schema)]
    for key in settings:
        choose(f"setting of {group} {name}", key, known)
    structured = OmegaConf.structured(schema)
    OmegaConf.set_readonly(structured, False)
    try:
        return OmegaConf.to_object(OmegaConf.merge(structured, dict(settings)))
    except OmegaConfBaseException as error:
        raise HopdiffError(f"{group}.{error.full_key}: {one_line(error)}") from error
