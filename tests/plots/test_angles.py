from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
import torch
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import to_hex
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from hopdiff.motion import Motion, Phase
from hopdiff.plots import style
from hopdiff.plots.angles import LEAST_SPAN, angles_figure
from tests.plots.conftest import make_motion

SHOWN = ("hip", "knee", "trunk", "shoulder", "elbow")  # of a body whose ankles say nothing


def drawn(figure: Figure) -> Figure:
    FigureCanvasAgg(figure).draw()
    return figure


def curves(axes: Axes) -> list[Line2D]:
    return [line for line in axes.lines if len(line.get_xdata()) > 2]


def test_curves_are_in_degrees_and_in_the_colour_of_their_side(motion: Motion) -> None:
    figure = angles_figure(motion)
    assert len(figure.axes) == len(SHOWN)
    for axes, joint in zip(figure.axes, SHOWN, strict=True):
        found = {to_hex(line.get_color()).upper(): line for line in curves(axes)}
        names = (
            {style.BODY: joint} if joint == "trunk" else {style.LEFT: f"left_{joint}", style.RIGHT: f"right_{joint}"}
        )
        assert set(found) == set(names)
        for colour, name in names.items():
            np.testing.assert_allclose(found[colour].get_xdata(), motion.times)
            np.testing.assert_allclose(found[colour].get_ydata(), np.degrees(motion.angles[name].numpy()))


def test_dense_frames_are_drawn_as_they_are() -> None:
    dense = make_motion(frames=681)
    for axes in angles_figure(dense).axes:
        for line in curves(axes):
            assert len(line.get_xdata()) == 681
            turns = np.abs(np.diff(np.asarray(line.get_ydata()), 2))
            assert turns.max() < 0.1, "a corner of more than a tenth of a degree"


def test_stances_are_shaded_from_touchdown_to_take_off(motion: Motion) -> None:
    # No phase begins with a frame.
    phases = (
        Phase("stance", "left", 0.0, 0.2011),
        Phase("flight", "left", 0.2011, 0.3403),
        Phase("stance", "right", 0.3403, 0.5507),
        Phase("flight", "right", 0.5507, 0.68),
    )
    for axes in angles_figure(replace(motion, phases=phases)).axes:
        spans = [(patch.get_x(), patch.get_x() + patch.get_width()) for patch in axes.patches]
        assert spans == [pytest.approx((0.0, 0.2011)), pytest.approx((0.3403, 0.5507))]
        edges = [line.get_xdata()[0] for line in axes.lines if len(set(line.get_xdata())) == 1]
        assert edges == [0.2011, 0.3403, 0.5507]
    axes = angles_figure(replace(motion, phases=phases)).axes[0]
    assert [text.get_text() for text in axes.texts] == [
        "left stance\n0.201 s",
        "flight\n0.139 s",
        "right stance\n0.210 s",
        "flight\n0.129 s",
    ]


def test_a_phase_too_brief_for_its_name_goes_without(motion: Motion) -> None:
    phases = (Phase("stance", "left", 0.0, 0.64), Phase("flight", "left", 0.64, 0.68))
    axes = angles_figure(replace(motion, phases=phases)).axes[0]
    assert [text.get_text() for text in axes.texts] == ["left stance\n0.640 s"]


def test_what_hardly_moves_looks_so(motion: Motion) -> None:
    steady = {**motion.angles, "trunk": math.radians(7.0) + math.radians(0.75) * torch.sin(20.0 * motion.times)}
    trunk = angles_figure(replace(motion, angles=steady)).axes[2]
    low, high = trunk.get_ylim()
    assert high - low == pytest.approx(LEAST_SPAN)
    assert LEAST_SPAN >= 30.0
    assert 0.5 * (low + high) == pytest.approx(7.0, abs=0.1)


def test_a_degree_is_as_high_in_every_panel_and_no_curve_leaves_its_own(motion: Motion) -> None:
    figure = drawn(angles_figure(motion))
    scales = []
    for axes in figure.axes:
        low, high = axes.get_ylim()
        scales.append(axes.get_window_extent().height / (high - low))
        for line in curves(axes):
            assert low < min(line.get_ydata())
            assert max(line.get_ydata()) < high
    np.testing.assert_allclose(scales, scales[0], rtol=0.03)


def test_every_axis_says_what_it_shows(motion: Motion) -> None:
    figure = angles_figure(motion, "4 m/s")
    assert [axes.get_ylabel() for axes in figure.axes] == [
        "thigh [deg]",
        "knee [deg]",
        "trunk [deg]",
        "upper arm [deg]",
        "elbow [deg]",
    ]
    assert figure.axes[-1].get_xlabel() == "time since left touchdown [s]"
    assert figure.get_suptitle() == "4 m/s: joint angles over one stride"
    assert [text.get_text() for text in figure.legends[0].texts] == ["left", "right", "trunk"]


def test_a_joint_without_a_curve_gets_no_panel_and_an_ankle_with_one_does(motion: Motion) -> None:
    without = {name: curve for name, curve in motion.angles.items() if "elbow" not in name}
    labels = [axes.get_ylabel() for axes in angles_figure(replace(motion, angles=without)).axes]
    assert labels == ["thigh [deg]", "knee [deg]", "trunk [deg]", "upper arm [deg]"]
    ankles = {f"{side}_ankle": motion.angles[f"{side}_knee"] for side in ("left", "right")}
    figure = angles_figure(replace(motion, angles={**motion.angles, **ankles}))
    assert figure.axes[2].get_ylabel() == "ankle [deg]"
    drawn(angles_figure(replace(motion, angles={})))


def test_no_text_lies_on_another(motion: Motion) -> None:
    figure = drawn(angles_figure(motion))
    titles = [title for axes in figure.axes for title in (axes.title, axes._left_title, axes._right_title)]
    texts = [text for text in (*figure.axes[0].texts, *titles) if text.get_text()]
    boxes = [text.get_window_extent() for text in texts]
    for i, box in enumerate(boxes):
        assert figure.bbox.x0 <= box.x0
        assert box.x1 <= figure.bbox.x1
        clashes = [texts[j].get_text() for j in range(i) if boxes[j].overlaps(box)]
        assert not clashes, f"{texts[i].get_text()} lies on {clashes}"
