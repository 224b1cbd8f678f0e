from __future__ import annotations

import math

import pytest
import torch

from hopdiff.editing.root_path import RootPath, path_of, root_path, steps_of, with_root_path
from hopdiff.geometry.rotation import axis_rotation
from tests.editing.walks import stride, walk


@pytest.mark.parametrize("bend", [0.0, 2.0, -9.0])
def test_steps_put_together_are_the_path(bend: float) -> None:
    path = walk(300, bend=bend)
    again = path_of(steps_of(path), path.place[0], path.yaw[0])
    assert (again.place - path.place).abs().max() < 1e-12
    assert (again.yaw - path.yaw).abs().max() < 1e-12


def test_steps_do_not_know_where_a_path_begins_and_faces() -> None:
    path = walk(bend=1.0)
    steps = steps_of(path)
    moved = path_of(steps, torch.tensor([5.0, -3.0], dtype=torch.float64), torch.tensor(2.0, dtype=torch.float64))
    assert (steps_of(moved) - steps).abs().max() < 1e-12


def test_a_step_to_the_left_of_one_who_faces_plus_x_goes_along_minus_z() -> None:
    place = torch.tensor([[0.0, 0.0], [0.0, -1.0]], dtype=torch.float64)
    path = RootPath(place, torch.full((2,), math.pi / 2, dtype=torch.float64))
    assert steps_of(path)[0].tolist() == pytest.approx([1.0, 0.0, 0.0])


def test_many_paths_at_once_are_each_of_them_alone() -> None:
    paths = [walk(bend=bend) for bend in (0.0, 1.0, -2.0)]
    place, yaw = torch.stack([p.place for p in paths]), torch.stack([p.yaw for p in paths])
    together = steps_of(RootPath(place, yaw))
    for one, path in zip(together, paths, strict=True):
        assert torch.equal(one, steps_of(path))
    again = path_of(together, place[:, 0], yaw[:, 0])
    assert (again.place - place).abs().max() < 1e-12


def test_the_yaw_of_a_leaning_root_is_where_it_faces() -> None:
    clip = stride()
    turn = axis_rotation("Y", torch.tensor(0.7, dtype=torch.float64))
    lean = axis_rotation("X", torch.tensor(0.4, dtype=torch.float64))
    rotations = clip.rotations.clone()
    rotations[:, 0] = turn @ lean
    leaning = type(clip)(clip.skeleton, clip.root_position, rotations, clip.frame_time)
    assert root_path(leaning).yaw.numpy() == pytest.approx(0.7, abs=1e-12)
    assert root_path(leaning, rest_yaw=0.2).yaw.numpy() == pytest.approx(0.9, abs=1e-12)


def test_a_clip_led_along_its_own_path_stays_what_it_is() -> None:
    clip = stride()
    path = root_path(clip)
    same = with_root_path(clip, path, path)
    assert (same.root_position - clip.root_position).abs().max() == 0.0
    assert (same.rotations - clip.rotations).abs().max() < 1e-12


def test_a_clip_led_along_another_path_keeps_its_pose_about_the_root() -> None:
    clip = stride()
    before = root_path(clip)
    turned = path_of(
        steps_of(before) + torch.tensor([0.0, 0.01, 0.02], dtype=torch.float64), before.place[0], before.yaw[0]
    )
    after = with_root_path(clip, before, turned)
    assert (root_path(after).place - turned.place).abs().max() < 1e-12
    assert (root_path(after).yaw - turned.yaw).abs().max() < 1e-9
    assert torch.equal(after.rotations[:, 1:], clip.rotations[:, 1:])
    assert torch.equal(after.root_position[:, 1], clip.root_position[:, 1])
    distances = [torch.cdist(c.joint_positions(), c.joint_positions()) for c in (clip, after)]
    assert (distances[0] - distances[1]).abs().max() < 1e-9
