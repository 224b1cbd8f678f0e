"""Frames in which clips go over into each other: found, and bound frames left alone."""

from __future__ import annotations

import pytest
import torch

from hopdiff.feet.prints import GroundMove
from hopdiff.joins.seams import FREE, moments, placed, seams
from hopdiff.types import HopdiffError
from tests.joins.neighbours import laid, rise, walk


@pytest.mark.parametrize("frame", [0, 7, 20])
def test_a_walk_that_was_cut_goes_on_where_it_was_cut(frame: int) -> None:
    whole = walk(6.0)
    rest = whole.part(slice(30, None))
    before = laid(whole.part(slice(0, 30 + frame + 1)), 70.0, 2.0, -3.0)
    begin, end = seams(rest, before, None)
    assert end is None
    assert begin is not None
    assert begin.frame == frame
    there = placed(rest, begin.move).joint_positions()[frame]
    assert (there - before.joint_positions()[-1]).norm(dim=-1).max() < 2e-3


def test_of_like_frames_those_between_which_the_walk_goes_as_far_as_it_shall() -> None:
    whole = walk(6.0)
    stride = 32
    before = whole.part(slice(0, 10))
    ways = {}
    for more in (0.0, 1.0):
        after = whole.part(slice(whole.frames - 8, None))
        after = placed(after, _ahead(more))
        begin, end = seams(whole, before, after)
        assert begin is not None
        assert end is not None
        ways[more] = end.frame - begin.frame
    assert ways[1.0] - ways[0.0] >= 0
    near = placed(whole.part(slice(whole.frames - 8, None)), _ahead(-1.3))
    begin, end = seams(whole, before, near)
    assert begin is not None
    assert end is not None
    assert ways[0.0] - (end.frame - begin.frame) > 0.5 * stride


def _ahead(metres: float) -> GroundMove:
    return GroundMove(torch.tensor(0.0, dtype=torch.float64), torch.tensor([0.0, metres], dtype=torch.float64))


def test_bound_frames_stay_in_the_walk_and_off_its_seams() -> None:
    clip = walk()
    room = round(FREE / clip.frame_time)
    begin, _ = seams(clip, rise(), None, [room + 2])
    assert begin is not None
    assert begin.frame <= 2
    with pytest.raises(HopdiffError, match=rf"^frame 3 is bound.*clip before: frame {room} or a later one may be\.$"):
        seams(clip, rise(), None, [3, 60])
    last = clip.frames - 1
    with pytest.raises(HopdiffError, match=rf"clip after: frame {last - room} or an earlier one may be\.$"):
        seams(clip, None, rise(), [60, last])


def test_how_joints_move_counts() -> None:
    """One who swings forwards is not like one who swings back, in the same pose."""
    clip = walk()
    back = clip.part(slice(0, 40))
    flipped = type(back)(back.skeleton, back.root_position.flip(0), back.rotations.flip(0), back.frame_time)
    same, other = moments(clip, torch.tensor([20])), moments(flipped, torch.tensor([19]))
    places = clip.joint_positions()[20] - flipped.joint_positions()[19]
    assert places.abs().max() < 1e-9
    half = same.ground.shape[1] // 2
    assert (same.ground[:, half:] + other.ground[:, half:]).abs().max() < 1e-9
    assert (same.ground[:, :half] - other.ground[:, :half]).abs().max() < 1e-9
    assert float(same.ground[:, half:].abs().max()) > 1e-3
