"""The rows of the objective: what is weighed, priced, measured and kept."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import pytest
import torch

from hopdiff.choices import build_costs
from hopdiff.objective import Term, priced, residuals_of, with_brought
from hopdiff.problem import RunProblem
from hopdiff.types import HopdiffError
from tests.builders import make_problem, settings_of, valid_genes


def row(name: str, view: str = "hopper", weight: float = 1.0) -> Term:
    return Term(name, weight, lambda judged: torch.ones_like(judged.energy), view=view)


def test_the_cost_is_the_sum_of_its_rows() -> None:
    problem = make_problem()
    genes = valid_genes(problem, 4)
    result = problem.evaluate(genes, with_grad=False)
    rows = [result.terms[term.name] for term in problem.terms]
    assert [term.name for term in problem.terms] == [
        "eval",
        "energy_match",
        "leg_force",
        "style",
        "posture",
        "ordinary",
    ]
    assert torch.allclose(sum(rows) + result.terms["penalty"], result.cost)


def test_a_term_given_as_an_object_is_added_with_its_weight() -> None:
    plain = make_problem()
    genes = valid_genes(plain, 3)
    more = RunProblem(
        plain.character, plain.table, plain.model, plain.settings, plain.speed, plain.beta, [row("ones", weight=3.0)]
    )
    gap = more.evaluate(genes, with_grad=False).cost - plain.evaluate(genes, with_grad=False).cost
    assert torch.allclose(gap, torch.full_like(gap, 3.0))


def test_weights_come_from_the_settings_and_are_zero_otherwise() -> None:
    brought = [row("theirs", weight=9.0)]
    assert [term.name for term in with_brought([row("own")], brought, {}, "hopper")] == ["own"]
    (_, theirs) = with_brought([row("own")], brought, {"theirs": 0.5}, "hopper")
    assert (theirs.name, theirs.weight) == ("theirs", 0.5)


@pytest.mark.parametrize(
    ("brought", "extra", "given", "says"),
    [
        ([], {"styel": 1.0}, [], "Unknown setting 'costs.styel'. Did you mean 'style'?"),
        ([row("theirs")], {"theirs": -1.0}, [], "costs.theirs must be a number of 0 or more, not -1.0."),
        ([row("theirs")], {"theirs": float("nan")}, [], "costs.theirs must be a number of 0 or more, not nan."),
        ([row("theirs", "body")], {"theirs": 1.0}, [], "'theirs' judges runs of model=body, not of this one"),
        ([], {}, [row("style")], "two terms of the cost are called 'style'"),
    ],
)
def test_what_cannot_be_weighed_is_refused(
    brought: list[Term], extra: dict[str, float], given: list[Term], says: str
) -> None:
    with pytest.raises(HopdiffError) as refused:
        with_brought([row("style")], brought, extra, "hopper", given)
    assert says in str(refused.value)


def test_a_number_of_no_setting_is_taken_for_a_weight() -> None:
    costs = build_costs({**settings_of("costs", "default"), "theirs": 2}, "smooth")
    assert costs.extra == {"theirs": 2.0}


@pytest.mark.parametrize(
    ("changed", "says"),
    [
        ({"view": "foo"}, "the view of the cost term 'high' must be body or hopper, not 'foo'"),
        ({"weight": math.nan}, "the weight of the cost term 'high' must be 0 or more, not nan"),
        ({"weight": -1.0}, "the weight of the cost term 'high' must be 0 or more, not -1.0"),
        ({"weight": "much"}, "the weight of the cost term 'high' must be 0 or more, not 'much'"),
    ],
)
def test_terms_that_make_no_sense_are_refused(changed: dict[str, Any], says: str) -> None:
    with pytest.raises(HopdiffError, match=says):
        Term(**{"name": "high", "weight": 1.0, "value": torch.zeros_like, **changed})


@pytest.mark.parametrize(
    ("value", "told"),
    [
        (lambda seen: 1.0, "float"),
        (lambda seen: torch.zeros(2, 3), r"\(2, 3\)"),
        (lambda seen: torch.zeros(()), r"\(\)"),
    ],
)
def test_a_term_returns_a_number_for_each_candidate(value: Any, told: str) -> None:
    with pytest.raises(HopdiffError, match=rf"the cost term 'high' must return a tensor of shape \(2,\), not {told}"):
        priced([Term("high", 1.0, value)], None, 2)
    assert priced([Term("high", 3.0, lambda seen: torch.ones(2))], None, 2)["high"].tolist() == [3.0, 3.0]


def test_a_term_without_residuals_counts_as_its_root() -> None:
    judged = SimpleNamespace(x=torch.tensor([[3.0, 4.0], [0.0, 2.0]]))
    plain = Term("plain", 2.0, lambda j: j.x.square().sum(-1), view="hopper")
    rooted = replace(plain, name="rooted", residuals=lambda j: j.x)
    prices = priced([plain, rooted], judged, 2)
    one, many = residuals_of([plain, rooted], judged, prices)
    torch.testing.assert_close(one, torch.tensor([[50.0], [8.0]]).sqrt())
    torch.testing.assert_close(many, 2.0**0.5 * judged.x)
