from __future__ import annotations

import math
from dataclasses import replace
from itertools import combinations, pairwise

import numpy as np
import pytest
import torch
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import PolyCollection
from matplotlib.colors import to_hex
from matplotlib.figure import Figure

from hopdiff.geometry.rotation import axis_rotation
from hopdiff.motion import Motion
from hopdiff.plots.front import front_figure
from hopdiff.plots.strip import FILL
from tests.plots.bends import bent, repeated


def drawn(figure: Figure) -> Figure:
    FigureCanvasAgg(figure).draw()
    return figure


def runners(figure: Figure) -> list[PolyCollection]:
    return [c for c in figure.axes[0].collections if isinstance(c, PolyCollection)]


def leans(figure: Figure) -> list[str]:
    return [text.get_text() for text in figure.axes[0].texts if "\u00b0" in text.get_text()]


def upright(motion: Motion, right: float = 0.0) -> Motion:
    """The body without the turns of its joints, tilted to its right [rad]."""
    rotations = torch.eye(3, dtype=torch.float64).expand_as(motion.clip.rotations).clone()
    rotations[:, 0] = axis_rotation("Z", torch.tensor(right, dtype=torch.float64))
    return replace(motion, clip=replace(motion.clip, rotations=rotations))


def test_four_poses_a_step_side_by_side_in_true_proportions(motion: Motion) -> None:
    figure = drawn(front_figure(motion))
    axes = figure.axes[0]
    extents = [np.concatenate([path.vertices for path in runner.get_paths()]) for runner in runners(figure)]
    assert len(extents) == 8
    for left, right in pairwise(extents):
        assert left[:, 0].max() < right[:, 0].min()
    (low, high), (bottom, top), box = axes.get_xlim(), axes.get_ylim(), axes.get_window_extent()
    assert low < extents[0].min()
    assert extents[-1][:, 0].max() < high
    assert max(extent[:, 1].max() for extent in extents) < top
    assert box.width / (high - low) == pytest.approx(box.height / (top - bottom), rel=1e-6)


def test_left_is_left(motion: Motion) -> None:
    runner = runners(front_figure(upright(motion)))[0]
    middles: dict[str, list[float]] = {side: [] for side in FILL}
    for path, colour in zip(runner.get_paths(), runner.get_facecolors(), strict=True):
        side = next(side for side, fill in FILL.items() if fill == to_hex(colour).upper())
        middles[side].append(float(path.vertices[:, 0].mean()))
    assert max(middles["left"]) < min(middles["middle"])
    assert max(middles["middle"]) < min(middles["right"])


def test_each_step_tells_how_long_its_leg_carries(motion: Motion) -> None:
    left, flight, *rest = motion.phases
    shorter = (replace(left, end=left.end - 0.1), replace(flight, start=flight.start - 0.1), *rest)
    texts = [text.get_text() for text in front_figure(replace(motion, phases=shorter)).axes[0].texts]
    contact = 0.33 * 0.68
    assert f"the left leg carries for {contact - 0.1:.3f} s" in texts
    assert f"the right leg carries for {contact:.3f} s" in texts
    assert f"{contact - 0.1:.2f} s" in texts  # take-off of the left foot
    names = [text for text in texts if text in ("touchdown", "mid-stance", "take-off", "middle of flight")]
    assert names == ["touchdown", "mid-stance", "take-off", "middle of flight"] * 2


@pytest.mark.parametrize(
    ("angle", "text"),
    [(math.radians(5.0), "5.0\u00b0 right"), (-math.radians(2.5), "2.5\u00b0 left"), (0.0, "0.0\u00b0")],
)
def test_the_lean_of_the_trunk(motion: Motion, angle: float, text: str) -> None:
    figure = front_figure(upright(motion, angle))
    assert leans(figure) == [text] * 8
    trunk = next(line for line in figure.axes[0].lines if to_hex(line.get_color()) == "#ffffff")
    across, up = np.diff(trunk.get_data(), axis=1).sum(axis=1)
    assert math.atan2(across, up) == pytest.approx(angle, abs=1e-9)


def test_the_upright_stands_in_the_middle_of_the_feet(motion: Motion) -> None:
    shifted = replace(motion, clip=replace(motion.clip, root_position=motion.clip.root_position + 0.3))
    shifted = replace(shifted, feet=motion.feet + 0.3)
    for one in (motion, shifted):
        figure = front_figure(one)
        line = next(line for line in figure.axes[0].lines if line.get_linestyle() == "--")
        trunk = next(line for line in figure.axes[0].lines if to_hex(line.get_color()) == "#ffffff")
        stands = [one.feet[one.contact[:, side], side, 0].mean() for side in (0, 1)]
        waist = one.clip.joint_positions()[0, one.clip.skeleton.index("waist"), 0]
        aside = float(waist) - float(sum(stands)) / 2
        # From behind, what is farther to the left stands farther left on the page.
        assert float(trunk.get_xdata()[0]) - float(line.get_xdata()[0]) == pytest.approx(-aside, abs=1e-6)


def test_the_view_turns_with_the_run(motion: Motion) -> None:
    """A straight run in another direction gives the same picture; of many strides the first is shown."""
    long = repeated(motion, 3)
    turn = axis_rotation("Y", torch.tensor(0.7, dtype=torch.float64))
    rotations = long.clip.rotations.clone()
    rotations[:, 0] = turn @ rotations[:, 0]
    clip = replace(long.clip, root_position=long.clip.root_position @ turn.T, rotations=rotations)
    turned = replace(long, clip=clip, feet=long.feet @ turn.T)
    plain, other = runners(front_figure(motion)), runners(front_figure(turned))
    for a, b in zip(plain, other, strict=True):
        box, again = (np.concatenate([path.vertices for path in runner.get_paths()]) for runner in (a, b))
        np.testing.assert_allclose(box.max(axis=0), again.max(axis=0), atol=0.02)
        np.testing.assert_allclose(box.min(axis=0), again.min(axis=0), atol=0.02)


def test_no_text_on_another(motion: Motion) -> None:
    figure = drawn(front_figure(bent(repeated(motion, 2), turn=0.5)))
    texts = [text for text in (*figure.texts, *figure.axes[0].texts) if text.get_text()]
    boxes = [(text.get_text(), text.get_window_extent()) for text in texts]
    for (one, box), (other, second) in combinations(boxes, 2):
        assert not box.overlaps(second), f"{one} lies on {other}"
    for text, box in boxes:
        assert figure.bbox.x0 <= box.x0, text
        assert box.x1 <= figure.bbox.x1, text
        assert figure.bbox.y0 <= box.y0, text
        assert box.y1 <= figure.bbox.y1, text
