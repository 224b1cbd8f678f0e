from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from hopdiff.export.body.loft import joined
from hopdiff.export.body_mesh import body_mesh
from hopdiff.export.full_body import full_body
from hopdiff.export.skinning import joint_matrices, skinned, skinned_normals
from tests.export.takes import own, walked


def rest_places(offsets: np.ndarray, parents: tuple[int, ...]) -> np.ndarray:
    places = np.zeros_like(offsets)
    for joint, parent in enumerate(parents[1:], start=1):
        places[joint] = places[parent] + offsets[joint]
    return places


@pytest.mark.parametrize("which", ["own", "walk", "stretched"])
def test_a_vertex_of_one_joint_goes_where_that_joint_goes(which: str) -> None:
    take = walked() if which == "walk" else full_body(own())
    clip = take.clip
    if which == "stretched":
        clip = replace(clip, offsets=clip.skeleton.offsets.expand(take.frames, -1, -1) * 1.1)
    count = len(clip.skeleton.names)
    rest = rest_places(clip.skeleton.offsets.numpy(), clip.skeleton.parents)
    aside = np.random.default_rng(0).normal(size=(count, 3))
    joints, weights = np.tile(np.arange(count)[:, None], (1, 2)), np.full((count, 2), 0.5)
    found = skinned(rest + aside, joints, weights, joint_matrices(clip))
    places, turns = (values.numpy() for values in clip.forward())
    for joint in range(count):
        wanted = places[:, joint] + Rotation.from_matrix(turns[:, joint]).apply(aside[joint])
        np.testing.assert_allclose(found[:, joint], wanted, atol=1e-9)


def test_between_two_joints_it_lies_between_where_they_take_it() -> None:
    matrices = joint_matrices(full_body(own()).clip)[:3]
    point = np.array([[0.1, 0.2, 0.3]])
    a, b, between = (
        skinned(point, np.array([[3, 7]]), np.array([shares]), matrices) for shares in ((1, 0), (0, 1), (0.3, 0.7))
    )
    assert np.abs(a - b).max() > 0.01
    np.testing.assert_allclose(between, 0.3 * a + 0.7 * b, atol=1e-12)


def test_normals_stand_on_the_moved_surface() -> None:
    """Those of a surface's own triangles, as they lie after the move, up to what blending bends."""
    take = full_body(own())
    surface = joined(list(body_mesh(take.clip.skeleton, take.masses).values()))
    matrices = joint_matrices(take.clip)[[0, 10]]
    bound = (surface.joints, surface.weights)
    points, normals = skinned(surface.vertices, *bound, matrices), skinned_normals(surface.normals, *bound, matrices)
    np.testing.assert_allclose(np.linalg.norm(normals, axis=-1), 1.0, atol=1e-9)
    corners = points[:, surface.faces]
    flat = np.cross(corners[:, :, 1] - corners[:, :, 0], corners[:, :, 2] - corners[:, :, 0])
    flat /= np.linalg.norm(flat, axis=-1, keepdims=True).clip(1e-15)
    alike = (flat * normals[:, surface.faces].mean(axis=2)).sum(axis=-1)
    assert np.quantile(alike, 0.02) > 0.5


def test_one_frame_of_rest_changes_nothing() -> None:
    skeleton = full_body(own()).clip.skeleton
    straight = torch.eye(3, dtype=torch.float64).expand(1, len(skeleton.names), 3, 3)
    clip = replace(own().clip, skeleton=skeleton, root_position=torch.zeros(1, 3).double(), rotations=straight)
    surface = joined(list(body_mesh(skeleton).values()))
    found = skinned(surface.vertices, surface.joints, surface.weights, joint_matrices(clip))
    np.testing.assert_allclose(found[0], surface.vertices, atol=1e-12)
