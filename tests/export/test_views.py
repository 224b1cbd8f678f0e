from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from hopdiff.export.views import FACING, VIEWS, views_of
from hopdiff.types import HopdiffError

# Where the axes of a body go on screen, to the right and up: its left (x), the sky (y), ahead (z).
SEEN = {
    "side": ((0, 0), (0, 1), (1, 0)),
    "front": ((1, 0), (0, 1), (0, 0)),
    "back": ((-1, 0), (0, 1), (0, 0)),
    "top": ((0, 1), (0, 0), (1, 0)),
}


@pytest.mark.parametrize("name", SEEN)
def test_where_a_body_faces(name: str) -> None:
    [view] = VIEWS[name]
    np.testing.assert_allclose(view.axes[:2].T, SEEN[name], atol=1e-12)


@pytest.mark.parametrize("name", VIEWS)
def test_axes_are_those_of_a_picture(name: str) -> None:
    for view in VIEWS[name]:
        np.testing.assert_allclose(view.axes @ view.axes.T, np.eye(3), atol=1e-12)
        assert np.linalg.det(view.axes) == pytest.approx(1.0)


def test_ways_to_face_go_round_by_their_names() -> None:
    assert tuple(view.name for view in VIEWS["eight"]) == FACING
    for view in VIEWS["eight"]:
        right, up, towards = view.axes
        words = view.name.split("_")
        assert np.sign(np.round(right[2], 9)) == ("right" in words) - ("left" in words)
        assert np.sign(np.round(up[2], 9)) == ("up" in words) - ("down" in words)
        assert towards[1] == pytest.approx(np.sin(np.radians(30.0)))
    assert [view.name for view in VIEWS["four"]] == ["down", "right", "up", "left"]


@pytest.mark.parametrize(
    ("value", "names"),
    [
        ("side", ["side"]),
        ([30, 10], ["30_10"]),
        ([[30, 10], "top"], ["30_10", "top"]),
        (["front", "four"], ["front", "down", "right", "up", "left"]),
    ],
)
def test_settings_name_views(value: Any, names: list[str]) -> None:
    assert [view.name for view in views_of(value, "view")] == names


@pytest.mark.parametrize(
    ("value", "message"),
    [
        ("sied", r"Unknown exports.a.view 'sied'.*Did you mean 'side'"),
        ([], "exports.a.view needs at least one view"),
        (["side", "side"], "exports.a.view has the view 'side' twice"),
        (["four", "eight"], "exports.a.view has the view 'down' twice"),
        ([0, 91], "exports.a.view: an elevation lies between -90 and 90 degrees, not at 91"),
        (90, r"exports.a.view must be one of side, front, .* not 90"),
        ([[1, 2, 3]], r"exports.a.view must be one of"),
        ([True, False], r"exports.a.view must be one of"),
        ({"side": 1}, r"exports.a.view must be one of"),
        (None, r"exports.a.view must be one of"),
    ],
)
def test_what_is_no_view_gets_one_sentence(value: Any, message: str) -> None:
    with pytest.raises(HopdiffError, match=message):
        views_of(value, "exports.a.view")
