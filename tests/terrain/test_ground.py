"""What holds for the ground of every kind."""

from __future__ import annotations

import math

import pytest
import torch

from hopdiff.terrain.ground import Flat, Ground
from tests.terrain.grounds import AHEAD, BEHIND, every_kind, scattered, sole

KINDS = pytest.mark.parametrize(("name", "ground"), every_kind().items(), ids=list(every_kind()))


@KINDS
def test_only_flat_ground_says_so(name: str, ground: Ground) -> None:
    place, _ = scattered(1000)
    assert ground.flat == (name == "flat") == bool((ground.height(place) == 0.0).all())


@KINDS
def test_normals_are_those_of_the_heights(name: str, ground: Ground) -> None:
    place, _ = scattered(2000)
    step = 1e-6
    shifts = step * torch.tensor([[1.0, 0.0], [0.0, 1.0]], dtype=torch.float64)
    rise = torch.stack([(ground.height(place + s) - ground.height(place - s)) / (2.0 * step) for s in shifts], dim=-1)
    whole = torch.stack((-rise[:, 0], torch.ones(len(place)).double(), -rise[:, 1]), dim=-1)
    normal = ground.normal(place)
    assert (normal.norm(dim=-1) - 1.0).abs().max() < 1e-12
    assert (normal[:, 1] > 0.0).all()
    off = (normal - whole / whole.norm(dim=-1, keepdim=True)).norm(dim=-1)
    assert (off < 1e-6).double().mean() > 0.995  # all but places on an edge
    # A short sole lies as the ground does.
    small = ground.sole_normal(place, torch.zeros(len(place)), 1e-6, 1e-6)
    if name in ("flat", "slope"):
        assert ((small - normal).norm(dim=-1) < 1e-6).double().mean() > 0.95


@KINDS
def test_nothing_exceeds_the_height_over_a_place(name: str, ground: Ground) -> None:
    place, _ = scattered(500)
    for reach in (0.05, 0.3):
        over = ground.height_over(place, reach)
        highest = ground.height(place)
        for k in range(60):
            share, angle = math.sqrt((k % 6) / 5.0), 0.1 * k
            aside = reach * share * torch.tensor([math.sin(angle), math.cos(angle)], dtype=torch.float64)
            highest = torch.maximum(highest, ground.height(place + aside))
        assert (over - highest).min() > -1e-9
        if name != "map":
            # Not much higher than needed either: nowhere above what is a little farther away.
            assert over.max() <= ground.height(scattered(200_000, 1)[0]).max() + 1e-9
            assert (over - highest < 0.02).double().mean() > 0.9


@KINDS
def test_a_foot_that_was_moved_stands_on_one_tread(name: str, ground: Ground) -> None:
    place, heading = scattered(300)
    shift = ground.footing(place, heading, AHEAD, BEHIND)
    if name in ("flat", "map"):
        assert (shift == 0.0).all()
        return
    moved = shift.norm(dim=-1)
    assert 0.02 < moved.max() < 0.3
    assert (moved == 0.0).double().mean() > 0.3
    under = ground.height(sole(place + shift, heading))
    # Seen along a sole, the ground has no step and no bend.
    assert under.diff(dim=1).diff(dim=1).abs().max() < 2e-4
    before = ground.height(sole(place, heading)).diff(dim=1).diff(dim=1).abs().amax(dim=1)
    assert (before[moved > 0.06] > 2e-4).all()
    assert ground.footing(place + shift, heading, AHEAD, BEHIND).norm(dim=-1).max() < 1e-9


@KINDS
def test_the_mean_height_follows_without_steps(name: str, ground: Ground) -> None:
    way = torch.linspace(-4.0, 4.0, 1601, dtype=torch.float64)
    place = torch.stack((torch.full_like(way, 0.9), way), dim=-1)
    mean, own = ground.mean_height(place, 0.4), ground.height(place)
    jumps = name in ("stairs", "polygons")  # of 17 cm and more, of which a tenth may be left between two places
    assert mean.diff().abs().max() <= (0.03 if jumps else float(own.diff().abs().max()) + 1e-12)
    assert (mean - own).abs().max() < 0.2


@KINDS
def test_points_are_above_the_ground_below_them(name: str, ground: Ground) -> None:
    place, _ = scattered(50)
    points = torch.stack((place[:, 0], ground.height(place) + 0.3, place[:, 1]), dim=-1).reshape(5, 10, 3)
    assert (ground.above(points) - 0.3).abs().max() < 1e-12


def test_flat_ground_is_at_height_zero() -> None:
    ground, (place, _) = Flat(), scattered(10)
    assert (ground.height_over(place, 0.5) == 0.0).all()
    assert (ground.normal(place) == torch.tensor([0.0, 1.0, 0.0], dtype=torch.float64)).all()
