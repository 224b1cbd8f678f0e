"""The written-out points of the body against its full forward kinematics."""

from __future__ import annotations

import math

import pytest
import torch
from torch import Tensor

from hopdiff.models.body import (
    LOWER,
    UPPER,
    Answer,
    by_name,
    foot_height,
    hip_joint,
    lower_centre,
    mirror,
    sway_sensitivity,
    upper_centre,
)
from hopdiff.models.trajectory import JOINT_CHANNELS
from tests.builders import make_character

BODIES = ("human", "child", "cartoon")
MIDLINE = (
    "pelvis_tilt",
    "pelvis_roll",
    "pelvis_yaw",
    "trunk_lean",
    "trunk_side",
    "trunk_yaw",
    "neck_flex",
    "neck_side",
)
PAIRED = ("thigh", "tilt", "knee", "shoulder", "abduction", "inward", "elbow")
ETAS = ("trunk_lean", "trunk_side", "neck_flex", "neck_side", "shoulder", "abduction", "elbow")
NAMES = (*MIDLINE, *(f"{side}_{name}" for side in ("left", "right") for name in PAIRED))


def random_channels(frames: int = 40, seed: int = 0) -> dict[str, Tensor]:
    """Every channel anywhere between -1 and 1 rad, (1, T) each."""
    values = torch.rand(len(NAMES), 1, frames, generator=torch.Generator().manual_seed(seed), dtype=torch.float64)
    return dict(zip(NAMES, 2.0 * values - 1.0, strict=True))


def rows(channels: dict[str, Tensor], names: tuple[str, ...]) -> Tensor:
    """(C, 1, T)."""
    return torch.stack([channels[name] for name in names])


def full_body(name: str, channels: dict[str, Tensor], height: Tensor) -> tuple[Tensor, Tensor, dict[str, Tensor]]:
    """Joint positions, orientations and ends (1, T, ...) with HIP at a height (1, T)."""
    body = make_character(name)
    zero = torch.zeros_like(height)
    positions, orientations = body.skeleton.forward(torch.stack((zero, height, zero), -1), body.rotations(channels))
    return positions, orientations, body.skeleton.end_positions(positions, orientations)


@pytest.mark.parametrize("name", BODIES)
def test_centre_of_mass(name: str) -> None:
    body, channels = make_character(name), random_channels()
    # What has one gene does not change: the tilt of the pelvis, and how far both arms turn inwards.
    tilt, inward = torch.tensor([0.2]).double(), torch.tensor([-0.3]).double()
    for still, value in (("pelvis_tilt", tilt), ("left_inward", inward), ("right_inward", inward)):
        channels[still] = value.expand(1, 40)
    positions, orientations, _ = full_body(name, channels, torch.zeros(1, 40).double())
    low, high = lower_centre(body, rows(channels, LOWER), tilt), upper_centre(body, rows(channels, UPPER), inward)
    found = torch.stack([a + b for a, b in zip(low, high, strict=True)], dim=-1)
    torch.testing.assert_close(found, body.centre_of_mass(positions, orientations), atol=1e-12, rtol=0.0)


@pytest.mark.parametrize("name", BODIES)
def test_feet_and_hips(name: str) -> None:
    body, channels = make_character(name), random_channels(seed=1)
    height = torch.linspace(0.5, 1.0, 40, dtype=torch.float64).unsqueeze(0)
    positions, _, ends = full_body(name, channels, height)
    feet = foot_height(body, rows(channels, LOWER), height)
    for side, found in zip(("left", "right"), feet.unbind(0), strict=True):
        torch.testing.assert_close(found, ends[f"{side}_knee"][..., 1], atol=1e-12, rtol=0.0)
        hip = torch.stack(hip_joint(body, channels, side), dim=-1)
        wanted = positions[..., body.skeleton.index(f"{side}_hip"), :] - positions[..., 0, :]
        torch.testing.assert_close(hip, wanted, atol=1e-12, rtol=0.0)


def test_mirroring_the_channels_mirrors_the_body() -> None:
    channels = random_channels(seed=2)
    twins = mirror(channels, torch.ones(1, 40, dtype=torch.bool))
    height = torch.full((1, 40), 0.9, dtype=torch.float64)
    positions, _, ends = full_body("human", channels, height)
    other, _, other_ends = full_body("human", twins, height)
    index = make_character().skeleton.index
    flip = torch.tensor([-1.0, 1.0, 1.0], dtype=torch.float64)
    for name in make_character().skeleton.names:
        twin = name.replace("left", "LEFT").replace("right", "left").replace("LEFT", "right")
        torch.testing.assert_close(
            other[..., index(twin), :], positions[..., index(name), :] * flip, atol=1e-12, rtol=0
        )
        if name in ends:
            torch.testing.assert_close(other_ends[twin], ends[name] * flip, atol=1e-12, rtol=0.0)
    back = mirror(twins, torch.ones(1, 40, dtype=torch.bool))
    assert all(torch.equal(back[name], channels[name]) for name in NAMES)
    untouched = mirror(channels, torch.zeros(1, 40, dtype=torch.bool))
    assert all(torch.equal(untouched[name], channels[name]) for name in NAMES)


def genes(**given: float) -> dict[str, Tensor]:
    names = ("arm_swing", "arm_offset", "arm_phase", "arm_abduction", "arm_inward", "elbow_flexion", "elbow_swing")
    names = (*names, "neck_flex", *(f"eta_{name}" for name in ETAS))
    assert set(given) <= set(names)
    return {name: torch.tensor([given.get(name, 0.0)], dtype=torch.float64) for name in names}


SPEED = torch.tensor([5.0], dtype=torch.float64)


def answer(g: dict[str, Tensor]) -> Answer:
    """At nine moments of a stride, without any turning of the trunk."""
    phase = torch.linspace(0.0, 2.0 * math.pi, 9, dtype=torch.float64).unsqueeze(0)
    return Answer.of(g, phase, torch.zeros_like(phase), SPEED)


def upper(g: dict[str, Tensor], sway: float = 0.0, side: float = 0.0) -> dict[str, Tensor]:
    swayed = torch.tensor([sway, side], dtype=torch.float64)[None, :, None].expand(1, 2, 9)
    return dict(zip(UPPER, answer(g).angles(swayed).unbind(0), strict=True))


def test_arms_swing_against_the_legs_of_their_own_side() -> None:
    channels = upper(genes(arm_swing=0.5, arm_offset=-0.2, elbow_flexion=1.5, elbow_swing=0.3))
    left, right = channels["left_shoulder"][0], channels["right_shoulder"][0]
    # Left touchdown (phase 0): left leg in front, left arm behind; half a stride later the other way round.
    assert float(left[0]) == pytest.approx(-0.7)
    assert float(right[0]) == pytest.approx(0.3)
    torch.testing.assert_close(left[4], right[0])
    assert float(channels["left_elbow"][0, 0]) == pytest.approx(1.2)


@pytest.mark.parametrize(
    ("eta", "channel", "axis"),
    [
        ("eta_trunk_lean", "trunk_lean", "forward"),
        ("eta_neck_flex", "neck_flex", "forward"),
        ("eta_shoulder", "left_shoulder", "forward"),
        ("eta_elbow", "right_elbow", "forward"),
        ("eta_trunk_side", "trunk_side", "side"),
        ("eta_neck_side", "neck_side", "side"),
        ("eta_abduction", "left_abduction", "side"),
    ],
)
def test_every_gain_moves_its_own_joint_and_axis(eta: str, channel: str, axis: str) -> None:
    still = upper(genes())
    moved = upper(genes(**{eta: 2.0}), **({"sway": 0.5} if axis == "forward" else {"side": 0.5}))
    # eta times sway over speed.
    assert float((moved[channel] - still[channel]).abs()[0, 0]) == pytest.approx(2.0 * 0.5 / 5.0)
    for name in ("trunk_lean", "trunk_side", "neck_flex", "neck_side"):
        if name != channel:
            assert torch.equal(moved[name], still[name])


@pytest.mark.parametrize(
    "eta", ["trunk_lean", "neck_flex", "shoulder", "elbow", "trunk_side", "neck_side", "abduction"]
)
def test_sensitivity_is_the_slope_of_the_centre_of_mass(eta: str) -> None:
    body, g, tiny = make_character(), genes(**{f"eta_{eta}": 3.0}), 1e-5

    def centre(sway: float, side: float) -> tuple[float, float]:
        point = upper_centre(body, rows(upper(g, sway, side), UPPER), g["arm_inward"])
        return float(point[2][0, 0]), float(point[0][0, 0])  # type: ignore[index]

    forward = (centre(tiny, 0.0)[0] - centre(-tiny, 0.0)[0]) / (2.0 * tiny)
    sideways = (centre(0.0, tiny)[1] - centre(0.0, -tiny)[1]) / (2.0 * tiny)
    wanted = sway_sensitivity(body, answer(g).gains)
    assert (forward, sideways) == pytest.approx(wanted[:, 0].tolist(), abs=1e-6)
    assert abs(forward) + abs(sideways) > 1e-3


def test_rows_of_angles_and_what_never_changes_are_all_the_channels() -> None:
    channels = random_channels(seed=3)
    still = {"pelvis_tilt": torch.full((1,), 0.25), "arm_inward": torch.full((1,), -0.5)}
    found = by_name(rows(channels, LOWER), rows(channels, UPPER), still)
    assert set(found) == set(NAMES)
    for name in (*LOWER, *UPPER):
        assert torch.equal(found[name], channels[name])
    assert found["pelvis_tilt"].tolist() == [[0.25] * 40]
    assert found["left_inward"].tolist() == found["right_inward"].tolist() == [[-0.5] * 40]


def test_channels_that_cost_energy_name_joints_of_the_body() -> None:
    skeleton = make_character().skeleton
    for channel, joint, axis in JOINT_CHANNELS:
        assert channel in NAMES
        assert joint in skeleton.names
        assert axis in (0, 1, 2)
