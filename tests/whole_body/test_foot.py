"""The foot on the ground: it rolls without slipping, never sinks in, and stands on its sole."""

from __future__ import annotations

import math

import pytest
import torch
from torch import Tensor

from hopdiff.whole_body.foot import ROUND, pitch_course, sole
from tests.whole_body.bodies import DTYPE, NAMES, layout_of, solved

PITCHES = torch.linspace(-1.5, 0.9, 241, dtype=DTYPE)


def height_of(point: Tensor, pitch: Tensor) -> Tensor:
    """Of a point (3,) of the foot above the ankle, toes up."""
    return point[1] * pitch.cos() + point[2] * pitch.sin()


@pytest.mark.parametrize("name", ["human", "child", "cartoon"])
def test_neither_heel_nor_ball_sinks_into_the_ground(name: str) -> None:
    layout = layout_of(name)
    standing = sole(layout, PITCHES)
    size = float(layout.ball[2] - layout.heel[2])
    lowest = torch.minimum(*(standing.height + height_of(point, PITCHES) for point in (layout.heel, layout.ball)))
    assert float(lowest.min()) > -1e-12
    # The sole between its edges bulges by no more than its roundness, most where the foot is level.
    assert float(lowest.max()) <= ROUND * size * math.log(2.0) * 1.001
    level = sole(layout, torch.zeros(1, dtype=DTYPE))
    assert float(level.height) == pytest.approx(-float(layout.heel[1]) + ROUND * size * math.log(2.0))
    # Far from level it stands on an edge.
    assert float(lowest[0]) < 1e-6
    assert float(lowest[-1]) < 1e-6


def test_the_contact_is_where_rolling_puts_it() -> None:
    """Height and place of the contact belong together: dh = -ahead d(pitch)."""
    layout, step = layout_of(), 1e-6
    slope = (sole(layout, PITCHES + step).height - sole(layout, PITCHES - step).height) / (2.0 * step)
    torch.testing.assert_close(sole(layout, PITCHES).ahead, -slope, rtol=0.0, atol=1e-9)


def test_a_material_point_rests_while_it_is_the_contact() -> None:
    """Of a foot that rolls over its sole, from its height alone: the ankle moves by -h d(pitch)."""
    layout, step = layout_of(), 1e-5
    standing = sole(layout, PITCHES)
    # The contact in the axes of the foot, forward and up.
    c, s = PITCHES.cos(), PITCHES.sin()
    forward = standing.ahead * c - standing.height * s
    up = -standing.ahead * s - standing.height * c

    def place(shift: float) -> tuple[Tensor, Tensor]:
        """Where that point is, ahead of and above the contact, when the foot has turned on by `shift`."""
        pitch = PITCHES + shift
        middle = sole(layout, PITCHES + 0.5 * shift).height
        c, s = pitch.cos(), pitch.sin()
        return (
            -middle * shift + forward * c - up * s - standing.ahead,
            sole(layout, pitch).height + forward * s + up * c,
        )

    after, before = place(step), place(-step)
    for one, other in zip(after, before, strict=True):
        assert float(((one - other) / (2.0 * step)).abs().max()) < 1e-9
    # It is a point of the sole, between heel and ball, and rises both before and after.
    assert float(forward.min()) >= float(layout.heel[2]) - 1e-3
    assert float(forward.max()) <= float(layout.ball[2]) + 1e-3
    assert float(torch.minimum(after[1], before[1]).min()) > -1e-12


def test_the_course_of_the_pitch() -> None:
    def one(*values: float) -> Tensor:
        return torch.tensor(values, dtype=DTYPE)

    phase = torch.linspace(0.0, 1.0, 11, dtype=DTYPE).repeat(2, 1)
    given = one(0.2, -0.1), one(-0.6, -0.9), one(5.0, 3.0), one(30.0, 10.0), one(3.5, 2.5)
    found = pitch_course(phase, *given)
    for k in range(2):
        down, off, settle, slap, rise = (float(x[k]) for x in given)
        wanted = [down * math.exp(-settle * s - slap * s * s) + off * s**rise for s in phase[k].tolist()]
        assert found[k].tolist() == pytest.approx(wanted, abs=1e-12)
    assert float(found[0, 0]) == pytest.approx(0.2, abs=1e-12)
    assert float(found[0, -1]) == pytest.approx(-0.6, abs=1e-12)


@pytest.mark.parametrize("name", NAMES)
def test_standing_feet_of_a_movement_do_not_slip(name: str) -> None:
    """The point of the foot under the pressure is at rest, at every node of every contact."""
    movement, body, _ = solved(name)
    for k, footing in enumerate(movement.support.footings):
        ankle, pitch = body.carried.ankles[k], body.carried.pitches[k]
        standing = sole(movement.layout, pitch)
        rate, turning = footing.grid.derivative(ankle), footing.grid.derivative(pitch)
        # Toes up turns forward into up: a point at (ahead, -h) moves by turning * (h, ahead).
        ahead = rate[:, 2] + turning * standing.height
        up = rate[:, 1] + turning * standing.ahead
        assert float(turning.abs().max()) > 1.0
        assert float(ahead.abs().max()) < 2e-3
        assert float(up.abs().max()) < 2e-3
        assert float(rate[:, 0].abs().max()) < 1e-12
        torch.testing.assert_close(ankle[:, 1], standing.height)
