"""What every search owes, whatever its method."""

import re
from dataclasses import FrozenInstanceError, fields
from pathlib import Path

import pytest
import torch
from omegaconf import OmegaConf

from hopdiff.doors import SEARCHES as DOOR
from hopdiff.search.base import Search
from hopdiff.search.gradient import Gradient
from hopdiff.search.hybrid import Hybrid
from hopdiff.search.loop import Budget, SearchResult, run_search
from hopdiff.types import HopdiffError
from tests.search import problems

SEARCHES = {name: DOOR.load(name) for name in DOOR.own}
CONF = Path(__file__).parents[2] / "conf" / "search"
CASES = {
    # `ordinary` does not search: tests of its own.
    **{name: search() for name, search in SEARCHES.items() if name != "ordinary"},
    "adam": Gradient(method="adam"),
    "baldwin": Hybrid(write_back=False),
}
EVERY = pytest.mark.parametrize("search", CASES.values(), ids=CASES.keys())


def run(search: Search, problem: problems.Function, evaluations: int = 1500, seed: int = 0) -> SearchResult:
    return run_search(problem, search, Budget(evaluations), torch.Generator().manual_seed(seed))


@pytest.mark.few(4)
@EVERY
@pytest.mark.parametrize("make", [problems.kinked, problems.half_invalid, problems.patchy])
def test_a_seed_repeats_exactly_and_another_differs(search, make):
    first, second, other = (run(search, make(), seed=seed) for seed in (3, 3, 4))
    assert torch.equal(first.best_genes, second.best_genes)
    rows = [[str(row._replace(seconds=0)) for row in result.history] for result in (first, second)]
    assert rows[0] == rows[1]
    assert first.history[0].median != other.history[0].median


@pytest.mark.few(4)
@EVERY
@pytest.mark.parametrize("make", [problems.corner, problems.half_invalid, problems.rastrigin])
def test_never_leaves_the_box(search, make):
    problem = make()
    problem.keep = True
    run(search, problem)
    seen = torch.cat(problem.seen)
    assert seen.isfinite().all()
    assert seen.min() >= 0
    assert seen.max() <= 1


@EVERY
@pytest.mark.parametrize("evaluations", [1, 37, 1001])
@pytest.mark.parametrize("price", [0.0, 2.5])
def test_budget_is_counted_row_by_row_and_never_exceeded(search, evaluations, price):
    problem = problems.sphere()
    result = run_search(problem, search, Budget(evaluations, price), torch.Generator().manual_seed(0))
    assert result.evaluations == problem.evaluated
    assert result.gradient_evaluations == problem.differentiated
    assert result.spent == problem.evaluated + price * problem.differentiated
    assert result.spent <= evaluations
    assert result.stopped == "converged" or evaluations - (1 + price) < result.spent
    assert result.history[-1].spent == result.spent


@EVERY
@pytest.mark.parametrize("make", [problems.rastrigin, problems.half_invalid])
def test_best_never_rises_and_is_what_the_genes_cost(search, make):
    problem = make()
    result = run(search, problem)
    best = [row.best for row in result.history]
    assert best == sorted(best, reverse=True)
    cost = problem.evaluate(result.best_genes[None], with_grad=False).cost
    torch.testing.assert_close(cost, cost.new_tensor([result.best_cost]), rtol=1e-12, atol=0)


@pytest.mark.few(5)
@pytest.mark.parametrize("name", [name for name in CASES if name != "random"])
@pytest.mark.parametrize("make", [problems.ellipsoid, problems.half_invalid, problems.corner, problems.kinked])
def test_beats_random_search(name, make):
    floor = [run(CASES["random"], make(), 2000, seed).best_cost for seed in range(3)]
    found = [run(CASES[name], make(), 2000, seed).best_cost for seed in range(3)]
    assert max(found) < min(floor)


@EVERY
def test_lives_with_numbers_that_are_not(search):
    result = run(search, problems.patchy())
    assert 0 < result.invalid_fraction < 1
    assert result.best_genes[0] <= 0.7
    assert result.best_cost < 1


@EVERY
def test_says_so_when_nothing_is_valid(search):
    with pytest.raises(HopdiffError, match=r"None of the \d+ candidates .*push harder than the body can bear\.$"):
        run(search, problems.all_invalid(), 500)


@EVERY
def test_works_in_float32_and_in_one_dimension(search):
    for dimension in (1, 6):
        problem = problems.sphere(dimension)
        problem.dtype = torch.float32
        problem.keep = True
        result = run(search, problem, 600)
        assert {batch.dtype for batch in problem.seen} == {torch.float32}
        assert result.best_cost < 0.2


@EVERY
def test_gives_the_callers_random_numbers_no_say(search):
    torch.manual_seed(0)
    first = run(search, problems.kinked(), 600)
    torch.manual_seed(1)
    assert run(search, problems.kinked(), 600).best_cost == first.best_cost


@pytest.mark.parametrize("name", SEARCHES)
def test_config_file_says_every_setting_and_no_default(name):
    text = (CONF / f"{name}.yaml").read_text(encoding="utf-8")
    search = SEARCHES[name]
    assert dict(OmegaConf.create(text)) == {"name": name}
    told = re.findall(r"^#   (\w+)", text, re.MULTILINE)
    assert told == [entry.name for entry in fields(search) if entry.name != "name"]
    with pytest.raises(FrozenInstanceError):
        search().name = "other"


def test_there_is_a_config_file_for_every_search():
    assert sorted(path.stem for path in CONF.glob("*.yaml")) == sorted(SEARCHES)
    assert all(search().name == name for name, search in SEARCHES.items())


@pytest.mark.parametrize(
    ("name", "setting", "value"),
    [
        ("random", "population", 0),
        ("ga", "population", 1),
        ("ga", "elites", 100),
        ("ga", "pressure", 2.5),
        ("ga", "crossover", -0.1),
        ("ga", "sigma", float("nan")),
        ("cmaes", "population", 2),
        ("cmaes", "restarts", -1),
        ("ga", "patience", 0),
        ("gradient", "restarts", -1),
        ("gradient", "gain", 2.0),
        ("hybrid", "restarts", -1),
        ("cmaes", "growth", 0.5),
        ("gradient", "starts", 0),
        ("gradient", "screen", 0),
        ("gradient", "method", "newton"),
        ("hybrid", "climbers", 0),
        ("hybrid", "share", 0.6),
        ("hybrid", "mutation", 1.5),
    ],
)
def test_wrong_settings_are_named(name, setting, value):
    with pytest.raises(HopdiffError, match=rf"^search\.{setting} must be .*, not .*\.$"):
        SEARCHES[name](**{setting: value})


def test_a_screening_holds_the_starts_that_are_taken_from_it():
    with pytest.raises(HopdiffError, match=r"^search\.screen must be .*, not 3\.$"):
        SEARCHES["gradient"](starts=16, screen=3)


@pytest.mark.parametrize(
    ("name", "setting", "low", "high"),
    [
        ("random", "population", 1, None),
        ("ga", "elites", 0, 99),
        ("ga", "pressure", 1, 2),
        ("ga", "stretch", 0, None),
        ("ga", "sigma", 0, None),
        ("ga", "sigma_floor", 0, None),
        *(("ga", share, 0, 1) for share in ("crossover", "blend", "mutation", "sigma_decay")),
        ("cmaes", "population", 3, None),
        ("cmaes", "restarts", 0, None),
        ("ga", "patience", 1, None),
        ("ga", "gain", 0, 1),
        ("gradient", "restarts", 0, None),
        ("gradient", "gain", 0, 1),
        ("hybrid", "restarts", 0, None),
        ("hybrid", "gain", 0, 1),
        ("cmaes", "sigma", 1e-6, 1),
        ("cmaes", "growth", 1, None),
        ("cmaes", "patience", 1, None),
        ("cmaes", "tolerance", 0, None),
        ("gradient", "starts", 1, 128),
        ("gradient", "screen", 1, None),
        ("gradient", "reach", 1e-6, None),
        ("gradient", "tolerance", 0, None),
        ("gradient", "patience", 1, None),
        ("gradient", "rate", 1e-6, 1),
        ("gradient", "steps", 1, None),
        ("hybrid", "population", 2, None),
        ("hybrid", "children", 1, None),
        ("hybrid", "climbers", 1, None),
        ("hybrid", "renew", 1, None),
        ("hybrid", "misses", 1, None),
        ("hybrid", "share", 0, 0.5),
        ("hybrid", "apart", 0, 1),
        ("hybrid", "reach", 1e-6, None),
        ("hybrid", "tolerance", 0, None),
        ("hybrid", "patience", 1, None),
    ],
)
def test_settings_reach_to_their_bounds_and_no_further(name, setting, low, high):
    more = 1 if isinstance(low, int) and setting not in ("sigma", "apart") else 1e-3
    for value, beyond in ((low, low - more), (high, None if high is None else high + more)):
        if value is not None:
            SEARCHES[name](**{setting: value})
            if setting != "starts" or beyond < 1:
                with pytest.raises(HopdiffError, match=rf"^search\.{setting} must be"):
                    SEARCHES[name](**{setting: beyond})
