"""Uneven ground in pictures: figures, tracks and footprints lie on it, and it is drawn about the way."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
import torch
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.colors import to_rgba_array
from matplotlib.contour import QuadContourSet
from matplotlib.figure import Figure
from matplotlib.text import Annotation

from hopdiff.editing.root_path import root_path
from hopdiff.motion import Motion
from hopdiff.plots.animation import path_film
from hopdiff.plots.edit import edit_figure
from hopdiff.plots.ground import ELEVATION, FLAT, camera_beside, shadow
from hopdiff.plots.path import oblique_figure, path_figure
from hopdiff.plots.relief import BESIDE, draw_heights, draw_relief, laid, relief_of
from hopdiff.plots.scene import footprints, side_camera
from hopdiff.plots.sticks import sticks_figure
from hopdiff.plots.view import RIGHT, Array, numbers
from hopdiff.terrain.ground import Flat, Ground
from hopdiff.terrain.patches import Patch, Patches
from hopdiff.terrain.profile import slope, stairs
from tests.plots.bends import bent, repeated
from tests.plots.conftest import make_motion
from tests.plots.walkers import skeleton, walker
from tests.terrain.grounds import box

HILL = slope(math.radians(10.0), 0.0, (0.0, 1.0))
WAY = np.stack((np.zeros(50), np.zeros(50), np.linspace(0.0, 4.0, 50)), axis=-1)


def heights(ground: Ground, points: Array) -> Array:
    return numbers(ground.height(torch.as_tensor(points[..., [0, 2]])))


def sheet_of(figure: Figure) -> list[PolyCollection]:
    return [c for c in figure.axes[0].collections if isinstance(c, PolyCollection) and c.get_zorder() == 1.3]


def lifted(motion: Motion, ground: Ground) -> Motion:
    """A motion above a ground, for pictures only."""
    root, feet = motion.clip.root_position.double().clone(), motion.feet.double().clone()
    root[:, 1] += ground.height(root[:, [0, 2]])
    feet[..., 1] += ground.height(feet[..., [0, 2]])
    return replace(motion, clip=replace(motion.clip, root_position=root), feet=feet)


def test_points_are_laid_on_the_ground() -> None:
    points = np.random.default_rng(0).normal(size=(4, 5, 3))
    for ground in (None, Flat()):
        assert np.array_equal(laid(points, ground), points * FLAT)
    on = laid(points, HILL)
    assert np.array_equal(on[..., [0, 2]], points[..., [0, 2]])
    assert on[..., 1] == pytest.approx(heights(HILL, points))


def test_the_sheet_lies_on_the_ground_about_the_way() -> None:
    assert len(relief_of(None, WAY)) == len(relief_of(Flat(), WAY)) == 0
    pieces = relief_of(HILL, WAY)
    assert pieces[..., 1] == pytest.approx(heights(HILL, pieces))
    side = np.ptp(pieces[..., 0], axis=1)
    assert side.max() - side.min() < 1e-9
    assert len(pieces) * side[0] ** 2 == pytest.approx(2 * BESIDE * 4.0 + math.pi * BESIDE**2, rel=0.03)
    assert len(relief_of(HILL, 100.0 * WAY)) < 40_000


def test_near_pieces_cover_far_ones_and_steep_ones_are_dark() -> None:
    pieces = relief_of(stairs(0.17, 0.29, 0.0, (0.0, 0.5), 6), WAY)
    axes = Figure().add_subplot()
    draw_relief(axes, RIGHT, pieces)
    (sheet,) = axes.collections
    colours = to_rgba_array(sheet.get_facecolor())[:, :3].mean(axis=1)
    order = np.argsort(RIGHT.nearness(pieces.mean(axis=1)))
    steep = np.ptp(pieces[order][..., 1], axis=1) > 0.1
    assert colours[steep].max() < colours[~steep].min() - 0.1
    near = [float(numbers(path.vertices)[:, 0].mean()) for path in sheet.get_paths()]
    assert near == pytest.approx(RIGHT.project(pieces[order].mean(axis=1))[:, 0], abs=0.05)


def test_a_strip_stands_on_its_ground() -> None:
    clip = walker(skeleton())
    root = clip.root_position.double().clone()
    root[:, 1] += HILL.height(root[:, [0, 2]])
    up = replace(clip, root_position=root)
    figure = sticks_figure(up, before=clip, curve=[[0.2, 0.0], [0.2, 4.0]], ground=HILL)
    axes, camera = figure.axes[0], camera_beside(numbers(root) * FLAT, 0.0, ELEVATION)
    lines = [np.stack(line.get_data(), axis=1) for line in axes.lines]
    assert any(np.array_equal(line, camera.project(laid(numbers(root), HILL))[:, :2]) for line in lines)
    # The way before the edit went over flat ground.
    assert any(np.array_equal(line, camera.project(numbers(root) * FLAT)[:, :2]) for line in lines)
    drawn_curve = camera.project(laid(np.array([[0.2, 0.0, 0.0], [0.2, 0.0, 4.0]]), HILL))[:, :2]
    assert any(np.array_equal(line, drawn_curve) for line in lines)
    (sheet,) = sheet_of(figure)
    spots = np.concatenate([path.vertices for path in sheet.get_paths()])
    (left, right), (bottom, top) = axes.get_xlim(), axes.get_ylim()
    assert ((spots > (left, bottom)) & (spots < (right, top))).all()
    assert not sheet_of(sticks_figure(clip, ground=Flat()))
    shadows = [c for c in axes.collections if isinstance(c, PolyCollection) and c.get_zorder() == 1.5]
    last = camera.project(shadow(numbers(root[-1:]), HILL))[:, :2]
    assert np.allclose(numbers(shadows[0].get_paths()[-1].vertices)[: len(last)], last)
    # Times stand below the shadows, on the hill too.
    ends = camera.project(laid(numbers(root[-1:]), HILL))[0, :2]
    assert any(np.allclose(text.xy, ends) for text in axes.texts if isinstance(text, Annotation))


def test_shadows_lie_on_the_ground() -> None:
    disc = shadow(np.array([[0.0, 1.5, 3.0]]), HILL)
    assert disc[:, 1] == pytest.approx(heights(HILL, disc))
    assert np.ptp(disc[:, 1]) == pytest.approx(0.4 * math.tan(math.radians(10.0)), rel=0.02)


def test_what_lies_on_a_tread_does_not_hang_over_its_edge() -> None:
    ground = stairs(0.17, 0.29, 0.0, (0.0, 0.0), 6)
    disc = shadow(np.array([[0.0, 1.5, 0.3]]), ground)
    assert disc[:, 1] == pytest.approx(2 * 0.17)


def test_a_run_along_a_path_stands_on_its_ground() -> None:
    motion = lifted(bent(repeated(make_motion(), 3), turn=0.9, waves=1.0), HILL)
    camera = side_camera(motion, ELEVATION)
    figure = oblique_figure(motion, ground=HILL)
    assert len(sheet_of(figure)) == 1
    assert not sheet_of(oblique_figure(motion))
    drawn = [c.get_paths() for c in figure.axes[0].collections if c.get_zorder() == 2.5]
    prints = [np.asarray(path.vertices)[:-1] for path in drawn[0]]
    wanted = [camera.project(laid(step.outline(), HILL))[:, :2] for step in footprints(motion)]
    for seen, true in zip(prints, wanted, strict=True):
        assert seen.mean(axis=0) == pytest.approx(true.mean(axis=0), abs=0.02)


def contours(axes: Axes) -> list[QuadContourSet]:
    return [one for one in axes.collections if isinstance(one, QuadContourSet)]


def test_maps_show_heights_unless_the_ground_is_flat(motion: Motion) -> None:
    low, high = np.array([-1.0, 0.0]), np.array([1.0, 4.0])
    for ground in (None, Flat(), HILL):
        axes = Figure().add_subplot()
        draw_heights(axes, ground, low, high)
        assert len(contours(axes)) == (2 if ground is HILL else 0)
    for line, level in zip(contours(axes)[1].get_paths(), contours(axes)[1].levels, strict=True):
        # x and z of a line of equal height.
        assert heights(HILL, np.insert(numbers(line.vertices), 1, 0.0, axis=1)) == pytest.approx(level, abs=1e-6)
    assert 3 <= len(contours(axes)[1].get_paths()) <= 12
    clip = walker(skeleton())
    path = root_path(clip)
    assert len(contours(edit_figure(path, path, [], clip.frame_time, ground=HILL).axes[0])) == 2
    assert len(contours(path_figure(motion, [[0, 0], [0, 3]], ground=HILL).axes[0])) == 2


def test_a_film_on_a_platform_is_the_film_on_the_floor() -> None:
    motion = bent(repeated(make_motion(), 2), turn=0.9, waves=1.0)
    platform = Patches([Patch(box(-99, -99, 99, 99), (0.5, 0.0, 0.0))])
    moments = np.array([0.0, 0.4])
    films = path_film(motion), path_film(lifted(motion, platform), ground=platform), path_film(motion, ground=platform)
    for below, above, wrong in zip(*(film.draw(moments, 200) for film in films), strict=True):
        assert below.size == above.size
        # Lines of the grid are drawn in one piece there, and in many here.
        assert np.abs(np.asarray(below, dtype=int) - np.asarray(above, dtype=int)).mean() < 1.0
        assert below.size != wrong.size or np.abs(np.asarray(below, dtype=int) - np.asarray(wrong)).mean() > 5.0
    (hill,) = path_film(lifted(motion, HILL), ground=HILL).draw(moments[1:], 200)
    assert hill.size[0] == 200
