"""Limits: what is wrong with a run that oversteps one."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
import torch
from torch import Tensor

from hopdiff.effort.limits import CONVERGED, Excess, excesses, penalty, status_of
from hopdiff.effort.priced import POWER_WIDTH
from hopdiff.effort.settings import BodyLimits
from hopdiff.types import Status
from hopdiff.whole_body.layout import SEGMENTS
from tests.effort.runs import ORDINARY, priced, unit_genes
from tests.whole_body.bodies import DTYPE, body_problem

# So wide that nothing is wrong.
WIDE = BodyLimits(
    friction=3.0,
    clearance=0.0,
    apart=-1.0,
    flight_time=0.0,
    reach=1.1,
    knee_deg=[-90.0, 180.0],
    ankle_deg=[-90.0, 90.0],
    hip_deg=[-180.0, 180.0],
    elbow_deg=[-180.0, 180.0],
    weight=1.0,
)


def status(limits: BodyLimits) -> Status:
    run = priced()
    return Status(int(status_of(excesses(run, limits), run.moved)[0]))


def over(limits: BodyLimits) -> float:
    return float(penalty(excesses(priced(), limits))[0])


@pytest.mark.parametrize(
    ("tightened", "wrong"),
    [
        ({"friction": 0.05}, Status.SLIPPERY),
        ({"reach": 0.97}, Status.LEG_OVERREACH),
        ({"flight_time": 1.0}, Status.NO_FLIGHT),
        ({"apart": 0.3}, Status.LEGS_MEET),
        ({"knee_deg": [-90.0, 60.0]}, Status.JOINT_LIMIT),
        ({"knee_deg": [30.0, 180.0]}, Status.JOINT_LIMIT),
        ({"ankle_deg": [0.0, 90.0]}, Status.JOINT_LIMIT),
        ({"hip_deg": [-180.0, 10.0]}, Status.JOINT_LIMIT),
        ({"elbow_deg": [100.0, 170.0]}, Status.JOINT_LIMIT),
    ],
)
def test_a_run_oversteps_the_one_limit_that_is_tightened(tightened: dict[str, object], wrong: Status) -> None:
    assert status(WIDE) == Status.OK
    assert status(replace(WIDE, **tightened)) == wrong  # type: ignore[arg-type]
    assert over(replace(WIDE, **tightened)) > over(WIDE)  # type: ignore[arg-type]


def test_limits_lie_where_their_numbers_say() -> None:
    """Just inside costs nothing, grossly outside is impossible: against maxima read off the run itself. A joint feels
    the end of its range 1.7 degrees before."""
    run = priced()
    angles, carried = run.body.angles, run.body.carried
    bend = math.degrees(float(angles.knee.max()))
    least = math.degrees(float((angles.foot - angles.thigh + angles.knee).min()))
    swing = math.degrees(float((angles.thigh + angles.pelvis[:, :1]).max()))
    flight = float(run.movement.grid.durations[0, 1]) / run.pace
    ankles = run.body.joints[0, [SEGMENTS.index(f"{side}_foot") for side in ("left", "right")], 0]
    knees = run.body.joints[0, [SEGMENTS.index(f"{side}_shank") for side in ("left", "right")], 0]
    apart = float(min((x[0] - x[1]).min() for x in (ankles, knees))) / run.leg
    for inside, outside in (
        ({"knee_deg": [-90.0, bend + 1.8]}, {"knee_deg": [-90.0, bend - 6.0]}),
        ({"ankle_deg": [least - 1.8, 90.0]}, {"ankle_deg": [least + 6.0, 90.0]}),
        ({"hip_deg": [-180.0, swing + 1.8]}, {"hip_deg": [-180.0, swing - 6.0]}),
        ({"flight_time": flight - 1e-6}, {"flight_time": flight + 0.031}),
        ({"apart": apart - 1e-6}, {"apart": apart + 0.031}),
        ({"reach": 0.988 + 1e-6}, {"reach": 0.988 - 0.0051}),
    ):
        assert over(replace(WIDE, **inside)) == pytest.approx(over(WIDE), abs=1e-9)  # type: ignore[arg-type]
        assert status(replace(WIDE, **outside)) != Status.OK  # type: ignore[arg-type]
    for near in ({"knee_deg": [-90.0, bend + 1.0]}, {"ankle_deg": [least - 1.0, 90.0]}):
        assert status(replace(WIDE, **near)) == Status.OK  # type: ignore[arg-type]
        assert over(replace(WIDE, **near)) > over(WIDE) + 1e-9  # type: ignore[arg-type]
    force = carried.force[0, 0]
    lift, aside = force[1], torch.sqrt(force[0] ** 2 + force[2] ** 2)
    firm = lift > 1.0
    needed = float((aside[firm] / lift[firm]).max())
    assert status(replace(WIDE, friction=needed - 0.1)) == Status.SLIPPERY


def test_a_foot_in_the_ground_is_wrong() -> None:
    """Against the height of the heel, put lower than it is."""
    run = priced()
    sunk = replace(run.body, root=run.body.root - 0.05 * torch.tensor([0.0, 1.0, 0.0], dtype=DTYPE)[:, None])
    found = excesses(replace(run, body=sunk), WIDE)
    assert int(status_of(found, run.moved)[0]) == Status.FOOT_UNDERGROUND
    # By as much: in units of a fiftieth of the leg.
    worst = max(float(one.curves.max()) for one in found if one.status == Status.FOOT_UNDERGROUND and not one.wish)
    lowest = []
    for piece in run.movement.legs.swings[0].places:
        ankle = sunk.joints[0, 8 + piece.side, 1, piece.period]
        pitch = run.body.angles.foot[0, piece.side, piece.period]
        for point in (run.movement.layout.heel, run.movement.layout.ball):
            lowest.append(float((ankle + point[1] * pitch.cos() + point[2] * pitch.sin()).min()))
    # Limits look between the nodes too.
    assert worst == pytest.approx(-min(lowest) / run.leg / 0.02, rel=0.01)
    # Room over the ground is a wish: it costs, but stops nobody.
    assert status(replace(WIDE, clearance=0.5)) == Status.OK
    assert over(replace(WIDE, clearance=0.5)) > over(WIDE) + 1.0


def test_grip_is_told_in_shares_of_the_force_that_a_foot_bears() -> None:
    """What is needed beyond the friction, over .015 of the vertical force and .005 body weights more."""
    run = priced()
    (told,) = [one for one in excesses(run, replace(WIDE, friction=0.3)) if one.status == Status.SLIPPERY]
    force = run.finer(run.body.carried.force)[0] / 9.81
    lift = force[:, 1].clamp_min(0.0)
    needed = torch.sqrt(force[:, 0] ** 2 + force[:, 2] ** 2)
    wanted = (needed - 0.3 * lift) / (0.005 + 0.015 * lift)
    torch.testing.assert_close(told.curves[0], wanted, rtol=1e-4, atol=1e-3)
    assert float(lift.max()) > 2.0


def test_a_body_that_is_pulled_down_is_wrong() -> None:
    run = priced()
    (force,) = run.body.carried.forces
    down = torch.tensor([0.0, -0.5, 0.0], dtype=DTYPE)[:, None]
    carried = replace(run.body.carried, forces=[torch.zeros_like(force) + down])
    found = excesses(replace(run, body=replace(run.body, carried=carried)), WIDE)
    assert int(status_of(found, run.moved)[0]) == Status.PULLED_DOWN


def one(status: Status, *curves: float, wish: bool = False) -> Excess:
    return Excess(status, torch.tensor([list(curves)], dtype=DTYPE), None, wish)


NEAR = torch.tensor([0.1 * CONVERGED], dtype=DTYPE)


@pytest.mark.parametrize(
    ("found", "moved", "wanted"),
    [
        ([one(Status.LEGS_MEET, 0.2, -3.0)], 0.0, Status.OK),
        ([one(Status.LEGS_MEET, 0.6, -3.0)], 0.0, Status.LEGS_MEET),
        # Friction is told in units half as large.
        ([one(Status.SLIPPERY, 0.9, -3.0)], 0.0, Status.OK),
        ([one(Status.SLIPPERY, 1.1, -3.0)], 0.0, Status.SLIPPERY),
        # A joint's range gives way: to twice as much.
        ([one(Status.JOINT_LIMIT, 0.9)], 0.0, Status.OK),
        ([one(Status.JOINT_LIMIT, 1.1)], 0.0, Status.JOINT_LIMIT),
        ([one(Status.JOINT_LIMIT, 1.1), one(Status.NO_FLIGHT, 0.7)], 0.0, Status.NO_FLIGHT),
        ([one(Status.JOINT_LIMIT, 1.6), one(Status.NO_FLIGHT, 0.7)], 0.0, Status.JOINT_LIMIT),
        ([one(Status.SLIPPERY, 9.0), one(Status.NO_FLIGHT, -1.0)], 1.01 * CONVERGED, Status.NOT_CLOSED),
        ([one(Status.SLIPPERY, 0.0)], math.nan, Status.NOT_CLOSED),
        ([one(Status.SLIPPERY, math.nan)], 0.0, Status.NOT_FINITE),
        ([one(Status.NO_FLIGHT, 0.0), one(Status.FOOT_UNDERGROUND, 7.0, wish=True)], 0.0, Status.OK),
    ],
)
def test_the_worst_is_told(found: list[Excess], moved: float, wanted: Status) -> None:
    assert int(status_of(found, torch.tensor([moved], dtype=DTYPE))[0]) == wanted


def test_penalty_is_the_mean_square_of_what_is_over() -> None:
    """Rows of curves are added, times are averaged: evenly, or with their weights."""
    even = Excess(Status.SLIPPERY, torch.tensor([[[3.0, -1.0], [1.0, 2.0]]], dtype=DTYPE), None)
    weighed = Excess(
        Status.NO_FLIGHT, torch.tensor([[2.0, 4.0, -9.0]], dtype=DTYPE), torch.tensor([[0.5, 0.25, 0.25]], dtype=DTYPE)
    )
    assert float(penalty([even])[0]) == pytest.approx(4.5 + 2.5)
    assert float(penalty([weighed])[0]) == pytest.approx(2.0 + 4.0)
    assert float(penalty([even, weighed])[0]) == pytest.approx(13.0)


def candidate(*overrides: str) -> tuple[Status, float, float]:
    problem = body_problem(*ORDINARY, *overrides)
    found = problem.evaluate(unit_genes(problem), with_grad=False)
    return Status(int(found.status[0])), float(found.cost[0]), float(found.merit[0])


@pytest.mark.parametrize(
    ("setting", "wrong"),
    [
        ("costs.limits.friction=0.05", Status.SLIPPERY),
        ("costs.limits.reach=0.97", Status.LEG_OVERREACH),
        ("costs.limits.flight_time=1.0", Status.NO_FLIGHT),
    ],
)
def test_an_impossible_candidate_has_no_cost_but_a_merit(setting: str, wrong: Status) -> None:
    found, cost, merit = candidate(setting)
    assert found == wrong
    assert math.isinf(cost)
    assert math.isfinite(merit)


def test_a_candidate_that_is_not_solved_is_told_so() -> None:
    """Genes from all over the box in the fewest rounds that can be set."""
    problem = body_problem(*ORDINARY, "model.rounds=4")
    genes: Tensor = torch.rand(16, problem.dimension, generator=torch.Generator().manual_seed(5), dtype=DTYPE)
    found, moved = problem.evaluate(genes, with_grad=False), problem.run(genes, with_grad=False).moved
    unsolved = moved >= CONVERGED
    assert int(unsolved.sum()) > 8
    assert bool((found.status[unsolved] == int(Status.NOT_CLOSED)).all())
    assert not bool((found.status[~unsolved] == int(Status.NOT_CLOSED)).any())
    assert bool(torch.isinf(found.cost[unsolved]).all())


def test_rounding_of_the_work_is_a_share_of_the_bodys_own_power() -> None:
    """g sqrt(g l): of a body four times as tall, twice as much."""
    human, tall = priced(), priced(*ORDINARY, "character.height=7")
    for run in (human, tall):
        assert run.power_width == pytest.approx(POWER_WIDTH * 9.81 * math.sqrt(9.81 * run.leg))
    assert tall.power_width == pytest.approx(2.0 * human.power_width)
