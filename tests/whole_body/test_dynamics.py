"""Torques and powers of the joints: a body that stands still, and the energy of one that moves."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import pytest
import torch
from torch import Tensor

from hopdiff.whole_body.dynamics import ANKLES, Dynamics, dynamics
from hopdiff.whole_body.kinematics import Angles, all_frames, segment_centres, trunk_frames
from hopdiff.whole_body.layout import SEGMENTS, SHANKS, THIGHS
from hopdiff.whole_body.movement import Body, Movement
from hopdiff.whole_body.plan import RUN
from tests.whole_body.bodies import DTYPE, NAMES, ROUNDS, Solved, genes_of, matrices, movement_of, solved, spins

HIPS, KNEES = (slice(own.start - 1, own.stop - 1) for own in (THIGHS, SHANKS))  # among the joints after the pelvis

GRAVITY = 9.81
JOINTS = SEGMENTS[1:]


def standing(**bent: tuple[float, float]) -> tuple[Movement, Body]:
    """A body that keeps still on its left foot, under its centre of mass; angles of left and right limbs [rad]."""
    movement = movement_of("run", genes_of("run"))
    layout, count = movement.layout, movement.grid.size
    trunk, none = torch.zeros(1, 3, count, dtype=DTYPE), torch.zeros(1, 2, count, dtype=DTYPE)
    plain = Angles(trunk, trunk, trunk, trunk, none, none, none, none, none, none, none[:, 0, 0], none[:, 0, 0])
    pairs = {name: torch.tensor([pair], dtype=DTYPE)[..., None].expand(1, 2, count) for name, pair in bent.items()}
    angles = plain._replace(**pairs)
    frames = all_frames(angles, trunk_frames(angles))
    root = torch.zeros(1, 3, count, dtype=DTYPE)
    centres = segment_centres(layout, root, frames)
    com = torch.einsum("s,psim->pim", movement.shares, centres)
    force = torch.zeros(1, 2, 3, count, dtype=DTYPE)
    force[:, 0, 1] = GRAVITY
    cop = torch.stack((com, com), dim=1) * torch.tensor([1.0, 0.0, 1.0], dtype=DTYPE)[:, None]
    cop[:, :, 1] = -layout.leg
    carried: Any = SimpleNamespace(com=com, force=force, cop=cop)
    return movement, Body(layout, angles, root, frames, [], com, carried)


def lever(movement: Movement, body: Body, joint: str, parts: tuple[str, ...]) -> Tensor:
    """(3,) moment of the weight of some segments about a joint, per body mass."""
    total = torch.zeros(3, dtype=DTYPE)
    for part in parts:
        k = SEGMENTS.index(part)
        arm = body.centres[0, k, :, 0] - body.joints[0, SEGMENTS.index(joint), :, 0]
        weight = movement.shares[k] * torch.tensor([0.0, -GRAVITY, 0.0], dtype=DTYPE)
        total = total + torch.linalg.cross(arm, weight)
    return total


def test_what_still_joints_hold() -> None:
    """The weight of what hangs on them, and on the standing leg that of everything else."""
    movement, body = standing(thigh=(0.3, 1.1), knee=(0.5, 0.7), shoulder=(0.0, 1.2), elbow=(0.0, 0.4))
    found = dynamics(movement, body)
    assert float(found.residual.abs().max()) < 1e-9
    assert float(found.rate.abs().max()) < 1e-9
    # Axes of the segment above.
    for joint, parts in (
        ("right_thigh", ("right_thigh", "right_shank", "right_foot")),
        ("right_shank", ("right_shank", "right_foot")),
        ("right_upper_arm", ("right_upper_arm", "right_forearm")),
        ("right_forearm", ("right_forearm",)),
        ("head", ("head",)),
    ):
        k = SEGMENTS.index(joint)
        holder = {"right_thigh": 0, "right_shank": SEGMENTS.index("right_thigh"), "right_upper_arm": 2, "head": 2}
        above = holder.get(joint, SEGMENTS.index("right_upper_arm"))
        wanted = -(matrices(body.frames)[0, above, 0].T @ lever(movement, body, joint, parts))
        torch.testing.assert_close(found.torque[0, k - 1, :, 0], wanted, rtol=0.0, atol=1e-9)
        assert float(wanted.norm()) > 0.005, joint
    # A raised thigh is held up: against the axis to the left, about which things fall forward.
    assert float(found.torque[0, HIPS][1, 0, 0]) < -0.1
    # Left knee: everything but shank and foot rests on it.
    beyond = tuple(name for name in SEGMENTS if name not in ("left_shank", "left_foot"))
    wanted = matrices(body.frames)[0, SEGMENTS.index("left_thigh"), 0].T @ lever(movement, body, "left_shank", beyond)
    torch.testing.assert_close(found.torque[0, KNEES][0, :, 0], wanted, rtol=0.0, atol=1e-9)
    # Left ankle: the ground pushes at a lever.
    ahead = float(body.carried.cop[0, 0, 2, 0] - body.joints[0, SEGMENTS.index("left_foot"), 2, 0])
    foot = lever(movement, body, "left_foot", ("left_foot",))
    assert float(found.torque[0, ANKLES][0, 0, 0]) == pytest.approx(GRAVITY * ahead - float(foot[0]), abs=1e-9)


def energy(one: Solved) -> Tensor:
    """(P, M) kinetic and potential energy of all segments per body mass [J/kg]."""
    movement, body, _ = one
    layout = movement.layout
    velocity = movement.grid.derivative(body.centres)
    turns, rates = matrices(body.frames), spins(movement, body.frames)
    local = (turns.transpose(-1, -2) @ rates.unsqueeze(-1))[..., 0]
    moving = 0.5 * (layout.masses[:, None] * (velocity**2).sum(2)).sum(1)
    turning = 0.5 * (layout.inertias[:, None] * local**2).sum(-1).sum(1)
    height = (layout.masses[:, None] * body.centres[:, :, 1]).sum(1)
    return (moving + turning + GRAVITY * height) / layout.masses.sum()


def power(found: Dynamics) -> Tensor:
    """(P, M) of all joints [W/kg]."""
    return (found.torque * found.rate).sum(dim=(1, 2))


def work_gap(one: Solved) -> float:
    """Largest difference between the change of energy and the power of the joints [W/kg], away from ends of phases."""
    grid = one.movement.grid
    gap = (grid.derivative(energy(one)) - power(dynamics(one.movement, one.body))).abs()
    return max(float(gap[:, grid.slice(phase)][:, 2:-2].max()) for phase in range(len(grid.nodes)))


# Measured: 0.05, 0.003, 0.27 and 0.22 % of the largest power.
@pytest.mark.parametrize(("name", "share"), [("run", 1e-3), ("walk", 1e-3), ("hop", 5e-3), ("limp", 5e-3)])
def test_joints_do_all_the_work(name: str, share: float) -> None:
    """Energy of the segments changes as fast as the joints work: a foot that rolls takes nothing from the ground."""
    one = solved(name)
    worked = power(dynamics(one.movement, one.body))
    largest = float(worked.abs().max())
    assert 5.0 < largest < 400.0
    assert work_gap(one) < share * largest
    # What they work over a period comes back.
    positive = float(one.movement.grid.total_of(worked.clamp_min(0.0)))
    assert float(one.movement.grid.total_of(worked).abs()) < 1e-3 * positive


def test_what_is_left_over_is_left_by_the_nodes() -> None:
    """With twelve nodes more a phase the same run keeps its energy eight times as well."""
    coarse = solved("run")
    movement = coarse.movement
    plan = replace(RUN, nodes=tuple(size + 12 for size in RUN.nodes))
    fine = Movement(movement.layout, plan, movement.genes, movement.speed, movement.grid.durations)
    state, moved = fine.solve(ROUNDS)
    assert work_gap(Solved(fine, fine.body(state), moved)) < work_gap(coarse) / 8.0


@pytest.mark.parametrize("name", NAMES)
def test_nothing_turns_the_pelvis_but_its_joints(name: str) -> None:
    movement, body, _ = solved(name)
    left_over = dynamics(movement, body).residual
    for phase in range(len(movement.grid.nodes)):
        assert float(left_over[..., movement.grid.slice(phase)][..., 2:-2].abs().max()) < 5e-3


def test_torque_rates_are_rates() -> None:
    movement, body, _ = solved("run")
    found = dynamics(movement, body)
    grid, inside = movement.grid, slice(4, 20)
    gone = grid.integral(found.torque_rate)[..., inside]
    torque = found.torque[..., inside]
    torch.testing.assert_close(gone - gone[..., :1], torque - torque[..., :1], rtol=0.0, atol=1e-6)


def test_powers_do_not_depend_on_neighbours() -> None:
    three, one = solved("run", 3, 0.03), solved("run")
    together, alone = dynamics(three.movement, three.body), dynamics(one.movement, one.body)
    inner = slice(3, 21)
    torch.testing.assert_close(together.torque[:1, ..., inner], alone.torque[..., inner], rtol=0.0, atol=1e-6)
    torch.testing.assert_close(together.rate[:1], alone.rate, rtol=0.0, atol=1e-6)
