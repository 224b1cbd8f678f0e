from __future__ import annotations

import numpy as np
import pytest
import trimesh
from numpy.typing import NDArray

import hopdiff.export.raster
from hopdiff.export.raster import BLEED, drawn

TOWARDS = np.array([0.0, 0.0, 1.0])
RED, BLUE = np.array([0.8, 0.1, 0.1]), np.array([0.1, 0.1, 0.8])


def flat(corners: list[tuple[float, float]], depth: float) -> NDArray[np.float64]:
    """A triangle across the way of looking, its corners against the clock for who looks at it."""
    return np.array([(x, y, depth) for x, y in corners])


def one(points: NDArray[np.float64], colour: NDArray[np.float64], size: tuple[int, int]) -> NDArray[np.uint8]:
    count = len(points)
    faces = np.arange(count).reshape(-1, 3)
    return drawn(points, np.tile(TOWARDS, (count, 1)), faces, np.tile(colour, (count, 1)), *size)


def test_coverage_is_the_area() -> None:
    rng = np.random.default_rng(1)
    for _ in range(20):
        corners = rng.uniform(3.0, 47.0, (3, 2))
        area = 0.5 * float(np.linalg.det(np.stack((corners[1] - corners[0], corners[2] - corners[0]))))
        if area > 0.0:  # rows count downwards, so that this one turns with the clock
            corners, area = corners[::-1], -area
        found = one(flat([(x, y) for x, y in corners], 0.0), RED, (50, 50))
        around = float(np.linalg.norm(np.roll(corners, 1, axis=0) - corners, axis=-1).sum())
        assert found[..., 3].sum() / 255.0 == pytest.approx(-area, abs=0.03 * around)


def test_what_turns_away_is_not_drawn() -> None:
    corners = [(10.0, 40.0), (40.0, 40.0), (25.0, 5.0)]
    assert one(flat(corners, 0.0), RED, (50, 50))[..., 3].max() == 255
    assert one(flat(corners[::-1], 0.0), RED, (50, 50))[..., 3].max() == 0


@pytest.mark.parametrize("swapped", [False, True])
def test_the_nearest_is_seen(swapped: bool) -> None:
    far, near = (flat([(5.0, 45.0), (45.0, 45.0), (25.0, 5.0)], depth) for depth in (-3.0, 2.0))
    parts = [(far, BLUE), (near, RED)][:: -1 if swapped else 1]
    points = np.concatenate([part for part, _ in parts])
    colours = np.concatenate([np.tile(colour, (3, 1)) for _, colour in parts])
    found = drawn(points, np.tile(TOWARDS, (6, 1)), np.arange(6).reshape(2, 3), colours, 50, 50)
    seen = found[found[..., 3] == 255]
    assert bool((seen[:, 0] > seen[:, 2]).all())


def test_faces_that_pass_through_each_other_meet_where_they_are_as_near() -> None:
    sloped = np.array([(0.0, 60.0, 30.0), (60.0, 60.0, -30.0), (30.0, -60.0, 0.0)])  # as near as 0 in column 30
    level = np.array([(0.0, 60.0, 0.0), (60.0, 60.0, 0.0), (30.0, -60.0, 0.0)])
    colours = np.repeat([RED, BLUE], 3, axis=0)
    faces = np.arange(6).reshape(2, 3)
    found = drawn(np.concatenate((sloped, level)), np.tile(TOWARDS, (6, 1)), faces, colours, 60, 50)
    row = found[45].astype(int)
    assert bool((row[12:29, 0] > row[12:29, 2]).all())
    assert bool((row[31:48, 2] > row[31:48, 0]).all())


def test_edges_have_the_colour_of_what_they_bound() -> None:
    """Also beyond the edge, where a program that mixes pixels looks for colours."""
    found = one(flat([(7.3, 40.2), (41.7, 33.8), (22.5, 6.1)], 0.0), RED, (50, 50))
    covered = found[..., 3] > 0
    inside = found[found[..., 3] == 255][0, :3]
    assert bool((np.abs(found[covered][:, :3].astype(int) - inside) <= 1).all())
    assert len(np.unique(found[covered][:, 3])) > 5
    wide = np.pad(covered, BLEED)
    near = np.zeros_like(covered)
    for dy in range(2 * BLEED + 1):
        for dx in range(2 * BLEED + 1):
            near |= wide[dy : dy + covered.shape[0], dx : dx + covered.shape[1]]
    assert bool((np.abs(found[near][:, :3].astype(int) - inside) <= 1).all())
    assert not found[~near].any()


def ball() -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.int64]]:
    sphere = trimesh.creation.icosphere(subdivisions=3, radius=20.0)
    normals = sphere.vertices / 20.0
    # The picture's rows count downwards.
    return sphere.vertices * [1.0, -1.0, 1.0] + [32.0, 32.0, 0.0], normals, sphere.faces


def test_a_ball_is_round_and_lit_from_above() -> None:
    points, normals, faces = ball()
    found = drawn(points, normals, faces, np.tile(RED, (len(points), 1)), 64, 64).astype(int)
    assert found[..., 3].sum() / 255.0 == pytest.approx(np.pi * 20.0**2, rel=0.03)
    assert found[14, 32, 0] > found[32, 32, 0] > found[50, 32, 0] > 40
    np.testing.assert_allclose(found[..., 3], found[:, ::-1, 3], atol=40)


def test_bands_make_the_same_picture(monkeypatch: pytest.MonkeyPatch) -> None:
    points, normals, faces = ball()
    whole = drawn(points, normals, faces, np.tile(RED, (len(points), 1)), 64, 64)
    monkeypatch.setattr(hopdiff.export.raster, "SAMPLES", 64 * 16 * 5)
    np.testing.assert_array_equal(drawn(points, normals, faces, np.tile(RED, (len(points), 1)), 64, 64), whole)


def test_nothing_to_see_is_transparent() -> None:
    found = one(flat([(-30.0, 40.0), (-10.0, 40.0), (-20.0, 5.0)], 0.0), RED, (20, 10))
    assert found.shape == (10, 20, 4)
    assert not found.any()
