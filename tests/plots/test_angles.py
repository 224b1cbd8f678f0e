from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from matplotlib.colors import to_hex

from hopdiff.motion import Motion
from hopdiff.plots import style
from hopdiff.plots.angles import PANELS, angles_figure


def test_curves_are_in_degrees_and_in_the_colour_of_their_side(motion: Motion) -> None:
    figure = angles_figure(motion)
    assert len(figure.axes) == len(PANELS)
    for axes, (joint, _) in zip(figure.axes, PANELS, strict=True):
        curves = {to_hex(line.get_color()).upper(): np.asarray(line.get_ydata()) for line in axes.lines}
        names = (
            {style.BODY: joint} if joint == "trunk" else {style.LEFT: f"left_{joint}", style.RIGHT: f"right_{joint}"}
        )
        assert set(curves) == set(names)
        for colour, name in names.items():
            np.testing.assert_allclose(curves[colour], np.degrees(motion.angles[name].numpy()))


def test_stances_are_shaded_from_touchdown_to_take_off(motion: Motion) -> None:
    axes = angles_figure(motion).axes[0]
    spans = [(patch.get_x(), patch.get_x() + patch.get_width()) for patch in axes.patches]
    expected = [(phase.start, phase.end) for phase in motion.phases if phase.kind == "stance"]
    assert spans == [pytest.approx(span) for span in expected]
    assert [text.get_text() for text in axes.texts] == ["left stance", "flight", "right stance", "flight"]


def test_a_curve_that_is_missing_leaves_its_panel_empty(motion: Motion) -> None:
    without = {name: curve for name, curve in motion.angles.items() if "elbow" not in name}
    figure = angles_figure(replace(motion, angles=without))
    assert [len(axes.lines) for axes in figure.axes] == [2, 2, 1, 2, 0]
