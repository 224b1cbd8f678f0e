"""The ground force: what it adds up to over a period, and where it points."""

from __future__ import annotations

import math

import pytest
import torch
from torch import Tensor

from hopdiff.whole_body.places import pieces
from hopdiff.whole_body.plan import HOP, LIMP, RUN, WALK, Plan
from hopdiff.whole_body.support import Carried, vertical_force
from tests.whole_body.bodies import DTYPE, LIMP_AMOUNT, NAMES, SPEEDS, UP, genes_of, movement_of, solved

GRAVITY = 9.81


def small(value: Tensor, bound: float = 1e-8) -> None:
    assert float(value.abs().max()) < bound


@pytest.mark.parametrize("shape", [(0.0, 0.0, 0.0), (0.3, -0.2, 0.1), (-0.5, 0.4, -0.3)])
def test_vertical_force_is_four_sines_with_the_impulse_asked_for(shape: tuple[float, ...]) -> None:
    count = 2001
    phase = torch.linspace(0.0, 1.0, count, dtype=DTYPE).expand(2, -1)
    impulse, time = torch.tensor([3.4, 5.0], dtype=DTYPE), torch.tensor([0.2, 0.35], dtype=DTYPE)
    force = vertical_force(phase, impulse, time, torch.tensor([shape] * 2, dtype=DTYPE))
    torch.testing.assert_close(torch.trapezoid(force, phase * time[:, None]), impulse, rtol=1e-5, atol=0.0)
    small(force[:, [0, -1]], 1e-12)
    # Sine by sine: twice the mean of force times wave.
    for order in range(1, 6):
        wave = torch.sin(math.pi * order * phase)
        weight = 2.0 * torch.trapezoid(force * wave, phase) / (impulse / time)
        wanted = {1: 0.5 * math.pi - shape[1] / 3.0, 5: 0.0}.get(order, shape[(order - 2) % 3])
        torch.testing.assert_close(weight, torch.full_like(weight, wanted), rtol=0.0, atol=1e-5)


def moments(carried: Carried) -> Tensor:
    """(P, 3, M) about the centre of mass, component by component."""
    arm, force = carried.cop - carried.com.unsqueeze(1), carried.force
    x, y, z = arm.unbind(2)
    fx, fy, fz = force.unbind(2)
    return torch.stack((y * fz - z * fy, z * fx - x * fz, x * fy - y * fx), dim=2).sum(1)


@pytest.mark.parametrize("name", NAMES)
def test_over_a_period_the_ground_carries_the_body_and_gives_it_nothing_else(name: str) -> None:
    movement, body, _ = solved(name, 3, 0.03)
    grid, carried = movement.grid, body.carried
    force = carried.force.sum(1)
    torch.testing.assert_close(grid.total_of(force[:, 1]), GRAVITY * grid.total, rtol=1e-7, atol=0.0)
    small(grid.total_of(force[:, 2]))
    torch.testing.assert_close(carried.moment(), moments(carried), rtol=0.0, atol=1e-12)
    turned = grid.total_of(moments(carried))
    small(turned[:, 0])
    if not movement.plan.mirrored:
        # A whole stride: nothing sideways, no roll, no yaw. In a mirrored plan the next step takes it back.
        small(grid.total_of(force[:, 0]))
        small(turned)


@pytest.mark.parametrize("name", NAMES)
def test_the_centre_of_mass_goes_as_the_force_says(name: str) -> None:
    movement, body, _ = solved(name, 3, 0.03)
    grid, carried = movement.grid, body.carried
    com, force = carried.com, carried.force.sum(1)
    acceleration = grid.derivative(grid.derivative(com))
    small(acceleration + UP[:, None] - force, 2e-2)
    rate = grid.derivative(com)
    flip = torch.tensor([-1.0 if movement.plan.mirrored else 1.0, 1.0, 1.0], dtype=DTYPE)
    way = torch.zeros(3, 3, dtype=DTYPE)
    way[:, 2] = SPEEDS[name] * grid.total
    small(com[:, :, -1] - (com[:, :, 0] * flip + way))
    small(rate[:, :, -1] - rate[:, :, 0] * flip, 2e-4)
    # And from phase to phase.
    for phase in range(1, len(grid.nodes)):
        a, b = grid.slice(phase - 1).stop - 1, grid.slice(phase).start
        small(com[:, :, a] - com[:, :, b])
        small(rate[:, :, a] - rate[:, :, b], 2e-4)
    assert float(grid.mean_of(rate[:, 2])[0]) == pytest.approx(SPEEDS[name], rel=1e-9)


@pytest.mark.parametrize("name", NAMES)
def test_the_force_is_continuous_and_acts_on_the_sole_of_a_foot_that_stands(name: str) -> None:
    movement, body, _ = solved(name)
    grid, plan, carried = movement.grid, movement.plan, body.carried
    force, layout = carried.force, movement.layout
    count = len(grid.nodes)
    flip = torch.tensor([-1.0, 1.0, 1.0], dtype=DTYPE)
    for phase in range(count):
        end = force[0, :, :, grid.slice(phase).stop - 1]
        start = force[0, :, :, grid.slice((phase + 1) % count).start]
        if phase == count - 1 and plan.mirrored:
            start = start.flip(0) * flip
        small(end - start, 1e-6)
    for contact in plan.contacts:
        side = ("left", "right").index(contact.limb)
        standing = (force[0, side, 1].abs() > 1e-6).nonzero().flatten()
        assert len(standing) > 15
        ankle, pitch = body.joints[0, 8 + side], body.angles.foot[0, side]
        arm = carried.cop[0, side] - ankle
        along = arm[2] * pitch.cos() + arm[1] * pitch.sin()
        small(carried.cop[0, side, 1])
        assert float(along[standing].min()) > float(layout.heel[2]) - 2e-3
        assert float(along[standing].max()) < float(layout.ball[2]) + 2e-3


@pytest.mark.parametrize("name", ["run", "walk", "limp"])
def test_feet_stand_a_step_width_apart_and_force_aims_sideways_at_the_body(name: str) -> None:
    movement, body, _ = solved(name)
    support, carried = movement.support, body.carried
    first = support.pieces[0]
    width = genes_of(name)["step_width"]
    flip = torch.tensor([-1.0, 1.0, 1.0], dtype=DTYPE)[:, None]
    rows = []
    for piece in first:
        turn = flip if piece.mirrored else torch.ones_like(flip)
        parts = carried.cop[0, piece.side], carried.force[0, piece.side], carried.com[0]
        rows.append(torch.stack([part[:, piece.period] * turn for part in parts]))
    cop, force, com = torch.cat(rows, dim=-1)
    small(cop[0] - 0.5 * width)
    middle = cop.shape[-1] // 2
    aimed = force[0, middle] / force[1, middle]
    assert float(aimed) == pytest.approx(float((com[0, middle] - cop[0, middle]) / com[1, middle]), rel=1e-6)


@pytest.mark.parametrize("name", ["run", "walk", "hop"])
def test_a_force_that_aims_at_the_centre_of_mass_turns_nothing_over(name: str) -> None:
    """aim_below 0 without sway: no pitching moment at any time; aim_below 1: no push ahead at all."""
    genes = genes_of(name)
    genes["aim_sway"] = torch.zeros(1, dtype=DTYPE)
    for aim in (0.0, 1.0):
        genes["aim_below"] = torch.full((1,), aim, dtype=DTYPE)
        movement = movement_of(name, genes)
        # Also of a body that is not solved, once its way ahead is.
        forward, height = movement.speed[:, None] * movement.grid.times, torch.ones(1, dtype=DTYPE)
        takeoff = torch.full((1, len(movement.plan.contacts)), -0.6, dtype=DTYPE)
        for _ in range(60):
            carried = movement.support.carry(forward, height, takeoff)
            forward = carried.forward
        if aim == 0.0:
            assert float(carried.force[:, :, 2].abs().max()) > 0.5
            small(carried.moment()[:, 0])
        else:
            small(carried.force[:, :, 2])
            assert float(carried.moment()[:, 0].abs().max()) > 0.3


def test_feet_press_equally_hard_in_a_limp() -> None:
    movement, body, _ = solved("limp")
    durations = movement.grid.durations[0]
    left, right = movement.grid.total_of(body.carried.force[:, :, 1])[0]
    assert float(durations[0] / durations[2]) == pytest.approx(1.0 - LIMP_AMOUNT)
    assert float(left / right) == pytest.approx(1.0 - LIMP_AMOUNT, rel=1e-6)
    assert float(durations[1]) == pytest.approx(float(durations[3]))


def test_limbs_and_phases_of_the_plans() -> None:
    """In words: which limb is on the ground, phase by phase of the period, from the force alone."""
    wanted = {
        "run": [("left",), ()],
        "walk": [("left", "right"), ("left",)],
        "hop": [("left", "right"), ()],
        "limp": [("left",), (), ("right",), ()],
    }
    for name, phases in wanted.items():
        movement, body, _ = solved(name)
        for phase, limbs in enumerate(phases):
            pressed = body.carried.force[0, :, 1, movement.grid.slice(phase)].abs().amax(-1) > 1e-3
            found = tuple(limb for limb, on in zip(("left", "right"), pressed.tolist(), strict=True) if on)
            assert found == limbs, (name, phase)


@pytest.mark.parametrize("plan", [RUN, WALK, HOP, LIMP])
def test_stance_and_swing_fill_the_stride(plan: Plan) -> None:
    """Every node of the stride belongs to each worked-out limb once, in stance or in swing."""
    for contact in plan.contacts:
        found = pieces(plan, contact.limb, contact.phases) + pieces(plan, contact.limb, plan.swing(contact))
        seen = sorted((p.period.start, p.period.stop, p.mirrored) for p in found)
        starts = [sum(plan.nodes[:k]) for k in range(plan.count)]
        spans = [(start, start + size) for start, size in zip(starts, plan.nodes, strict=True)]
        mirrors = (False, True) if plan.mirrored else (False,)
        assert seen == sorted((a, b, m) for a, b in spans for m in mirrors)
        own = 0 if contact.limb == "left" else 1
        assert all(p.side == (1 - own if p.mirrored else own) for p in found)


def test_durations_of_steps() -> None:
    genes = {"step_time": torch.tensor([0.5, 0.4], dtype=DTYPE), "contact_share": torch.tensor([0.6, 0.7], dtype=DTYPE)}
    torch.testing.assert_close(RUN.durations(genes), torch.tensor([[0.3, 0.2], [0.28, 0.12]], dtype=DTYPE))
    genes["contact_share"] = torch.tensor([1.2, 1.1], dtype=DTYPE)
    # Both feet stand a fifth of the step, then one the rest: it stands twice the first and once the second.
    torch.testing.assert_close(WALK.durations(genes), torch.tensor([[0.1, 0.4], [0.04, 0.36]], dtype=DTYPE))
