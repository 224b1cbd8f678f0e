from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from matplotlib.text import Annotation

from hopdiff.character import REQUIRED_PARENTS, Character
from hopdiff.plots.figure import character_figure
from tests.builders import make_character

BODIES = ("human", "child", "cartoon")


@pytest.fixture(params=BODIES)
def character(request: pytest.FixtureRequest) -> Character:
    return make_character(request.param)


@pytest.fixture
def figure(character: Character) -> Figure:
    figure = character_figure(character)
    FigureCanvasAgg(figure).draw()
    return figure


def names(figure: Figure) -> list[Annotation]:
    return [text for axes in figure.axes for text in axes.texts if isinstance(text, Annotation)]


def test_every_joint_is_named_once_where_it_is(figure: Figure, character: Character) -> None:
    joints = {name.replace("_", " "): name for name in REQUIRED_PARENTS}
    assert sorted(text.get_text() for text in names(figure)) == sorted(joints)
    places, _ = character.skeleton.forward(
        character.skeleton.offsets[0], character.coms.new_tensor(np.eye(3)).expand(11, 3, 3)
    )
    for text in names(figure):
        x, y, z = places[character.skeleton.index(joints[text.get_text()])].tolist()
        across = x if text.axes is figure.axes[0] else z
        assert text.xy == pytest.approx((across, y))


def test_from_the_front_left_is_on_the_right(figure: Figure) -> None:
    for text in names(figure):
        if "left" in text.get_text():
            assert text.xyann[0] > text.xy[0] > 0
        if "right" in text.get_text():
            assert text.xyann[0] < text.xy[0] < 0


def test_names_lie_beside_the_body_and_not_on_each_other(figure: Figure) -> None:
    for axes in figure.axes:
        outlines = [p.vertices for c in axes.collections if isinstance(c, PolyCollection) for p in c.get_paths()]
        reach = np.abs(np.concatenate(outlines)[:, 0]).max()
        for text in names(figure):
            if text.axes is axes:
                assert abs(text.xyann[0]) > reach
    heights = {(axes, text.xyann[0]): [] for axes in figure.axes for text in names(figure) if text.axes is axes}
    for text in names(figure):
        heights[text.axes, text.xyann[0]].append(text.xyann[1])
    inch = figure.axes[0].transData.transform((0, 1))[1] - figure.axes[0].transData.transform((0, 0))[1]
    for column in heights.values():
        for a, b in combinations(column, 2):
            assert abs(a - b) * inch > 10 / 72 * figure.dpi, "lines of 10 points overlap"
    for text in names(figure):
        box = text.get_window_extent()
        assert figure.bbox.x0 <= box.x0
        assert box.x1 <= figure.bbox.x1


def test_the_title_holds_the_measures(figure: Figure, character: Character) -> None:
    title = figure.get_suptitle()
    assert character.name in title
    for number in (f"{character.height:.2f} m", f"{character.mass:.0f} kg", f"{character.leg_length:.2f} m"):
        assert number in title


def test_both_views_share_one_scale_of_metres(figure: Figure, character: Character) -> None:
    front, side = figure.axes
    for axes in (front, side):
        (low, high), (bottom, top), box = axes.get_xlim(), axes.get_ylim(), axes.get_window_extent()
        assert box.width / (high - low) == pytest.approx(box.height / (top - bottom), rel=1e-3)
        outlines = np.concatenate([p.vertices for c in axes.collections for p in c.get_paths()])
        assert outlines[:, 1].max() == pytest.approx(character.height, rel=0.01)
        assert abs(outlines[:, 1].min()) < 0.03 * character.height  # the rounded end of the shank
        assert top > outlines[:, 1].max()
    assert front.get_ylim() == side.get_ylim()
    assert list(front.get_yticks()) == sorted(front.get_yticks())
    assert max(front.get_yticks()) <= top
    assert np.diff(front.get_yticks()) == pytest.approx(0.25)
