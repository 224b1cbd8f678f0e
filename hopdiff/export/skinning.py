"""Where a skinned body is once its joints have moved.

Linear blend skinning: N. Magnenat-Thalmann, R. Laperrière, D. Thalmann, "Joint-dependent local deformations for hand
animation and object grasping", Graphics Interface (1988). What glTF and UsdSkel programs do, too.
"""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.sparse import csr_array

from hopdiff.geometry.clip import Clip

Floats = NDArray[np.float64]


def joint_matrices(clip: Clip) -> Floats:
    """(T, J, 4, 4) what takes points of the rest pose, with joint 0 at the origin, to where each joint takes them [m].

    Joints are not turned in the rest pose.
    """
    skeleton = clip.skeleton
    straight = torch.eye(3, dtype=torch.float64).expand(1, len(skeleton.names), 3, 3)
    rest = skeleton.forward(torch.zeros(1, 3, dtype=torch.float64), straight)[0][0]
    places, turns = (values.detach().double().cpu() for values in clip.forward())
    matrices = np.zeros((*places.shape[:2], 4, 4))
    matrices[..., :3, :3] = turns
    matrices[..., :3, 3] = places - (turns @ rest.unsqueeze(-1)).squeeze(-1)
    matrices[..., 3, 3] = 1.0
    return matrices


def skinned(vertices: Floats, joints: NDArray[np.int64], weights: Floats, matrices: Floats) -> Floats:
    """(T, V, 3) places of vertices [m].

    vertices: (V, 3) in the rest pose [m]. joints, weights: (V, K) that each follows, and by which shares, 1 in sum.
    matrices: (T, J, 4, 4), see `joint_matrices`.
    """
    return _blended(vertices, 1.0, joints, weights, matrices)


def skinned_normals(normals: Floats, joints: NDArray[np.int64], weights: Floats, matrices: Floats) -> Floats:
    """(T, V, 3) unit normals of vertices, which turn with the joints; otherwise as `skinned`."""
    turned = _blended(normals, 0.0, joints, weights, matrices)
    unit: Floats = turned / np.linalg.norm(turned, axis=-1, keepdims=True).clip(1e-30)
    return unit


def _blended(values: Floats, last: float, joints: NDArray[np.int64], weights: Floats, matrices: Floats) -> Floats:
    """Homogeneous vectors, whose last entry is given, moved by the weighted means of matrices."""
    count, wide = joints.shape
    rows = np.arange(0, count * wide + 1, wide)
    shares = csr_array((weights.ravel(), joints.ravel(), rows), shape=(count, matrices.shape[1]))
    whole = np.concatenate((values, np.full((len(values), 1), last)), axis=-1)
    found = np.empty((len(matrices), len(values), 3))
    for frame, one in enumerate(matrices):
        blend = (shares @ one[:, :3].reshape(-1, 12)).reshape(-1, 3, 4)
        found[frame] = (blend @ whole[:, :, None])[..., 0]
    return found
