"""The genetic algorithm: who breeds, and what children look like."""

import math
from functools import partial

import pytest
import torch

from hopdiff.search.base import Eval
from hopdiff.search.box import Box
from hopdiff.search.ga import GA, Population
from tests.counting import calls
from tests.search import problems
from tests.search.driving import told

BOX = Box(3, torch.float64, torch.device("cpu"))


def seeded(seed=0):
    return torch.Generator().manual_seed(seed)


def people(genes, cost, generation=1):
    group = Population.empty(BOX)._replace(generation=generation).joined(genes, cost)
    return GA(population=2, elites=0).steered(group, group.signals.tolist())._replace(generation=generation)


def answer(cost):
    return Eval(cost, None, cost, {}, torch.zeros(len(cost), dtype=torch.int64))


def test_invalid_ones_are_removed_and_the_rest_is_sorted():
    genes = torch.arange(12.0, dtype=torch.float64).view(4, 3)
    group = people(genes, torch.tensor([3.0, math.inf, 1.0, 2.0], dtype=torch.float64))
    assert group.cost.tolist() == [1.0, 2.0, 3.0]
    assert torch.equal(group.genes, genes[[2, 3, 0]])


def test_chance_falls_linearly_with_rank():
    n = 5
    group = people(torch.arange(n, dtype=torch.float64)[:, None].expand(n, 3) / n, torch.arange(n, dtype=torch.float64))
    clones = GA(crossover=0.0, mutation=0.0, pressure=1.8).breed(group, 200_000, seeded())
    share = torch.bincount((clones[:, 0] * n).round().long(), minlength=n) / len(clones)
    expected = torch.linspace(1.8, 0.2, n) / n
    torch.testing.assert_close(share, expected, atol=0.004, rtol=0)


def test_a_swapped_gene_comes_from_either_parent():
    group = people(torch.tensor([[0.2] * 3, [0.6] * 3], dtype=torch.float64), torch.zeros(2, dtype=torch.float64))
    children = GA(crossover=1.0, blend=0.0, mutation=0.0, pressure=1.0).breed(group, 2000, seeded())
    assert set(children.unique().tolist()) == {0.2, 0.6}
    assert (children[:, 0] != children[:, 1]).any()


def test_a_mixed_gene_lies_between_the_parents_or_a_stretch_beyond():
    group = people(torch.tensor([[0.4] * 3, [0.6] * 3], dtype=torch.float64), torch.zeros(2, dtype=torch.float64))
    children = GA(crossover=1.0, blend=1.0, mutation=0.0, stretch=0.5, pressure=1.0).breed(group, 5000, seeded())
    assert children.min() == pytest.approx(0.3, abs=2e-3)
    assert children.max() == pytest.approx(0.7, abs=2e-3)


def test_mutations_shrink_generation_by_generation():
    settings = GA(crossover=0.0, mutation=0.5, sigma=0.1, sigma_decay=0.5, sigma_floor=0.02)
    spreads = []
    for generation in (1, 2, 9):
        group = people(torch.full((4, 3), 0.5, dtype=torch.float64), torch.zeros(4, dtype=torch.float64), generation)
        change = settings.breed(group, 20_000, seeded()) - 0.5
        assert float((change != 0).double().mean()) == pytest.approx(0.5, abs=0.01)
        spreads.append(float(change[change != 0].std()))
    assert spreads == pytest.approx([0.1, 0.05, 0.02], rel=0.02)


def test_elites_live_on_without_being_priced_again():
    settings, generator = GA(population=20, elites=3), seeded()
    problem = problems.sphere(3)
    state = settings.init(problem, generator)
    for _ in range(5):
        genes, with_grad = settings.ask(state, generator)
        assert not with_grad
        assert len(genes) == (20 if state.generation == 0 else 17)
        best = state.genes[:3]
        state = told(settings, state, genes, problem.evaluate(genes, False), generator)
        assert all((state.genes == elite).all(1).any() for elite in best)


def test_all_invalid_means_a_new_random_population():
    settings, generator = GA(population=20, elites=0), seeded()
    state = settings.init(problems.sphere(3), generator)
    first, _ = settings.ask(state, generator)
    state = told(settings, state, first, answer(first.sum(1)), generator)
    children, _ = settings.ask(state, generator)
    state = told(settings, state, children, answer(torch.full((20,), math.inf)), generator)
    assert len(state.genes) == 0
    again, _ = settings.ask(state, generator)
    assert again.shape == (20, 3)
    assert not torch.equal(again, first)


def test_first_generation_is_drawn_on_until_a_tenth_is_valid():
    settings, generator = GA(population=40), seeded()
    state = settings.init(problems.sphere(3), generator)
    for valid_so_far in (1, 2, 3, 4):
        genes, _ = settings.ask(state, generator)
        cost = torch.full((40,), math.inf, dtype=torch.float64)
        cost[7] = 1.0
        state = told(settings, state, genes, answer(cost), generator)
        assert len(state.genes) == valid_so_far
        assert state.generation == (valid_so_far == 4)


def test_a_generation_is_bred_without_a_loop_over_individuals():
    counts = set()
    for population in (50, 100, 1000):
        settings, generator, problem = GA(population=population), seeded(), problems.sphere(30)
        state = settings.init(problem, generator)
        genes, _ = settings.ask(state, generator)
        state = told(settings, state, genes, problem.evaluate(genes, False), generator)
        children, _ = settings.ask(state, generator)
        result = problem.evaluate(children, False)
        bred = calls(partial(settings.ask, state, generator))
        chosen = calls(partial(settings.tell, state, children, result, generator))
        counts.add((bred, chosen))
    # Whatever the number of individuals.
    assert len(counts) == 1
    assert max(counts.pop()) < 200


def test_a_search_without_progress_is_over():
    """Half a per cent a generation is progress of a thousandth, a hundredth of that is not."""
    settings, generator = GA(population=10, elites=0, patience=3), seeded()
    state = settings.init(problems.sphere(3), generator)
    story = []
    for best in (10.0, 9.95, 9.949, 9.948, 9.93, 9.93, 9.93, 9.93):
        assert not settings.finished(state)
        genes, _ = settings.ask(state, generator)
        cost = best + torch.arange(len(genes), dtype=torch.float64)
        state = told(settings, state, genes, answer(cost), generator)
        story.append(state.idle)
    assert story == [0, 0, 1, 2, 0, 1, 2, 3]
    assert settings.finished(state)
