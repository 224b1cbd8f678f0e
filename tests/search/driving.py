"""Searches driven by hand."""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor

from hopdiff.search.base import Eval


def told(search: Any, state: Any, genes: Tensor, result: Eval, generator: torch.Generator) -> Any:
    """The state after an answer, with its signals read as the loop reads them."""
    state = search.tell(state, genes, result, generator)
    signals = search.signals(state)
    return state if signals is None else search.steered(state, signals.tolist())
