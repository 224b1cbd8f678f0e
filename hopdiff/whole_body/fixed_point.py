"""Solving state = round(state) for many candidates at once, and its gradient."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from typing import Any

import torch
from torch import Tensor

MEMORY = 4  # rounds that the next guess is drawn from
REBUILT = (1, 3)  # rounds before which what a round is told is worked out anew, after the first


class _Recent:
    """Anderson (1965) mixing: the next guess is where the last few rounds, taken for linear, would come to rest."""

    def __init__(self) -> None:
        self.states: list[Tensor] = []
        self.steps: list[Tensor] = []

    def next(self, state: Tensor, step: Tensor) -> Tensor:
        """states, steps: (P, K)."""
        self.states, self.steps = [*self.states, state][-MEMORY:], [*self.steps, step][-MEMORY:]
        if len(self.states) < 2:
            return state + step
        bends = torch.stack([b - a for a, b in pairwise(self.steps)], dim=-1)
        moves = torch.stack([b - a for a, b in pairwise(self.states)], dim=-1)
        normal = bends.transpose(1, 2) @ bends
        size = normal.diagonal(dim1=1, dim2=2).amax(-1).clamp_min(1e-30)
        normal = normal + 1e-10 * size[:, None, None] * torch.eye(normal.shape[-1]).to(state)
        # A candidate that has run away must not stop the others.
        normal = torch.where(
            normal.isfinite().all(-1).all(-1)[:, None, None], normal, torch.eye(normal.shape[-1]).to(state)
        )
        shares = torch.linalg.solve(normal, bends.transpose(1, 2) @ step.unsqueeze(-1))
        found: Tensor = state + step - ((moves + bends) @ shares).squeeze(-1)
        return found


def fixed_point(
    start: Tensor,
    one_round: Callable[[Tensor, Any], Tensor],
    prepare: Callable[[Tensor], Any],
    rounds: int,
    adjoint_rounds: int,
    answer: Tensor | None = None,
) -> tuple[Tensor, Tensor]:
    """The state (P, K) after `rounds` of `one_round`, and how far the last of them moved it (P,).

    prepare: what a round is told, worked out from the state now and then. With adjoint_rounds the state carries the
    gradient of the fixed point: the adjoint equation is solved by as many rounds of its own.
    answer: (K, K) about the inverse of 1 - d(round)/d(state), row vectors from the left: every step, and every one of
    the adjoint, is multiplied by it, and what a round is told stays as it was at the start.
    """

    def guided(step: Tensor) -> Tensor:
        return step if answer is None else step @ answer

    with torch.no_grad():
        state = start
        told = prepare(state)
        moved = state.new_zeros(len(state))
        recent = _Recent()
        # With a gradient the last round is the one that is recorded.
        for k in range(rounds - (adjoint_rounds > 0)):
            if k in REBUILT and answer is None:
                told = prepare(state)
                recent = _Recent()
            step = one_round(state, told) - state
            moved = step.abs().amax(-1)
            step = guided(step)
            state = recent.next(state, step) if k + 1 < rounds else state + step
    if not adjoint_rounds:
        return state, moved
    seen = state.detach().requires_grad_(True)
    found = one_round(seen, told)
    step = found.detach() - state
    moved = step.abs().amax(-1)

    def adjoint(gradient: Tensor) -> Tensor:
        total = gradient if answer is None else gradient @ answer.T
        before = _Recent()
        for k in range(adjoint_rounds):
            (pulled,) = torch.autograd.grad(found, seen, total, retain_graph=True)
            left = gradient + pulled - total
            left = left if answer is None else left @ answer.T
            total = before.next(total, left) if k + 1 < adjoint_rounds else total + left
        return total

    solved: Any = found + (guided(step) - step)
    solved.register_hook(adjoint)
    return solved, moved
