"""The paper's own variant: its Table 1, and where it breaks."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
import torch
from torch import Tensor

from hopdiff.editing.laplacian import laplacian
from hopdiff.editing.measure import largest_turn, path_measures
from hopdiff.editing.paper import RIDGE, PaperSettings, edit_path_as_paper, path_from, spline_basis, states_of
from hopdiff.editing.root_path import RootPath
from hopdiff.editing.targets import EditedPath
from hopdiff.types import HopdiffError
from tests.editing.walks import path_of_clip, walk

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


@pytest.mark.parametrize("theta", ["turn", "tangent"])
@pytest.mark.parametrize("smooth", [False, True])
def test_asking_for_what_is_there_changes_nothing(smooth: bool, theta: str) -> None:
    path = walk(bend=1.0)
    place = (float(path.place[-1, 0]), float(path.place[-1, 1]))
    edited = edit_path_as_paper(path, FRAME, place, float(path.yaw[-1]), replace(TURN, smooth=smooth, theta=theta))
    assert edited.rounds == 0
    assert (edited.path.place - path.place).abs().max() < 1e-6


def half_turn(path: RootPath, settings: PaperSettings, frame_time: float = FRAME) -> EditedPath:
    """Back to the left of the start, as in figure 4."""
    way = path.place[-1] - path.place[0]
    left = path.place[0] + 0.5 * torch.stack((way[1], -way[0]))
    return edit_path_as_paper(
        path, frame_time, (float(left[0]), float(left[1])), float(path.yaw[-1]) + math.pi, settings
    )


def test_a_half_turn_ends_in_a_fold_with_the_tangent_as_state() -> None:
    """Bound in the last state alone the path is one of a family of three numbers, of which none near arrives: rounds
    end where the end hardly answers any more. With the turn as state there is no such place."""
    path = walk(150)
    turn, tangent = (half_turn(path, replace(TURN, theta=theta)) for theta in ("turn", "tangent"))
    assert turn.converged
    assert math.degrees(largest_turn(turn.path, FRAME)) < 6.0
    assert not tangent.converged
    assert tangent.rounds < TURN.rounds
    assert largest_turn(tangent.path, FRAME) > 3.0 * largest_turn(turn.path, FRAME)
    start, states = states_of(path, "tangent"), states_of(tangent.path, "tangent")
    ramp = (states - start)[:, 2:] / (states - start)[-1, 2]
    assert float(ramp.diff(dim=0).min()) > 0.0
    assert (states - start - ramp * (states - start)[-1]).abs().max() < 1e-9
    before, after = (answers(path, from_states, ramp) for from_states in (start, states))
    assert float(torch.linalg.cond(after)) > 100.0 * float(torch.linalg.cond(before))


def answers(path: RootPath, states: Tensor, ramp: Tensor) -> Tensor:
    """(3, 3) of x, z and yaw of the end to a ramp added to each state, by differences."""
    columns = []
    for k in range(3):
        ends = []
        for by in (1e-7, -1e-7):
            moved = states.clone()
            moved[:, k] += by * ramp[:, 0]
            found = path_from(moved, path, "tangent")
            ends.append(torch.cat((found.place[-1], found.yaw[-1:])))
        columns.append((ends[0] - ends[1]) / 2e-7)
    return torch.stack(columns, dim=-1)


@pytest.mark.parametrize("bend", [0.0, 1.0])
def test_a_half_turn_arrives_with_the_tangent_if_a_spline_eases_it(bend: float) -> None:
    """Figure 4(b): without a kink, and the body faces its way as it did."""
    path = walk(150, bend=bend)
    eased = half_turn(path, replace(TURN, theta="tangent", smooth=True))
    assert eased.converged
    numbers = path_measures(path, eased.path, FRAME)
    assert numbers["turn_max_deg"] < 6.0
    assert numbers["side_slip_p95_deg"] < 6.0
    assert 0.9 < numbers["stretch"] < 1.1
    assert numbers["delta_max"] < 2.0 * numbers["delta_max_before"]


@pytest.mark.parametrize("name", ["walk", "run", "walk sideways", "walk_straight_snu_30hz", "walk_straight_cmu_16_15"])
def test_half_turns_of_people_arrive_with_a_spline(name: str) -> None:
    """Also one that sets out from a stand, and one that goes sideways."""
    path, frame_time = path_of_clip(name)
    eased = half_turn(path, replace(TURN, theta="tangent", smooth=True), frame_time)
    assert eased.converged
    assert eased.rounds <= 30
    numbers = path_measures(path, eased.path, frame_time)
    assert numbers["side_slip_p95_deg"] < 8.0
    assert 0.9 < numbers["stretch"] < 1.1


def test_a_body_that_stands_in_between_is_not_whirled_about() -> None:
    """The direction of a short step is noise, so a spline bends it less."""
    path = walk(150)
    place = path.place.clone()
    still = torch.arange(60, 90)
    place[60:] = torch.cat((place[60] + 1e-4 * torch.sin(2.0 * still)[:, None], place[60:-30]))[:90]
    path = RootPath(place, path.yaw)
    eased = half_turn(path, replace(TURN, theta="tangent", smooth=True))
    assert eased.converged
    assert math.degrees(largest_turn(eased.path, FRAME)) < 15.0


@pytest.mark.parametrize("theta", ["turn", "tangent"])
def test_a_spline_changes_differential_coordinates_slowly(theta: str) -> None:
    """What it adds to them is a cubic spline over the clip: smooth in between its knots, a third of a second apart."""
    path = walk(122)
    x, z = aside(path, 0.1)
    eased = edit_path_as_paper(path, FRAME, (x, z), float(path.yaw[-1]) + 0.5, replace(TURN, theta=theta, smooth=True))
    assert eased.converged
    added = laplacian(states_of(eased.path, theta) - states_of(path, theta))[10:-10]
    fourth = added.diff(n=4, dim=0).abs()
    # Five frames with a knot inside them begin 1 to 3 frames before it.
    over_knot = torch.arange(len(fourth)) % 10 >= 7
    assert float(fourth[~over_knot].max()) < 1e-3 * float(fourth[over_knot].max())


def test_of_the_splines_that_arrive_the_least_is_taken() -> None:
    """Against the dense pseudo-inverses of the equations (10-13), where a place alone makes them linear."""
    path = walk(121)
    x, z = aside(path, 0.2)
    eased = edit_path_as_paper(path, FRAME, (x, z), None, replace(TURN, smooth=True))
    basis, one = torch.from_numpy(spline_basis(120, FRAME)), torch.eye(120, dtype=torch.float64)
    response = torch.linalg.pinv(torch.cat((laplacian(one), one[:1]))) @ torch.cat((basis, torch.zeros_like(basis[:1])))
    c, s = torch.cos(path.yaw[:-1]), torch.sin(path.yaw[:-1])
    rows = torch.stack((torch.stack((c, s)), torch.stack((-s, c))))  # x and z of a step to the left and ahead
    # With the numbers in units of their cost the least ones are those of the pseudo-inverse.
    root = torch.linalg.cholesky(torch.linalg.inv(basis.T @ basis + RIDGE * response.T @ response))
    ends = torch.einsum("edt,tp->edp", rows, response @ root).flatten(1)
    wanted = torch.tensor((x, z), dtype=torch.float64) - path.place[-1]
    numbers = (torch.linalg.pinv(ends) @ wanted).reshape(2, -1).T
    changed = states_of(eased.path, "turn") - states_of(path, "turn")
    assert (changed[:, :2] - response @ root @ numbers).abs().max() < 1e-9


@pytest.mark.parametrize("smooth", [False, True])
def test_heights_are_solved_where_asked(smooth: bool) -> None:
    """y is the fourth state (eq. 3): its second differences stay, the last frame comes to be as high as asked."""
    path = walk(100)
    where = aside(path)
    plain = edit_path_as_paper(path, FRAME, where, None, replace(TURN, smooth=smooth))
    assert plain.rise is None
    raised = edit_path_as_paper(path, FRAME, where, None, replace(TURN, smooth=smooth, rise=0.12))
    assert raised.rise is not None
    assert torch.equal(raised.path.place, plain.path.place)
    assert raised.rise.shape == (100,)
    assert float(raised.rise[0]) == 0.0
    assert float(raised.rise[-1]) == pytest.approx(0.12, abs=1e-12)
    assert raised.rise.diff().min() > -1e-9
    assert raised.rise.diff(n=2).abs().max() < 0.12 / 99
    same = edit_path_as_paper(path, FRAME, where, None, replace(TURN, smooth=smooth, rise=0.0))
    assert same.rise is not None
    assert float(same.rise.abs().max()) == 0.0


def test_what_cannot_be_is_told() -> None:
    path = walk()
    with pytest.raises(HopdiffError, match=r"edit\.theta must be one of tangent, turn, not 'bend'\."):
        edit_path_as_paper(path, FRAME, (0.0, 0.0), None, PaperSettings(theta="bend"))
    with pytest.raises(HopdiffError, match="at least 3 frames, not 2"):
        edit_path_as_paper(RootPath(path.place[:2], path.yaw[:2]), FRAME, (0.0, 0.0), None, TURN)


@pytest.mark.parametrize("count", [3, 4, 5, 61])
def test_splines_reach_every_cubic_and_no_more_than_their_knots_allow(count: int) -> None:
    basis = torch.from_numpy(spline_basis(count, FRAME))
    assert torch.linalg.matrix_rank(basis) == basis.shape[1] <= count
    torch.testing.assert_close(basis.sum(-1), torch.ones(count, dtype=torch.float64))
    at = torch.linspace(-1.0, 1.0, count, dtype=torch.float64)
    for power in range(min(count, 4)):
        rest = at**power - basis @ torch.linalg.lstsq(basis, at[:, None] ** power).solution[:, 0]
        assert rest.abs().max() < 1e-9
    if count == 61:
        assert basis.shape[1] == 9
