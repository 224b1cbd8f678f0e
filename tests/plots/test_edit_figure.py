from __future__ import annotations

import math

import numpy as np
import pytest
import torch
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection
from matplotlib.colors import to_hex
from matplotlib.figure import Figure

from hopdiff.editing.laplacian import laplacian
from hopdiff.editing.root_path import RootPath, steps_of
from hopdiff.editing.targets import Constraint, edit_path
from hopdiff.plots.edit import ABRUPT, AFTER, BEFORE, abrupt_steps, delta_norm, edit_figure
from hopdiff.types import HopdiffError
from tests.editing.walks import path_of_clip, walk

FRAME = 1.0 / 30.0


def edited(path: RootPath, turn: float = 0.9) -> tuple[RootPath, list[Constraint]]:
    last = path.place[-1]
    wanted = [Constraint(path.frames - 1, (float(last[0]) + 0.8, float(last[1])), float(path.yaw[-1]) + turn)]
    return edit_path(path, wanted, FRAME).path, wanted


def drawn(figure: Figure) -> Figure:
    FigureCanvasAgg(figure).draw()
    return figure


def lines_of(figure: Figure, panel: int = 0) -> dict[str, np.ndarray]:
    return {str(line.get_label()): np.stack(line.get_data(), axis=1) for line in figure.axes[panel].lines}


def bars_of(figure: Figure, label: str) -> list[np.ndarray]:
    found = [c for c in figure.axes[0].collections if str(c.get_label()).startswith(label)]
    assert len(found) <= 1
    return [path.vertices for c in found for path in c.get_paths()]


def strokes_of(figure: Figure) -> list[list[np.ndarray]]:
    """Headings before and after."""
    found = [c for c in figure.axes[0].collections if isinstance(c, LineCollection) and "δ" not in str(c.get_label())]
    return [[path.vertices for path in c.get_paths()] for c in sorted(found, key=lambda c: c.get_zorder())]


def arrows_of(figure: Figure) -> list[tuple[np.ndarray, np.ndarray]]:
    return [(np.array(text.xyann), np.array(text.xy)) for text in figure.axes[0].texts if text.arrow_patch]


def test_both_paths_lie_where_they_are() -> None:
    path = walk()
    after, wanted = edited(path)
    figure = edit_figure(path, after, wanted, FRAME)
    lines = lines_of(figure)
    np.testing.assert_allclose(lines["before"], path.place)
    np.testing.assert_allclose(lines["after"], after.place)
    np.testing.assert_allclose(lines["start"], after.place[:1])
    colours = {str(line.get_label()): to_hex(line.get_color()).upper() for line in figure.axes[0].lines}
    assert colours["after"] == AFTER
    assert colours["before"] != AFTER


@pytest.mark.parametrize("turn", [0.0, 1.6, 3.1])
def test_the_map_has_equal_scales_left_on_the_left_and_everything_on_it(turn: float) -> None:
    path = walk()
    after, wanted = edited(path, turn)
    curve = [[1.0, 1.0], [4.0, 6.0]]
    figure = drawn(edit_figure(path, after, wanted, FRAME, curve=curve))
    axes = figure.axes[0]
    (left, right), (bottom, top) = axes.get_xlim(), axes.get_ylim()
    assert left > right
    box = axes.get_window_extent()
    assert box.width / (left - right) == pytest.approx(box.height / (top - bottom), rel=1e-3)
    spots = [*lines_of(figure).values(), *(np.stack(arrow) for arrow in arrows_of(figure))]
    spots += [stroke for strokes in strokes_of(figure) for stroke in strokes]
    everything = np.concatenate(spots)
    assert right < everything[:, 0].min()
    assert everything[:, 0].max() < left
    assert bottom < everything[:, 1].min()
    assert everything[:, 1].max() < top
    np.testing.assert_allclose(lines_of(figure)["drawn curve"], curve)


def test_strokes_point_where_the_body_faces_at_even_times() -> None:
    path = walk(facing=1.2)
    after, wanted = edited(path)
    for strokes, seen in zip(strokes_of(edit_figure(path, after, wanted, FRAME)), (path, after), strict=True):
        at = np.arange(0.0, path.frames - 1 + 1e-6, 0.25 / FRAME)
        assert len(strokes) == len(at) == 16
        for stroke, frame in zip(strokes, at, strict=True):
            yaw = np.interp(frame, np.arange(path.frames), seen.yaw)
            way = stroke[1] - stroke[0]
            assert math.remainder(math.atan2(way[0], way[1]) - yaw, math.tau) == pytest.approx(0.0, abs=1e-9)
        np.testing.assert_allclose(strokes[0][0], seen.place[0], atol=1e-12)


@pytest.mark.parametrize(("seconds", "most"), [(4.0, 20), (60.0, 101), (600.0, 101)])
def test_long_clips_get_no_more_strokes_than_can_be_seen(seconds: float, most: int) -> None:
    path = walk(round(30 * seconds))
    strokes, _ = strokes_of(edit_figure(path, path, [], FRAME))
    assert 10 < len(strokes) <= most


def test_bars_stand_across_the_way_and_are_as_long_as_delta() -> None:
    path = walk(bend=1.0)
    # Two kinks, so that some bars are red.
    yaw = path.yaw.clone()
    yaw[40:] += 0.3
    yaw[80:] -= 0.2
    after = RootPath(path.place, yaw)
    figure = edit_figure(path, after, [], FRAME)
    bars = np.array(bars_of(figure, "|δ|, as bars") + bars_of(figure, "|δ| changes most"))
    delta = laplacian(steps_of(after)).norm(dim=-1).numpy()[1:-1]
    assert len(bars) == len(delta) == path.frames - 3
    # Each bar begins where the step ends whose change it shows.
    frames = [int(np.hypot(*(path.place.numpy() - bar[0]).T).argmin()) for bar in bars]
    assert sorted(frames) == list(range(2, path.frames - 1))
    lengths = np.hypot(*(bars[:, 1] - bars[:, 0]).T)
    np.testing.assert_allclose(lengths / lengths.max(), delta[np.array(frames) - 2] / delta.max(), atol=1e-9)
    step = path.place[3:] - path.place[1:-2]
    for bar, frame in zip(bars, frames, strict=True):
        way = step[frame - 2].numpy() / np.linalg.norm(step[frame - 2])
        side = bar[1] - bar[0]
        if np.hypot(*side) > 0.02:
            assert abs(side @ way) < 0.25 * np.hypot(*side)
            assert way[1] * side[0] - way[0] * side[1] > 0, "not on the left"


def test_bars_bury_neither_way() -> None:
    """They are short and pale, lie below both ways and inside the map, and stand where the source's way is not."""
    even = walk(400)
    sway = 0.01 * torch.sin(2.0 * torch.arange(400, dtype=torch.float64))
    path = RootPath(even.place, even.yaw + sway)
    for turn, target in ((0.9, 1.5), (-0.9, -1.5)):
        last = path.place[-1]
        wanted = [Constraint(path.frames - 1, (float(last[0]) + target, float(last[1])), float(path.yaw[-1]) + turn)]
        after = edit_path(path, wanted, FRAME).path
        figure = drawn(edit_figure(path, after, wanted, FRAME))
        axes = figure.axes[0]
        bars = np.array(bars_of(figure, "|δ|, as bars") + bars_of(figure, "|δ| changes most"))
        inches = np.hypot(*(axes.transData.transform(bars[:, 1]) - axes.transData.transform(bars[:, 0])).T) / figure.dpi
        assert 0.2 < inches.max() < 0.45
        starts = axes.transData.transform(bars[:, 0]) / figure.dpi
        assert np.median(np.hypot(*np.diff(starts, axis=0).T)) > 0.05, "bars as dense as a hatching"
        (low, high), (bottom, top) = sorted(axes.get_xlim()), axes.get_ylim()
        assert low < bars[..., 0].min()
        assert bars[..., 0].max() < high
        assert bottom < bars[..., 1].min()
        assert bars[..., 1].max() < top
        orders = {str(line.get_label()): line.get_zorder() for line in axes.lines}
        below = [c.get_zorder() for c in axes.collections if "δ" in str(c.get_label())]
        assert max(below) < min(orders["before"], orders["after"])
        source = path.place.numpy()
        apart = [np.hypot(*(source[:, None] - bars[None, :, end]).transpose(2, 0, 1)).min(axis=0) for end in (0, 1)]
        assert apart[1].mean() > apart[0].mean()


def test_bars_on_the_outside_of_a_large_turn_are_on_the_map() -> None:
    even = walk(1800, bend=-4.0)
    path = RootPath(even.place, even.yaw + 0.01 * torch.sin(2.0 * torch.arange(1800, dtype=torch.float64)))
    figure = edit_figure(path, path, [], FRAME)
    (right, left), (bottom, top) = sorted(figure.axes[0].get_xlim()), figure.axes[0].get_ylim()
    tips = np.array(bars_of(figure, "|δ|, as bars"))[:, 1]
    assert right < tips[:, 0].min()
    assert tips[:, 0].max() < left
    assert bottom < tips[:, 1].min()
    assert tips[:, 1].max() < top


def test_the_legend_tells_the_longest_bar_and_fits_the_page() -> None:
    path = walk()
    after, wanted = edited(path)
    figure = drawn(edit_figure(path, after, wanted, FRAME, curve=[[0.0, 0.0], [1.0, 4.0]]))
    texts = [text.get_text() for text in figure.legends[0].texts]
    assert f"|δ|, as bars (longest {delta_norm(after).max():.2g})" in texts
    box = figure.legends[0].get_window_extent()
    assert figure.bbox.x0 <= box.x0
    assert box.x1 <= figure.bbox.x1


def test_red_bars_are_where_the_edit_made_a_kink() -> None:
    path = walk()
    yaw = path.yaw.clone()
    yaw[60:] += 0.4
    figure = edit_figure(path, RootPath(path.place, yaw), [], FRAME)
    red = np.array(bars_of(figure, "|δ| changes most"))
    places = path.place.numpy()
    frames = {int(np.hypot(*(places - bar[0]).T).argmin()) for bar in red}
    assert 60 in frames
    assert frames <= set(range(58, 63))
    (found,) = (c for c in figure.axes[0].collections if c.get_label() == "|δ| changes most")
    assert to_hex(found.get_color()[0]).upper() == ABRUPT.upper()


def test_an_even_path_has_no_red_and_only_short_bars() -> None:
    path = walk()
    figure = edit_figure(path, path, [], FRAME)
    assert not bars_of(figure, "|δ| changes most")
    lengths = [float(np.hypot(*(bar[1] - bar[0]))) for bar in bars_of(figure, "|δ|, as bars")]
    low, high = figure.axes[0].get_ylim()
    assert max(lengths) < 0.06 * (high - low)
    assert not any("most" in text.get_text() for text in figure.legends[0].texts)


@pytest.mark.parametrize("every", [1, 2, 4])
def test_delta_is_the_same_at_any_frame_rate(every: int) -> None:
    fine = walk(30 * every * 3 + 1, FRAME / every)
    coarse = RootPath(fine.place[::every], fine.yaw[::every])
    np.testing.assert_allclose(delta_norm(fine, every), delta_norm(coarse))
    times = lines_of(edit_figure(fine, fine, [], FRAME / every), panel=1)["after"]
    np.testing.assert_allclose(times[:, 0], FRAME * np.arange(2, 90))
    np.testing.assert_allclose(times[:, 1], delta_norm(coarse))


def test_steps_stand_out_against_what_is_usual_in_the_source() -> None:
    before = np.tile([0.0, 0.002], 50)
    after = np.zeros(100)
    after[30], after[60] = 0.001, 0.05
    assert np.flatnonzero(abrupt_steps(before, after)).tolist() == [60]
    assert not abrupt_steps(before, before).any()


def test_a_winding_way_is_red_itself_and_has_no_bars() -> None:
    path = walk(1500, bend=12 * math.pi)
    yaw = path.yaw.clone()
    yaw[700:] += 0.5
    figure = edit_figure(path, RootPath(path.place, yaw), [], FRAME)
    assert not bars_of(figure, "|δ|, as bars")
    near = [np.hypot(*(path.place.numpy() - piece[0]).T).argmin() for piece in bars_of(figure, "|δ| changes most")]
    assert near
    assert all(696 <= frame <= 702 for frame in near)


def test_constraints_are_crosses_and_rings_with_arrows() -> None:
    path = walk()
    wanted = [
        Constraint(0, None, 0.5),
        Constraint(50, (1.5, 3.0)),
        Constraint(80, (2.0, 4.0), keep=True),
        Constraint(119, (3.0, 5.0), math.pi / 2),
    ]
    lines, arrows = lines_of(figure := edit_figure(path, path, wanted, FRAME)), arrows_of(figure)
    np.testing.assert_allclose(lines["wanted place"], [(1.5, 3.0), (2.0, 4.0), (3.0, 5.0)])
    np.testing.assert_allclose(lines["wanted heading"], path.place[:1])
    headings = [0.5, float(path.yaw[80]), math.pi / 2]
    starts = [path.place[0].numpy(), (2.0, 4.0), (3.0, 5.0)]
    assert len(arrows) == 3
    for (tail, tip), heading, start in zip(arrows, headings, starts, strict=True):
        np.testing.assert_allclose(tail, start)
        way = tip - tail
        assert math.atan2(way[0], way[1]) == pytest.approx(heading)
    times = [line.get_xdata()[0] for line in figure.axes[1].lines if line.is_dashed()]
    np.testing.assert_allclose(times, [FRAME * one.frame for one in wanted])


def test_many_constraints_are_drawn_smaller() -> None:
    path = walk()
    sizes = []
    for count in (3, 30):
        wanted = [Constraint(4 * k, (float(k), 0.0)) for k in range(count)]
        figure = edit_figure(path, path, wanted, FRAME)
        (crosses,) = (line for line in figure.axes[0].lines if line.get_label() == "wanted place")
        assert len(crosses.get_xdata()) == count
        sizes.append(crosses.get_markersize())
    assert sizes[1] < 0.6 * sizes[0]


def test_the_lower_panel_compares_delta_before_and_after() -> None:
    path = walk()
    after, wanted = edited(path)
    figure = edit_figure(path, after, wanted, FRAME)
    lines = lines_of(figure, panel=1)
    np.testing.assert_allclose(lines["before"][:, 1], delta_norm(path))
    np.testing.assert_allclose(lines["after"][:, 1], delta_norm(after))
    colours = {str(line.get_label()): to_hex(line.get_color()).upper() for line in figure.axes[1].lines}
    assert (colours["before"], colours["after"]) == (BEFORE, AFTER)


def test_the_title_tells_both_ways() -> None:
    path = walk()
    after, wanted = edited(path)
    old, new = (float(p.place.diff(dim=0).norm(dim=-1).sum()) for p in (path, after))
    title = edit_figure(path, after, wanted, FRAME).get_suptitle()
    assert title == f"Root path: {old:.2f} m before, {new:.2f} m after the edit, {119 / 30:.2f} s"
    assert edit_figure(path, after, wanted, FRAME, title="Mine").get_suptitle() == "Mine"


def test_one_who_stands_can_be_drawn() -> None:
    still = RootPath(torch.zeros(40, 2, dtype=torch.float64), torch.zeros(40, dtype=torch.float64))
    drawn(edit_figure(still, still, [Constraint(39, None, 1.0)], FRAME))


@pytest.mark.parametrize("frames", [5, 6, 9])
@pytest.mark.parametrize("rate", [24.0, 120.0])
def test_short_clips_can_be_drawn(frames: int, rate: float) -> None:
    path = walk(frames, 1.0 / rate)
    drawn(edit_figure(path, path, [], 1.0 / rate))


@pytest.mark.parametrize(
    ("before", "after", "frame", "message"),
    [(4, 30, 0, "source has 4"), (30, 3, 0, "edited path has 3"), (30, 30, 30, "frame 30"), (30, 30, -1, "frame -1")],
)
def test_what_cannot_be_drawn(before: int, after: int, frame: int, message: str) -> None:
    with pytest.raises(HopdiffError, match=message):
        edit_figure(walk(before), walk(after), [Constraint(frame, (0.0, 0.0))], FRAME)


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
def test_paths_of_people_are_drawn_with_few_pieces(name: str) -> None:
    path, frame_time = path_of_clip(name)
    figure = drawn(edit_figure(path, path, [Constraint(path.frames - 1, (0.0, 0.0), 0.0)], frame_time))
    assert len(figure.findobj()) < 400
