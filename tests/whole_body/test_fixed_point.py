"""The iteration, on linear maps whose solution and gradient are known."""

from __future__ import annotations

import pytest
import torch
from torch import Tensor

from hopdiff.whole_body.fixed_point import REBUILT, fixed_point
from tests.whole_body.bodies import DTYPE

SIZE = 6


def contractions(count: int, size: float = 0.7, seed: int = 0) -> Tensor:
    """(count, SIZE, SIZE) matrices of spectral norm `size`."""
    matrices = torch.randn(count, SIZE, SIZE, generator=torch.Generator().manual_seed(seed), dtype=DTYPE)
    return size * matrices / torch.linalg.matrix_norm(matrices, 2)[:, None, None]


def linear(matrices: Tensor, shift: Tensor, rounds: int, adjoint_rounds: int = 0) -> tuple[Tensor, Tensor]:
    def one_round(state: Tensor, told: None) -> Tensor:
        return (matrices @ state.unsqueeze(-1))[..., 0] + shift

    return fixed_point(
        torch.zeros(len(matrices), SIZE, dtype=DTYPE), one_round, lambda state: None, rounds, adjoint_rounds
    )


def exact(matrices: Tensor, shift: Tensor) -> Tensor:
    return torch.linalg.solve(torch.eye(SIZE, dtype=DTYPE) - matrices, shift)


def test_a_linear_map_comes_to_rest_at_its_solution() -> None:
    matrices, shift = contractions(3), torch.randn(3, SIZE, generator=torch.Generator().manual_seed(1), dtype=DTYPE)
    state, moved = linear(matrices, shift, 40)
    torch.testing.assert_close(state, exact(matrices, shift), rtol=0.0, atol=1e-8)
    assert float(moved.max()) < 1e-7
    # Drawing on the last rounds is quicker than going from one to the next.
    plain = torch.zeros(3, SIZE, dtype=DTYPE)
    for _ in range(14):
        plain = (matrices @ plain.unsqueeze(-1))[..., 0] + shift
    quick, _ = linear(matrices, shift, 14)
    wanted = exact(matrices, shift)
    assert float((quick - wanted).abs().max()) < 0.2 * float((plain - wanted).abs().max())


def test_moved_is_how_far_the_last_round_went() -> None:
    matrices, shift = contractions(2), torch.ones(2, SIZE, dtype=DTYPE)
    _, moved = linear(matrices, shift, 1)
    torch.testing.assert_close(moved, torch.ones(2, dtype=DTYPE))
    # The last round is a plain one.
    state, moved = linear(matrices, shift, 2)
    second = (matrices @ shift.unsqueeze(-1))[..., 0]
    torch.testing.assert_close(moved, second.abs().amax(-1))
    torch.testing.assert_close(state, shift + second)


def test_the_gradient_is_that_of_the_solution() -> None:
    matrices = contractions(3)
    shift = torch.randn(3, SIZE, generator=torch.Generator().manual_seed(2), dtype=DTYPE).requires_grad_()
    weights = torch.randn(3, SIZE, generator=torch.Generator().manual_seed(3), dtype=DTYPE)
    state, _ = linear(matrices, shift, 60, 80)
    (found,) = torch.autograd.grad((state * weights).sum(), shift)
    (wanted,) = torch.autograd.grad((exact(matrices, shift) * weights).sum(), shift)
    torch.testing.assert_close(found, wanted, rtol=0.0, atol=1e-9)
    # Few rounds of the adjoint give the first terms of its series.
    state, _ = linear(matrices, shift, 60, 2)
    (short,) = torch.autograd.grad((state * weights).sum(), shift)
    turned = matrices.transpose(1, 2)
    once = (turned @ weights.unsqueeze(-1))[..., 0]
    twice = (turned @ once.unsqueeze(-1))[..., 0]
    torch.testing.assert_close(short, weights + once + twice, rtol=0.0, atol=1e-9)


def test_without_adjoint_rounds_there_is_no_gradient() -> None:
    shift = torch.ones(1, SIZE, dtype=DTYPE, requires_grad=True)
    state, _ = linear(contractions(1), shift, 5)
    assert not state.requires_grad


def test_what_a_round_is_told_is_worked_out_before_the_rounds_that_say_so() -> None:
    heard, states = [], []

    def prepare(state: Tensor) -> int:
        states.append(state.clone())
        return len(states)

    def one_round(state: Tensor, told: int) -> Tensor:
        heard.append(told)
        return 0.5 * state + 1.0

    fixed_point(torch.zeros(1, 1, dtype=DTYPE), one_round, prepare, 8, 0)
    # And once before all rounds.
    assert heard == [1 + sum(k >= first for first in REBUILT) for k in range(8)]
    assert len(states) == 1 + len(REBUILT)


@pytest.mark.parametrize("wrong", [float("nan"), float("inf"), 1e200])
def test_a_candidate_that_runs_away_does_not_touch_its_neighbours(wrong: float) -> None:
    matrices, shift = contractions(3), torch.ones(3, SIZE, dtype=DTYPE)
    spoiled = shift.clone()
    spoiled[1] = wrong
    wild = matrices.clone()
    wild[1] *= 1e3
    alone, _ = linear(matrices[[0, 2]], shift[[0, 2]], 12)
    beside, moved = linear(wild, spoiled, 12)
    torch.testing.assert_close(beside[[0, 2]], alone, rtol=0.0, atol=1e-12)
    assert not float(moved[1]) < 1.0
