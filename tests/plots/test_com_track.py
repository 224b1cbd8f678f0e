from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.patches import Ellipse

from hopdiff.motion import Motion
from hopdiff.plots.com_track import com_track_figure
from tests.plots.bends import bent, repeated


def lines_of(figure: Figure) -> dict[str, np.ndarray]:
    return {str(line.get_label()): np.stack(line.get_data(), axis=1) for line in figure.axes[0].lines}


def prints_of(motion: Motion, **options: Any) -> np.ndarray:
    axes = com_track_figure(motion, **options).axes[0]
    return np.array(sorted(patch.center for patch in axes.patches if isinstance(patch, Ellipse)))


def stands(motion: Motion) -> list[tuple[float, float]]:
    """Where each foot stands on the average, forward and to the left."""
    found = [motion.feet[motion.contact[:, side], side].mean(dim=0).tolist() for side in (0, 1)]
    return sorted((z, x) for x, _, z in found)


def test_target_is_dashed_and_actual_solid_with_the_left_side_up(motion: Motion) -> None:
    figure = com_track_figure(motion)
    styles = {line.get_label(): line.get_linestyle() for line in figure.axes[0].lines}
    assert (styles["target"], styles["centre of mass"]) == ("--", "-")
    lines = lines_of(figure)
    np.testing.assert_allclose(lines["target"], motion.com_target[:, [2, 0]])
    np.testing.assert_allclose(lines["centre of mass"], motion.com[:, [2, 0]])


def test_where_the_ground_force_is_known_its_centre_is_dashed(motion: Motion) -> None:
    figure = com_track_figure(replace(motion, cop=motion.feet))
    assert "centre of pressure, joined through the air" in lines_of(figure)
    assert "target" not in lines_of(figure)


@pytest.mark.parametrize("strides", [1, 2, 4])
def test_a_metre_is_as_long_both_ways_and_all_is_inside(motion: Motion, strides: int) -> None:
    figure = com_track_figure(motion, strides)
    FigureCanvasAgg(figure).draw()
    axes = figure.axes[0]
    (low, high), (bottom, top), box = axes.get_xlim(), axes.get_ylim(), axes.get_window_extent()
    assert box.width / (high - low) == pytest.approx(box.height / (top - bottom), rel=1e-3)
    for track in lines_of(figure).values():
        assert low < track[:, 0].min()
        assert track[:, 0].max() < high
        assert bottom < track[:, 1].min()
        assert track[:, 1].max() < top
    for patch in axes.patches:
        assert isinstance(patch, Ellipse)
        assert (patch.width, patch.height) == (0.26, 0.1)  # as large as a foot
        assert low < patch.center[0] - 0.13
        assert bottom < patch.center[1] - 0.08
        assert patch.center[1] + 0.08 < top
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("forward [m]", "to the left [m]")
    texts = [axes._left_title, figure._suptitle]
    assert all(figure.bbox.x0 <= t.get_window_extent().x0 and t.get_window_extent().x1 <= figure.bbox.x1 for t in texts)


def test_a_line_tells_how_small_the_sway_is_and_why(motion: Motion) -> None:
    wave = 0.02 * torch.sin(2 * torch.pi * motion.times / motion.times[-1])
    com = motion.com.clone()
    com[:, 0] = wave
    feet = motion.feet.clone()
    feet[:, 0, 0], feet[:, 1, 0] = 0.06, -0.05
    note = com_track_figure(replace(motion, com=com, feet=feet)).axes[0].get_title(loc="left")
    assert "sways by 4.0 cm" in note
    assert "feet stand 11.0 cm apart" in note
    assert "a step of 0.34 s is over before" in note
    assert not com_track_figure(bent(repeated(motion, 2), turn=0.6)).axes[0].get_title(loc="left")


def test_each_stride_repeats_the_first_one_stride_further(motion: Motion) -> None:
    actual = lines_of(com_track_figure(motion, strides=3))["centre of mass"][:, 0].reshape(3, -1)
    travel = float(motion.clip.root_position[-1, 2] - motion.clip.root_position[0, 2])
    np.testing.assert_allclose(actual[2], actual[0] + 2 * travel)


def test_feet_stand_where_they_stand_on_the_average(motion: Motion) -> None:
    rolling = motion.feet + 0.1 * motion.times[:, None, None]
    np.testing.assert_allclose(prints_of(replace(motion, feet=rolling)), stands(replace(motion, feet=rolling)))
    assert len(prints_of(motion, strides=2)) == 4


def test_a_foot_that_never_stands_leaves_no_print(motion: Motion) -> None:
    contact = motion.contact.clone()
    contact[:, 1] = False
    assert len(prints_of(replace(motion, contact=contact))) == 1


def limping(motion: Motion) -> Motion:
    """The left foot lifts off after half its stance."""
    left, flight, *rest = motion.phases
    early = left.start + 0.5 * (left.end - left.start)
    contact = motion.contact.clone()
    contact[motion.times > early, 0] = False
    return replace(motion, contact=contact, phases=(replace(left, end=early), replace(flight, start=early), *rest))


def test_a_limping_run_stands_where_its_feet_do(motion: Motion) -> None:
    np.testing.assert_allclose(prints_of(limping(motion)), stands(limping(motion)))


def test_a_motion_of_many_strides_is_cut_not_repeated(motion: Motion) -> None:
    long = repeated(motion, 5)
    np.testing.assert_allclose(prints_of(long, strides=3), prints_of(motion, strides=3), atol=1e-9)
    actual = lines_of(com_track_figure(long, strides=3))["centre of mass"][:, 0]
    assert len(actual) == 3 * (len(motion.times) - 1) + 1
    assert actual[-1] == pytest.approx(float(motion.com[0, 2]) + 3 * 4.0 * 0.68)


def test_a_motion_that_is_too_short_is_repeated(motion: Motion) -> None:
    assert len(prints_of(repeated(motion, 2), strides=4)) == 8
