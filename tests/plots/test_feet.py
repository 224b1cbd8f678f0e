from __future__ import annotations

import numpy as np
import pytest
import torch
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import to_hex
from matplotlib.figure import Figure

from hopdiff.plots import style
from hopdiff.plots.feet import contact_spans, feet_figure
from hopdiff.types import HopdiffError

NAMES = ("left heel", "left toe", "right heel", "RightToeBase")
STAGES = ("source", "edited", "cleaned")
Tracks = dict[str, torch.Tensor]


def walk(seconds: float = 3.0, rate: float = 30.0) -> tuple[torch.Tensor, torch.Tensor, Tracks, Tracks]:
    """Times, contacts, speeds and heights of feet that stand for 0.6 s and swing for 0.4 s."""
    times = torch.arange(round(seconds * rate) + 1, dtype=torch.float64) / rate
    phase = torch.remainder(times[:, None] + torch.tensor([0.0, 0.1, 0.5, 0.6]), 1.0)
    contact = phase < 0.6
    swing = torch.where(contact, 0.0, torch.sin(torch.pi * (phase - 0.6) / 0.4)).double()
    slide = {"source": 0.02, "edited": 0.3, "cleaned": 0.03}
    speeds = {stage: value + 3.0 * swing for stage, value in slide.items()}
    heights = dict.fromkeys(STAGES, 0.02 + 0.25 * swing)
    return times, contact, speeds, heights


def drawn(figure: Figure) -> Figure:
    FigureCanvasAgg(figure).draw()
    return figure


def test_a_pair_of_panels_for_each_point() -> None:
    times, contact, speeds, heights = walk()
    figure = drawn(feet_figure(times, NAMES, contact, speeds, heights))
    assert len(figure.axes) == 8
    for point, name in enumerate(NAMES):
        upper, lower = figure.axes[2 * point : 2 * point + 2]
        assert upper.get_title(loc="left") == name
        for axes, tracks, unit in ((upper, speeds, 1.0), (lower, heights, 100.0)):
            lines = {str(line.get_label()): line for line in axes.lines}
            assert list(lines) == list(STAGES)
            for stage, line in lines.items():
                np.testing.assert_allclose(line.get_xdata(), times)
                np.testing.assert_allclose(line.get_ydata(), unit * tracks[stage][:, point])
            assert len({to_hex(line.get_color()) for line in lines.values()}) == 3


def test_slide_can_be_read_however_fast_the_swing() -> None:
    times, contact, speeds, heights = walk()
    figure = feet_figure(times, NAMES, contact, speeds, heights)
    for axes in figure.axes[::2]:
        assert axes.get_ylim() == (0.0, 0.5)
    for axes in figure.axes[1::2]:
        assert axes.get_ylim() == (0.0, 20.0)


def test_every_panel_says_what_it_shows_and_reaches_over_the_mean() -> None:
    times, contact, speeds, heights = walk()
    labels = [axes.get_ylabel() for axes in feet_figure(times, NAMES, contact, speeds, heights).axes]
    assert labels == ["speed [m/s]", "height\n[cm]"] * 4
    speeds["edited"] = speeds["edited"] + 0.7
    figure = feet_figure(times, NAMES, contact, speeds, heights)
    assert all(axes.get_ylim()[1] == pytest.approx(1.5) for axes in figure.axes[::2])


def test_a_foot_below_the_floor_stays_in_its_panel() -> None:
    times, contact, speeds, heights = walk()
    heights["edited"] = heights["edited"] - 0.06
    figure = feet_figure(times, NAMES, contact, speeds, heights)
    assert all(axes.get_ylim()[0] == pytest.approx(-5.0) for axes in figure.axes[1::2])


def test_contacts_are_shaded_in_the_colour_of_their_side() -> None:
    times, contact, speeds, heights = walk()
    figure = feet_figure(times, NAMES, contact, speeds, heights)
    for axes, point in zip(figure.axes, np.repeat(range(4), 2), strict=True):
        (shades,) = axes.collections
        spans = [tuple(path.vertices[:, 0][[0, 2]]) for path in shades.get_paths()]
        extents = [(min(span), max(span)) for span in spans]
        np.testing.assert_allclose(sorted(extents), contact_spans(times.numpy(), contact[:, point].numpy()))
        side = "left" if point < 2 else "right"
        assert to_hex(shades.get_facecolor()[0]).upper() == style.pale(style.SIDE_COLOURS[side], 0.88)


@pytest.mark.parametrize(
    ("touching", "spans"),
    [
        ([0, 0, 0, 0], []),
        ([1, 1, 1, 1], [(-0.05, 0.35)]),
        ([1, 0, 1, 1], [(-0.05, 0.05), (0.15, 0.35)]),
        ([0, 1, 0, 0], [(0.05, 0.15)]),
    ],
)
def test_spans_of_contact(touching: list[int], spans: list[tuple[float, float]]) -> None:
    found = contact_spans(np.array([0.0, 0.1, 0.2, 0.3]), np.array(touching, dtype=bool))
    assert len(found) == len(spans)
    np.testing.assert_allclose(np.array(found).reshape(-1, 2), np.array(spans).reshape(-1, 2), atol=1e-12)


def test_the_mean_speed_in_contact_stands_over_each_panel() -> None:
    times, contact, speeds, heights = walk()
    figure = drawn(feet_figure(times, NAMES, contact, speeds, heights))
    wanted = {"mean in contact:", "source 0.020 m/s", "edited 0.300 m/s", "cleaned 0.030 m/s"}
    for axes in figure.axes[::2]:
        assert {text.get_text() for text in axes.texts} == wanted
        boxes = [text.get_window_extent() for text in (*axes.texts, axes._left_title)]
        assert not any(a.overlaps(b) for i, a in enumerate(boxes) for b in boxes[:i])


def test_a_point_that_never_touches_says_so() -> None:
    times, contact, speeds, heights = walk()
    contact[:, 1] = False
    figure = drawn(feet_figure(times, NAMES, contact, speeds, heights))
    assert [text.get_text() for text in figure.axes[2].texts] == ["never in contact"]


def test_of_a_long_clip_only_contacts_are_drawn_on_a_wide_page() -> None:
    times, contact, speeds, heights = walk(93.0)
    figure = drawn(feet_figure(times, NAMES, contact, speeds, heights))
    assert len(figure.findobj()) < 1000
    assert figure.get_figwidth() == 24.0
    for axes, point in zip(figure.axes, np.repeat(range(4), 2), strict=True):
        for line in axes.lines:
            np.testing.assert_array_equal(np.isfinite(line.get_ydata()), contact[:, point])


@pytest.mark.parametrize("stages", [("source",), ("source", "edited"), ("source", "edited", "cleaned", "by hand")])
def test_any_stages_will_do(stages: tuple[str, ...]) -> None:
    times, contact, speeds, heights = walk()
    chosen = [{stage: tracks.get(stage, tracks["source"]) for stage in stages} for tracks in (speeds, heights)]
    figure = drawn(feet_figure(times.numpy(), NAMES, contact.numpy(), *chosen, title="Mine"))
    assert figure.get_suptitle() == "Mine"
    assert [text.get_text() for text in figure.legends[0].texts] == list(stages)
    assert len({to_hex(line.get_color()) for line in figure.axes[0].lines}) == len(stages)


@pytest.mark.parametrize(
    ("frames", "points", "message"), [(50, 4, "speeds of source"), (91, 3, "points"), (1, 4, "at least 2 frames")]
)
def test_sizes_that_do_not_fit(frames: int, points: int, message: str) -> None:
    times, contact, speeds, heights = walk()
    speeds = {stage: track[:frames, :points] for stage, track in speeds.items()}
    rows = slice(None) if frames > 1 else slice(1)
    with pytest.raises(HopdiffError, match=message):
        feet_figure(times[rows], NAMES, contact[rows], speeds, heights)
