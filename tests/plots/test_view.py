from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hopdiff.plots.view import BEHIND, FRONT, RIGHT, Camera

LEFT, UP, AHEAD = np.eye(3)


@given(azimuth=st.floats(-10, 10), elevation=st.floats(-1.5, 1.5))
def test_a_picture_neither_stretches_nor_mirrors(azimuth: float, elevation: float) -> None:
    axes = Camera(azimuth, elevation).axes
    np.testing.assert_allclose(axes @ axes.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(axes) == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("camera", "to_the_right", "to_the_viewer"),
    [(FRONT, LEFT, AHEAD), (BEHIND, -LEFT, -AHEAD), (RIGHT, AHEAD, -LEFT), (Camera(math.pi / 2), -AHEAD, LEFT)],
)
def test_where_the_runner_is_seen_from(camera: Camera, to_the_right: np.ndarray, to_the_viewer: np.ndarray) -> None:
    np.testing.assert_allclose(camera.project(to_the_right), (1, 0, 0), atol=1e-12)
    np.testing.assert_allclose(camera.project(UP), (0, 1, 0), atol=1e-12)
    np.testing.assert_allclose(camera.project(to_the_viewer), (0, 0, 1), atol=1e-12)
    assert camera.nearness(to_the_viewer) == pytest.approx(1.0)


def test_straight_down_from_behind_is_a_map_with_forward_up_and_left_on_the_left() -> None:
    above = Camera(math.pi, math.pi / 2)
    np.testing.assert_allclose(above.project(np.stack((AHEAD, LEFT, UP)))[:, :2], [(0, 1), (-1, 0), (0, 0)], atol=1e-12)


def test_higher_ground_points_are_farther_away() -> None:
    camera = Camera(2.0, 0.5)
    points = np.random.default_rng(0).normal(size=(20, 3)) * (1, 0, 1)
    order = np.argsort(camera.nearness(points))
    assert (np.diff(camera.project(points)[order, 1]) < 0).all()
    np.testing.assert_allclose(camera.nearness(points + UP), camera.nearness(points))
