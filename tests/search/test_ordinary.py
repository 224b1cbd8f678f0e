"""The run without a search."""

from __future__ import annotations

import pytest
import torch

from hopdiff.search.loop import Budget, run_search
from hopdiff.search.ordinary import Ordinary
from hopdiff.types import HopdiffError
from tests.search import problems


class Started(problems.Function):
    """A problem that names its start: the middle of the box."""

    @property
    def start(self) -> torch.Tensor:
        return torch.full((self.dimension,), 0.5, dtype=self.dtype)


def started(of: problems.Function) -> Started:
    return Started(of.f, of.dimension, of.valid)


def test_it_prices_the_start_and_nothing_else() -> None:
    problem = started(problems.sphere())
    problem.keep = True
    result = run_search(problem, Ordinary(), Budget(1000), torch.Generator())
    assert torch.equal(torch.cat(problem.seen), problem.start[None])
    assert torch.equal(result.best_genes, problem.start)
    assert (result.evaluations, result.gradient_evaluations, len(result.history)) == (1, 0, 1)
    assert result.best_cost == float(problem.f(problem.start[None]))


def test_it_says_why_the_start_is_impossible() -> None:
    with pytest.raises(HopdiffError, match=r"^The one candidate tried is not a possible run: .*the body can bear\.$"):
        run_search(started(problems.all_invalid()), Ordinary(), Budget(), torch.Generator())


def test_a_problem_without_a_start_is_refused() -> None:
    with pytest.raises(HopdiffError, match="names no start"):
        run_search(problems.sphere(), Ordinary(), Budget(), torch.Generator())
