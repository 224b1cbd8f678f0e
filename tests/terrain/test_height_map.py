"""Heights on a grid."""

from __future__ import annotations

import torch

from hopdiff.terrain.height_map import HeightMap
from tests.terrain.grounds import bumps, scattered


def test_the_map_meets_its_nodes_and_is_bilinear_between_them() -> None:
    ground = HeightMap(torch.tensor([[0.0, 1.0, 4.0], [2.0, 3.0, 8.0]]).double(), 0.5, (1.0, -2.0))
    nodes = torch.tensor([[1.0, -2.0], [1.5, -2.0], [2.0, -1.5], [1.0, -1.5]])
    assert ground.height(nodes).tolist() == [0.0, 1.0, 8.0, 2.0]
    assert float(ground.height(torch.tensor([1.75, -1.75]))) == (1.0 + 4.0 + 3.0 + 8.0) / 4.0


def test_beyond_the_border_it_is_level_across_it() -> None:
    ground = bumps()
    inside = torch.tensor([[4.9, 0.33]]).double()
    assert torch.equal(ground.height(inside + torch.tensor([9.0, 0.0])), ground.height(inside + torch.tensor([0.1, 0])))
    assert ground.normal(inside + torch.tensor([9.0, 0.0]))[0, 0] == 0.0


def test_a_map_of_one_row_changes_in_one_direction() -> None:
    ground = HeightMap(torch.tensor([[0.0, 0.2, 0.4]]).double(), 1.0, (0.0, 0.0))
    place, _ = scattered(20)
    heights = ground.height(place)
    assert torch.allclose(heights, 0.2 * place[:, 0].clamp(0.0, 2.0))
    assert torch.isfinite(ground.normal(place)).all()
