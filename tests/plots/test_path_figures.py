from __future__ import annotations

import math
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from PIL import Image, ImageSequence

from hopdiff.motion import Motion
from hopdiff.plots import style
from hopdiff.plots.animation import path_film
from hopdiff.plots.body import Body
from hopdiff.plots.film import write_film
from hopdiff.plots.ground import ELEVATION, map_axes, spacing
from hopdiff.plots.path import oblique_figure, path_figure
from hopdiff.plots.poses import sample
from hopdiff.plots.scene import footprints, ground_track, side_camera
from hopdiff.plots.strip import FILL
from tests.plots.bends import bent, repeated
from tests.plots.conftest import make_motion

POINTS = [[0.0, 0.0], [1.0, 2.5], [0.0, 5.0]]


@pytest.fixture(scope="module")
def curve() -> Motion:
    return bent(repeated(make_motion(), 3), turn=0.9, waves=1.0)


@pytest.fixture(scope="module")
def lap() -> Motion:
    return bent(repeated(make_motion(), 22), turn=2 * math.pi)


def drawn(figure: Figure) -> Figure:
    FigureCanvasAgg(figure).draw()
    return figure


def collections(figure: Figure, label: str) -> list[np.ndarray]:
    (found,) = (c for c in figure.axes[0].collections if c.get_label() == label)
    return [path.vertices for path in found.get_paths()]


def no_text_is_cut_off(figure: Figure) -> None:
    for text in (*figure.texts, *figure.axes[0].texts):
        box = text.get_window_extent()
        assert figure.bbox.x0 <= box.x0, text.get_text()
        assert box.x1 <= figure.bbox.x1, text.get_text()
        assert figure.bbox.y0 <= box.y0, text.get_text()
        assert box.y1 <= figure.bbox.y1, text.get_text()


def test_a_lap_turns_once_to_the_left_and_comes_home(lap: Motion) -> None:
    track, heading = ground_track(lap)
    assert heading[-1] - heading[0] == pytest.approx(2 * math.pi, abs=0.1)
    np.testing.assert_allclose(track[-1], track[0], atol=0.02)
    assert track[:, 0].max() > 15  # the left is where x grows
    assert not track[:, 1].any()


def test_footprints_point_along_the_run(lap: Motion) -> None:
    prints = footprints(lap)
    assert [step.side for step in prints] == ["left", "right"] * 22
    radius = 22 * 4.0 * 0.68 / (2 * math.pi)
    for step in prints:
        x, _, z = step.place
        along = math.atan2(z, radius - x)  # the circle's own heading there
        assert math.remainder(step.heading - along, 2 * math.pi) == pytest.approx(0.0, abs=0.12)
        longest = max(step.outline(), key=lambda corner: float(np.linalg.norm(corner - step.place)))
        assert np.linalg.norm(longest - step.place) == pytest.approx(0.13)
        cross = np.cross(longest - step.place, (math.sin(step.heading), 0, math.cos(step.heading)))
        np.testing.assert_allclose(cross, 0, atol=1e-9)


def test_the_plan_has_equal_scales_and_left_on_the_left(curve: Motion) -> None:
    figure = drawn(path_figure(curve, POINTS))
    axes = figure.axes[0]
    (right, left), (bottom, top) = axes.get_xlim()[::-1], axes.get_ylim()
    assert left > right
    box = axes.get_window_extent()
    assert box.width / (left - right) == pytest.approx(box.height / (top - bottom), rel=1e-3)
    no_text_is_cut_off(figure)


def test_a_narrow_map_has_numbers_on_both_sides() -> None:
    axes = Figure().add_subplot()
    map_axes(axes, np.array([0.5, 0.0]), np.array([9.9, 28.5]))
    for axis, (low, high) in ((axes.xaxis, (0.5, 9.9)), (axes.yaxis, (0.0, 28.5))):
        inside = [tick for tick in axis.get_ticklocs() if low <= tick <= high]
        assert 3 <= len(inside) <= 16


def test_the_plan_shows_points_track_and_feet(curve: Motion) -> None:
    figure = path_figure(curve, POINTS)
    lines = {line.get_label(): np.stack(line.get_data(), axis=1) for line in figure.axes[0].lines}
    np.testing.assert_allclose(lines["points of the path"], POINTS)
    np.testing.assert_allclose(lines["hips"], curve.clip.root_position[:, [0, 2]])
    np.testing.assert_allclose(lines["centre of mass"], curve.com[:, [0, 2]])
    np.testing.assert_allclose(lines["start"], curve.clip.root_position[:1, [0, 2]])
    for side in ("left", "right"):
        centres = [outline[:-1].mean(axis=0) for outline in collections(figure, f"{side} foot")]
        np.testing.assert_allclose(centres, [s.place[[0, 2]] for s in footprints(curve) if s.side == side], atol=1e-9)
    everything = np.concatenate(list(lines.values()))
    (right, left), (bottom, top) = figure.axes[0].get_xlim()[::-1], figure.axes[0].get_ylim()
    assert right < everything[:, 0].min()
    assert everything[:, 0].max() < left
    assert bottom < everything[:, 1].min()
    assert everything[:, 1].max() < top


def test_the_title_tells_way_and_time(curve: Motion) -> None:
    text = path_figure(curve, POINTS).get_suptitle()
    seconds = 3 * 0.68
    assert text == f"{seconds * 4.0:.1f} m in {seconds:.2f} s: 4.00 m/s"
    # The way along the wanted curve, if it is known: the hips cut the corners.
    line = [[0.0, 0.0], [0.0, 10.0]]
    assert path_figure(curve, POINTS, line).get_suptitle().startswith("10.0 m in")
    assert path_figure(curve, POINTS, title="Mine").get_suptitle() == "Mine"


def test_footprints_stay_visible_on_a_long_way(lap: Motion) -> None:
    figure = drawn(path_figure(lap, POINTS))
    outline = figure.axes[0].transData.transform(collections(figure, "left foot")[0])
    inches = np.linalg.norm(np.ptp(outline, axis=0)) / figure.dpi
    assert inches > 0.08


def figures_of(figure: Figure) -> list[PolyCollection]:
    """The drawn runners, in the order of drawing."""
    runners = [c for c in figure.axes[0].collections if isinstance(c, PolyCollection) and c.get_zorder() >= 3]
    return sorted(runners, key=lambda c: c.get_zorder())


def test_near_runners_cover_far_ones(lap: Motion) -> None:
    drawn_runners = figures_of(oblique_figure(lap, count=30))
    at = np.linspace(0.0, float(lap.times[-1]), 30)
    poses = sample(lap.times.numpy(), Body(lap.clip.skeleton).points(lap.clip), at)
    camera = side_camera(lap, ELEVATION)
    expected = poses[np.argsort(camera.nearness(poses[:, 0]))]
    assert len(drawn_runners) == 30
    for runner, pose in zip(drawn_runners, expected, strict=True):
        outline = np.concatenate([path.vertices for path in runner.get_paths()])
        seen = camera.project(pose)[:, :2]
        np.testing.assert_allclose(outline.max(axis=0), seen.max(axis=0), atol=0.12)
        np.testing.assert_allclose(outline.min(axis=0), seen.min(axis=0), atol=0.12)


def test_a_metre_is_as_high_as_long_in_the_oblique_view_and_all_is_inside(curve: Motion) -> None:
    figure = drawn(oblique_figure(curve))
    axes = figure.axes[0]
    (left, right), (bottom, top) = axes.get_xlim(), axes.get_ylim()
    box = axes.get_window_extent()
    assert box.width / (right - left) == pytest.approx(box.height / (top - bottom), rel=1e-3)
    outlines = np.concatenate([path.vertices for runner in figures_of(figure) for path in runner.get_paths()])
    assert left < outlines[:, 0].min()
    assert outlines[:, 0].max() < right
    assert bottom < outlines[:, 1].min()
    assert outlines[:, 1].max() < top
    no_text_is_cut_off(figure)


def test_figures_of_an_oblique_view(curve: Motion, lap: Motion) -> None:
    crowded = figures_of(oblique_figure(curve))
    assert len(crowded) == len(curve.phases) / 3
    assert 20 <= len(figures_of(oblique_figure(lap))) <= 48
    assert len(figures_of(oblique_figure(curve, count=5))) == 5
    parts = len(Body(curve.clip.skeleton).parts(np.random.default_rng(0).normal(size=(16, 3))))
    assert all(len(runner.get_paths()) == parts for runner in figures_of(oblique_figure(curve)))


def test_figures_leave_each_other_room(curve: Motion) -> None:
    boxes = []
    for runner in figures_of(oblique_figure(curve)):
        outline = np.concatenate([path.vertices for path in runner.get_paths()])
        boxes.append((outline[:, 0].min(), outline[:, 0].max()))
    for (_, end), (start, _) in pairwise(sorted(boxes)):
        assert start > end - 0.1


def test_the_oblique_camera_sees_the_run_go_to_the_right(curve: Motion) -> None:
    track, _ = ground_track(curve)
    seen = side_camera(curve, 0.5).project(track[[0, -1]])
    assert seen[1, 0] > seen[0, 0] + 0.9 * np.linalg.norm(track[-1] - track[0])


def test_one_stride_will_do(motion: Motion) -> None:
    for figure in (path_figure(motion, [[0, 0], [0, 2]]), oblique_figure(motion)):
        no_text_is_cut_off(drawn(figure))


def test_long_runs_are_drawn_with_few_pieces(lap: Motion) -> None:
    for figure in (path_figure(lap, POINTS), oblique_figure(lap)):
        assert len(drawn(figure).findobj()) < 250


@pytest.mark.parametrize(("extent", "step"), [(3.0, 0.5), (9.0, 1.0), (18.0, 2.0), (60.0, 10.0), (5000.0, 100.0)])
def test_grid_lines_lie_round_numbers_apart(extent: float, step: float) -> None:
    assert spacing(extent) == step


def test_the_path_gif_runs_at_true_speed_with_the_runner_inside(curve: Motion, tmp_path: Path) -> None:
    write_film(tmp_path / "path.gif", path_film(curve), width=320)
    with Image.open(tmp_path / "path.gif") as gif:
        durations, pictures = [], []
        for frame in ImageSequence.Iterator(gif):
            durations.append(frame.info["duration"])
            pictures.append(np.asarray(frame.convert("RGB"), dtype=int))
    assert min(durations) >= 40
    assert sum(durations) == pytest.approx(1000 * float(curve.times[-1]), abs=5)
    for picture in pictures:
        height, width, _ = picture.shape
        assert width == 320
        rows, columns = np.nonzero(near(picture, FILL["middle"]))  # trunk and head
        assert len(rows) > 0.005 * height * width
        assert rows.min() > 2
        assert rows.max() < height - 2
        assert columns.min() > 0.2 * width
        assert columns.max() < 0.8 * width
    lines = [near(picture, style.GROUND) for picture in pictures]
    assert all((a != b).any() for a, b in pairwise(lines)), "the ground does not move"


def near(picture: np.ndarray, colour: str) -> np.ndarray:
    wanted = np.array([int(colour[i : i + 2], 16) for i in (1, 3, 5)])
    return np.abs(picture - wanted).sum(axis=2) < 12


def test_a_long_run_is_cut_to_twelve_seconds_and_a_small_file(lap: Motion, tmp_path: Path) -> None:
    write_film(tmp_path / "lap.gif", path_film(lap, caption=("a lap", "model smooth")))
    assert (tmp_path / "lap.gif").stat().st_size < 2_000_000
    with Image.open(tmp_path / "lap.gif") as gif:
        total = sum(frame.info["duration"] for frame in ImageSequence.Iterator(gif))
    assert total == 12_000
