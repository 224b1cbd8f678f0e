"""Two steps of a limp as one stride."""

from __future__ import annotations

import torch
from torch import Tensor

from hopdiff.models.trajectory import JOINT_CHANNELS, LEG_CHANNELS, Trajectory, join_steps


def steps() -> Trajectory:
    """Left and right steps of two candidates, every number another."""
    generator = torch.Generator().manual_seed(0)

    def of(*shape: int) -> Tensor:
        return torch.rand(4, *shape, generator=generator, dtype=torch.float64)

    channels = len(JOINT_CHANNELS)
    return Trajectory(
        weights=of(6),
        angles=of(6, channels),
        accelerations=of(6, channels),
        rates_before=of(LEG_CHANNELS),
        rates_after=of(LEG_CHANNELS),
        balance_error=of(6, 2),
        com_height=of(6),
        foot_height=of(9, 2),
        leg_force=of(6),
        reach=of(),
        pelvis_tilt=of(),
        contact_time=of(),
        flight_time=of(),
        speed=of(),
        sway_stiffness=of(),
        solved=torch.tensor([True, True, True, False]),
    )


def test_a_stride_holds_both_steps_in_a_row() -> None:
    both = steps()
    side = torch.tensor([9.0, 0.01, 9.0, 9.0], dtype=torch.float64)
    stride = join_steps(both, side)
    for p in (0, 1):
        left, right = p, p + 2
        for name in ("weights", "angles", "accelerations", "rates_before", "rates_after", "balance_error"):
            values = getattr(both, name)
            assert torch.equal(getattr(stride, name)[p], torch.cat((values[left], values[right]))), name
        for name in ("com_height", "foot_height", "leg_force"):
            values = getattr(both, name)
            assert torch.equal(getattr(stride, name)[p], torch.cat((values[left], values[right]))), name
        for name in ("pelvis_tilt", "contact_time", "flight_time", "speed"):
            values = getattr(both, name)
            torch.testing.assert_close(getattr(stride, name)[p], 0.5 * (values[left] + values[right]), msg=name)
        assert float(stride.reach[p]) == max(float(both.reach[left]), float(both.reach[right]))
        worst = min(float(v[k]) for v in (both.sway_stiffness, side) for k in (left, right))
        assert float(stride.sway_stiffness[p]) == worst
        torch.testing.assert_close(stride.duration[p], both.duration[left] + both.duration[right])
    assert stride.solved.tolist() == [True, False]
    assert float(stride.sway_stiffness[1]) == 0.01


def test_the_legs_come_first_among_the_channels() -> None:
    """Connectivity compares hips and knees; every channel has an axis to turn about."""
    names = [name for name, _, _ in JOINT_CHANNELS]
    assert names[:LEG_CHANNELS] == ["left_thigh", "right_thigh", "left_knee", "right_knee"]
    assert len(set(names)) == len(names)
