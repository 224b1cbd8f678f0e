from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import to_hex
from matplotlib.figure import Figure
from matplotlib.patches import Polygon

from hopdiff.motion import Motion
from hopdiff.plots.body import Body
from hopdiff.plots.poses import contact_points, key_moments, sample
from hopdiff.plots.save import save_figure
from hopdiff.plots.strip import FILL, strip_figure
from hopdiff.types import HopdiffError
from tests.plots.conftest import make_motion


@pytest.fixture
def figure(motion: Motion) -> Figure:
    figure = strip_figure(motion)
    FigureCanvasAgg(figure).draw()
    return figure


def figures_of(figure: Figure, motion: Motion) -> list[list[Polygon]]:
    """The parts of every drawn pose."""
    parts = [patch for patch in figure.axes[0].patches if isinstance(patch, Polygon)]
    body = Body(motion.clip.skeleton)
    count = len(body.parts(body.points(motion.clip)[0]))
    return [parts[start : start + count] for start in range(0, len(parts), count)]


def test_ten_poses_side_by_side(figure: Figure, motion: Motion) -> None:
    poses = figures_of(figure, motion)
    assert len(poses) == 10
    extents = [np.concatenate([part.get_xy() for part in pose])[:, 0] for pose in poses]
    for left, right in pairwise(extents):
        assert left.max() < right.min()
    low, high = figure.axes[0].get_xlim()
    assert low < extents[0].min()
    assert extents[-1].max() < high


def test_a_metre_is_as_high_as_long(figure: Figure) -> None:
    for axes in figure.axes:
        box = axes.get_window_extent()
        (low, high), (bottom, top) = axes.get_xlim(), axes.get_ylim()
        assert box.width / (high - low) == pytest.approx(box.height / (top - bottom), rel=1e-6)


def test_heights_and_the_way_are_numbered(figure: Figure) -> None:
    trace = figure.axes[1]
    assert (trace.get_xlabel(), trace.get_ylabel()) == ("along the way [m]", "height [m]")
    assert sum(0 <= tick <= trace.get_ylim()[1] for tick in trace.get_yticks()) >= 3


@pytest.mark.parametrize("speed", [2.0, 5.0, 10.0])
def test_the_trace_and_its_numbers_stay_on_the_page(speed: float) -> None:
    figure = strip_figure(make_motion(speed))
    FigureCanvasAgg(figure).draw()
    trace = figure.axes[1]
    assert trace.yaxis.label.get_window_extent().x0 >= figure.bbox.x0
    assert trace.get_window_extent().x1 <= figure.bbox.x1


def test_the_near_side_covers_the_far_side(figure: Figure, motion: Motion) -> None:
    assert len(set(FILL.values())) == 3
    for pose in figures_of(figure, motion):
        orders = {
            side: [p.get_zorder() for p in pose if to_hex(p.get_facecolor()).upper() == FILL[side]] for side in FILL
        }
        assert max(orders["left"]) < min(orders["middle"]) < min(orders["right"])


def test_no_text_on_another(figure: Figure) -> None:
    texts = [text for text in (*figure.axes[0].texts, *figure.texts) if text.get_text()]
    boxes = [text.get_window_extent() for text in texts]
    page = figure.bbox
    for i, box in enumerate(boxes):
        assert page.x0 <= box.x0
        assert box.x1 <= page.x1
        clashes = [texts[j].get_text() for j in range(i) if boxes[j].overlaps(box)]
        assert not clashes, f"{texts[i].get_text()} lies on {clashes}"


def test_key_moments(motion: Motion) -> None:
    moments = key_moments(motion)
    names = ["touchdown", "mid-stance", "late stance", "take-off", "apex"]
    assert [(m.name, m.side) for m in moments[:5]] == [(name, "left") for name in names]
    assert [(m.name, m.side) for m in moments[5:]] == [(name, "right") for name in names]
    times = [m.time for m in moments]
    assert times == sorted(set(times))
    stance, flight, *_ = motion.phases
    assert moments[1].time == pytest.approx((stance.start + stance.end) / 2)
    assert moments[4].time == pytest.approx((flight.start + flight.end) / 2)
    assert [m.carries for m in moments[:5]] == [True, True, True, True, False]


def test_sample_between_frames() -> None:
    times = np.array([0.0, 1.0, 3.0])
    track = np.array([[0.0, 1.0], [2.0, 1.0], [6.0, -1.0]])
    np.testing.assert_allclose(sample(times, track, [0.5, 2.0, 3.0, 9.0]), [[1, 1], [4, 0], [6, -1], [6, -1]])


def test_contact_points_are_where_the_foot_stands(motion: Motion) -> None:
    (left, left_place), (right, right_place) = contact_points(motion)
    assert (left.side, right.side) == ("left", "right")
    np.testing.assert_allclose(left_place, motion.feet[motion.contact[:, 0], 0].mean(dim=0))
    np.testing.assert_allclose(right_place, motion.feet[motion.contact[:, 1], 1].mean(dim=0))


def test_the_head_is_the_highest_part(motion: Motion) -> None:
    body = Body(motion.clip.skeleton)
    pose = body.points(motion.clip)[0]
    parts = body.parts(pose)
    highest = max(parts, key=lambda part: float(part.outline[:, 1].max()))
    assert highest.side == "middle"
    assert highest.outline[:, 1].max() == pytest.approx(pose[:, 1].max(), abs=0.01)
    assert all(np.isfinite(part.outline).all() for part in parts)


def test_saving(figure: Figure, tmp_path: Path) -> None:
    save_figure(figure, tmp_path / "strip.svg")
    assert (tmp_path / "strip.svg").read_text().lstrip().startswith("<?xml")
    with pytest.raises(HopdiffError, match=r"strip\.bmp"):
        save_figure(figure, tmp_path / "strip.bmp")
    assert {path.name for path in tmp_path.iterdir()} == {"strip.svg"}
