"""Rotation matrices: the few conversions that motion needs.

A matrix R (..., 3, 3) takes a vector from the child's frame to the parent's frame: v_parent = R v_child.
"""

from __future__ import annotations

import torch
from torch import Tensor

_AXES = {"X": 0, "Y": 1, "Z": 2}


def axis_rotation(axis: str, angle: Tensor) -> Tensor:
    """Right-handed rotation about a coordinate axis.

    axis: "X", "Y" or "Z". angle: (...) [rad]. Returns (..., 3, 3).
    """
    c, s = torch.cos(angle), torch.sin(angle)
    one, zero = torch.ones_like(c), torch.zeros_like(c)
    rows = {
        "X": (one, zero, zero, zero, c, -s, zero, s, c),
        "Y": (c, zero, s, zero, one, zero, -s, zero, c),
        "Z": (c, -s, zero, s, c, zero, zero, zero, one),
    }[axis]
    return torch.stack(rows, dim=-1).reshape(*angle.shape, 3, 3)


def euler_to_matrix(angles: Tensor, order: str) -> Tensor:
    """Intrinsic Euler angles to a matrix: order "ZXY" gives R = Z(a0) X(a1) Y(a2), as BVH channels are read.

    angles: (..., 3) [rad], in the order of the letters. Returns (..., 3, 3).
    """
    first, second, third = (axis_rotation(axis, angles[..., i]) for i, axis in enumerate(order))
    return first @ second @ third


def matrix_to_euler(matrix: Tensor, order: str) -> Tensor:
    """Inverse of `euler_to_matrix` for the six orders with three different axes.

    matrix: (..., 3, 3). Returns (..., 3) [rad]; the middle angle lies in [-pi/2, pi/2]. At the poles of the
    middle angle the split between the outer two is not unique and the third is left at the value of atan2(0, 0).
    """
    i, j, k = (_AXES[axis] for axis in order)
    sign = 1.0 if (j - i) % 3 == 1 else -1.0
    second = torch.asin((sign * matrix[..., i, k]).clamp(-1.0, 1.0))
    first = torch.atan2(-sign * matrix[..., j, k], matrix[..., k, k])
    third = torch.atan2(-sign * matrix[..., i, j], matrix[..., i, i])
    return torch.stack((first, second, third), dim=-1)


def unwrap(angles: Tensor, dim: int = 0) -> Tensor:
    """Remove jumps of a full turn along a dimension, so that neighbouring frames lie within pi of each other."""
    step = torch.diff(angles, dim=dim)
    turns = torch.round(step / (2 * torch.pi))
    correction = torch.cumsum(turns, dim=dim) * (2 * torch.pi)
    head = torch.zeros_like(angles.narrow(dim, 0, 1))
    return angles - torch.cat((head, correction), dim=dim)
