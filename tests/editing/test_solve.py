"""The least change of a path against another solver, and its parts by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch
from scipy.optimize import minimize
from torch import Tensor

from hopdiff.editing.laplacian import laplacian
from hopdiff.editing.root_path import RootPath, path_of, steps_of
from hopdiff.editing.solve import FRAME, STANDING, PathSolver, SolveSettings, Targets, jacobian
from hopdiff.editing.targets import Constraint, edit_path, targets_of
from tests.editing.walks import walk


def slowing(frames: int, frame_time: float) -> RootPath:
    """A walk in a bend that all but stops in its middle."""
    path = walk(frames, frame_time, bend=0.6)
    steps = steps_of(path)
    middle = slice(frames // 2 - 2, frames // 2 + 2)
    steps[middle, :2] *= torch.tensor([[0.5], [0.02], [0.2], [0.6]], dtype=torch.float64)
    return path_of(steps, path.place[0], path.yaw[0])


def dearness(path: RootPath, change: Tensor, settings: SolveSettings, frame_time: float) -> Tensor:
    """What a change of the steps (T - 1, 3) costs, from the words of the module."""
    ridge = settings.ridge * (frame_time / FRAME) ** 4
    weights = torch.tensor([settings.side, settings.ahead, settings.turn], dtype=torch.float64)
    pace = steps_of(path)[:, :2].norm(dim=-1)
    slowness = pace.mean() / torch.maximum(pace, STANDING * pace.mean())
    slow = slowness**2
    ridges = ridge * torch.stack((slow, slow, 1.0 + settings.standing * slow), dim=-1)
    ends = settings.ends * (change[0] ** 2 + change[-1] ** 2)
    return ((laplacian(change) ** 2 + ridges * change**2).sum(dim=0) + ends) @ weights


WISHES = {
    "place": lambda path: [Constraint(17, (2.0, 1.6), keep=True)],
    "heading": lambda path: [Constraint(17, None, float(path.yaw[17]) + 0.9)],
    "both": lambda path: [Constraint(17, (2.0, 1.6), float(path.yaw[17]) - 0.5)],
    "on the way": lambda path: [Constraint(9, (1.5, 1.4)), Constraint(17, (1.7, 1.5), float(path.yaw[17]) + 0.4)],
}


@pytest.mark.parametrize("wish", WISHES)
@pytest.mark.parametrize("frame_time", [1 / 30, 1 / 20])
def test_it_is_the_least_change_that_meets_the_targets(wish: str, frame_time: float) -> None:
    path = slowing(18, frame_time)
    settings = SolveSettings(ridge=0.02, side=3.0, turn=0.05, standing=20.0, ends=0.3, rounds=200)
    constraints = WISHES[wish](path)
    own, targets = steps_of(path), targets_of(path, constraints)
    found = PathSolver(path, frame_time, settings).solve(targets)
    assert bool(found.converged)
    shape = own.shape

    def cost(numbers: np.ndarray) -> tuple[float, np.ndarray]:
        change = torch.from_numpy(numbers).view(shape).requires_grad_()
        value = dearness(path, change, settings, frame_time)
        return float(value.detach()), torch.autograd.grad(value, change)[0].flatten().numpy()

    def lack(change: Tensor) -> Tensor:
        place, yaw = targets.error(path_of((own + change.view(shape))[None], targets.start_place, targets.start_yaw))
        lacks = torch.cat((place[:, targets.has_place].flatten(), yaw[:, targets.has_yaw].flatten()))
        if targets.turning:
            return lacks
        return torch.cat((lacks, change.view(shape)[:, 2]))

    other = minimize(
        cost,
        np.zeros(own.numel()),
        jac=True,
        method="SLSQP",
        constraints={
            "type": "eq",
            "fun": lambda x: lack(torch.from_numpy(x)).numpy(),
            "jac": lambda x: torch.autograd.functional.jacobian(lack, torch.from_numpy(x)).numpy(),
        },
        options={"maxiter": 400, "ftol": 1e-14},
    )
    change = found.steps[0] - own
    assert float(dearness(path, change, settings, frame_time)) == pytest.approx(other.fun, rel=5e-3)
    torch.testing.assert_close(change, torch.from_numpy(other.x).view(shape), rtol=0.0, atol=1e-2)


def test_rows_are_the_slopes_of_places_and_yaws() -> None:
    path = walk(12, bend=1.0)
    wishes = [Constraint(4, (1.2, 1.1)), Constraint(7, None, 0.9), Constraint(11, (1.1, 1.3), 0.2)]
    for constraints in (wishes, [Constraint(4, (1.2, 1.1), keep=True), Constraint(11, (1.1, 1.3), keep=True)]):
        targets = targets_of(path, constraints)
        steps = steps_of(path)

        def reached(steps: Tensor, path: RootPath = path, targets: Targets = targets) -> Tensor:
            there = path_of(steps, path.place[0], path.yaw[0])
            yaws = there.yaw[targets.frames][targets.has_yaw]
            return torch.cat((there.place[targets.frames][targets.has_place].flatten(), yaws))

        wanted = torch.autograd.functional.jacobian(reached, steps)
        if not targets.turning:
            wanted[..., 2] = 0.0
        rows = jacobian(targets, RootPath(path.place[None], path.yaw[None]))
        torch.testing.assert_close(rows[0], wanted)


def test_a_round_asks_for_alpha_at_most() -> None:
    """A turn of 1 rad in rounds of .3: three leave .1, which is the last."""
    path = walk(40)
    wish = [Constraint(39, None, float(path.yaw[39]) + 1.0)]
    for alpha, rounds in ((0.3, 4), (0.5, 2), (2.0, 1)):
        assert edit_path(path, wish, 1 / 30, SolveSettings(alpha=alpha)).rounds == rounds
    targets = targets_of(path, wish)
    left = []
    for rounds in (1, 2, 3):
        found = PathSolver(path, 1 / 30, SolveSettings(alpha=0.3, rounds=rounds)).solve(targets)
        assert not bool(found.converged)
        left.append(float(found.error_yaw))
        assert float(found.error_place) == 0.0
    assert left == pytest.approx([0.7, 0.4, 0.1])


def test_the_least_change_is_taken_where_it_does_what_was_asked(monkeypatch: pytest.MonkeyPatch) -> None:
    """On a gentle bend every round of .4 m does more than half of that: it looks at one change, and halves none."""
    path = walk(60)
    looked = []

    def counted(*given: Tensor) -> RootPath:
        looked.append(given[0])
        return path_of(*given)

    monkeypatch.setattr("hopdiff.editing.solve.path_of", counted)
    place = (float(path.place[59, 0]) + 1.5, float(path.place[59, 1]))
    found = edit_path(path, [Constraint(59, place, float(path.yaw[59]))], 1 / 30, SolveSettings(alpha=0.4))
    assert found.rounds == 5
    assert len(looked) == found.rounds + 2  # the first look, and a last round to the last digits


def test_a_guess_near_the_solution_is_followed() -> None:
    path = walk(60)
    wish = [Constraint(59, (0.4, 2.0), float(path.yaw[59]) + 2.5)]
    first = edit_path(path, wish, 1 / 30)
    again = edit_path(path, wish, 1 / 30, guess=first.path)
    assert again.rounds == 1
    assert float((again.path.place - first.path.place).abs().max()) < 1e-3
    assert again.converged


def test_what_binds_and_what_does_not_can_be_mixed() -> None:
    path = walk()
    wishes = [
        Constraint(60, tuple((path.place[60] + 0.2).tolist()), keep=True),
        Constraint(119, None, float(path.yaw[119]) + 1.0),
    ]
    edited = edit_path(path, wishes, 1 / 30)
    assert edited.converged
    assert edited.path.place[60].tolist() == pytest.approx(wishes[0].place, abs=1e-4)
    assert float(edited.path.yaw[60] - path.yaw[60]) == pytest.approx(0.0, abs=1e-5)
    assert float(edited.path.yaw[119] - path.yaw[119]) == pytest.approx(1.0, abs=1e-5)


@pytest.mark.parametrize(("turn", "change"), [("nearest", math.tau / 2 - 0.1), ("left", math.tau / 2 - 0.1)])
def test_a_turn_that_is_there_is_not_made_again(turn: str, change: float) -> None:
    path = walk(200)
    wishes = [
        Constraint(100, None, float(path.yaw[100]) + change),
        Constraint(199, None, float(path.yaw[199]) + change - math.tau),
    ]
    edited = edit_path(path, wishes, 1 / 30, turn=turn)
    for frame in (100, 199):
        assert float(edited.path.yaw[frame] - path.yaw[frame]) == pytest.approx(change, abs=1e-4)
