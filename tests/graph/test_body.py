from __future__ import annotations

import math

import numpy as np
import pytest
import torch

from hopdiff.editing.root_path import root_path
from hopdiff.graph.body import body_of, deepest, depths, groups, hits, said_depth
from hopdiff.graph.scene import Scene, Wall
from hopdiff.graph.space import FreeSpace
from tests.graph.rooms import hall, rectangle
from tests.people import clip_of

HALF = 0.25


def test_a_body_placed_on_its_own_path_is_where_the_clip_is() -> None:
    clip = clip_of("wander")
    body = body_of(clip)
    placed = body.placed(root_path(clip))
    own = torch.cat([clip.joint_positions(), *(end[:, None] for end in clip.end_positions().values())], dim=1)
    np.testing.assert_allclose(placed.real, own[..., 2].numpy(), atol=1e-9)
    np.testing.assert_allclose(placed.imag, own[..., 0].numpy(), atol=1e-9)
    assert len(body.names) == placed.shape[1]
    # The root is a part of it, and the outline holds the farthest part.
    assert float(np.abs(body.parts[:, 0]).max()) < 1e-9
    assert set(np.round(np.abs(body.outline).max(axis=1) - 0.9 * body.reach, 9) >= 0) == {True}


def test_ways_out_lead_to_the_nearest_free_floor() -> None:
    scene = hall(6.0, 14.0, walls={"post": Wall((3.0, 4.0), (3.0, 6.0), 0.4)}, furniture={"box": rectangle(0, 8, 1, 1)})
    space = FreeSpace(scene, HALF)
    points = np.array([[5.0 + 2.9j, 5.0 + 3.19j], [10.0 + 3.0j, -0.3 + 2.0j], [8.5 + 0.9j, 5.0 + 1.0j]])
    out = space.way_out(points)
    expected = np.array([[-0.1j, 0.01j], [0.0, 0.3], [0.1j, 0.0]])
    np.testing.assert_allclose(out, expected, atol=1e-9)
    np.testing.assert_allclose(depths(space, points), np.abs(expected), atol=1e-9)


def test_bodies_are_pushed_by_their_deepest_part_or_their_middle() -> None:
    space = FreeSpace(hall(6.0, 14.0), HALF)
    roots = np.array([7.0 + 3.0j, 7.0 + 0.3j, 7.0 + 0.3j, 7.0 + 0.2j])
    parts = roots[:, None] + np.array([[0.0, 0.3j], [0.0, -0.34j], [0.0, -0.305j], [0.0, 0.1]])
    push = hits(space, roots, parts)
    # Free; a hand 4 cm in the wall; one that brushes it by half a centimetre; a middle 5 cm too near.
    np.testing.assert_allclose(push.imag, [0.0, 0.04, 0.0, 0.05], atol=3e-3)
    np.testing.assert_allclose(push.real, 0.0, atol=1e-9)


def test_frames_are_grouped_by_the_gaps_between_them() -> None:
    assert [group.tolist() for group in groups(np.array([1, 2, 4, 9, 10]), 2)] == [[1, 2, 4], [9, 10]]
    assert groups(np.array([], dtype=np.int64), 2) == []


def test_what_does_not_fit_is_named() -> None:
    space = FreeSpace(hall(6.0, 14.0, furniture={"box": rectangle(2.0, 2.0, 2.0, 2.0)}), 0.0)
    body = body_of(clip_of("wander"))
    deep = body.depth_at(space, (3.0, 3.0), 0.3)
    assert (deep > 0.9).all()
    said = said_depth(body, space, (3.0, 3.0), 0.3)
    assert said.endswith("cm inside furniture 'box'")
    assert float(said.split(" is ")[1].split()[0]) == pytest.approx(100.0 * deep.min(), abs=0.06)
    beside = body.depth_at(space, (4.1, 3.0), math.radians(90.0))
    assert 0.0 < beside.max() < 0.9


def test_the_deepest_part_is_told_with_its_frame_and_what_it_is_in() -> None:
    """Of a floor that ends 2 cm before the farthest place that any part gets to along x in some frames."""
    clip, here = clip_of("wander"), slice(100, 200)
    ends = {f"the end of {name}": end for name, end in clip.end_positions().items()}
    parts = dict(zip(clip.skeleton.names, clip.joint_positions().unbind(1), strict=True)) | ends
    far = torch.stack([place[:, 0] for place in parts.values()], dim=1)
    frame, part = divmod(int(far[here].argmax()), far.shape[1])
    edge = float(far[here].max()) - 0.02
    for thing, more in (("a wall", {}), ("furniture 'box'", {"furniture": {"box": rectangle(edge, -30.0, 5.0, 60.0)}})):
        wide = 60.0 if more else 30.0 + edge
        scene = Scene("hall", {"hall": rectangle(-30.0, -30.0, wide, 60.0)}, **more)
        found = deepest(clip, FreeSpace(scene, 0.0), here)
        assert found.depth == pytest.approx(0.02, abs=1e-6)
        assert (found.frame, found.part, found.thing) == (100 + frame, list(parts)[part], thing)
        assert deepest(clip, FreeSpace(scene, 0.0), slice(100, 100 + frame)).depth < 0.02
        assert deepest(clip, FreeSpace(scene, 0.0), slice(0, 0)).depth == 0.0
