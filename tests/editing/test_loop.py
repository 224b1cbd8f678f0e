"""Strides laid end to end."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch

from hopdiff.editing.loop import is_loop, repeated
from hopdiff.editing.root_path import root_path, with_root_path
from hopdiff.editing.targets import Constraint, edit_path
from hopdiff.geometry.clip import Clip
from tests.editing.walks import stride
from tests.people import clip_of


def part(clip: Clip, frames: int) -> Clip:
    return replace(clip, root_position=clip.root_position[:frames], rotations=clip.rotations[:frames])


def test_a_stride_of_our_own_is_a_loop_and_a_part_of_it_is_not() -> None:
    clip = stride()
    assert is_loop(clip)
    assert not is_loop(part(clip, clip.frames - 4))
    assert not is_loop(part(clip, 2))


@pytest.mark.parametrize("name", ["walk with a turn", "walk_turn_left90_cmu_16_17"])
def test_a_walk_between_two_stands_is_no_loop(name: str) -> None:
    assert not is_loop(clip_of(name))


@pytest.mark.parametrize("count", [1, 2, 7])
def test_repetitions_go_on_where_the_one_before_ended(count: int) -> None:
    clip = stride()
    long = repeated(clip, count)
    assert long.frames == count * (clip.frames - 1) + 1
    way = clip.root_position[-1] - clip.root_position[0]
    assert (long.root_position[-1] - long.root_position[0] - count * way).abs().max() < 1e-3
    moved = long.joint_positions().diff(dim=0).norm(dim=-1)
    assert float(moved.max()) < 1.01 * float(clip.joint_positions().diff(dim=0).norm(dim=-1).max())


def test_a_loop_in_a_bend_goes_round() -> None:
    clip = stride()
    path = root_path(clip)
    bent = edit_path(path, [Constraint(clip.frames - 1, None, float(path.yaw[-1]) + 0.5)], clip.frame_time)
    turned = with_root_path(clip, path, bent.path)
    long = root_path(repeated(turned, 6))
    assert float(long.yaw[-1] - long.yaw[0]) == pytest.approx(3.0, abs=1e-3)
    steps = long.place.diff(dim=0).norm(dim=-1)
    assert torch.isfinite(steps).all()
    assert float(steps.max()) < 1.05 * float(bent.path.place.diff(dim=0).norm(dim=-1).max())
