"""A solved movement that others are found beside: the same movements, in fewer rounds, with the same gradient."""

from __future__ import annotations

import pytest
import torch
from torch import Tensor

from hopdiff.whole_body.anchor import Anchor
from hopdiff.whole_body.movement import Movement
from tests.whole_body.bodies import DTYPE, NAMES, genes_of, movement_of


def anchor_of(name: str) -> Anchor:
    found = Anchor.of(lambda genes: movement_of(name, genes), genes_of(name))
    assert found is not None
    return found


def exact(movement: Movement) -> Tensor:
    state, moved = movement.solve(80)
    assert float(moved.max()) < 1e-9
    return state


@pytest.mark.parametrize("name", NAMES)
def test_beside_an_anchor_the_same_movement_is_found_in_fewer_rounds(name: str) -> None:
    anchor = anchor_of(name)
    # A limp further away can be solved in two ways: with the lame foot at the end of its range, or not.
    movement = movement_of(name, genes_of(name, 3, 0.01 if name == "limp" else 0.03))
    wanted = exact(movement)
    guided, moved = movement.solve(8, guide=anchor)
    plain, _ = movement.solve(11)
    error, plain_error = ((x - wanted).abs().amax(-1) for x in (guided, plain))
    # The first is the anchor's own.
    assert float(error[0]) < 1e-6
    assert float(error.max()) < 1e-4
    assert float(error.max()) < 0.1 * float(plain_error.max())
    assert float(moved.max()) < 1e-3


def test_its_guess_is_right_to_the_second_order() -> None:
    anchor = anchor_of("run")
    errors = []
    for size in (0.02, 0.01):
        genes = genes_of("run", 4, size)
        errors.append(float((anchor.guess(genes) - exact(movement_of("run", genes))).abs().max()))
    assert 0.0 < errors[1] < 0.35 * errors[0]


def test_the_gradient_beside_an_anchor_is_that_of_the_solution() -> None:
    anchor = anchor_of("run")
    weights = torch.randn(anchor.state.shape[-1], generator=torch.Generator().manual_seed(1), dtype=DTYPE)

    def gradient(rounds: int, adjoint: int, guide: Anchor | None) -> Tensor:
        genes = {name: value.clone().requires_grad_() for name, value in genes_of("run", 2, 0.02).items()}
        state, _ = movement_of("run", genes).solve(rounds, adjoint, guide)
        found = torch.autograd.grad((state * weights).sum(), list(genes.values()))
        return torch.stack(found, dim=-1)

    wanted, quick = gradient(60, 60, None), gradient(8, 5, anchor)
    assert float((quick - wanted).norm()) < 1e-3 * float(wanted.norm())
    # Without rounds of the adjoint there is only the anchor's own answer.
    assert float((gradient(8, 1, anchor) - wanted).norm()) > 3.0 * float((quick - wanted).norm())


def test_where_no_movement_is_found_there_is_no_anchor() -> None:
    genes = genes_of("run")
    genes["step_time"] = torch.full((1,), torch.nan, dtype=DTYPE)
    assert Anchor.of(lambda near: movement_of("run", near), genes) is None
