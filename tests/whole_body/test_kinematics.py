"""Frames and places of segments against products of rotation matrices and the skeleton's own forward kinematics."""

from __future__ import annotations

import math

import pytest
import torch
from torch import Tensor

from hopdiff.whole_body.kinematics import Angles, all_frames, joint_places, segment_centres, trunk_frames
from hopdiff.whole_body.layout import CHEST, COUNT, JOINT_OF, PARENTS, SEGMENTS
from tests.whole_body.bodies import DTYPE, axis_turn, layout_of, matrices

P, M = 3, 5


def random_angles(seed: int = 0) -> Angles:
    generator = torch.Generator().manual_seed(seed)

    def draw(*shape: int) -> Tensor:
        return 2.0 * torch.rand(*shape, generator=generator, dtype=DTYPE) - 1.0

    trunk = [draw(P, 3, M) for _ in range(4)]
    limbs = [draw(P, 2, M) for _ in range(6)]
    return Angles(*trunk, *limbs, draw(P), draw(P))


def wanted_turns(angles: Angles) -> Tensor:
    """(P, S, M, 3, 3) attitudes of all segments, one elementary turn after the other."""
    found = []
    for pitch, roll, yaw in (one.unbind(1) for one in (angles.pelvis, angles.waist, angles.chest, angles.head)):
        found.append(axis_turn(1, yaw) @ axis_turn(2, roll) @ axis_turn(0, pitch))
    for bend in (angles.thigh, angles.thigh - angles.knee):
        # A limb that swings forward turns the other way round about the axis to the left.
        found += [axis_turn(2, angles.tilt[:, k]) @ axis_turn(0, -bend[:, k]) for k in (0, 1)]
    found += [axis_turn(0, -angles.foot[:, k]) for k in (0, 1)]
    upper = []
    for k, side in enumerate((1.0, -1.0)):
        out = axis_turn(2, (side * angles.abduction[:, None]).expand(P, M))
        turn = axis_turn(1, (-side * angles.inward[:, None]).expand(P, M))
        upper.append(found[CHEST] @ out @ axis_turn(0, -angles.shoulder[:, k]) @ turn)
    found += upper
    found += [arm @ axis_turn(0, -angles.elbow[:, k]) for k, arm in enumerate(upper)]
    return torch.stack(found, dim=1)


@pytest.mark.parametrize("seed", [0, 1])
def test_frames_are_the_products_of_elementary_turns(seed: int) -> None:
    angles = random_angles(seed)
    frames = all_frames(angles, trunk_frames(angles))
    assert frames.shape == (P, COUNT, 3, 3, M)
    torch.testing.assert_close(matrices(frames), wanted_turns(angles), rtol=0.0, atol=1e-14)


@pytest.mark.parametrize("name", ["human", "cartoon"])
def test_places_are_those_of_the_skeleton(name: str) -> None:
    layout, angles = layout_of(name), random_angles(2)
    frames = all_frames(angles, trunk_frames(angles))
    root = torch.rand(P, 3, M, generator=torch.Generator().manual_seed(3), dtype=DTYPE)
    joints = joint_places(layout, root, frames)
    turns = wanted_turns(angles)
    rotations = torch.eye(3, dtype=DTYPE).repeat(P, M, len(layout.skeleton.names), 1, 1)
    for k, segment in enumerate(SEGMENTS):
        parent = PARENTS[k]
        own = turns[:, k] if parent < 0 else turns[:, parent].transpose(-1, -2) @ turns[:, k]
        rotations[:, :, layout.skeleton.index(JOINT_OF[segment])] = own
    places, attitudes = layout.skeleton.forward(root.transpose(1, 2), rotations)
    for k, segment in enumerate(SEGMENTS):
        joint = layout.skeleton.index(JOINT_OF[segment])
        torch.testing.assert_close(joints[:, k].transpose(1, 2), places[:, :, joint], rtol=0.0, atol=1e-13)
        torch.testing.assert_close(turns[:, k], attitudes[:, :, joint], rtol=0.0, atol=1e-13)
    centres = segment_centres(layout, root, frames)
    wanted = joints + (turns @ layout.centres[:, None, :, None])[..., 0].transpose(2, 3)
    torch.testing.assert_close(centres, wanted, rtol=0.0, atol=1e-13)


def still(**changed: Tensor) -> Angles:
    none, two = torch.zeros(1, 3, 1, dtype=DTYPE), torch.zeros(1, 2, 1, dtype=DTYPE)
    plain = Angles(none, none, none, none, two, two, two, two, two, two, two[:, 0, 0], two[:, 0, 0])
    return plain._replace(**changed)


def places(angles: Angles) -> dict[str, list[float]]:
    layout = layout_of()
    frames = all_frames(angles, trunk_frames(angles))
    centres = segment_centres(layout, torch.zeros(1, 3, 1, dtype=DTYPE), frames)
    return {name: centres[0, k, :, 0].tolist() for k, name in enumerate(SEGMENTS)}


def test_directions_are_those_that_names_tell() -> None:
    """x is left, y up, z ahead."""
    straight, quarter = places(still()), torch.tensor([[[0.4], [0.4]]], dtype=DTYPE)
    left, right = (torch.tensor([[[a], [b]]], dtype=DTYPE) for a, b in ((0.4, 0.0), (0.0, 0.4)))
    assert places(still(thigh=quarter))["left_thigh"][2] > straight["left_thigh"][2] + 0.05
    bent = places(still(knee=right))
    assert bent["right_foot"][2] < straight["right_foot"][2] - 0.1
    assert bent["left_foot"] == pytest.approx(straight["left_foot"])
    assert places(still(tilt=left))["left_foot"][0] > straight["left_foot"][0] + 0.1
    assert places(still(foot=quarter))["left_foot"][1] > straight["left_foot"][1]
    assert places(still(shoulder=quarter))["left_forearm"][2] > straight["left_forearm"][2] + 0.05
    assert places(still(elbow=right))["right_forearm"][2] > straight["right_forearm"][2] + 0.03
    out = places(still(abduction=torch.tensor([0.4], dtype=DTYPE)))
    assert out["left_upper_arm"][0] > straight["left_upper_arm"][0] + 0.03
    assert out["right_upper_arm"][0] < straight["right_upper_arm"][0] - 0.03
    bend = quarter + math.radians(60)
    folded = places(still(elbow=bend))
    turned = places(still(elbow=bend, inward=torch.tensor([0.4], dtype=DTYPE)))
    assert turned["left_forearm"][0] < folded["left_forearm"][0] - 0.03
    assert turned["right_forearm"][0] > folded["right_forearm"][0] + 0.03
    for axis, (name, coordinate, sign) in enumerate(
        (("chest", 2, 1.0), ("chest", 0, -1.0), ("left_upper_arm", 2, -1.0))
    ):
        lean = torch.zeros(1, 3, 1, dtype=DTYPE)
        lean[:, axis] = 0.4
        moved = places(still(chest=lean))[name][coordinate] - straight[name][coordinate]
        assert sign * moved > 0.02
