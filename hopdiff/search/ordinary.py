"""No search: the one point that the problem itself would try first."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from hopdiff.search.base import Eval, Problem
from hopdiff.types import HopdiffError


@dataclass(frozen=True)
class Ordinary:
    """Prices the start of the problem and is done. The state is what is left to ask for: one point, then none."""

    name: str = "ordinary"

    def init(self, problem: Problem, generator: torch.Generator) -> Tensor:
        """Raises HopdiffError if the problem names no start."""
        start = getattr(problem, "start", None)
        if start is None:
            raise HopdiffError("search=ordinary has nothing to try: this problem names no start.")
        found: Tensor = start.unsqueeze(0)
        return found

    def ask(self, state: Tensor, generator: torch.Generator) -> tuple[Tensor, bool]:
        return state, False

    def tell(self, state: Tensor, genes: Tensor, result: Eval, generator: torch.Generator) -> Tensor:
        return state[:0]


SEARCH = Ordinary
