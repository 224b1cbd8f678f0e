"""The genetic algorithm of the thesis: what is in print, and the plain choices where nothing is."""

from __future__ import annotations

import math

import pytest
import torch
from torch import Tensor

from hopdiff.search.base import Eval
from hopdiff.search.box import Box
from hopdiff.search.ga_thesis import GAThesis
from hopdiff.search.loop import Budget, run_search
from hopdiff.types import HopdiffError
from tests.search.driving import told as answered


class Bowl:
    """Squared distance from .3; beyond `wall` in the first gene nothing is possible."""

    dimension, dtype, device = 4, torch.float64, torch.device("cpu")

    def __init__(self, wall: float = 1.0) -> None:
        self.wall = wall

    def evaluate(self, genes: Tensor, with_grad: bool) -> Eval:
        cost = ((genes - 0.3) ** 2).sum(-1).where(genes[:, 0] <= self.wall, math.inf)
        return Eval(cost, None, cost, {}, torch.zeros(len(genes), dtype=torch.long))


def told(search: GAThesis, problem: Bowl, seed: int = 0) -> tuple[object, Tensor]:
    generator = torch.Generator().manual_seed(seed)
    state = search.init(problem, generator)
    first, _ = search.ask(state, generator)
    state = answered(search, state, first, problem.evaluate(first, False), generator)
    return state, search.ask(state, generator)[0]


def test_the_impossible_is_removed_and_the_rest_ranked() -> None:
    state, _ = told(GAThesis(), Bowl(0.5))
    assert (state.genes[:, 0] <= 0.5).all()  # type: ignore[attr-defined]
    assert 30 < len(state.genes) < 70  # type: ignore[attr-defined]
    assert state.cost.diff().min() >= 0  # type: ignore[attr-defined]


def test_children_take_the_beginning_of_one_parent_and_the_end_of_another() -> None:
    search = GAThesis(population=200, mutation=0.0)
    state, children = told(search, Bowl())
    parents = state.genes  # type: ignore[attr-defined]
    own = [(children[:, None, k] == parents[None, :, k]) for k in range(4)]
    assert all(bool(column.any(1).all()) for column in own)
    for child in range(len(children)):
        cuts = [
            cut
            for cut in (1, 2, 3)
            if torch.stack([own[k][child] for k in range(cut)]).all(0).any()
            and torch.stack([own[k][child] for k in range(cut, 4)]).all(0).any()
        ]
        assert cuts


def test_better_ranks_breed_more_from_twice_the_average_to_none() -> None:
    search = GAThesis(population=4000, mutation=0.0, crossover=0.0)
    generator = torch.Generator().manual_seed(1)
    parents = told(GAThesis(population=5), Bowl())[0]
    children = search._bred(parents, generator)  # type: ignore[arg-type]
    counts = [int((children == row).all(-1).sum()) for row in parents.genes]  # type: ignore[attr-defined]
    expected = [1600, 1200, 800, 400, 0]
    assert counts == pytest.approx(expected, abs=120)


def test_a_child_has_one_random_gene_on_average_and_nothing_lives_on() -> None:
    search = GAThesis(population=2000)
    state, children = told(search, Bowl())
    fresh = ~torch.stack([(children[:, None, k] == state.genes[None, :, k]).any(1) for k in range(4)], -1)  # type: ignore[attr-defined]
    assert float(fresh.double().sum(-1).mean()) == pytest.approx(1.0, abs=0.1)
    generator = torch.Generator().manual_seed(3)
    after = answered(search, state, children, Bowl().evaluate(children, False), generator)  # type: ignore[arg-type]
    assert after.generation == 2
    assert len(after.genes) == 2000


def test_a_generation_without_two_possible_ones_is_drawn_anew() -> None:
    search, problem = GAThesis(population=10), Bowl(-1.0)
    _, again = told(search, problem)
    assert again.shape == (10, 4)
    box = Box.of(problem)
    generator = torch.Generator().manual_seed(0)
    box.uniform(10, generator)
    assert torch.equal(again, box.uniform(10, generator))


def test_it_comes_down_in_a_hundred_generations() -> None:
    result = run_search(Bowl(0.6), GAThesis(), Budget(10_000), torch.Generator().manual_seed(0))
    assert result.best_cost < 1e-3
    assert len(result.history) == 100


def test_settings_out_of_range_get_a_sentence() -> None:
    for name, value in (("population", 1), ("crossover", 1.5), ("mutation", -0.1)):
        with pytest.raises(HopdiffError, match=f"search.{name}"):
            GAThesis(**{name: value})  # type: ignore[arg-type]
