"""What the study of exports measures with, on motions whose answer is known; these tests need no other program."""

from __future__ import annotations

import math
from pathlib import Path

import pytest
import torch

from hopdiff.export.glb import write_glb
from hopdiff.export.take import Take
from hopdiff.geometry.clip import Clip
from hopdiff.geometry.rotation import axis_rotation
from hopdiff.whole_body.skeleton import JOINTS, full_skeleton
from tests.builders import make_character

FPS = 20.0


def standing_body(frames: int, speed: float, height: float = 0.0) -> Take:
    """A stiff body that glides ahead, its toes at a height [m], at 20 frames/s."""
    skeleton = full_skeleton(make_character().skeleton)
    rotations = torch.eye(3, dtype=torch.float64).repeat(frames, len(JOINTS), 1, 1)
    clip = Clip(skeleton, torch.zeros(frames, 3, dtype=torch.float64), rotations, 1.0 / FPS)
    lowest = float(clip.joint_positions()[0, skeleton.index("left_toe"), 1])
    way = speed / FPS * torch.arange(frames, dtype=torch.float64)
    root = torch.stack((0.0 * way, 0.0 * way + height - lowest, way), dim=-1)
    return Take("glide", Clip(skeleton, root, rotations, 1.0 / FPS), False)


@pytest.mark.parametrize(("speed", "ratio"), [(0.0, 0.0), (0.49, 0.0), (1.0, 1.0)])
def test_a_foot_that_glides_on_the_ground_skates(speed: float, ratio: float) -> None:
    from experiments.exports.feet import skating_ratio

    assert skating_ratio(standing_body(41, speed)) == ratio


def test_a_short_slip_is_averaged_away_and_a_raised_foot_does_not_skate() -> None:
    from experiments.exports.feet import _skates

    feet = torch.zeros(41, 2, 3, dtype=torch.float64)
    feet[20:, 0, 2] = 0.1  # 2 m/s in one interval, 0.4 in the mean over five
    assert not _skates(feet.numpy()).any()
    feet[21:, 0, 2] = 0.2
    assert _skates(feet.numpy())[:, 0].sum() == 2
    # The other foot's ground counts for both.
    feet[:, 0, 1] = 0.06
    assert not _skates(feet.numpy()).any()


def test_points_that_stand_and_points_that_slip() -> None:
    from experiments.exports.feet import standing

    points = torch.zeros(6, 2, 3, dtype=torch.float64)
    points[3:, 1, 0] = 0.02
    points[4:, 1, 2] = 5.0
    points[..., 1] = 0.001
    contact = torch.ones(6, 2, dtype=torch.bool)
    contact[4:, 1] = False
    found = standing(points, contact, 0.1)
    assert found.drift == pytest.approx(0.02)
    assert found.fastest == pytest.approx(0.2)
    assert found.mean == pytest.approx(0.2 / 8)
    assert (found.lowest, found.highest) == (0.001, 0.001)


def test_the_seam_of_a_loop_is_as_smooth_as_what_repeats_itself() -> None:
    from experiments.exports.feet import seam

    # Nodding with a period of the clip: the largest change of velocity is wherever the phase puts it.
    frames = 41
    take = standing_body(frames, 3.0)
    phase = 2.0 * math.pi * torch.arange(frames, dtype=torch.float64) / (frames - 1)
    rotations = take.clip.rotations.clone()
    rotations[:, JOINTS.index("neck")] = axis_rotation("X", 0.3 * torch.sin(phase + 1.0))
    whole = Clip(take.clip.skeleton, take.clip.root_position, rotations, take.clip.frame_time)
    found = seam(whole)
    assert found.gap < 1e-12
    assert found.kink <= found.elsewhere * 1.01
    # A frame too few: the gap is what it would have gone in it.
    short = Clip(whole.skeleton, whole.root_position[:-1], rotations[:-1], whole.frame_time)
    assert seam(short).gap > 1e-3


def test_glb_files_are_read_back_as_they_were_written(tmp_path: Path) -> None:
    from experiments.exports.glb import read_glb

    frames = 12
    take = standing_body(frames, 2.0)
    rotations = take.clip.rotations.clone()
    rotations[:, 3] = axis_rotation("Y", torch.linspace(0.0, 2.0, frames, dtype=torch.float64))
    take = Take("turn", Clip(take.clip.skeleton, take.clip.root_position, rotations, 1.0 / 59.3), False)
    write_glb(tmp_path / "a.glb", [take])
    found = read_glb(tmp_path / "a.glb")["turn"]
    assert found.skeleton.names == take.clip.skeleton.names
    assert found.frame_time == pytest.approx(1.0 / 59.3, rel=1e-6)
    assert float((found.joint_positions() - take.clip.joint_positions()).abs().max()) < 1e-5
