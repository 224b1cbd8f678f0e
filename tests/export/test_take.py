from __future__ import annotations

from dataclasses import replace

import pytest
import torch

from hopdiff.editing.loop import is_loop
from hopdiff.export.take import Take
from hopdiff.geometry.rotation import axis_rotation
from hopdiff.types import HopdiffError
from tests.editing.walks import stride_motion
from tests.export.takes import own, walked


def test_a_run_of_our_own_is_taken_with_all_that_is_known_of_it() -> None:
    take, motion = own(), stride_motion()
    assert take.loop
    assert take.clip.offsets is None
    torch.testing.assert_close(take.clip.joint_positions(), motion.clip.joint_positions().double())
    assert take.contact is not None
    assert bool((take.contact == motion.contact).all())
    assert take.masses is not None
    assert sum(take.masses.values()) == pytest.approx(70.0)
    assert take.leg_force is not None
    assert float(take.leg_force.max()) == pytest.approx(float(motion.leg_force.max()) * 70.0 * 9.81, rel=1e-3)


def test_contacts_of_walks_are_found() -> None:
    take = walked()
    assert not take.loop
    assert take.contact is not None
    assert take.feet is not None
    assert 0.4 < float(take.contact.double().mean()) < 0.8
    standing = take.contact[1:] & take.contact[:-1]
    moved = take.feet[..., [0, 2]].diff(dim=0).norm(dim=-1)
    assert float(moved[standing].mean()) < 0.3 * float(moved[~standing].mean())


def test_repetitions_go_on_where_the_last_one_ended() -> None:
    take = own()
    three = take.repeated(3)
    assert three.frames == 3 * (take.frames - 1) + 1
    travel = take.clip.root_position[-1] - take.clip.root_position[0]
    for entry in ("com", "feet"):
        before, after = getattr(take, entry), getattr(three, entry)
        shift = travel * torch.tensor([1.0, 0.0, 1.0])
        torch.testing.assert_close(after[take.frames : 2 * take.frames - 1], before[1:] + shift, atol=1e-6, rtol=0)
    assert three.contact is not None
    assert take.contact is not None
    assert bool((three.contact[: take.frames] == take.contact).all())
    assert take.repeated(1) is take


def test_what_is_no_loop_is_not_repeated() -> None:
    with pytest.raises(HopdiffError, match="cycles=2: run is no loop"):
        replace(own(), loop=False).repeated(2)
    with pytest.raises(HopdiffError, match="makes more than"):
        own().repeated(10_000_000)


def test_a_motion_that_ends_almost_as_it_began_is_no_loop() -> None:
    """Standing feet would slip where it goes on."""
    take = own()
    rotations = take.clip.rotations.clone()
    knee = take.clip.skeleton.index("left_knee")
    rotations[-1, knee] = rotations[-1, knee] @ axis_rotation("X", torch.tensor(0.01, dtype=torch.float64))
    bent = replace(take.clip, rotations=rotations)
    assert is_loop(bent)
    assert Take.of_clip("bent", take.clip, {}).loop
    assert not Take.of_clip("bent", bent, {}).loop


@pytest.mark.parametrize("fps", [24.0, 30.0, 60.0, 120.0])
def test_other_frame_rates_keep_the_speed(fps: float) -> None:
    take = own()
    whole, exact = take.resampled(fps, exact=False), take.resampled(fps, exact=True)
    assert whole.clip.duration == pytest.approx(take.clip.duration, abs=1e-12)
    torch.testing.assert_close(whole.clip.rotations[-1], take.clip.rotations[-1], atol=1e-9, rtol=0)
    torch.testing.assert_close(whole.clip.root_position[-1], take.clip.root_position[-1], atol=1e-9, rtol=0)
    assert exact.clip.frame_time == 1.0 / fps
    assert 0.0 <= take.clip.duration - exact.clip.duration < 1.0 / fps
    for one in (whole, exact):
        way = one.clip.root_position[-1, 2] - one.clip.root_position[0, 2]
        assert float(way) / one.clip.duration == pytest.approx(3.0, rel=0.02)


def test_frames_between_others_lie_between_them() -> None:
    take = own()
    twice = take.resampled(2.0 / take.clip.frame_time, exact=False)
    torch.testing.assert_close(twice.clip.rotations[::2], take.clip.rotations, atol=1e-9, rtol=0)
    fine, coarse = twice.clip.joint_positions(), take.clip.joint_positions()
    torch.testing.assert_close(fine[::2], coarse, atol=1e-9, rtol=0)
    # Arcs, not chords: between two frames a joint is off the middle by no more than their curvature makes it.
    assert float((fine[1::2] - 0.5 * (coarse[1:] + coarse[:-1])).norm(dim=-1).max()) < 0.03
    assert take.resampled(1.0 / take.clip.frame_time, exact=False) is take


def test_too_many_frames_are_refused() -> None:
    with pytest.raises(HopdiffError, match="fps=1e\\+09 makes more than"):
        own().resampled(1e9, exact=True)


def test_joints_that_hardly_move_are_fixed() -> None:
    clip = own().clip
    noise = 1e-4 * torch.sin(torch.arange(clip.frames).double())[:, None, None]
    offsets = clip.skeleton.offsets + noise * torch.ones(1, len(clip.skeleton.names), 3)
    assert Take.of_clip("a", replace(clip, offsets=offsets), {}).clip.offsets is None
    assert Take.of_clip("a", replace(clip, offsets=offsets + 100.0 * noise), {}).clip.offsets is not None


def test_too_few_frames_of_a_loop_are_refused() -> None:
    """First and last frame are one: of a stride in two frames nothing would move."""
    take = own()
    with pytest.raises(HopdiffError, match=r"fps=1 is too low for the loop \w.* at least (\d+)\.") as caught:
        take.resampled(1.0, exact=False)
    told = float(str(caught.value).split()[-1].rstrip("."))
    assert take.resampled(told, exact=True).frames > 4
