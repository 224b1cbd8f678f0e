from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.patches import Ellipse

from hopdiff.motion import Motion
from hopdiff.plots.com_track import com_track_figure
from tests.plots.bends import bent, repeated


def test_target_is_dashed_and_actual_solid_with_the_left_side_up(motion: Motion) -> None:
    axes = com_track_figure(motion, strides=1).axes[0]
    lines = {line.get_label(): line for line in axes.lines}
    assert lines["target"].get_linestyle() == "--"
    assert lines["actual"].get_linestyle() == "-"
    for label, track in (("target", motion.com_target), ("actual", motion.com)):
        np.testing.assert_allclose(lines[label].get_xdata(), track[:, 2])
        np.testing.assert_allclose(lines[label].get_ydata(), 100 * track[:, 0])  # x, to the left, in centimetres


def test_each_stride_repeats_the_first_one_stride_further(motion: Motion) -> None:
    axes = com_track_figure(motion, strides=3).axes[0]
    actual = np.asarray(axes.lines[1].get_xdata()).reshape(3, -1)
    travel = float(motion.clip.root_position[-1, 2] - motion.clip.root_position[0, 2])
    np.testing.assert_allclose(actual[2], actual[0] + 2 * travel)


def test_feet_stand_where_they_touch_down(motion: Motion) -> None:
    axes = com_track_figure(motion, strides=2).axes[0]
    prints = [patch.center for patch in axes.patches if isinstance(patch, Ellipse)]
    assert len(prints) == 4
    first_right = int(motion.contact[:, 1].nonzero()[0])
    np.testing.assert_allclose(prints[2], (motion.feet[first_right, 1, 2], 100 * motion.feet[first_right, 1, 0]))
    low, high = axes.get_ylim()
    assert low == -high
    assert high > max(abs(y) for _, y in prints)


def test_a_foot_that_never_stands_leaves_no_print(motion: Motion) -> None:
    contact = motion.contact.clone()
    contact[:, 1] = False
    axes = com_track_figure(replace(motion, contact=contact), strides=1).axes[0]
    assert sum(isinstance(patch, Ellipse) for patch in axes.patches) == 1


def limping(motion: Motion) -> Motion:
    """The left foot lifts off after half its stance."""
    left, flight, *rest = motion.phases
    early = left.start + 0.5 * (left.end - left.start)
    contact = motion.contact.clone()
    contact[motion.times > early, 0] = False
    return replace(motion, contact=contact, phases=(replace(left, end=early), replace(flight, start=early), *rest))


def prints_of(motion: Motion, **options: Any) -> np.ndarray:
    axes = com_track_figure(motion, **options).axes[0]
    return np.array(sorted(patch.center for patch in axes.patches if isinstance(patch, Ellipse)))


def test_a_limping_run_stands_where_its_feet_touch_down(motion: Motion) -> None:
    lame = limping(motion)
    places = [
        (float(lame.feet[frame, side, 2]), 100 * float(lame.feet[frame, side, 0]))
        for side in (0, 1)
        for frame in lame.contact[:, side].nonzero()[0].tolist()
    ]
    np.testing.assert_allclose(prints_of(lame, strides=1), sorted(places))


def test_a_motion_of_many_strides_is_cut_not_repeated(motion: Motion) -> None:
    long = repeated(motion, 5)
    np.testing.assert_allclose(prints_of(long, strides=3), prints_of(motion, strides=3), atol=1e-9)
    actual = np.asarray(com_track_figure(long, strides=3).axes[0].lines[1].get_xdata())
    assert len(actual) == 3 * (len(motion.times) - 1) + 1
    assert actual[-1] == pytest.approx(float(motion.com[0, 2]) + 3 * 4.0 * 0.68)


def test_a_motion_that_is_too_short_is_repeated(motion: Motion) -> None:
    assert len(prints_of(repeated(motion, 2), strides=4)) == 8


def test_with_equal_axes_a_metre_is_a_metre(motion: Motion) -> None:
    figure = com_track_figure(bent(repeated(motion, 4), turn=0.6, waves=1.0), strides=4, equal=True)
    FigureCanvasAgg(figure).draw()
    axes = figure.axes[0]
    (low, high), (bottom, top), box = axes.get_xlim(), axes.get_ylim(), axes.get_window_extent()
    assert box.width / (high - low) == pytest.approx(box.height / (top - bottom), rel=1e-3)
    lefts = np.asarray(axes.lines[1].get_ydata())
    assert bottom < lefts.min()
    assert lefts.max() < top
    assert axes.get_ylabel() == "to the left [m]"
