from __future__ import annotations

from dataclasses import replace

import pytest
import torch

from hopdiff.export.contact_events import contact_events
from hopdiff.export.full_body import full_body
from hopdiff.export.one_stride import one_stride
from hopdiff.export.pose import mirrored
from hopdiff.export.settings import RetargetSettings
from hopdiff.export.take import Take
from hopdiff.types import HopdiffError
from tests.export.takes import own, walked


@pytest.mark.parametrize("which", ["run", "mirrored", "full"])
def test_it_begins_with_the_left_foot_and_has_the_same_motion(which: str) -> None:
    take = {"run": own, "mirrored": lambda: mirrored(own()), "full": lambda: full_body(own())}[which]()
    stride = one_stride(take, 50)
    assert (stride.frames, stride.loop) == (51, True)
    assert stride.clip.duration == pytest.approx(take.clip.duration)
    before, after = contact_events(take), contact_events(stride)
    assert [event.name for event in after] == ["LeftDown", "LeftUp", "RightDown", "RightUp"]
    assert after[0].time == pytest.approx(0.0, abs=1e-3)
    phases = {event.name: event.phase for event in before}
    for event in after:
        assert event.phase == pytest.approx(phases[event.name], abs=0.005), event
    # The same poses, whenever they are: heights of all joints at the same phase of the stride.
    start = next(event.time for event in before if event.name == "LeftDown") / take.clip.frame_time
    heights = take.repeated(2).clip.joint_positions()[..., 1]
    at = start + torch.arange(51) * (take.frames - 1) / 50
    low = heights[at.floor().long()] * (1.0 - at % 1.0)[:, None] + heights[at.ceil().long()] * (at % 1.0)[:, None]
    torch.testing.assert_close(stride.clip.joint_positions()[..., 1], low, atol=5e-3, rtol=0)


def test_feet_stand_where_they_stood_from_where_the_way_begins() -> None:
    stride = one_stride(mirrored(own()), 64)
    assert stride.feet is not None
    assert stride.contact is not None
    assert stride.contact[0].tolist() == [True, False]
    assert float(stride.clip.root_position[:, 2].min()) > -0.2
    assert float(stride.clip.root_position[0, 2]) < 0.2
    for side in range(2):
        standing = stride.feet[stride.contact[:, side] & (torch.arange(65) < 60), side]
        assert float((standing - standing[0]).norm(dim=-1).max()) < 0.02


def test_of_several_strides_it_is_one_and_without_forces_it_begins_at_a_frame() -> None:
    one, three = one_stride(own(), 40), one_stride(own().repeated(3), 40)
    torch.testing.assert_close(three.clip.joint_positions(), one.clip.joint_positions(), atol=1e-6, rtol=0)
    assert three.loop
    plain = one_stride(replace(own(), leg_force=None), 40)
    assert next(event.time for event in contact_events(plain)) == 0.0
    torch.testing.assert_close(plain.clip.joint_positions(), one.clip.joint_positions(), atol=1e-6, rtol=0)


def test_what_has_no_stride_is_refused() -> None:
    with pytest.raises(HopdiffError, match=r"keys=32: walk is no loop"):
        one_stride(walked(), 32)
    with pytest.raises(HopdiffError, match=r"keys=32: run has no touchdown of the left foot"):
        one_stride(Take("run", own().clip, True), 32)
    with pytest.raises(HopdiffError, match=r"retarget.fps has no effect with retarget.keys"):
        RetargetSettings(keys=32, fps=30.0).check_clip("retarget")
    with pytest.raises(HopdiffError, match=r"retarget.keys must lie between"):
        RetargetSettings(keys=1).check_clip("retarget")
