"""The terms of the cost against their definitions, on a run whose joints, forces and angles are known."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
import torch
from torch import Tensor

from hopdiff.effort.priced import Priced
from hopdiff.effort.settings import EffortSettings
from hopdiff.effort.terms import (
    Asked,
    Muscles,
    arm_swing,
    energy_rate,
    energy_ratio,
    energy_target,
    largest_swing_knee,
    mid_stance_drop,
    muscle_power,
    muscle_pull,
    terms_of,
    touchdown_yaw,
)
from hopdiff.whole_body.layout import SEGMENTS
from tests.builders import effort_settings
from tests.effort.runs import ORDINARY, priced
from tests.whole_body.bodies import DTYPE, body_problem

GRAVITY = 9.81
JOINTS = SEGMENTS[1:]
WEIGHTS = ("positive_work", "negative_work", "torque", "torque_rate", "steady", "energy", "contact_cap")
NOTHING_ASKED = Asked(1.0, None, None)


def settings(**changed: object) -> EffortSettings:
    """Strong joints and stiff tendons everywhere, no ligaments, all weights 0 but those that are changed."""
    kinds = ("waist", "chest", "neck", "hip", "knee", "ankle", "shoulder", "elbow")
    plain: dict[str, object] = {
        **dict.fromkeys(WEIGHTS, 0.0),
        "strength": {kind: [0.2, 0.1, 0.3] for kind in kinds},
        "tendon": {},
        "ankle_stiffness": 0.0,
        "transfer": 0.0,
    }
    return replace(effort_settings(), **(plain | changed))  # type: ignore[arg-type]


def muscles_of(run: Priced, given: EffortSettings) -> Muscles:
    return Muscles.of(given, run.leg, run.dynamics.torque)


def values(run: Priced, given: EffortSettings, asked: Asked = NOTHING_ASKED, knee: float = 1.8) -> dict[str, float]:
    rows = terms_of(given, muscles_of(run, given), run.pace, asked, knee)
    return {row.name: float(row.value(run)[0]) for row in rows if row.weight != 0.0}


def integral(run: Priced, curve: Tensor, other: Tensor | None = None, sign: float = 0.0) -> float:
    """Over the period, of a curve (M,) through the nodes, by a fine trapezoid rule; times another one, and of only
    what has the sign, if told so.
    """
    grid = run.movement.grid
    total = 0.0
    for phase in range(len(grid.nodes)):
        start, end = float(grid.durations[0, :phase].sum()), float(grid.durations[0, : phase + 1].sum())
        times = torch.linspace(start + 1e-9, end - 1e-9, 4001, dtype=DTYPE)
        fine = grid.sample(curve.reshape(1, 1, -1), times.unsqueeze(0))[0, 0]
        if other is not None:
            fine = fine * grid.sample(other.reshape(1, 1, -1), times.unsqueeze(0))[0, 0]
        fine = (sign * fine).clamp_min(0.0) if sign else fine
        total += float(torch.trapezoid(fine, times))
    return total


def test_means_and_integrals_over_the_way() -> None:
    run = priced()
    curve = torch.stack((run.body.carried.com[0, 1], run.body.angles.knee[0, 0] ** 2))
    whole = sum(integral(run, row) for row in curve)
    period = float(run.movement.grid.total)
    assert float(run.mean(curve.unsqueeze(0))[0]) == pytest.approx(whole / period, rel=1e-5)
    assert float(run.per_way(curve.unsqueeze(0))[0]) == pytest.approx(whole / (GRAVITY * 3.5 * period), rel=1e-5)
    assert float(run.way[0]) == pytest.approx(3.5 * period)
    assert run.pace == pytest.approx(math.sqrt(run.leg / GRAVITY))
    assert run.leg == pytest.approx(1.75 * 0.531)


def test_external_work_is_the_positive_work_on_the_centre_of_mass() -> None:
    run = priced()
    carried, grid = run.body.carried, run.movement.grid
    power = (carried.force.sum(1) * grid.derivative(carried.com)).sum(1)[0]
    wanted = integral(run, power.clamp_min(0.0)) / (GRAVITY * float(run.way[0]))
    assert wanted > 0.05
    assert float(run.external_work()[0]) == pytest.approx(wanted, rel=0.01)
    # What it gains it loses: braking takes as much.
    assert abs(integral(run, power)) < 1e-5
    torch.testing.assert_close(run.contact_times(), run.movement.grid.durations[:, :1])


def test_work_is_that_of_all_joints_by_themselves() -> None:
    """Without tendons, ligaments and muscles over two joints: torque times rate, positive and negative apart."""
    run = priced()
    given = settings(positive_work=1.0, negative_work=1.0)
    curves = (run.dynamics.torque[0].flatten(0, 1), run.dynamics.rate[0].flatten(0, 1))
    found = values(run, given)
    way = GRAVITY * float(run.way[0])
    for name, sign in (("positive_work", 1.0), ("negative_work", -1.0)):
        wanted = sum(integral(run, torque, rate, sign) for torque, rate in zip(*curves, strict=True)) / way
        assert found[name] == pytest.approx(wanted, rel=0.05)
    # Both are the work of one cycle, which comes back.
    assert found["positive_work"] == pytest.approx(found["negative_work"], rel=1e-3)


def test_muscles_over_two_joints_share_the_power_of_a_leg() -> None:
    run = priced()
    given = settings()
    pull, muscles = muscle_pull(run, given), muscles_of(run, given)
    apart, half, together = (muscle_power(pull, muscles, share)[0] for share in (0.0, 0.5, 1.0))
    torch.testing.assert_close(apart, (run.finer(run.dynamics.torque) * run.finer(run.dynamics.rate))[0])
    for side in ("left", "right"):
        rows = [JOINTS.index(f"{side}_{part}") for part in ("thigh", "shank", "foot")]
        mean = apart[rows, 0].mean(0)
        for row in rows:
            torch.testing.assert_close(together[row, 0], mean)
            torch.testing.assert_close(half[row, 0], 0.5 * (mean + apart[row, 0]))
    # Nothing else is shared: other axes, other joints.
    torch.testing.assert_close(together[:, 1:], apart[:, 1:])
    rest = [k for k, name in enumerate(JOINTS) if name.split("_")[-1] not in ("thigh", "shank", "foot")]
    torch.testing.assert_close(together[rest], apart[rest])


def test_tendons_give_way() -> None:
    """A muscle shortens by what its tendon is stretched, beside the joint's own way: energy is kept in it."""
    run = priced()
    stiff, soft = settings(), settings(tendon={"ankle": 0.5})
    pull = muscle_pull(run, soft)
    plain, sprung = (muscle_power(pull, muscles_of(run, given), 0.0)[0] for given in (stiff, soft))
    stretch = run.dynamics.torque[0] / (0.5 * GRAVITY * run.leg)
    given_way = run.finer(run.movement.grid.derivative(stretch.unsqueeze(0)))[0]
    for k, name in enumerate(JOINTS):
        gap = sprung[k] - plain[k]
        if not name.endswith("foot"):
            assert float(gap.abs().max()) == 0.0
            continue
        wanted = run.finer(run.dynamics.torque)[0, k, 0] * given_way[k, 0]
        torch.testing.assert_close(gap[0], wanted)
        assert float(gap[1:].abs().max()) == 0.0


def test_ligaments_hold_the_foot() -> None:
    """Like springs about where the foot rests: they press toes down where the ankle is bent up, for nothing."""
    run = priced()
    given = settings(ankle_stiffness=0.04, ankle_rest_deg=-10.0)
    pull = muscle_pull(run, given)
    held = run.finer(run.dynamics.torque) - pull.torque
    angles, grid = run.body.angles, run.movement.grid
    for k, name in enumerate(JOINTS):
        if not name.endswith("foot"):
            assert float(held[0, k].abs().max()) < 1e-11
            continue
        side = 0 if name.startswith("left") else 1
        ankle = angles.foot[0, side] - (angles.thigh - angles.knee)[0, side]
        wanted = 0.04 * GRAVITY * run.leg * (ankle + math.radians(10.0))
        torch.testing.assert_close(held[0, k, 0], run.finer(wanted), rtol=0.0, atol=1e-11)
        assert float(held[0, k, 1:].abs().max()) < 1e-11
        rate = (run.finer(run.dynamics.torque_rate) - pull.torque_rate)[0, k, 0]
        torch.testing.assert_close(rate, run.finer(grid.derivative(wanted.unsqueeze(0)))[0], rtol=0.0, atol=1e-8)
        # A positive turn about the axis to the left presses toes down: a spring takes energy when the ankle bends up.
        stored = (0.5 * 0.04 * GRAVITY * run.leg * (ankle + math.radians(10.0)) ** 2).unsqueeze(0)
        worked = held * run.finer(run.dynamics.rate)
        torch.testing.assert_close(worked[:, k, 0], -run.finer(grid.derivative(stored)), rtol=0.0, atol=0.05)


def test_holding_costs_the_square_of_torque_over_strength() -> None:
    """In body weights times the way, at the rate of g l in a time sqrt(l / g) where every muscle gives all it can."""
    run = priced()
    given = settings(torque=1.0, torque_rate=1.0)
    unit = GRAVITY * run.leg
    strengths = torch.tensor([0.2, 0.1, 0.3], dtype=DTYPE)[:, None] * unit
    found = values(run, given)
    for name, what, times in (
        ("torque", run.dynamics.torque, 1.0),
        ("torque_rate", run.dynamics.torque_rate, run.pace),
    ):
        shares = (what[0] * times / strengths).flatten(0, 1)
        wanted = sum(integral(run, row, row) for row in shares) * unit / run.pace / (GRAVITY * float(run.way[0]))
        assert found[name] == pytest.approx(wanted, rel=2e-4)


def test_muscles_are_as_strong_as_the_direction_they_pull_in() -> None:
    run = priced()
    given = settings()
    given.strength = given.strength | {"knee": [[0.2, 0.4], None, 0.3]}
    muscles = muscles_of(run, given)
    unit, knee = GRAVITY * run.leg, JOINTS.index("left_shank")
    torque = torch.zeros_like(run.dynamics.torque)
    for size, strength in ((5.0, 0.2 * unit), (-5.0, 0.4 * unit)):
        torque[:, knee] = size
        found = (torque**2 * muscles.burden(torque))[0, knee, :, 0]
        assert found.tolist() == pytest.approx([25.0 / strength**2, 0.0, 25.0 / (0.3 * unit) ** 2], rel=1e-9)
    # Where no torque is asked for, the two directions meet half-way.
    middle = muscles.burden(torch.zeros_like(torque))[0, knee, 0, 0]
    assert float(middle) == pytest.approx(0.5 * ((0.2 * unit) ** -2 + (0.4 * unit) ** -2))


def test_wishes_look_at_what_they_are_called() -> None:
    """Against the places of the hips: which is lower, which is behind."""
    run = priced(count=3, wobble=0.05)
    body = run.body
    hips = body.joints[:, [SEGMENTS.index(f"{side}_thigh") for side in ("left", "right")]]
    width = 2.0 * 0.05 * 1.75
    middle = run.movement.support.footings[0].phase.shape[-1] // 2
    # The run's step is one of the left foot: the right side swings, the left one lands.
    drop = torch.asin((hips[:, 0, 1] - hips[:, 1, 1])[:, middle] / width)
    torch.testing.assert_close(mid_stance_drop(run)[:, 0], drop, rtol=0.0, atol=1e-9)
    back = torch.atan2(hips[:, 1, 2] - hips[:, 0, 2], hips[:, 0, 0] - hips[:, 1, 0])[:, 0]
    torch.testing.assert_close(touchdown_yaw(run)[:, 0], back, rtol=0.0, atol=1e-9)
    assert float(drop[0]) > 0.0


def test_arm_swing_is_the_root_mean_square_of_a_wave() -> None:
    run = priced(count=3, wobble=0.05)
    genes = run.movement.genes
    wave = torch.sqrt(0.5 * (genes["shoulder_cos"] ** 2 + genes["shoulder_sin"] ** 2))
    torch.testing.assert_close(arm_swing(run), wave, rtol=1e-5, atol=0.0)


def test_the_largest_knee_flexion_is_that_of_the_swing() -> None:
    run = priced(count=3, wobble=0.05)
    found = largest_swing_knee(run)
    # The left knee swings in the air, and through the mirror image of the right one's.
    air = run.movement.grid.slice(1)
    largest = torch.maximum(run.body.angles.knee[:, 1].amax(-1), run.body.angles.knee[:, 0, air].amax(-1))
    # It lies between nodes of the grid.
    assert bool((found[:, 0] >= largest - 2e-3).all())
    assert bool((found[:, 0] <= largest + math.radians(0.5)).all())


def human(**changed: float) -> EffortSettings:
    return settings(human=replace(effort_settings().human, **changed))


def test_wishes_cost_the_square_of_what_they_miss() -> None:
    run = priced()
    lean, drop, yaw = (float(x) for x in (run.movement.genes["trunk_lean"], mid_stance_drop(run), touchdown_yaw(run)))
    given = human(trunk_lean=1.0, trunk_lean_deg=math.degrees(lean + 0.2))
    assert values(run, given)["trunk_lean"] == pytest.approx(4.0)
    given = human(pelvis_drop=1.0, pelvis_drop_deg=math.degrees(drop - 0.3))
    assert values(run, given)["pelvis_drop"] == pytest.approx(9.0)
    given = human(pelvis_yaw=1.0, pelvis_yaw_deg=math.degrees(yaw + 0.1))
    assert values(run, given)["pelvis_yaw"] == pytest.approx(1.0)
    knee, arms = float(largest_swing_knee(run)), float(arm_swing(run))
    assert values(run, human(swing_knee=1.0), knee=knee - 0.1)["swing_knee"] == 0.0
    assert values(run, human(swing_knee=1.0), knee=knee + 0.6)["swing_knee"] == pytest.approx(4.0)
    # Arms swing as far as the energy asks for, or farther.
    for energy, growth, wanted in (
        (1.0, 2.0, 1.0),
        (1.0, 0.0, 1.0),
        (2.0, 1.0, ((2.0 * (arms + 0.1) - arms) / 0.1) ** 2),
    ):
        given = human(arm_swing=1.0, arm_swing_deg=math.degrees(arms + 0.1), arm_growth=growth)
        assert values(run, given, Asked(energy, None, None))["arm_swing"] == pytest.approx(wanted)
    given = human(arm_swing=1.0, arm_swing_deg=math.degrees(arms - 0.1), arm_growth=1.0)
    assert values(run, given)["arm_swing"] == 0.0


def test_a_steady_chest_costs_nothing() -> None:
    run = priced()
    yaw = run.body.angles.chest[0, 2]
    wanted = integral(run, (yaw / 0.1) ** 2) / float(run.movement.grid.total)
    assert values(run, settings(steady=1.0))["steady"] == pytest.approx(wanted, rel=1e-4)
    still = replace(run.body, angles=run.body.angles._replace(chest=torch.zeros_like(run.body.angles.chest)))
    assert values(replace(run, body=still), settings(steady=1.0))["steady"] == 0.0


def test_the_energy_asked_for_is_held_against_that_of_the_least_run() -> None:
    run = priced()
    work, contact = float(run.external_work()[0]), float(run.contact_times()[0, 0])
    given = settings(energy=1.0, contact_cap=1.0)
    found = values(run, given, Asked(1.3, work / 1.3, contact))
    assert found["energy_match"] == pytest.approx(0.0, abs=1e-12)
    assert found["contact_cap"] == pytest.approx(0.0, abs=1e-12)
    found = values(run, given, Asked(2.0, work, contact / 1.2))
    assert found["energy_match"] == pytest.approx(0.25)
    assert found["contact_cap"] == pytest.approx(4.0)
    # Shorter contacts are nobody's business, and of an ordinary run nothing is asked.
    assert values(run, given, Asked(1.0, work, 2.0 * contact))["contact_cap"] == 0.0
    assert values(run, given) == {}


def test_rows_without_weight_are_left_out() -> None:
    rows = {row.name: row.weight for row in body_problem(*ORDINARY, "costs=effort", "costs.torque=0").terms}
    assert set(rows) == {"positive_work", "negative_work", "torque_rate", "steady"}
    assert min(rows.values()) > 0.0


@pytest.mark.parametrize("scale", [0.15, 0.4])
def test_energy_of_a_briskness(scale: float) -> None:
    assert energy_target(0.2) == pytest.approx(0.25)
    assert energy_ratio(0.2, scale) == pytest.approx(1.0)
    last = 0.0
    for beta in (0.2, 0.4, 0.7, 0.9):
        ratio = energy_ratio(beta, scale)
        assert ratio > last
        last = ratio
        # Told back, it is the thesis' target.
        undone = energy_rate(torch.tensor([ratio], dtype=DTYPE), scale)
        assert float(undone[0]) == pytest.approx(beta / (1.0 - beta))
    # There is a least that no sluggishness goes below.
    assert energy_ratio(0.0, scale) == energy_ratio(1e-6, scale) == 0.8
