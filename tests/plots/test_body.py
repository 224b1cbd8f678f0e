from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
import shapely
import torch

from hopdiff.geometry.clip import Clip
from hopdiff.geometry.rotation import axis_rotation
from hopdiff.geometry.skeleton import Skeleton
from hopdiff.motion import Motion
from hopdiff.plots.body import Body, Part
from hopdiff.plots.shapes import hull
from hopdiff.plots.view import BEHIND, FRONT, RIGHT, Camera
from hopdiff.whole_body.skeleton import full_skeleton, heel_of
from tests.builders import make_character

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


def rest(skeleton: Skeleton) -> np.ndarray:
    """(J + E, 3) points of a body that stands with hanging arms."""
    rotations = torch.eye(3, dtype=torch.float64).expand(1, len(skeleton.names), 3, 3)
    return Body(skeleton).points(Clip(skeleton, skeleton.offsets[:1], rotations, 1.0))[0]


@pytest.fixture(scope="module")
def shod() -> Skeleton:
    """A body with feet, toes and collarbones, on soles of two centimetres."""
    return full_skeleton(make_character("human").skeleton, 0.02)


def leg(body: Body, points: np.ndarray, camera: Camera | None = None) -> list[np.ndarray]:
    """The left leg's outlines from the hip down."""
    hip = points[body.joint_names.index("left_hip")]
    hip_seen = hip[1] if camera is None else camera.project(hip)[1]
    parts = [part.outline for part in body.parts(points, camera) if part.side == "left"]
    return sorted(
        (part for part in parts if part[:, 1].min() < 0.9 * hip_seen - 0.1), key=lambda part: -part[:, 1].min()
    )


def turned_leg(shod: Skeleton, ankle: float, toe: float) -> tuple[Body, np.ndarray]:
    """A standing body whose left foot is turned at the ankle and at the ball, toes up positive [rad]."""
    rotations = torch.eye(3, dtype=torch.float64).repeat(1, len(shod.names), 1, 1)
    for name, angle in (("left_ankle", ankle), ("left_toe", toe)):
        rotations[0, shod.index(name)] = axis_rotation("X", torch.tensor(-angle, dtype=torch.float64))
    body = Body(shod)
    return body, body.points(Clip(shod, shod.offsets[:1], rotations, 1.0))[0]


def heel_of_left(body: Body, points: np.ndarray, shod: Skeleton, ankle: float) -> np.ndarray:
    offset = heel_of(make_character("human").skeleton, 0.02).numpy()
    turn = axis_rotation("X", torch.tensor(-ankle, dtype=torch.float64)).numpy()
    return points[body.joint_names.index("left_ankle")] + turn @ offset


@pytest.mark.parametrize(("ankle", "toe"), [(0.0, 0.0), (0.4, 0.0), (-1.0, 0.0), (-0.6, 0.6), (-1.4, 0.3)])
def test_a_foot_is_one_piece_with_its_sole_at_heel_ball_and_toes(shod: Skeleton, ankle: float, toe: float) -> None:
    body, points = turned_leg(shod, ankle, toe)
    names = [*body.joint_names]
    tip = points[len(names) + body.end_names.index("left_toe")]
    spots = [heel_of_left(body, points, shod, ankle), points[names.index("left_toe")], tip]
    outlines = leg(body, points)
    assert len(outlines) == 3, "thigh, shank and foot"
    foot = shapely.Polygon(min(outlines, key=lambda outline: float(np.hypot(*(outline - tip[[2, 1]]).T).min())))
    assert foot.is_valid
    for spot in spots:
        assert foot.exterior.distance(shapely.Point(spot[[2, 1]])) < 1.5e-3
    assert foot.contains(shapely.Point(points[names.index("left_ankle")][[2, 1]]))


def test_standing_feet_stand_on_the_ground(shod: Skeleton) -> None:
    for skeleton in (shod, make_character("human").skeleton):
        points = rest(skeleton)
        lowest = min(part.outline[:, 1].min() for part in Body(skeleton).parts(points))
        assert lowest == pytest.approx(points[:, 1].min(), abs=1e-3)


def test_from_behind_feet_are_as_broad_as_shoes(shod: Skeleton) -> None:
    foot = leg(Body(shod), rest(shod), BEHIND)[-1]
    assert np.ptp(foot[:, 0]) < 0.12
    assert width_at(foot, 0.02) > 0.08


def test_arms_begin_at_the_shoulders_and_the_trunk_reaches_them(shod: Skeleton) -> None:
    body, points = Body(shod), rest(shod)
    shoulder = points[body.joint_names.index("left_shoulder")]
    parts = body.parts(points, FRONT)
    arms = [part.outline for part in parts if part.side == "left" and part.outline[:, 1].max() > 0.5 * shoulder[1]]
    assert min(outline[:, 0].min() for outline in arms if outline[:, 1].max() > 0.9 * shoulder[1]) > 0.6 * shoulder[0]
    trunk = [part.outline for part in parts if part.side == "middle"]
    assert max(outline[:, 0].max() for outline in trunk) > 0.8 * shoulder[0]


def test_hull() -> None:
    corners = np.array([[0.0, 0.0], [2.0, 0.0], [2.0, 1.0], [0.0, 1.0]])
    inside = np.array([[1.0, 0.5], [0.2, 0.9]])
    found = hull(np.concatenate((inside, corners)))
    assert {tuple(corner) for corner in found} == {tuple(corner) for corner in corners}
