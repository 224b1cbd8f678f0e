"""Edits of a path: they arrive, change no more than they must, and say what is wrong."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
import torch

from hopdiff.editing.measure import path_measures
from hopdiff.editing.root_path import RootPath, path_of, steps_of
from hopdiff.editing.solve import PathSolver, SolveSettings, Targets
from hopdiff.editing.targets import SPIN, Constraint, EditedPath, edit_path, spin, targets_of
from hopdiff.types import HopdiffError
from tests.editing.walks import path_of_clip, walk

FRAME = 1.0 / 30.0


def end(path: RootPath, left: float = 0.0, ahead: float = 0.0) -> tuple[float, float]:
    """Where a path ends, moved by shares of its net way to the left and ahead."""
    way = path.place[-1] - path.place[0]
    moved = path.place[-1] + ahead * way + left * torch.stack((way[1], -way[0]))
    return float(moved[0]), float(moved[1])


def last(path: RootPath, place: tuple[float, float] | None, turn_deg: float | None = None) -> Constraint:
    yaw = None if turn_deg is None else float(path.yaw[-1]) + math.radians(turn_deg)
    return Constraint(path.frames - 1, place, yaw, keep=turn_deg is None)


def arrives(edited: EditedPath, constraint: Constraint) -> None:
    path = edited.path
    assert edited.converged
    if constraint.place is not None:
        assert path.place[constraint.frame].tolist() == pytest.approx(constraint.place, abs=1e-4)
    if constraint.yaw is not None:
        assert math.remainder(float(path.yaw[constraint.frame]) - constraint.yaw, math.tau) == pytest.approx(
            0, abs=1e-5
        )


@pytest.mark.parametrize("bend", [0.0, 1.5])
def test_asking_for_what_is_there_changes_nothing(bend: float) -> None:
    path = walk(bend=bend)
    edited = edit_path(path, [last(path, end(path), 0.0)], FRAME)
    assert (edited.rounds, edited.converged) == (0, True)
    assert (edited.path.place - path.place).abs().max() < 1e-9
    assert (edited.path.yaw - path.yaw).abs().max() < 1e-9


@pytest.mark.parametrize("turn", [-90, -45, 0, 45, 90, 135, 180])
@pytest.mark.parametrize(("left", "ahead"), [(0.0, 0.0), (0.3, 0.1), (0.0, -0.4)])
@pytest.mark.parametrize("alpha", [0.3, 0.5, math.inf])
def test_it_arrives_and_the_start_stays(turn: float, left: float, ahead: float, alpha: float) -> None:
    path = walk(bend=0.4)
    wish = last(path, end(path, left, ahead), turn)
    edited = edit_path(path, [wish], FRAME, SolveSettings(alpha=alpha))
    arrives(edited, wish)
    assert torch.equal(edited.path.place[0], path.place[0])
    assert edited.path.yaw[0] == path.yaw[0]
    assert edited.rounds <= 15


def test_a_place_alone_takes_one_round_and_turns_no_frame() -> None:
    path = walk(bend=1.0)
    wish = last(path, end(path, 0.3, 0.2))
    edited = edit_path(path, [wish], FRAME, SolveSettings(alpha=0.1))
    arrives(edited, wish)
    assert edited.rounds == 1
    assert (edited.path.yaw - path.yaw).abs().max() < 1e-12


def test_a_place_with_a_free_heading_turns_into_the_way() -> None:
    path = walk()
    edited = edit_path(path, [Constraint(path.frames - 1, end(path, 0.5))], FRAME)
    assert edited.converged
    assert float(edited.path.yaw[-1] - path.yaw[-1]) > 0.2
    assert path_measures(path, edited.path, FRAME)["side_slip_p95_deg"] < 2.0


def test_a_heading_alone_leaves_the_place_free() -> None:
    path = walk()
    wish = last(path, None, 90.0)
    edited = edit_path(path, [wish], FRAME)
    arrives(edited, wish)
    assert path_measures(path, edited.path, FRAME)["stretch"] == pytest.approx(1.0, abs=0.02)


def test_frames_in_between_and_the_first_can_be_bound_too() -> None:
    path = walk(200)
    middle = path.place[100] + torch.tensor([0.3, -0.2])
    wishes = [
        Constraint(0, (0.0, 0.5), float(path.yaw[0]) - 0.3),
        Constraint(100, (float(middle[0]), float(middle[1])), None),
        Constraint(150, None, float(path.yaw[150]) + 0.4),
        last(path, end(path, 0.2), 60.0),
    ]
    edited = edit_path(path, wishes, FRAME)
    for wish in wishes:
        arrives(edited, wish)


def test_moving_the_start_alone_moves_all_of_it() -> None:
    path = walk(bend=1.0)
    edited = edit_path(path, [Constraint(0, (4.0, -2.0), 1.0)], FRAME)
    assert edited.path.place[0].tolist() == [4.0, -2.0]
    assert float(edited.path.yaw[0]) == pytest.approx(1.0)
    assert (steps_of(edited.path) - steps_of(path)).abs().max() < 1e-12


@pytest.mark.parametrize(("turn", "change"), [("nearest", -170.0), ("left", 190.0), ("right", -170.0)])
def test_the_side_of_a_turn_can_be_chosen(turn: str, change: float) -> None:
    path = walk(200)
    edited = edit_path(path, [last(path, end(path), 190.0)], FRAME, turn=turn)
    assert math.degrees(float(edited.path.yaw[-1] - path.yaw[-1])) == pytest.approx(change, abs=1e-3)


def test_a_chain_of_headings_goes_on_turning() -> None:
    """Each constraint turns on from the one before it: three thirds of a turn are a whole one."""
    path = walk(300)
    wishes = [Constraint(k, None, float(path.yaw[k]) + turn) for k, turn in ((99, 2.1), (199, 4.2), (299, 6.3))]
    edited = edit_path(path, wishes, FRAME)
    assert float(edited.path.yaw[-1] - path.yaw[-1]) == pytest.approx(6.3, abs=1e-5)


@pytest.mark.parametrize(
    "name",
    [
        "walk",
        "walk without toes",
        "walk_straight_cmu_07_01",
        "walk_straight_cmu_16_15",
        "walk_straight_snu_30hz",
    ],
)
def test_walks_turn_without_slipping_sideways_or_kinks(name: str) -> None:
    path, frame_time = path_of_clip(name)
    found = path_measures(path, edit_path(path, [last(path, end(path), 90.0)], frame_time).path, frame_time)
    assert found["side_slip_p95_deg"] < 5.0
    assert 0.9 < found["stretch"] < 1.16
    way = path.place[-1] - path.place[0]
    left = path.place[0] + 0.5 * torch.stack((way[1], -way[0]))
    about = edit_path(path, [last(path, (float(left[0]), float(left[1])), 180.0)], frame_time)
    assert about.converged
    assert path_measures(path, about.path, frame_time)["turn_max_deg"] < 6.0


def test_the_frame_rate_does_not_matter() -> None:
    """The same walk at 30 and 120 frames/s, the same target: the same path."""
    slow, fast = walk(120, FRAME), walk(477, FRAME / 4.0)
    assert (slow.place[-1] - fast.place[-1]).norm() < 0.01
    wish = end(slow, 0.2)
    paths = [
        edit_path(path, [replace(last(slow, wish, 70.0), frame=path.frames - 1)], frame_time).path
        for path, frame_time in ((slow, FRAME), (fast, FRAME / 4.0))
    ]
    assert (paths[0].place - paths[1].place[::4]).norm(dim=-1).max() < 0.03
    assert (paths[0].yaw - paths[1].yaw[::4]).abs().max() < 0.03


def many(path: RootPath, count: int) -> Targets:
    generator = torch.Generator().manual_seed(4)
    shift = 0.4 * torch.randn(count, 1, 2, dtype=torch.float64, generator=generator)
    turn = 0.8 * torch.randn(count, 1, dtype=torch.float64, generator=generator)
    one = targets_of(path, [last(path, end(path), 0.0)])
    return replace(
        one,
        place=one.place + shift,
        yaw=one.yaw + turn,
        start_place=one.start_place.expand(count, 2),
        start_yaw=one.start_yaw.expand(count),
    )


def test_a_thousand_targets_are_each_of_them_alone() -> None:
    path = walk()
    targets = many(path, 1000)
    solver = PathSolver(path, FRAME, SolveSettings())
    together = solver.solve(targets)
    assert bool(together.converged.all())
    for k in (0, 17, 999):
        alone = solver.solve(
            replace(
                targets,
                place=targets.place[k : k + 1],
                yaw=targets.yaw[k : k + 1],
                start_place=targets.start_place[:1],
                start_yaw=targets.start_yaw[:1],
            )
        )
        assert int(alone.rounds[0]) == int(together.rounds[k])
        assert (alone.path.place[0] - together.path.place[k]).abs().max() < 1e-6


def test_gradients_with_respect_to_targets_and_weights_are_finite_differences() -> None:
    path = walk(60)
    one = targets_of(path, [last(path, end(path, 0.2), 50.0)])

    def somewhere(place: torch.Tensor, yaw: torch.Tensor, weights: torch.Tensor) -> torch.Tensor:
        solver = PathSolver(path, FRAME, SolveSettings(alpha=math.inf), weights)
        found = solver.solve(replace(one, place=place, yaw=yaw)).path
        return found.place[0, 25, 0] + 2.0 * found.place[0, 40, 1] + found.yaw[0, 30]

    weights = torch.tensor([30.0, 1.0, 0.002], dtype=torch.float64)
    inputs = [one.place.clone(), one.yaw.clone(), weights]
    for tensor in inputs:
        tensor.requires_grad_()
    slopes = torch.autograd.grad(somewhere(*inputs), inputs)
    for which, (tensor, slope) in enumerate(zip(inputs, slopes, strict=True)):
        for k in range(tensor.numel()):
            h = 1e-4 * max(float(tensor.detach().flatten()[k].abs()), 0.1)
            values = []
            for sign in (1.0, -1.0):
                moved = [t.detach().clone() for t in inputs]
                moved[which].view(-1)[k] += sign * h
                values.append(float(somewhere(*moved)))
            measured = (values[0] - values[1]) / (2.0 * h)
            assert float(slope.flatten()[k]) == pytest.approx(measured, rel=1e-3, abs=1e-5)


@pytest.mark.parametrize(
    ("constraints", "turn", "said"),
    [
        ([], "nearest", "needs at least one frame"),
        ([Constraint(120, (0.0, 0.0))], "nearest", "frame 120 lies outside the clip, whose frames are 0 to 119."),
        ([Constraint(-1, (0.0, 0.0))], "nearest", "frame -1 lies outside"),
        ([Constraint(5, (0.0, math.nan))], "nearest", "frame 5: place and heading must be finite"),
        ([Constraint(5, None, math.inf)], "nearest", "frame 5: place and heading must be finite"),
        ([Constraint(5, (0.0, 1.0)), Constraint(5, (0.0, 2.0))], "nearest", "frame 5 shall be at [0.0, 1.0] and at"),
        ([Constraint(5, None, 0.0), Constraint(5, None, 1.0)], "nearest", "frame 5 shall face 0 and 57.2958 degrees"),
        ([Constraint(5, None, 0.0)], "up", "the turn must be one of nearest, left, right, not 'up'"),
    ],
)
def test_what_cannot_be_is_told(constraints: list[Constraint], turn: str, said: str) -> None:
    with pytest.raises(HopdiffError) as caught:
        edit_path(walk(), constraints, FRAME, turn=turn)
    assert said in str(caught.value)


def test_two_frames_are_too_few() -> None:
    path = walk(3)
    with pytest.raises(HopdiffError, match="at least 3 frames, not 2"):
        edit_path(RootPath(path.place[:2], path.yaw[:2]), [Constraint(1, (0.0, 0.0))], FRAME)


def test_constraints_that_say_the_same_are_one() -> None:
    path = walk()
    place = end(path, 0.1)
    both = [Constraint(119, place), Constraint(119, None, 0.5), Constraint(119, place, 0.5 + math.tau)]
    edited = edit_path(path, both, FRAME)
    arrives(edited, Constraint(119, place, 0.5))


def test_a_body_that_stands_is_moved_without_a_number_that_is_not_finite() -> None:
    path = path_of(
        torch.zeros(59, 3, dtype=torch.float64),
        torch.zeros(2, dtype=torch.float64),
        torch.zeros((), dtype=torch.float64),
    )
    edited = edit_path(path, [Constraint(59, (1.0, 1.0), 1.0)], FRAME)
    arrives(edited, Constraint(59, (1.0, 1.0), 1.0))


def test_milliseconds_are_told_of_set_up_and_solution(monkeypatch: pytest.MonkeyPatch) -> None:
    ticks = iter([1.0, 1.5, 3.5])
    monkeypatch.setattr("hopdiff.editing.targets.time.perf_counter", lambda: next(ticks))
    found = edit_path(walk(), [Constraint(119, (1.0, 2.0))], FRAME).milliseconds
    assert found == {"set_up": 500.0, "solve": 2000.0}


@pytest.mark.parametrize("facing", [90.0, -60.0, 180.0])
def test_where_the_body_faces_says_nothing_of_how_its_way_is_bent(facing: float) -> None:
    """Somebody who walks sideways is led along the way that somebody who walks ahead is led along."""
    ahead = walk(120, bend=0.4)
    aside = RootPath(ahead.place, ahead.yaw + math.radians(facing))
    place = end(ahead, 0.2, 0.1)
    found = [
        edit_path(path, [Constraint(119, place, float(path.yaw[-1]) + 0.6)], FRAME).path for path in (ahead, aside)
    ]
    assert (found[0].place - found[1].place).norm(dim=-1).max() < 1e-3
    turned = found[1].yaw - found[0].yaw - math.radians(facing)
    assert turned.abs().max() < 1e-3


@pytest.mark.parametrize("turn", [None, 90.0])
def test_a_clip_begins_and_ends_as_fast_as_it_did(turn: float | None) -> None:
    path = walk(150)
    wish = last(path, end(path, 0.1, 0.4), turn)
    held, free = (edit_path(path, [wish], FRAME, SolveSettings(ends=ends)).path for ends in (SolveSettings().ends, 0.0))

    def change(edited: RootPath) -> torch.Tensor:
        return (steps_of(edited) - steps_of(path))[:, :2].norm(dim=-1)

    for edge in (0, -1):
        assert float(change(held)[edge]) < 0.2 * float(change(held).mean())
        assert float(change(held)[edge]) < 0.3 * float(change(free)[edge])


def test_who_stands_is_not_shifted_while_standing() -> None:
    """What has to be gone farther is gone where the body goes."""
    path = walk(160)
    place = path.place.clone()
    place[60:100] = place[60]
    place[100:] -= place[100] - place[60]
    stop = RootPath(place, path.yaw)
    edited = edit_path(stop, [last(stop, end(stop, 0.0, 0.3))], FRAME).path
    moved = edited.place.diff(dim=0).norm(dim=-1)
    assert float(moved[66:94].sum()) < 0.05
    assert float(moved[10:50].mean()) > 1.2 * float(stop.place.diff(dim=0).norm(dim=-1)[10:50].mean())


def test_a_body_held_in_one_place_slows_down_rather_than_whirls() -> None:
    path = walk()
    place = (float(path.place[70, 0]), float(path.place[70, 1]))
    held = [Constraint(round(share * (path.frames - 1)), place) for share in (0.8, 0.9, 1.0)]
    fast = [spin(edit_path(path, held, FRAME, SolveSettings(turn=weight)).path.yaw, FRAME) for weight in (1e-6, 2e-3)]
    assert max(fast) < SPIN
    # Such a weight alone would have it whirl.
    targets = targets_of(path, held)
    alone = PathSolver(path, FRAME, SolveSettings(turn=1e-6)).solve(targets)
    assert spin(alone.path.yaw[0], FRAME) > SPIN
