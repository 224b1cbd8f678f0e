from __future__ import annotations

import math
from dataclasses import replace

import torch

from hopdiff.editing.root_path import root_path, with_root_path
from hopdiff.export.ground import ground_path
from hopdiff.export.prepare import in_place, with_ground_root
from hopdiff.export.take import Take
from tests.export.takes import own, walked


def bent(take: Take, turn: float) -> Take:
    """The take along an arc."""
    path = root_path(take.clip)
    share = torch.linspace(0.0, 1.0, take.frames, dtype=torch.float64)
    yaw = turn * share
    way = path.place - path.place[0]
    # Points of an arc of the same length.
    length = float(way[-1].norm())
    ahead = length / turn * torch.stack((1.0 - torch.cos(yaw), torch.sin(yaw)), dim=-1)
    sway = way[:, :1] * torch.stack((torch.cos(yaw), -torch.sin(yaw)), dim=-1)
    after = replace(path, place=ahead + sway, yaw=path.yaw + yaw)
    return replace(take, clip=with_root_path(take.clip, path, after), loop=False)


def test_one_stride_has_a_straight_way() -> None:
    take = own()
    path = ground_path(take)
    steps = path.place.diff(dim=0)
    torch.testing.assert_close(steps, steps[:1].expand_as(steps), atol=1e-9, rtol=0)
    torch.testing.assert_close(path.yaw, torch.zeros_like(path.yaw), atol=1e-6, rtol=0)
    travel = (take.clip.root_position[-1] - take.clip.root_position[0])[[0, 2]]
    torch.testing.assert_close(path.place[-1] - path.place[0], travel, atol=1e-9, rtol=0)


def test_sway_and_bounce_stay_on_the_spot() -> None:
    take = own()
    here = in_place(take)
    root = here.clip.root_position
    torch.testing.assert_close(root[-1], root[0], atol=1e-9, rtol=0)
    torch.testing.assert_close(root[:, 1], take.clip.root_position[:, 1])
    assert float(root[:, 2].abs().max()) < 0.15
    three = in_place(take.repeated(3))
    torch.testing.assert_close(three.clip.root_position[: take.frames], root, atol=1e-6, rtol=0)
    # Feet go with the body: seen from the pelvis they are where they were.
    assert here.feet is not None
    assert take.feet is not None
    torch.testing.assert_close(
        here.feet - root[:, None], take.feet - take.clip.root_position[:, None], atol=1e-9, rtol=0
    )


def test_turns_are_left_out_on_the_spot() -> None:
    take = bent(own().repeated(8), math.pi / 2)
    here = in_place(take)
    assert float(root_path(here.clip).yaw.abs().max()) < 0.15
    assert float(here.clip.root_position[:, [0, 2]].abs().max()) < 0.3
    slow = in_place(walked())
    assert float(slow.clip.root_position[:, [0, 2]].abs().max()) < 0.3


def test_the_root_on_the_ground_carries_the_way_and_nothing_else_moves() -> None:
    for take in (own(), own().repeated(4), bent(own().repeated(8), 1.0), walked()):
        grounded = with_ground_root(take, "root")
        assert grounded.clip.skeleton.names == ("root", *take.clip.skeleton.names)
        places = grounded.clip.joint_positions()
        torch.testing.assert_close(places[:, 1:], take.clip.joint_positions(), atol=1e-9, rtol=0)
        torch.testing.assert_close(places[:, 0, 1], torch.zeros(take.frames).double())
        ends, before = grounded.clip.end_positions(), take.clip.end_positions()
        for name in before:
            torch.testing.assert_close(ends[name], before[name], atol=1e-9, rtol=0)
        # Steady: its speed changes far less than the pelvis's.
        speed = places[:, 0, [0, 2]].diff(dim=0).norm(dim=-1)
        assert float(speed.std()) < 0.2 * float(speed.mean())
