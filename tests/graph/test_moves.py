from __future__ import annotations

import numpy as np
import pytest
import torch

from hopdiff.editing.root_path import root_path
from hopdiff.graph.blend import Piece, assemble
from hopdiff.graph.graph import MotionGraph, build_graph
from hopdiff.graph.moves import SAMPLES, moves_of, standing, stretches
from tests.graph.walkers import walker, wanderer


@pytest.fixture(scope="module")
def graph() -> MotionGraph:
    return build_graph([wanderer(), walker([(4.0, 20.0)], period=0.9713)])


def test_moves_show_what_the_assembled_clip_will_do(graph: MotionGraph) -> None:
    moves = moves_of(graph)
    assert (moves.transition >= 0).sum() > 100
    rng = np.random.default_rng(1)
    starts = np.repeat(np.arange(graph.frames), np.diff(moves.first))
    for move in rng.choice(len(moves.end), 60, replace=False).tolist():
        start, end, taken = int(starts[move]), int(moves.end[move]), int(moves.transition[move])
        if taken < 0:
            pieces = [Piece(start, end + 1, 0.0, 0j)]
        else:
            turn, shift = float(graph.turns[taken]), complex(graph.shifts[taken])
            leave = int(graph.sources[taken]) + graph.window
            pieces = [Piece(start, leave, 0.0, 0j), Piece(int(graph.targets[taken]), end + 1, turn, shift)]
        path = root_path(assemble(graph, pieces))
        assert path.frames == moves.frames[move] + 1
        passed = moves.passed[move]
        ground = torch.complex(path.place[:, 1], path.place[:, 0]).numpy()
        yaw = path.yaw.numpy()
        wanted = np.exp(-1j * yaw[0]) * (ground[passed] - ground[0])
        np.testing.assert_allclose(moves.place[move], wanted, atol=1e-9)
        # Rotations are blended as a whole, yaws by themselves.
        np.testing.assert_allclose(moves.yaw[move], yaw[passed] - yaw[0], atol=0.02)
        assert passed[-1] == moves.frames[move]
        assert len(passed) == SAMPLES


def test_every_transition_can_be_taken_from_its_own_frame(graph: MotionGraph) -> None:
    moves = moves_of(graph)
    starts = np.repeat(np.arange(graph.frames), np.diff(moves.first))
    taken = {(int(start), int(which)) for start, which in zip(starts, moves.transition, strict=True) if which >= 0}
    assert {(int(source), k) for k, source in enumerate(graph.sources)} <= taken
    # And from no frame after it, nor from far before.
    gaps = [int(graph.sources[which]) - start for start, which in taken]
    assert min(gaps) >= 0
    assert max(gaps) < stretches(graph)[0]


def test_a_clip_is_walked_to_its_last_frame_and_not_into_the_next(graph: MotionGraph) -> None:
    moves = moves_of(graph)
    plain = moves.transition < 0
    starts = np.repeat(np.arange(graph.frames), np.diff(moves.first))
    np.testing.assert_array_equal(graph.clip_of(starts[plain]), graph.clip_of(moves.end[plain]))
    for last in (graph.first[1:] - 1).tolist():
        assert last in moves.end[plain]
        assert last not in starts[plain]


def test_the_fastest_move_is_as_fast_as_the_walk() -> None:
    graph = build_graph([walker([(6.0, 0.0)], speed=1.2)])
    assert moves_of(graph).fastest == pytest.approx(1.2, abs=0.1)


def test_standing_frames_are_those_that_do_not_move() -> None:
    still, going = walker([(2.0, 0.0)], speed=0.0), walker([(3.0, 0.0)])
    graph = build_graph([still, going])
    found = standing(graph)
    assert found[: still.frames].all()
    assert not found[still.frames :].any()
