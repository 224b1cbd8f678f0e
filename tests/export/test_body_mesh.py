from __future__ import annotations

import numpy as np
import pytest
import torch

from hopdiff.export.body_mesh import body_mesh
from hopdiff.export.loft import Surface
from hopdiff.geometry.skeleton import Skeleton
from hopdiff.whole_body.skeleton import full_skeleton
from tests.builders import make_character
from tests.export.takes import WALKS, walked


def volume(surface: Surface) -> float:
    a, b, c = (surface.vertices[surface.faces[:, k]] for k in range(3))
    return float((a * np.cross(b, c)).sum() / 6.0)


def closed(surface: Surface) -> bool:
    """Whether every edge has a neighbour that runs the other way."""
    edges = np.concatenate([surface.faces[:, [k, (k + 1) % 3]] for k in range(3)])
    there = {tuple(edge) for edge in edges.tolist()}
    return all((b, a) in there for a, b in there) and len(there) == len(edges)


@pytest.mark.parametrize("name", ["human", "child", "cartoon"])
def test_bodies_weigh_what_they_should(name: str) -> None:
    body = make_character(name)
    masses = dict(zip(body.skeleton.names, body.masses.tolist(), strict=True))
    surfaces = body_mesh(full_skeleton(body.skeleton), masses)
    assert set(surfaces) == {"left", "right", "middle"}
    assert all(closed(one) for one in surfaces.values())
    # Parts reach into each other, so that together they hold a little more than the body.
    whole = 1000.0 * sum(volume(one) for one in surfaces.values())
    assert whole == pytest.approx(sum(masses.values()), rel=0.2)
    left, right = surfaces["left"], surfaces["right"]
    np.testing.assert_allclose(np.sort(left.vertices[:, 0]), np.sort(-right.vertices[:, 0]), atol=1e-9)
    assert bool((left.vertices[:, 0] > right.vertices[:, 0].min()).all())


def test_heavier_bodies_are_thicker() -> None:
    skeleton = full_skeleton(make_character().skeleton)
    names = make_character().skeleton.names
    thin, thick = (body_mesh(skeleton, dict.fromkeys(names, mass))["left"].vertices for mass in (3.0, 6.0))
    assert np.ptp(thick[:, 2]) > np.ptp(thin[:, 2])


@pytest.mark.parametrize("name", WALKS)
def test_people_have_one_around_their_bones(name: str) -> None:
    skeleton = walked(name).clip.skeleton
    surfaces = body_mesh(skeleton)
    straight = torch.eye(3, dtype=torch.float64).expand(1, len(skeleton.names), 3, 3)
    places = skeleton.forward(torch.zeros(1, 3).double(), straight)[0][0].numpy()
    points = np.concatenate([one.vertices for one in surfaces.values()])
    weights = np.concatenate([one.weights for one in surfaces.values()])
    assert all(closed(one) for one in surfaces.values())
    np.testing.assert_allclose(weights.sum(axis=-1), 1.0)
    for axis in range(3):
        assert points[:, axis].min() < places[:, axis].min() + 0.03
        assert points[:, axis].max() > places[:, axis].max() - 0.03
    height = np.ptp(points[:, 1])
    assert 1.3 < height < 2.1
    # A body, not a balloon.
    assert 25.0 < 1000.0 * sum(volume(one) for one in surfaces.values()) < 130.0


def test_skeletons_that_are_no_body_get_plain_bones() -> None:
    chain = Skeleton(
        ("a", "b", "c"),
        (-1, 0, 1),
        torch.tensor([[0.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 1.0, 0.5]]).double(),
        {"c": torch.tensor([0.0, 0.5, 0.0]).double()},
    )
    surfaces = body_mesh(chain)
    assert list(surfaces) == ["middle"]
    assert set(surfaces["middle"].joints[:, 0].tolist()) == {0, 1, 2}
