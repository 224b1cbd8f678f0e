from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from matplotlib.collections import LineCollection
from matplotlib.colors import to_hex
from matplotlib.figure import Figure
from PIL import Image

from hopdiff.physics.hopping import Hopper, Hopping, Legs, hop_along
from hopdiff.plots import style
from hopdiff.plots.hopper import hopper_figure
from hopdiff.plots.save import save_figure

HOPPER = Hopper(leg_length=1.5, touchdown_angle=math.pi / 6, speed=5.0, stiffness=9000.0, mass=50.0)
LEGS = Legs(1, 0.9, 1.3, -0.4, 0.35, 1.6, 2.2, 1.4)


def hopping(number: int, hops: int = 2) -> Hopping:
    done = hop_along(HOPPER, LEGS._replace(number=number), -0.5, 0.01, hops, 20_000)
    assert done is not None
    return done


def draw(done: Hopping) -> Figure:
    return hopper_figure(done, HOPPER.leg_length, "a hopper", "what it does")


def limbs(figure: Figure) -> dict[str, list[np.ndarray]]:
    """Drawn legs (3, 2) by colour."""
    found = [child for child in figure.axes[0].get_children() if isinstance(child, LineCollection)]
    return {to_hex(group.get_colors()[0]).upper(): group.get_segments() for group in found if group.get_segments()}


@pytest.mark.parametrize(("number", "hops"), [(1, 1), (1, 2), (2, 3), (2, 6)])
def test_a_metre_is_as_long_up_as_along(number: int, hops: int) -> None:
    figure = draw(hopping(number, hops))
    axes = figure.axes[0]
    box = axes.get_position()
    width, height = figure.get_size_inches()
    (left, right), (bottom, top) = axes.get_xlim(), axes.get_ylim()
    assert box.width * width / (right - left) == pytest.approx(box.height * height / (top - bottom), rel=1e-9)
    assert width <= 18.0 + 1e-9


def test_heights_and_the_way_are_numbered() -> None:
    axes = draw(hopping(2, 3)).axes[0]
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("along the way [m]", "height [m]")
    for axis, (low, high) in ((axes.xaxis, axes.get_xlim()), (axes.yaxis, axes.get_ylim())):
        assert sum(low <= tick <= high for tick in axis.get_ticklocs()) >= 2


def test_one_leg_is_coloured_by_stance_and_flight() -> None:
    done = hopping(1)
    drawn = limbs(draw(done))
    assert len(drawn) == 2
    for segment in drawn[style.RIGHT]:
        assert segment[2, 1] == pytest.approx(0.0, abs=1e-9), "a standing leg is on the ground"
    (pale,) = set(drawn) - {style.RIGHT}
    assert all(segment[2, 1] > -1e-6 for segment in drawn[pale])


def test_two_legs_keep_their_colours_and_the_carrier_is_strong() -> None:
    done = hopping(2)
    drawn = limbs(draw(done))
    assert {style.LEFT, style.RIGHT} < set(drawn)
    assert len(drawn) == 4
    for colour in (style.LEFT, style.RIGHT):
        assert all(abs(segment[2, 1]) < 1e-9 for segment in drawn[colour])
    # Every drawn pose shows both legs.
    assert sum(len(group) for group in drawn.values()) % 2 == 0
    spots = {round(float(segment[2, 0]), 6) for segment in drawn[style.RIGHT]}
    i = int((done.hop == 1).nonzero()[0])
    assert spots == {round(float(done.feet[i, 1, 0]), 6)}


def test_poses_are_evenly_spaced_along_the_way() -> None:
    done = hopping(1)
    hips = sorted(segment[0, 0] for group in limbs(draw(done)).values() for segment in group)
    gaps = np.diff(hips)
    np.testing.assert_allclose(gaps[:-1], gaps[0], rtol=1e-6)
    assert hips[0] == pytest.approx(float(done.hip[0, 0]))
    assert hips[-1] == pytest.approx(float(done.hip[-1, 0]))


def test_the_path_runs_through_every_frame_and_changes_are_marked() -> None:
    done = hopping(2)
    lines = {(line.get_marker(), line.get_linestyle()): line for line in draw(done).axes[0].lines[::-1]}
    path = max(draw(done).axes[0].lines, key=lambda line: len(line.get_xdata()))
    np.testing.assert_allclose(path.get_xydata(), done.hip.numpy())
    touchdowns = next(line for (marker, _), line in lines.items() if marker == "v")
    takeoffs = next(line for (marker, _), line in lines.items() if marker == "^")
    assert len(touchdowns.get_xdata()) == 3
    assert len(takeoffs.get_xdata()) == 2
    np.testing.assert_allclose(touchdowns.get_ydata(), HOPPER.touchdown_height)


def test_a_fall_on_the_first_frame_can_be_drawn(tmp_path: Path) -> None:
    done = hop_along(HOPPER, LEGS, -100.0, 0.02, 1, 100)
    assert done is not None
    save_figure(draw(done), tmp_path / "fall.png")
    with Image.open(tmp_path / "fall.png") as picture:
        assert picture.width > 100


def test_nothing_is_cut_off(tmp_path: Path) -> None:
    save_figure(draw(hopping(2, 3)), tmp_path / "hopper.png")
    with Image.open(tmp_path / "hopper.png") as picture:
        pixels = np.asarray(picture.convert("L"))
    for edge in (pixels[:3], pixels[-3:], pixels[:, :3], pixels[:, -3:]):
        assert (edge == 255).all()
