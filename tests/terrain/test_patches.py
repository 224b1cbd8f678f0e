"""Patches that lie on each other."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch

from hopdiff.terrain.ground import HALF_WIDTH
from hopdiff.terrain.patches import FARTHEST, Patch, Patches, plane_through
from hopdiff.terrain.profile import stairs
from tests.terrain.grounds import AHEAD, BEHIND, box, ramp, scattered


def heights(ground: Patches, *places: tuple[float, float]) -> list[float]:
    found: list[float] = ground.height(torch.tensor(places, dtype=torch.float64)).tolist()
    return found


def test_the_later_patch_lies_on_top() -> None:
    low, high = Patch(box(0, 0, 2, 2), (0.1, 0, 0)), Patch(box(1, 1, 3, 3), (0.5, 0, 0))
    where = ((0.5, 0.5), (1.5, 1.5), (2.5, 2.5), (5.0, 5.0))
    assert heights(Patches([low, high]), *where) == [0.1, 0.5, 0.5, 0.0]
    assert heights(Patches([high, low]), *where) == [0.1, 0.1, 0.5, 0.0]


def test_a_patch_may_be_a_plane_through_three_corners() -> None:
    corners = [[0.0, 0.1, 0.0], [2.0, 0.5, 0.0], [0.0, 0.2, 1.0]]
    ground = Patches([Patch(box(0, 0, 2, 1), plane_through(corners))])
    assert heights(ground, *((x, z) for x, _, z in corners)) == pytest.approx([y for _, y, _ in corners])
    with pytest.raises(ValueError, match="one line"):
        plane_through([[0, 0, 0], [1, 1, 1], [2, 5, 2]])


def test_only_steps_and_bends_are_edges() -> None:
    edges = ramp().edges
    middles = {tuple(np.round(edge.mean(axis=0), 3)) for edge in edges}
    length = np.hypot(*(edges[:, 1] - edges[:, 0]).T)
    # The ramp's foot and top bend by 8.5 degrees; the middle of the platform, under the kerb's outline, is none.
    assert {(1.0, 0.0), (0.0, 1.0), (2.0, 1.0), (0.0, 3.0), (1.0, 3.5), (1.5, 3.0)} <= middles
    ramp_and_platform, kerb, pit = 4 * 2 + 2 + 2 + 2, 1 + 1, 4
    assert math.isclose(length.sum(), ramp_and_platform + kerb + pit)
    gentle = Patches([Patch(box(0, 0, 2, 2), (0.005, 0.0, 0.0)), Patch(box(4, 0, 6, 2), (0.0, 0.0, 0.0))])
    assert len(gentle.edges) == 0


def test_soles_keep_their_width_off_edges() -> None:
    ground = Patches([Patch(box(0, -9, 9, 9), (0.2, 0, 0))])
    shift = ground.footing(torch.tensor([[0.01, 0.0], [-0.01, 0.0]]), torch.zeros(2), AHEAD, BEHIND)
    assert shift[:, 0].tolist() == pytest.approx([HALF_WIDTH - 0.01, 0.01 - HALF_WIDTH], abs=1e-6)
    assert shift[:, 1].abs().max() < 1e-6


def test_treads_of_patches_are_those_of_stairs() -> None:
    steps = stairs(0.17, 0.4, 0.0, (0.0, 0.0), 5)
    treads = Patches([Patch(box(-9, 0.4 * k, 9, 9), (0.17 * (k + 1), 0, 0)) for k in range(5)])
    place, heading = scattered(200)
    assert torch.allclose(treads.height(place), steps.height(place))
    ours, theirs = treads.footing(place, heading, AHEAD, BEHIND), steps.footing(place, heading, AHEAD, BEHIND)
    assert (ours - theirs).norm(dim=-1).quantile(0.9) < 0.05


def test_a_tread_shorter_than_a_sole_is_stepped_on_all_the_same() -> None:
    treads = Patches([Patch(box(-9, 0.2 * k, 9, 9), (0.17 * (k + 1), 0, 0)) for k in range(40)])
    place = torch.stack((torch.zeros(30), torch.linspace(3.0, 4.0, 30)), dim=-1).double()
    shift = treads.footing(place, torch.zeros(30), AHEAD, BEHIND)
    assert shift.norm(dim=-1).max() <= FARTHEST
    assert shift.norm(dim=-1).max() > 0.02


def test_ground_without_patches_has_no_edges() -> None:
    assert Patches([]).edges.shape == (0, 2, 2)
    assert heights(Patches([]), (1.0, 2.0)) == [0.0]
