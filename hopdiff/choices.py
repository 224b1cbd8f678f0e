"""Groups of settings whose schema depends on what was chosen: searches and models by name, costs by the model."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from types import NoneType, UnionType
from typing import Any, Union, get_args, get_origin, get_type_hints

from omegaconf import OmegaConf
from omegaconf.errors import OmegaConfBaseException

from hopdiff.character import Character
from hopdiff.costs import CostSettings
from hopdiff.doors import SEARCHES
from hopdiff.effort.settings import EffortSettings
from hopdiff.messages import choose, one_line, wrong_value
from hopdiff.models import MODELS, AnyModel
from hopdiff.models.limp import LimpSettings
from hopdiff.search.base import Search
from hopdiff.types import HopdiffError


def build_search(settings: Mapping[str, Any]) -> Search:
    """The search that `name` stands for. Raises HopdiffError for an unknown name or setting, or a wrong value."""
    name = str(settings.get("name"))
    schema = SEARCHES.load(name, "search.name")
    if not (isinstance(schema, type) and is_dataclass(schema)):
        raise HopdiffError(f"search={name} cannot be set up: {schema!r} is no dataclass.")
    own = {entry.name for entry in fields(schema)}
    given = settings if "name" in own else {key: value for key, value in settings.items() if key != "name"}
    search: Search = structured("search", name, schema, given)
    return search


def build_model(settings: Mapping[str, Any], character: Character, limp: LimpSettings) -> AnyModel:
    """The model that `name` stands for. Raises HopdiffError, naming the setting, for an unknown or a wrong one."""
    name = choose("model.name", str(settings.get("name")), MODELS)
    own = structured("model", name, MODELS[name], settings)
    limp.check()
    model: AnyModel = own.build(character, limp if limp.amount > 0 else None)
    return model


def build_costs(settings: Mapping[str, Any], model: str) -> CostSettings | EffortSettings:
    """The costs of a model. Raises HopdiffError for those of another one, an unknown setting, or a wrong value.

    Numbers under names that the class does not have are gathered in `extra`: weights of terms; the problem checks them.
    """
    name, whole = str(settings.get("name")), "positive_work" in settings
    if whole != (model == "body"):
        fitting = "human or effort" if model == "body" else "default or thesis"
        raise HopdiffError(f"costs={name} cannot judge runs of model={model}: take costs={fitting}.")
    schema = EffortSettings if whole else CostSettings
    own = {entry.name for entry in fields(schema)}
    extra = {key: value for key, value in settings.items() if key not in own and isinstance(value, int | float)}
    rest = {key: value for key, value in settings.items() if key not in extra}
    costs: CostSettings | EffortSettings = structured("costs", name, schema, {**rest, "extra": extra})
    return costs


def structured(group: str, name: str, schema: type, settings: Mapping[str, Any]) -> Any:
    """Settings of a group as an object of its class. Raises HopdiffError, naming the setting."""
    known = [entry.name for entry in fields(schema)]
    for key in settings:
        choose(f"setting of {group} {name}", key, known)
    typed = OmegaConf.structured(schema)
    OmegaConf.set_readonly(typed, False)
    try:
        return OmegaConf.to_object(OmegaConf.merge(typed, with_floats(schema, dict(settings))))
    except OmegaConfBaseException as error:
        key = f"{group}.{error.full_key}"
        raise HopdiffError(wrong_value(key, str(error)) or f"{key}: {one_line(error)}") from error


def with_floats(hint: Any, value: Any) -> Any:
    """Plain data with whole numbers made floats wherever a type hint asks for floats, inside of lists and tables too.

    OmegaConf does so for a float by itself, and refuses [0, 150] for a list of floats.
    """
    if hint is float and isinstance(value, int) and not isinstance(value, bool):
        return float(value)
    if isinstance(hint, type) and is_dataclass(hint) and isinstance(value, Mapping):
        hints = get_type_hints(hint)
        return {name: with_floats(hints.get(name), one) for name, one in value.items()}
    inside = get_args(hint)
    if get_origin(hint) is list and isinstance(value, list):
        return [with_floats(inside[0], one) for one in value]
    if get_origin(hint) is dict and isinstance(value, Mapping):
        return {name: with_floats(inside[1], one) for name, one in value.items()}
    if get_origin(hint) in (Union, UnionType):
        return with_floats(next(one for one in inside if one is not NoneType), value)
    return value
