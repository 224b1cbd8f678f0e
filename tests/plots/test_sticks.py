from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
import torch
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection
from matplotlib.colors import to_hex
from matplotlib.figure import Figure
from matplotlib.patches import Circle

from hopdiff.editing.root_path import RootPath, root_path, with_root_path
from hopdiff.geometry.clip import Clip
from hopdiff.plots import style
from hopdiff.plots.ground import ELEVATION, FLAT, camera_beside
from hopdiff.plots.joints import Bones, points_of
from hopdiff.plots.sticks import sticks_figure
from hopdiff.types import HopdiffError
from tests.people import clip_of
from tests.plots.walkers import MAKES, skeleton, walker


def drawn(figure: Figure) -> Figure:
    FigureCanvasAgg(figure).draw()
    return figure


def figures_of(figure: Figure, pale: bool = False) -> list[LineCollection]:
    """The drawn bodies, far ones first."""
    found = [c for c in figure.axes[0].collections if isinstance(c, LineCollection) and c.get_zorder() >= 2.4]
    return sorted((c for c in found if (c.get_zorder() < 3.0) == pale), key=lambda c: c.get_zorder())


def heads_of(figure: Figure) -> list[Circle]:
    return [artist for artist in figure.axes[0].get_children() if isinstance(artist, Circle)]


def colours_of(body: LineCollection) -> list[str]:
    return [to_hex(colour).upper() for colour in body.get_colors()]


def dark_top(body: LineCollection) -> float:
    """How high trunk and neck reach in the picture."""
    pairs = zip(body.get_paths(), colours_of(body), strict=True)
    return max(float(path.vertices[:, 1].max()) for path, colour in pairs if colour == style.BODY)


def moved(clip: Clip, turn: float) -> Clip:
    """The clip led along a way that turns."""
    before = root_path(clip)
    share = torch.linspace(0.0, 1.0, clip.frames, dtype=torch.float64)
    c, s = torch.cos(turn * share), torch.sin(turn * share)
    x, z = before.place.unbind(-1)
    place = torch.stack((c * x + s * z + 0.5 * share, c * z - s * x), dim=-1)
    return with_root_path(clip, before, RootPath(place, before.yaw + turn * share))


@pytest.mark.parametrize("make", MAKES)
@pytest.mark.parametrize("count", [1, 2, 7])
def test_as_many_figures_as_asked_for_at_even_times(make: str, count: int) -> None:
    clip = walker(skeleton(make))
    bodies = figures_of(sticks_figure(clip, count=count))
    camera = camera_beside(clip.root_position.numpy() * FLAT, 0.0, ELEVATION)
    frames = np.round(np.linspace(0, clip.frames - 1, count)).astype(int)
    wanted = points_of(clip)[frames]
    wanted = wanted[np.argsort(camera.nearness(wanted[:, 0]))]
    bones = Bones(clip.skeleton)
    assert len(bodies) == count
    for body, pose in zip(bodies, wanted, strict=True):
        lines = [path.vertices for path in body.get_paths()]
        assert len(lines) == 2 * len(bones.chains)
        seen = camera.project(pose)[:, :2]
        # Everything but the end of the neck, which lies in the head, is where the joint is.
        for node in set(range(len(seen))) - {bones.head.tip}:
            nearest = min(float(np.hypot(*(line - seen[node]).T).min()) for line in lines)
            assert nearest < 1e-9, bones.names[node]


def test_left_is_blue_and_right_is_orange_with_white_below() -> None:
    clip = walker(skeleton())
    (body,) = figures_of(sticks_figure(clip, count=1))
    colours = colours_of(body)
    assert set(colours[::2]) == {"#FFFFFF"}
    sides = [chain.side for chain in Bones(clip.skeleton).chains]
    assert sorted(colours[1::2]) == sorted(style.SIDE_COLOURS[side] for side in sides)
    widths = np.asarray(body.get_linewidths())
    assert (widths[::2] > widths[1::2]).all()
    # Blue are the lines that end on the left, where x grows.
    camera = camera_beside(clip.root_position.numpy() * FLAT, 0.0, ELEVATION)
    left = camera.project(clip.joint_positions()[0, clip.skeleton.index("LeftFoot")].numpy())[:2]
    blue = [path.vertices for path, colour in zip(body.get_paths(), colours, strict=True) if colour == style.LEFT]
    assert any(np.isclose(line, left).all(axis=1).any() for line in blue)


def test_sides_that_are_told_are_taken() -> None:
    clip = walker(skeleton())
    sides = ["middle"] * len(clip.skeleton.names)
    sides[1] = "right"
    (body,) = figures_of(sticks_figure(clip, sides, count=1))
    assert set(colours_of(body)) == {"#FFFFFF", style.BODY, style.RIGHT}


def test_fingers_are_thin() -> None:
    clip = walker(skeleton(fingers=5))
    (body,) = figures_of(sticks_figure(clip, count=1))
    widths = np.asarray(body.get_linewidths())[1::2]
    assert (widths < 0.5 * widths.max()).sum() == 10


@pytest.mark.parametrize("head", [True, False])
def test_a_head_is_a_disc_where_there_is_one(head: bool) -> None:
    figure = sticks_figure(walker(skeleton(head=head)), count=4)
    discs = heads_of(figure)
    assert len(discs) == (4 if head else 0)
    for disc, body in zip(sorted(discs, key=lambda d: d.get_zorder()), figures_of(figure), strict=False):
        assert disc.center[1] == pytest.approx(dark_top(body))
        assert 0.08 < disc.radius < 0.13
        assert body.get_zorder() < disc.get_zorder() < body.get_zorder() + 0.01


def test_before_is_pale_and_behind() -> None:
    clip = walker(skeleton())
    figure = sticks_figure(moved(clip, 0.8), before=clip, count=6)
    old, new = figures_of(figure, pale=True), figures_of(figure)
    assert len(old) == len(new) == 6
    assert max(body.get_zorder() for body in old) < min(body.get_zorder() for body in new)
    expected = {style.pale(colour, 0.72) for colour in style.SIDE_COLOURS.values()} | {"#FFFFFF"}
    assert {colour for body in old for colour in colours_of(body)} == expected
    assert "before the edit" in [text.get_text() for text in figure.texts]


@pytest.mark.parametrize("frames", [45, 200])
def test_before_may_have_another_length(frames: int) -> None:
    figure = sticks_figure(walker(skeleton()), before=walker(skeleton(), frames=frames), count=5)
    old, new = figures_of(figure, pale=True), figures_of(figure)
    ends = [sorted(float(path.vertices[0, 0]) for body in bodies for path in body.get_paths()) for bodies in (old, new)]
    assert len(old) == len(new)
    assert ends[0][-1] == pytest.approx(ends[1][-1], abs=0.05)


@pytest.mark.parametrize(("bend", "way"), [(0.0, 4.0), (math.pi, 5.0), (0.5, 18.0), (0.0, 0.0)])
def test_all_is_on_the_page_in_true_proportions(bend: float, way: float) -> None:
    clip = walker(skeleton(), bend=bend, way=way)
    figure = drawn(sticks_figure(clip, before=moved(clip, -0.5), curve=[[0, 0], [1, 2]]))
    axes = figure.axes[0]
    (left, right), (bottom, top) = axes.get_xlim(), axes.get_ylim()
    box = axes.get_window_extent()
    assert box.width / (right - left) == pytest.approx(box.height / (top - bottom), rel=1e-3)
    spots = [path.vertices for pale in (True, False) for body in figures_of(figure, pale) for path in body.get_paths()]
    spots += [disc.center + np.array([[0.0, disc.radius]]) for disc in heads_of(figure)]
    flat = np.concatenate(spots)
    assert left < flat[:, 0].min()
    assert flat[:, 0].max() < right
    assert bottom < flat[:, 1].min()
    assert flat[:, 1].max() < top
    texts = [text for text in (*figure.texts, *axes.texts) if text.get_text()]
    for text in texts:
        box = text.get_window_extent()
        assert figure.bbox.x0 <= box.x0, text.get_text()
        assert box.x1 <= figure.bbox.x1, text.get_text()
    head = [text.get_window_extent() for text in figure.texts]
    assert not any(a.overlaps(b) for i, a in enumerate(head) for b in head[:i])


def test_figures_of_a_walk_stand_beside_each_other() -> None:
    clip = walker(skeleton(), way=5.0)
    bodies = figures_of(sticks_figure(clip))
    hips = sorted(float(body.get_paths()[0].vertices[0, 0]) for body in bodies)
    assert 8 <= len(bodies) <= 14
    assert all(0.3 < b - a < 0.7 for a, b in pairwise(hips))


@pytest.mark.parametrize("turn", [0.0, 1.0, 3.0, -2.0])
def test_the_way_goes_to_the_right_wherever_it_goes(turn: float) -> None:
    clip = walker(skeleton())
    path = root_path(clip)
    c, s = math.cos(turn), math.sin(turn)
    place = path.place @ torch.tensor([[c, -s], [s, c]], dtype=torch.float64)
    (track,) = sticks_figure(with_root_path(clip, path, RootPath(place, path.yaw + turn))).axes[0].lines
    assert track.get_xdata()[-1] - track.get_xdata()[0] > 0.9 * 4.0


def test_a_way_that_winds_gets_few_figures_and_only_the_track_of_its_source() -> None:
    clip = walker(skeleton(), frames=1200, way=40.0, bend=10.0 * math.pi)
    figure = sticks_figure(clip, before=moved(clip, 0.5))
    assert 3 <= len(figures_of(figure)) <= 16
    assert not figures_of(figure, pale=True)
    assert sorted(len(line.get_xdata()) for line in figure.axes[0].lines) == [1200, 1200]


def test_times_stand_at_the_feet_and_apart() -> None:
    figure = drawn(sticks_figure(walker(skeleton(), frames=61, frame_time=0.05), count=7))
    times = [text for text in figure.axes[0].texts if text.get_text().endswith(" s")]
    assert [text.get_text() for text in times] == [f"{0.5 * k:.1f} s" for k in range(7)]
    boxes = [text.get_window_extent() for text in times]
    assert not any(a.overlaps(b) for i, a in enumerate(boxes) for b in boxes[:i])


def test_a_drawn_curve_lies_dashed_on_the_ground() -> None:
    clip = walker(skeleton())
    curve = np.array([[0.0, 0.0], [0.5, 2.0], [0.0, 4.0]])
    camera = camera_beside(clip.root_position.numpy() * FLAT, 0.0, ELEVATION)
    (line,) = (line for line in sticks_figure(clip, curve=curve).axes[0].lines if line.is_dashed())
    seen = camera.project(np.array([[0.0, 0, 0], [0.5, 0, 2.0], [0.0, 0, 4.0]]))
    np.testing.assert_allclose(np.stack(line.get_data(), axis=1), seen[:, :2])


def test_the_title_tells_way_and_time() -> None:
    clip = walker(skeleton(), frames=91, way=3.0)
    texts = [text.get_text() for text in sticks_figure(clip, count=7).texts]
    assert "3.00 m in 3.00 s, a figure every 0.50 s" in texts
    assert "Mine" in [text.get_text() for text in sticks_figure(clip, title="Mine").texts]


def test_joints_that_move_against_their_parents_are_drawn_where_they_are() -> None:
    clip = walker(skeleton(head=False), frames=10)
    offsets = clip.skeleton.offsets.repeat(10, 1, 1)
    offsets[-1, clip.skeleton.index("Collar"), 1] += 0.4
    stretched = replace(clip, offsets=offsets)
    plain, raised = (sorted(map(dark_top, figures_of(sticks_figure(c, count=2)))) for c in (clip, stretched))
    assert raised[0] == pytest.approx(plain[0])
    assert raised[1] - plain[1] == pytest.approx(0.4 * math.cos(ELEVATION))


def test_wide_figures_stand_farther_apart() -> None:
    walking = walker(skeleton(), way=8.0)
    running = replace(walking, rotations=walking.rotations @ walking.rotations)  # arms and legs swing twice as far
    counts = [len(figures_of(sticks_figure(clip))) for clip in (walking, running)]
    assert counts[1] < counts[0]
    widths = [
        float(np.median([np.ptp(np.concatenate([p.vertices[:, 0] for p in b.get_paths()])) for b in bodies]))
        for bodies in (figures_of(sticks_figure(clip)) for clip in (walking, running))
    ]
    for count, width in zip(counts, widths, strict=True):
        assert 8.0 / (count - 1) > 0.7 * width


@pytest.mark.parametrize("count", [0, -2])
def test_a_strip_of_nothing(count: int) -> None:
    with pytest.raises(HopdiffError, match=f"not {count}"):
        sticks_figure(walker(skeleton()), count=count)


@pytest.mark.parametrize(
    "name",
    [
        "walk",
        "walk sideways",
        "wander",
        "walk_straight_cmu_16_15",
        "walk_sideways_snu_cross90",
        "wander_snu_93s_30hz",
    ],
)
def test_people_are_drawn_with_few_pieces(name: str) -> None:
    clip = clip_of(name)
    figure = drawn(sticks_figure(moved(clip, 1.0), before=clip))
    assert len(figure.findobj()) < 500
    assert len(heads_of(figure)) == len(figures_of(figure)) + len(figures_of(figure, pale=True))
    assert len(figures_of(figure)) >= 3
