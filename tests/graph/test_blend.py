from __future__ import annotations

import cmath
import dataclasses
import math
from itertools import pairwise

import numpy as np
import pytest
import torch

from hopdiff.editing.root_path import root_path
from hopdiff.geometry.clip import Clip
from hopdiff.geometry.rotation import axis_rotation
from hopdiff.graph.blend import Piece, assemble, eased, slerp
from hopdiff.graph.graph import MotionGraph, build_graph
from hopdiff.types import HopdiffError
from tests.graph.walkers import angles_between, moved, walker, wanderer
from tests.people import clip_of


@pytest.fixture(scope="module")
def graph() -> MotionGraph:
    return build_graph([wanderer()])


def some_way(graph: MotionGraph, count: int, seed: int = 0) -> list[Piece]:
    """A walk over random transitions."""
    rng = np.random.default_rng(seed)
    frame, turn, shift = int(graph.sources[0]), 0.3, 1.0 + 2.0j
    pieces, start = [], frame
    for _ in range(count):
        low = np.searchsorted(graph.sources, frame)
        taken = int(min(low + rng.integers(0, 12), len(graph.sources) - 1))
        pieces.append(Piece(start, int(graph.sources[taken]) + graph.window, turn, shift))
        shift = shift + cmath.exp(1j * turn) * complex(graph.shifts[taken])
        turn += float(graph.turns[taken])
        start = int(graph.targets[taken])
        frame = int(graph.arrivals()[taken])
        if graph.sources[-1] < frame:
            break
    pieces.append(Piece(start, start + graph.window + 5, turn, shift))
    return pieces


def fastest(clip: Clip) -> tuple[float, float, float]:
    """Largest step of the root over the ground, turn of the body and turn of any joint from frame to frame."""
    path = root_path(clip)
    joints = angles_between(clip.rotations[:-1, 1:], clip.rotations[1:, 1:])
    return float(path.place.diff(dim=0).norm(dim=-1).max()), float(path.yaw.diff().abs().max()), float(joints.max())


def offsets(graph: MotionGraph, pieces: list[Piece]) -> tuple[float, float]:
    """How far the roots of two pieces are from each other along their overlaps, at most [m, rad]."""
    paths = [root_path(assemble(graph, [piece])) for piece in pieces]
    place = yaw = 0.0
    for before, after in pairwise(paths):
        apart = before.place[-graph.window :] - after.place[: graph.window]
        turn = torch.remainder(before.yaw[-graph.window :] - after.yaw[: graph.window] + math.pi, math.tau) - math.pi
        place, yaw = max(place, float(apart.norm(dim=-1).max())), max(yaw, float(turn.abs().max()))
    return place, yaw


def check_smooth(graph: MotionGraph, clip: Clip, pieces: list[Piece]) -> None:
    own = [fastest(source) for source in graph.clips]
    step, turn, joint = (max(one[k] for one in own) for k in range(3))
    place, yaw = offsets(graph, pieces)
    assert place < 0.15
    found = fastest(clip)
    # A blend is a mean of two walks, and closes what is between them with at most 1.5 times the mean speed.
    assert found[0] <= step + 1.5 * place / (graph.window - 1) + 1e-9
    assert found[1] <= turn + 1.6 * yaw / (graph.window - 1) + 1e-3
    assert found[2] <= 1.5 * joint
    assert clip.frames == sum(piece.frames for piece in pieces) - graph.window * (len(pieces) - 1)


def test_one_piece_is_the_source_moved(graph: MotionGraph) -> None:
    clip = assemble(graph, [Piece(20, 60, 0.7, 2.0 + 3.0j)])
    wanted = moved(graph.clips[0], 3.0, 2.0, 0.7)
    torch.testing.assert_close(clip.root_position, wanted.root_position[20:60])
    torch.testing.assert_close(clip.rotations, wanted.rotations[20:60])


def test_a_blend_starts_as_the_piece_that_ends_and_ends_as_the_one_that_begins(graph: MotionGraph) -> None:
    taken = int(np.argmax(graph.distances))
    source, target, window = int(graph.sources[taken]), int(graph.targets[taken]), graph.window
    first = Piece(source - min(5, source), source + window, 0.0, 0j)
    second = Piece(target, target + window + 4, float(graph.turns[taken]), complex(graph.shifts[taken]))
    clip = assemble(graph, [first, second])
    alone = assemble(graph, [first]), assemble(graph, [second])
    begin = first.frames - window
    for part in ("root_position", "rotations"):
        whole, before, after = (getattr(one, part) for one in (clip, *alone))
        torch.testing.assert_close(whole[: begin + 1], before[: begin + 1])
        torch.testing.assert_close(whole[begin + window - 1 :], after[window - 1 :])
        # In between it is neither.
        assert float((whole[begin + 4] - before[begin + 4]).abs().max()) > 1e-6
        assert float((whole[begin + 4] - after[4]).abs().max()) > 1e-6


@pytest.mark.parametrize("seed", range(4))
def test_a_way_over_transitions_has_no_jumps(graph: MotionGraph, seed: int) -> None:
    pieces = some_way(graph, 8, seed)
    assert len(pieces) >= 4
    check_smooth(graph, assemble(graph, pieces), pieces)


@pytest.mark.parametrize("name", ["wander", "wander_snu_93s_30hz"])
def test_people_s_walks_are_blended_without_jumps(name: str) -> None:
    graph = build_graph([clip_of(name)])
    for seed in range(3):
        pieces = some_way(graph, 12, seed)
        check_smooth(graph, assemble(graph, pieces), pieces)


def test_pieces_come_from_several_clips_and_keep_joints_that_move() -> None:
    parts = [walker([(4.0, 0.0)]), walker([(5.0, 0.0)], start=(1.0, 2.0, 0.5))]
    longer = [part.skeleton.offsets * torch.linspace(1.0, 1.1, part.frames).double()[:, None, None] for part in parts]
    parts = [dataclasses.replace(part, offsets=one) for part, one in zip(parts, longer, strict=True)]
    graph = build_graph(parts, threshold=0.2)
    across = np.flatnonzero(graph.clip_of(graph.sources) != graph.clip_of(graph.targets))
    taken = int(across[len(across) // 2])
    source, target = int(graph.sources[taken]), int(graph.targets[taken])
    pieces = [
        Piece(source, source + graph.window, 0.0, 0j),
        Piece(target, target + graph.window, float(graph.turns[taken]), complex(graph.shifts[taken])),
    ]
    clip = assemble(graph, pieces)
    assert clip.offsets is not None
    frames = torch.cat(longer)
    a, b = frames[source], frames[target + graph.window - 1]
    torch.testing.assert_close(clip.offsets[0], a)
    torch.testing.assert_close(clip.offsets[-1], b)


def test_slerp_takes_the_shorter_arc_at_an_even_pace() -> None:
    start = axis_rotation("X", torch.tensor([0.2, -2.9], dtype=torch.float64))
    end = axis_rotation("X", torch.tensor([1.0, 2.9], dtype=torch.float64))
    middle = slerp(start, end, torch.tensor([0.25, 0.5], dtype=torch.float64))
    wanted = axis_rotation("X", torch.tensor([0.4, math.pi], dtype=torch.float64))
    torch.testing.assert_close(middle, wanted)


def test_weights_of_a_blend_start_and_end_without_slope() -> None:
    weight = eased(np.linspace(0.0, 1.0, 1001))
    assert weight[0] == 0.0
    assert weight[-1] == 1.0
    slope = np.gradient(weight, 1e-3)
    assert slope[[0, -1]].max() < 2e-2
    assert slope.min() >= 0.0
    assert slope.max() == pytest.approx(1.5, abs=1e-3)


@pytest.mark.parametrize(
    ("pieces", "said"),
    [
        ([], "needs at least one piece"),
        ([Piece(-1, 20, 0.0, 0j)], "piece 1: frames -1 to 19 are not frames of one clip"),
        ([Piece(10, 10, 0.0, 0j)], "piece 1: frames 10 to 9 are not frames"),
        ([Piece(0, 100_000, 0.0, 0j)], "piece 1: frames 0 to 99999"),
        ([Piece(0, 20, 0.0, 0j), Piece(5, 9, 0.0, 0j)], "piece 2 has 4 frames, but its blends of 10 frames need 9"),
    ],
)
def test_pieces_that_do_not_fit_are_told(graph: MotionGraph, pieces: list[Piece], said: str) -> None:
    with pytest.raises(HopdiffError, match=said):
        assemble(graph, pieces)


def test_a_piece_may_not_run_from_one_clip_into_the_next() -> None:
    graph = build_graph([walker([(3.0, 0.0)]), walker([(4.0, 0.0)])])
    with pytest.raises(HopdiffError, match="piece 1: frames 80 to 99 are not frames of one clip"):
        assemble(graph, [Piece(80, 100, 0.0, 0j)])
