from __future__ import annotations

from dataclasses import replace

import numpy as np
from matplotlib.patches import Ellipse

from hopdiff.motion import Motion
from hopdiff.plots.com_track import com_track_figure


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
