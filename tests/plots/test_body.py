from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest

from hopdiff.motion import Motion
from hopdiff.plots.body import Body, Part
from hopdiff.plots.shapes import hull
from hopdiff.plots.view import BEHIND, FRONT, RIGHT, Camera

OBLIQUE = Camera(-1.9, 0.5)


@pytest.fixture
def body(motion: Motion) -> Body:
    return Body(motion.clip.skeleton)


@pytest.fixture
def pose(motion: Motion, body: Body) -> np.ndarray:
    return body.points(motion.clip)[6]


@pytest.fixture
def standing(motion: Motion, body: Body) -> np.ndarray:
    """Feet together, arms hanging."""
    offsets = motion.clip.skeleton.offsets.numpy()
    points: list[np.ndarray] = []
    for parent, offset in zip(motion.clip.skeleton.parents, offsets, strict=True):
        points.append(offset if parent < 0 else points[parent] + offset)
    ends = motion.clip.skeleton.end_sites
    points += [points[motion.clip.skeleton.index(name)] + ends[name].numpy() for name in body.end_names]
    return np.stack(points)


def limbs(parts: list[Part], side: str) -> list[np.ndarray]:
    return sorted((part.outline for part in parts if part.side == side), key=lambda outline: tuple(outline[0]))


def width_at(outline: np.ndarray, height: float) -> float:
    """Width of a convex outline at a height; 0 where it does not reach."""
    crossings, height = [], height + 1e-7  # between corners
    for (x, y), (next_x, next_y) in pairwise([*outline, outline[0]]):
        if (y - height) * (next_y - height) < 0:
            crossings.append(x + (height - y) / (next_y - y) * (next_x - x))
    return max(crossings, default=0.0) - min(crossings, default=0.0)


def trunk_width(body: Body, pose: np.ndarray, camera: Camera, height: float) -> float:
    return max(width_at(part.outline, height) for part in body.parts(pose, camera) if part.side == "middle")


def test_from_the_right_a_camera_sees_the_limbs_of_the_side_view(body: Body, pose: np.ndarray) -> None:
    plain, seen = body.parts(pose), body.parts(pose, RIGHT)
    for side in ("left", "right"):
        ours, theirs = limbs(seen, side), limbs(plain, side)
        assert len(ours) == 4
        for a, b in zip(ours, theirs, strict=True):
            np.testing.assert_allclose(a, b, atol=1e-9)


@pytest.mark.parametrize(("camera", "near"), [(RIGHT, "right"), (Camera(math.pi / 2), "left")])
def test_the_near_side_is_drawn_last(body: Body, pose: np.ndarray, camera: Camera, near: str) -> None:
    sides = [part.side for part in body.parts(pose, camera)]
    first_middle, last_middle = sides.index("middle"), len(sides) - sides[::-1].index("middle")
    assert set(sides[:first_middle]) == {"left", "right"} - {near}
    assert set(sides[last_middle:]) == {near}


@pytest.mark.parametrize("elevation", [0.0, 0.5])
def test_a_limb_in_front_of_the_trunk_is_hidden_from_behind(body: Body, standing: np.ndarray, elevation: float) -> None:
    pose = standing.copy()
    knee, foot = body.joint_names.index("left_knee"), len(body.joint_names) + body.end_names.index("left_knee")
    pose[[knee, foot]] = pose[body.joint_names.index("left_hip")] + np.array([[0, 0, 0.4], [0, -0.4, 0.4]])

    def covers(camera: Camera) -> bool:
        """Whether the left thigh, its part with the knee's end in the picture, comes after the trunk."""
        parts = body.parts(pose, camera)
        place = camera.project(pose[knee])[:2]
        middle = max(order for order, part in enumerate(parts) if part.side == "middle")
        reaching = [
            order
            for order, part in enumerate(parts)
            if part.side == "left" and np.hypot(*(part.outline - place).T).min() < 0.08
        ]
        return min(reaching) > middle

    assert covers(Camera(0.0, elevation))
    assert not covers(Camera(math.pi, elevation))


def test_the_trunk_tapers_between_shoulders_and_hips(body: Body, standing: np.ndarray) -> None:
    names = body.joint_names
    heights = {name: standing[names.index(name), 1] for name in ("left_shoulder", "waist", "pelvis")}
    front = {name: trunk_width(body, standing, FRONT, y) for name, y in heights.items()}
    side = {name: trunk_width(body, standing, RIGHT, y) for name, y in heights.items()}
    assert front["left_shoulder"] > 1.2 * front["waist"]
    assert front["pelvis"] > 1.05 * front["waist"]
    assert front["left_shoulder"] > 1.7 * side["left_shoulder"]
    shoulders = np.ptp(standing[[names.index(f"{side}_shoulder") for side in ("left", "right")], 0])
    assert 0.85 * shoulders < front["left_shoulder"] < 1.3 * shoulders
    assert trunk_width(body, standing, BEHIND, heights["waist"]) == pytest.approx(front["waist"])


def test_a_limb_that_points_at_the_viewer_is_short_and_as_thick(body: Body, standing: np.ndarray) -> None:
    forward = standing.copy()
    hand, elbow = len(body.joint_names) + body.end_names.index("left_elbow"), body.joint_names.index("left_elbow")
    forward[hand] = forward[elbow] + np.array([0, 0, 0.35])

    def forearm(pose: np.ndarray) -> np.ndarray:
        place = FRONT.project(pose[[hand, elbow]].mean(axis=0))[:2]
        return min(
            (part.outline for part in body.parts(pose, FRONT) if part.side == "left"),
            key=lambda outline: float(np.hypot(*(outline.mean(axis=0) - place))),
        )

    hanging, pointing = np.ptp(forearm(standing), axis=0), np.ptp(forearm(forward), axis=0)
    assert pointing[1] < 0.35 * hanging[1]
    assert pointing[0] == pytest.approx(hanging[0], rel=0.05)


def test_the_picture_does_not_change_when_runner_and_camera_turn_together(body: Body, pose: np.ndarray) -> None:
    turn = 0.8
    x, z = pose[:, 0], pose[:, 2]
    turned = np.stack(
        (x * math.cos(turn) + z * math.sin(turn), pose[:, 1], z * math.cos(turn) - x * math.sin(turn)), axis=1
    )
    turned_camera = Camera(OBLIQUE.azimuth + turn, OBLIQUE.elevation)
    for a, b in zip(body.parts(pose, OBLIQUE), body.parts(turned, turned_camera), strict=True):
        assert a.side == b.side
        np.testing.assert_allclose(a.outline.max(axis=0), b.outline.max(axis=0), atol=5e-3)
        np.testing.assert_allclose(a.outline.mean(axis=0), b.outline.mean(axis=0), atol=2e-2)


def test_hull() -> None:
    corners = np.array([[0.0, 0.0], [2.0, 0.0], [2.0, 1.0], [0.0, 1.0]])
    inside = np.array([[1.0, 0.5], [0.2, 0.9]])
    found = hull(np.concatenate((inside, corners)))
    assert {tuple(corner) for corner in found} == {tuple(corner) for corner in corners}
