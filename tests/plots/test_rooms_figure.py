from __future__ import annotations

import math

import numpy as np
import pytest
import torch
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.patches import PathPatch
from matplotlib.text import Annotation

from hopdiff.editing.root_path import RootPath
from hopdiff.graph.scene import Passage, Place, Scene, Wall
from hopdiff.plots.rooms import rooms_figure

START, GOAL = Place((1.0, 1.0), 0.0), Place((3.0, 8.0), math.radians(90.0))


def rectangle(x: float, z: float, wide: float, long: float) -> np.ndarray:
    return np.array([[x, z], [x + wide, z], [x + wide, z + long], [x, z + long]])


def scene(**more: object) -> Scene:
    rooms = {"first_room": rectangle(0.0, 0.0, 4.0, 4.0), "second_room": rectangle(0.0, 5.0, 4.0, 4.0)}
    passages = {"door": Passage(("first_room", "second_room"), (2.0, 4.0), (2.0, 5.0), 1.0)}
    walls = {"screen": Wall((0.0, 6.5), (1.0, 6.5), 0.1)}
    furniture = {"shelf": rectangle(3.6, 0.5, 0.4, 2.5), "bed": rectangle(0.0, 7.2, 2.0, 1.8)}
    return Scene("pair", rooms, passages, walls, furniture, thickness=0.2, **more)  # type: ignore[arg-type]


def path(end: tuple[float, float], yaw: float) -> RootPath:
    share = torch.linspace(0.0, 1.0, 60, dtype=torch.float64)
    corners = torch.tensor([[1.0, 1.0], [2.0, 4.0], [2.0, 5.0], list(end)], dtype=torch.float64)
    at = 3.0 * share
    low = at.floor().long().clamp(max=2)
    place = torch.lerp(corners[low], corners[low + 1], (at - low)[:, None])
    return RootPath(place, yaw * share)


@pytest.fixture(scope="module")
def figure() -> Figure:
    before, after = path((2.8, 7.6), 1.2), path(GOAL.position, GOAL.heading)
    made = rooms_figure(scene(), before, after, START, GOAL, 0.25)
    FigureCanvasAgg(made).draw()
    return made


def lines(figure: Figure) -> dict[str, np.ndarray]:
    return {str(line.get_label()): np.stack(line.get_data(), axis=1) for line in figure.axes[0].lines}


def test_both_paths_start_and_goal_are_drawn_where_they_are(figure: Figure) -> None:
    drawn = lines(figure)
    np.testing.assert_allclose(drawn["path in the motion graph"][-1], [2.8, 7.6])
    np.testing.assert_allclose(drawn["path after the edit"][-1], GOAL.position)
    np.testing.assert_allclose(drawn["start"], [START.position])
    np.testing.assert_allclose(drawn["goal"], [GOAL.position])


def test_arrows_point_along_the_headings(figure: Figure) -> None:
    arrows = [one for one in figure.axes[0].texts if isinstance(one, Annotation) and not one.get_text()]
    ways = {tuple(np.round(one.xyann, 6)): np.subtract(one.xy, one.xyann) for one in arrows}
    assert len(arrows) == 3
    for place, heading in ((START.position, 0.0), (GOAL.position, math.pi / 2.0), ((2.8, 7.6), 1.2)):
        way = ways[place]
        assert math.atan2(way[0], way[1]) == pytest.approx(heading, abs=1e-6)


def test_what_is_filled_at_a_point_is_what_stands_there(figure: Figure) -> None:
    patches = sorted((p for p in figure.axes[0].patches if isinstance(p, PathPatch)), key=lambda p: p.get_zorder())

    def colour(x: float, z: float) -> tuple | None:
        seen = [patch.get_facecolor() for patch in patches if patch.get_path().contains_point((x, z))]
        return seen[-1] if seen else None

    wall, floor = colour(1.0, 4.1), colour(3.0, 3.0)
    assert wall is not None
    assert floor is not None
    assert wall != floor
    assert colour(1.0, 4.9) == wall == colour(-0.1, 2.0) == colour(0.5, 6.5)
    assert colour(1.0, 4.5) is None  # the middle of a metre of wall that is drawn 0.2 m thick
    assert colour(1.3, 2.9) == colour(0.3, 5.5) == floor
    assert colour(3.8, 1.0) == colour(1.0, 8.0) != floor
    band = colour(2.2, 4.5)
    assert band not in (floor, wall)
    assert colour(-1.0, -1.0) is None


def test_nothing_is_cut_off_and_metres_are_equal(figure: Figure) -> None:
    axes = figure.axes[0]
    (left, right), (bottom, top) = axes.get_xlim(), axes.get_ylim()
    assert left > right  # as a walker sees left and right
    box = axes.get_window_extent()
    assert box.width / (left - right) == pytest.approx(box.height / (top - bottom), rel=1e-3)
    for patch in axes.patches:
        low, high = patch.get_path().get_extents().get_points()
        assert (low >= [right, bottom]).all()
        assert (high <= [left, top]).all()
    for text in (*axes.texts, *figure.texts):
        if text.get_text():
            where = text.get_window_extent()
            assert figure.bbox.x0 <= where.x0
            assert where.x1 <= figure.bbox.x1


def test_names_of_rooms_stay_off_furniture_and_inside(figure: Figure) -> None:
    axes = figure.axes[0]
    words = {text.get_text(): text.get_window_extent().transformed(axes.transData.inverted()) for text in axes.texts}
    assert {"first room", "second room", "shelf", "bed"} <= set(words)
    for name, low, high in (("first room", 0.0, 4.0), ("second room", 5.0, 9.0)):
        label = words[name]
        xs, zs = sorted((label.x0, label.x1)), sorted((label.y0, label.y1))
        assert xs[0] >= 0.0
        assert xs[1] <= 4.0
        assert zs[0] >= low
        assert zs[1] <= high
    bed = words["second room"]
    assert not (min(bed.x0, bed.x1) < 2.0 and max(bed.y0, bed.y1) > 7.2)
    (shelf,) = (text for text in axes.texts if text.get_text() == "shelf")
    assert shelf.get_rotation() == 90.0


def test_the_title_tells_both_lengths_or_what_is_wanted(figure: Figure) -> None:
    assert figure.get_suptitle().startswith("pair: ")
    lengths = [float(word) for word in figure.get_suptitle().split() if word[0].isdigit()]
    wanted = [float(path(end, 0.0).place.diff(dim=0).norm(dim=-1).sum()) for end in ((2.8, 7.6), GOAL.position)]
    assert lengths == pytest.approx(wanted, abs=0.006)
    bare = Scene("bare", {"a": rectangle(0.0, 0.0, 9.0, 9.0)}, thickness=0.0)
    own = rooms_figure(bare, path((2.0, 7.0), 0.0), path((2.0, 7.0), 0.0), START, GOAL, title="Mine")
    FigureCanvasAgg(own).draw()
    assert own.get_suptitle() == "Mine"
    assert "points on the way" not in lines(own)
