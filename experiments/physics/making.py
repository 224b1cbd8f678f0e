"""Runs to be checked: searched, and written as NumPy archives. What checks them knows nothing of this module."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from omegaconf import OmegaConf

import hopdiff
from hopdiff.composing import compose
from hopdiff.export.tables import write_npz

FRAME_RATE = 960.0  # frames/s
OWN_RATES = {"thesis": 200.0}  # it is stepped, and straight between its steps: in between there is nothing to see


def make(model: str, speed: float, beta: float, seed: int, folder: Path, chosen: dict[str, Any]) -> Path:
    """Search for a run and write its frames. chosen: further settings of the search.

    Raises HopdiffError where there is no such model or no run.
    """
    run = hopdiff.generate(speed, beta, seed=seed, model=model, fps=OWN_RATES.get(model, FRAME_RATE), **chosen)
    own = folder / f"{model}_v{speed:g}_b{beta:g}_s{seed}"
    own.mkdir(parents=True, exist_ok=True)
    path = own / "motion.npz"
    write_npz(path, run.take())
    return path


def made_with(model: str, chosen: dict[str, Any]) -> str:
    """The objective, its weights and the priors of the runs that `make` makes, in one line."""
    config = OmegaConf.to_container(compose([f"model={model}"]), resolve=True)
    assert isinstance(config, dict)
    spent = chosen.get("evaluations", config["budget"]["evaluations"])
    parts = [f"search {config['search']['name']}, {spent} evaluations"]
    parts += [f"genes {config['genes']['name']}", f"costs {config['costs']['name']}"]
    parts += [
        f"{name} {value:g}" if isinstance(value, float) else f"{name} {value}" for name, value in _flat(config["costs"])
    ]
    return ", ".join(parts)


def _flat(values: Mapping[Any, Any], above: str = "") -> Iterator[tuple[str, Any]]:
    """Every setting that is not switched off, by its whole name."""
    for name, value in values.items():
        if isinstance(value, Mapping):
            yield from _flat(value, f"{above}{name}.")
        elif value and name != "name":
            yield f"{above}{name}", value
