from __future__ import annotations

import dataclasses
from collections.abc import Callable
from functools import partial

import numpy as np
import pytest
import torch

from hopdiff.geometry.clip import Clip
from hopdiff.geometry.skeleton import Skeleton
from hopdiff.graph.graph import MotionGraph, build_graph
from hopdiff.types import HopdiffError
from tests.counting import calls
from tests.graph.walkers import moved, walker, wanderer
from tests.people import clip_of


@pytest.fixture(scope="module")
def graph() -> MotionGraph:
    return build_graph([wanderer()])


def reached(graph: MotionGraph, frame: int) -> set[int]:
    """All frames that can be reached from one."""
    onward: dict[int, list[int]] = {}
    for leave, arrive in zip(graph.sources.tolist(), graph.arrivals().tolist(), strict=True):
        onward.setdefault(leave, []).append(arrive)
    ends = set((graph.first[1:] - 1).tolist())
    met, waiting = {frame}, [frame]
    while waiting:
        here = waiting.pop()
        for there in (*onward.get(here, []), *([] if here in ends else [here + 1])):
            if there not in met:
                met.add(there)
                waiting.append(there)
    return met


def test_transitions_lay_alike_windows_on_each_other(graph: MotionGraph) -> None:
    positions = graph.clips[0].joint_positions().numpy()
    ground = positions[..., 2] + 1j * positions[..., 0]
    assert len(graph.sources) > 100
    steps = np.arange(graph.window)
    there = np.exp(1j * graph.turns)[:, None, None] * ground[graph.targets[:, None] + steps]
    apart = ground[graph.sources[:, None] + steps] - there - graph.shifts[:, None, None]
    tall = positions[graph.sources[:, None] + steps, :, 1] - positions[graph.targets[:, None] + steps, :, 1]
    squared = (np.abs(apart) ** 2 + tall**2).mean(axis=(1, 2))
    np.testing.assert_allclose(np.sqrt(squared), graph.distances, atol=1e-7)
    assert graph.distances.max() < 0.06


def test_frames_a_window_apart_at_least_are_joined_both_ways(graph: MotionGraph) -> None:
    assert (np.abs(graph.sources - graph.targets) >= graph.window).all()
    assert (np.diff(graph.sources) >= 0).all()
    ends = zip(graph.sources.tolist(), graph.targets.tolist(), strict=True)
    pairs = dict(zip(ends, zip(graph.turns, graph.shifts, strict=True), strict=True))
    both = [(pair, pair[::-1]) for pair in pairs if pair[::-1] in pairs]
    assert len(both) > 0.8 * len(pairs)
    for there, back in both:
        (turn, shift), (other, shift_back) = pairs[there], pairs[back]
        assert np.exp(1j * (turn + other)) == pytest.approx(1.0)
        assert abs(np.exp(1j * other) * shift + shift_back) < 1e-9


def test_from_each_frame_of_the_largest_part_all_others_can_be_reached(graph: MotionGraph) -> None:
    kept = set(np.flatnonzero(graph.kept).tolist())
    assert len(kept) > 0.5 * graph.frames
    rng = np.random.default_rng(0)
    for frame in rng.choice(sorted(kept), 5).tolist():
        assert kept <= reached(graph, frame)
    assert graph.kept[graph.sources].all()
    assert graph.kept[graph.arrivals()].all()


def test_transitions_lead_from_clip_to_clip_and_windows_stay_inside() -> None:
    parts = [walker([(4.0, 0.0), (1.0, 50.0)]), moved(walker([(5.0, 0.0), (1.5, -50.0)]), 4.0, 1.0, 2.0)]
    graph = build_graph(parts)
    assert graph.frames == sum(part.frames for part in parts)
    a, b = graph.clip_of(graph.sources), graph.clip_of(graph.targets)
    assert {(0, 0), (0, 1), (1, 0), (1, 1)} == set(zip(a.tolist(), b.tolist(), strict=True))
    for start in (graph.sources, graph.targets):
        np.testing.assert_array_equal(graph.clip_of(start), graph.clip_of(start + graph.window - 1))


def test_a_walk_that_never_comes_back_has_no_transitions() -> None:
    # Each step is longer than the one before.
    clip = walker([(3.0, 0.0)])
    stretched = clip.root_position.clone()
    stretched[:, 2] += 0.5 * torch.linspace(0.0, 3.0, clip.frames, dtype=torch.float64) ** 3
    graph = build_graph([dataclasses.replace(clip, root_position=stretched)], threshold=0.005)
    assert len(graph.sources) == 0
    assert not graph.kept.any()
    assert graph.numbers()["graph_transitions"] == 0


def test_a_wider_threshold_joins_more(graph: MotionGraph) -> None:
    counts = [build_graph(list(graph.clips), threshold).numbers()["graph_transitions"] for threshold in (0.01, 0.03)]
    assert 0 < counts[0] < counts[1] < len(graph.sources)


def nan_clip() -> Clip:
    clip = walker()
    root = clip.root_position.clone()
    root[3, 1] = torch.nan
    return dataclasses.replace(clip, root_position=root)


def renamed() -> Clip:
    clip = walker()
    names = (*clip.skeleton.names[:-1], "hat")
    return dataclasses.replace(clip, skeleton=Skeleton(names, clip.skeleton.parents, clip.skeleton.offsets))


def telescope() -> Clip:
    clip = walker()
    return dataclasses.replace(clip, offsets=clip.skeleton.offsets.expand(clip.frames, -1, -1))


@pytest.mark.parametrize(
    ("clips", "said"),
    [
        (list, "needs at least one clip"),
        (lambda: [walker(), walker([(0.2, 0.0)])], "clip 2 has 6 frames, fewer than a window of 10"),
        (lambda: [walker(), nan_clip()], "clip 2 holds a number that is not finite"),
        (lambda: [walker(), renamed()], "clip 2 has other joints than clip 1"),
        (lambda: [walker(), walker(leg=0.8)], "clip 2 has another bone at joint 'left_foot'"),
        (lambda: [walker(), walker(frame_time=0.01)], "clip 2 has 0.01 s a frame, but clip 1 0.0333"),
        (lambda: [walker(), telescope()], "clip 2 and clip 1 differ in whether joints move"),
    ],
)
def test_clips_that_do_not_fit_are_told(clips: Callable[[], list[Clip]], said: str) -> None:
    with pytest.raises(HopdiffError, match=said):
        build_graph(clips())


@pytest.mark.parametrize("value", [0.0, -1.0, float("nan"), float("inf")])
@pytest.mark.parametrize("setting", ["threshold", "window"])
def test_settings_of_a_graph_are_checked(setting: str, value: float) -> None:
    with pytest.raises(HopdiffError, match=f"graph.{setting} must be a number"):
        build_graph([walker()], **{setting: value})


@pytest.mark.parametrize(
    ("name", "frames", "kept", "transitions"),
    [("wander", 1258, 0.9, 1500), ("wander_snu_93s_30hz", 2798, 0.98, 2000)],
)
def test_of_a_long_walk_nearly_all_is_kept(name: str, frames: int, kept: float, transitions: int) -> None:
    graph = build_graph([clip_of(name)])
    assert graph.frames == frames
    assert graph.kept.mean() > kept
    assert len(graph.sources) > transitions


def test_pairs_of_frames_are_compared_in_blocks_and_not_one_by_one() -> None:
    counts = []
    for seconds in (10.0, 20.0, 40.0):
        clip = walker([(seconds, 30.0)], period=0.9713)
        build_graph([clip])
        counts.append(calls(partial(build_graph, [clip])))
    # Sixteen times as many pairs.
    assert counts[-1] < 1.3 * counts[0]
