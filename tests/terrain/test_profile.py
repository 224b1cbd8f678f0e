"""Slopes and stairs against what a carpenter would say."""

from __future__ import annotations

import math

import pytest
import torch
from torch import Tensor

from hopdiff.terrain.ground import direction
from hopdiff.terrain.profile import EDGE, Profile, slope, stairs


def along(ground: Profile, way: list[float]) -> Tensor:
    """Places on the middle line of a ground."""
    ahead = direction(torch.tensor(ground.heading))
    return torch.tensor(ground.start) + torch.tensor(way, dtype=torch.float64)[:, None] * ahead


def test_a_slope_rises_from_its_start_to_its_end() -> None:
    ground = slope(math.radians(20.0), math.radians(30.0), (1.0, 2.0), 3.0)
    steep = math.tan(math.radians(20.0))
    heights = ground.height(along(ground, [-5.0, 0.0, 1.0, 3.0, 10.0]))
    assert torch.allclose(heights, torch.tensor([0.0, 0.0, steep, 3.0 * steep, 3.0 * steep]).double(), atol=1e-12)
    normal = ground.normal(along(ground, [1.0]))[0]
    assert math.degrees(math.acos(float(normal[1]))) == pytest.approx(20.0)
    assert math.degrees(math.atan2(-float(normal[0]), -float(normal[2]))) == pytest.approx(30.0)


def test_a_slope_without_length_never_ends_and_a_negative_angle_goes_down() -> None:
    ground = slope(math.radians(-5.0), 0.0, (0.0, 0.0))
    assert float(ground.height(torch.tensor([7.0, 1000.0]))) == pytest.approx(-1000.0 * math.tan(math.radians(5.0)))


def test_the_height_over_a_place_looks_back_too() -> None:
    down = slope(math.radians(-20.0), 0.0, (0.0, 0.0))
    over = down.height_over(along(down, [-1.0, 0.1, 1.0]), 0.5)
    assert over.tolist() == pytest.approx([0.0, 0.0, -0.5 * math.tan(math.radians(20.0))])


def test_stairs_have_their_treads() -> None:
    ground = stairs(0.17, 0.29, math.radians(90.0), (0.0, 1.0), 3)
    x = torch.tensor([-0.01, 0.01, 0.28, 0.30, 0.57, 0.59, 5.0]).double()
    heights = ground.height(torch.stack((x, torch.full_like(x, -4.0)), dim=-1))
    assert torch.allclose(heights, 0.17 * torch.tensor([0.0, 1.0, 1.0, 2.0, 2.0, 3.0, 3.0]).double())


@pytest.mark.parametrize("rise", [0.17, -0.17])
@pytest.mark.parametrize("facing", [0.0, math.pi])
def test_a_sole_longer_than_a_tread_overhangs_the_lower_side(rise: float, facing: float) -> None:
    ground = stairs(rise, 0.2, 0.0, (0.0, 0.0), 6)
    ahead, behind = 0.15, 0.1
    place = torch.stack((torch.zeros(40), torch.linspace(0.3, 0.9, 40)), dim=-1).double()
    turned = torch.full((40,), facing).double()
    shift = ground.footing(place, turned, ahead, behind)
    ends = torch.stack((place + shift + ahead * direction(turned), place + shift - behind * direction(turned)))
    low, high = ends[..., 1].amin(0), ends[..., 1].amax(0)
    # The end on the higher side is a finger's breadth off the riser.
    upper = high if rise > 0 else low
    off = upper / 0.2 - (upper / 0.2).round()
    assert (off + math.copysign(EDGE / 0.2, rise)).abs().max() < 1e-9
    assert shift.norm(dim=-1).max() <= 0.1 + 1e-9


def test_a_sole_across_the_stairs_needs_only_its_own_line() -> None:
    ground = stairs(0.17, 0.29, 0.0, (0.0, 0.0), 6)
    shift = ground.footing(torch.tensor([[0.0, 0.295], [0.0, 0.4]]), torch.tensor([math.pi / 2.0] * 2), 0.15, 0.1)
    assert shift[0].tolist() == pytest.approx([0.0, EDGE - 0.005], abs=1e-6)
    assert (shift[1] == 0.0).all()


def test_a_gentle_bend_is_walked_over() -> None:
    place, heading = torch.tensor([[0.0, 0.0]]), torch.tensor([0.0])
    assert (slope(math.radians(4.0), 0.0, (0.0, 0.0)).footing(place, heading, 0.15, 0.1) == 0.0).all()
    assert float(slope(math.radians(8.0), 0.0, (0.0, 0.0)).footing(place, heading, 0.15, 0.1).norm()) > 0.05
