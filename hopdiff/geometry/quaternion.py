"""Quaternions (x, y, z, w), as files of motion want them, and the rotations between two others."""

from __future__ import annotations

import torch
from scipy.spatial.transform import Rotation
from torch import Tensor


def quaternions(rotations: Tensor) -> Tensor:
    """Unit quaternions (T, ..., 4), x y z w, of rotation matrices (T, ..., 3, 3), without changes of sign over time.

    Two quaternions mean each rotation; of these each frame has the one nearer to that of the frame before, so that
    programs that interpolate do not go the long way round.
    """
    matrices = rotations.detach().double().cpu().numpy()
    found = torch.from_numpy(Rotation.from_matrix(matrices.reshape(-1, 3, 3)).as_quat())
    found = found.reshape(*rotations.shape[:-2], 4)
    first = torch.where(found[:1, ..., 3:] < 0.0, -1.0, 1.0)
    same = torch.where((found[1:] * found[:-1]).sum(-1, keepdim=True) < 0.0, -1.0, 1.0)
    return found * torch.cat((first, same)).cumprod(dim=0).to(found)


def from_quaternions(values: Tensor) -> Tensor:
    """Rotation matrices (..., 3, 3) of quaternions (..., 4), x y z w, of any length but 0."""
    matrices = Rotation.from_quat(values.detach().double().cpu().numpy().reshape(-1, 4)).as_matrix()
    return torch.from_numpy(matrices).reshape(*values.shape[:-1], 3, 3)


def slerp(start: Tensor, end: Tensor, share: Tensor) -> Tensor:
    """Rotations (..., 3, 3) between two others on the shorter arc; share: (...) from 0 to 1, or what broadcasts."""
    between = (start.transpose(-1, -2) @ end).numpy()
    arcs = Rotation.from_matrix(between.reshape(-1, 3, 3)).as_rotvec().reshape(*between.shape[:-1])
    part = Rotation.from_rotvec((share.unsqueeze(-1).numpy() * arcs).reshape(-1, 3)).as_matrix()
    return start @ torch.from_numpy(part.reshape(between.shape))
