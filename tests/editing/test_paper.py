"""The paper's own variant: its Table 1, and where it breaks."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
import torch

from hopdiff.editing.measure import largest_turn
from hopdiff.editing.paper import PaperSettings, edit_path_as_paper, path_from, splined, states_of
from hopdiff.editing.root_path import RootPath
from hopdiff.types import HopdiffError
from tests.editing.walks import walk

FRAME = 1.0 / 30.0
TURN = PaperSettings(alpha=0.3)


def aside(path: RootPath, share: float = 0.3) -> tuple[float, float]:
    way = path.place[-1] - path.place[0]
    x, z = (path.place[-1] + share * torch.stack((way[1], -way[0]))).tolist()
    return x, z


@pytest.mark.parametrize("theta", ["tangent", "turn"])
def test_states_put_together_are_the_path(theta: str) -> None:
    path = walk(bend=1.0, facing=0.8)
    again = path_from(states_of(path, theta), path, theta)
    assert (again.place - path.place).abs().max() < 1e-12
    assert (again.yaw - path.yaw).abs().max() < 1e-12


def test_theta_is_the_angle_between_way_and_facing() -> None:
    path = walk(facing=0.8)
    sideways = states_of(path, "tangent")[:, 2]
    assert float(sideways.mean()) == pytest.approx(0.8, abs=0.05)


def test_rounds_are_those_of_table_1() -> None:
    """A place alone takes 1 round, with a quarter turn it takes 6 of at most .3 rad each."""
    path = walk(100)
    place = aside(path)
    assert edit_path_as_paper(path, FRAME, place, None, TURN).rounds == 1
    both = edit_path_as_paper(path, FRAME, place, float(path.yaw[-1]) + math.pi / 2, TURN)
    assert both.rounds == 6
    assert both.converged
    assert both.path.place[-1].tolist() == pytest.approx(place, abs=0.01)
    assert float(both.path.yaw[-1] - path.yaw[-1]) == pytest.approx(math.pi / 2, abs=0.01)


@pytest.mark.parametrize("smooth", [False, True])
def test_asking_for_what_is_there_changes_nothing(smooth: bool) -> None:
    path = walk(bend=1.0)
    place = (float(path.place[-1, 0]), float(path.place[-1, 1]))
    edited = edit_path_as_paper(path, FRAME, place, float(path.yaw[-1]), replace(TURN, smooth=smooth))
    assert edited.rounds == 0
    assert (edited.path.place - path.place).abs().max() < 1e-6


def test_a_half_turn_needs_the_turn_as_state() -> None:
    """With the angle against the tangent the way back bends without limit; with the turn it arrives without a kink."""
    path = walk(150)
    way = path.place[-1] - path.place[0]
    left = path.place[0] + 0.5 * torch.stack((way[1], -way[0]))
    place, yaw = (float(left[0]), float(left[1])), float(path.yaw[-1]) + math.pi
    turn, tangent = (
        edit_path_as_paper(path, FRAME, place, yaw, replace(TURN, theta=theta)) for theta in ("turn", "tangent")
    )
    assert turn.converged
    assert math.degrees(largest_turn(turn.path, FRAME)) < 6.0
    assert not tangent.converged
    assert largest_turn(tangent.path, FRAME) > 3.0 * largest_turn(turn.path, FRAME)


def test_a_spline_keeps_slow_changes_and_drops_fast_ones() -> None:
    time = torch.arange(200, dtype=torch.float64) * FRAME
    slow, fast = torch.sin(time), torch.sin(40.0 * time)
    kept = splined(torch.stack((slow, fast), dim=-1), FRAME)
    assert (kept[:, 0] - slow).abs().max() < 1e-3
    assert kept[5:-5, 1].abs().max() < 0.2


def test_what_cannot_be_is_told() -> None:
    path = walk()
    with pytest.raises(HopdiffError, match=r"edit\.theta must be one of tangent, turn, not 'bend'\."):
        edit_path_as_paper(path, FRAME, (0.0, 0.0), None, PaperSettings(theta="bend"))
    with pytest.raises(HopdiffError, match="at least 3 frames, not 2"):
        edit_path_as_paper(RootPath(path.place[:2], path.yaw[:2]), FRAME, (0.0, 0.0), None, TURN)


@pytest.mark.parametrize("theta", ["turn", "tangent"])
def test_a_spline_changes_nothing_as_the_problem_is_linear_in_the_states(theta: str) -> None:
    """The change is that of the last state alone, whatever the Laplacian of the rest: detail taken out comes back."""
    path = walk(100)
    plain, smooth = (
        edit_path_as_paper(path, FRAME, aside(path), float(path.yaw[-1]) + 1.2, replace(TURN, theta=theta, smooth=s))
        for s in (False, True)
    )
    assert plain.rounds == smooth.rounds > 1
    assert (plain.path.place - smooth.path.place).abs().max() < 1e-9
    assert (plain.path.yaw - smooth.path.yaw).abs().max() < 1e-9


def test_a_spline_is_the_least_squares_fit_on_even_knots() -> None:
    """The residual is orthogonal to every cubic that is smooth across the knots, a third of a second apart."""
    generator = torch.Generator().manual_seed(0)
    values = torch.randn(61, 2, dtype=torch.float64, generator=generator)
    rest = (values - splined(values, FRAME)).T
    at = torch.arange(61, dtype=torch.float64)
    truncated = [(at - 10.0 * k).clamp_min(0.0) ** 3 for k in range(1, 6)]
    for basis in (torch.ones(61).double(), at, at**2, at**3, *truncated):
        assert float((rest @ (basis / basis.norm())).abs().max()) < 1e-9
    cubic = torch.stack((0.3 * at - 1e-4 * at**3, at**2), dim=-1)
    torch.testing.assert_close(splined(cubic, FRAME), cubic, rtol=1e-9, atol=1e-9)
    few = values[:3]
    assert torch.equal(splined(few, FRAME), few)
