"""Rotation matrices: the few conversions that motion needs.

A matrix R (..., 3, 3) takes a vector from the child's frame to the parent's frame: v_parent = R v_child.
"""

from __future__ import annotations

import torch
from torch import Tensor
from torch.nn import functional

POLE = 1e-9  # sine of the angle between the outer two axes below which they count as one
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


def rotation_about(axis: Tensor, angle: Tensor) -> Tensor:
    """(..., 3, 3) right-handed rotations about unit axes (..., 3) by angles (...) [rad]."""
    x, y, z = axis.unbind(-1)
    zero = torch.zeros_like(x)
    cross = torch.stack((zero, -z, y, z, zero, -x, -y, x, zero), dim=-1).reshape(*axis.shape[:-1], 3, 3)
    s, c = torch.sin(angle)[..., None, None], torch.cos(angle)[..., None, None]
    return torch.eye(3, dtype=axis.dtype, device=axis.device) + s * cross + (1.0 - c) * (cross @ cross)


def from_vector(vector: Tensor) -> Tensor:
    """(..., 3, 3) rotations about vectors (..., 3) by their lengths [rad]."""
    angle = vector.norm(dim=-1)
    return rotation_about(vector / angle.clamp_min(1e-30).unsqueeze(-1), angle)


def to_vector(matrix: Tensor) -> Tensor:
    """(..., 3) the vectors [rad] that `from_vector` makes rotations (..., 3, 3) of, for turns below half a circle."""
    twist = matrix - matrix.transpose(-1, -2)
    axis = 0.5 * torch.stack((twist[..., 2, 1], twist[..., 0, 2], twist[..., 1, 0]), dim=-1)
    sine = axis.norm(dim=-1, keepdim=True)
    cosine = 0.5 * (matrix.diagonal(dim1=-2, dim2=-1).sum(-1, keepdim=True) - 1.0)
    return axis * torch.where(sine > 1e-12, torch.atan2(sine, cosine) / sine.clamp_min(1e-30), torch.ones_like(sine))


def between_directions(a: Tensor, b: Tensor) -> Tensor:
    """(..., 3, 3) the least rotations that take directions (..., 3), of any length but 0, into others."""
    a, b = functional.normalize(a, dim=-1), functional.normalize(b, dim=-1)
    cross = torch.linalg.cross(a, b)
    sine = cross.norm(dim=-1)
    # Opposite directions: about whatever lies across.
    least = a.abs().argmin(dim=-1, keepdim=True)
    across = torch.linalg.cross(a, torch.zeros_like(a).scatter(-1, least, 1.0))
    axis = torch.where(sine[..., None] > 1e-12, cross, across)
    return rotation_about(functional.normalize(axis, dim=-1), torch.atan2(sine, (a * b).sum(-1)))


def euler_to_matrix(angles: Tensor, order: str) -> Tensor:
    """Intrinsic Euler angles to a matrix: order "ZXY" gives R = Z(a0) X(a1) Y(a2), as BVH channels are read.

    angles: (..., n) [rad], in the order of the n letters; any letters, any number of them. Returns (..., 3, 3).
    """
    if not order:
        return torch.eye(3).to(angles).expand(*angles.shape[:-1], 3, 3)
    columns = list(axis_rotation(order[0], angles[..., 0]).unbind(-1))
    for i, axis in enumerate(order[1:], start=1):
        # A turn about an axis mixes the columns of the other two: quicker than a product of small matrices.
        c, s = torch.cos(angles[..., i, None]), torch.sin(angles[..., i, None])
        p, q = (_AXES[axis] + 1) % 3, (_AXES[axis] + 2) % 3
        columns[p], columns[q] = c * columns[p] + s * columns[q], c * columns[q] - s * columns[p]
    return torch.stack(columns, dim=-1)


def matrix_to_euler(matrix: Tensor, order: str, at_pole: Tensor | None = None) -> Tensor:
    """Inverse of `euler_to_matrix` for one, two or three letters of which no two neighbours are the same.

    matrix: (..., 3, 3). at_pole: (...) [rad], first angle where the outer two of three turn about one axis and only
    their sum counts; 0 if None. Returns (..., n) [rad]; the middle one of three lies in [-pi/2, pi/2] if all three
    letters differ and in [0, pi] if the outer two are the same, poles left aside. With one or two letters not every
    rotation can be had: then a rotation comes back that shares what it can.
    """
    axes = [_AXES[axis] for axis in order]
    if len(axes) == 1:
        q, r = (axes[0] + 1) % 3, (axes[0] + 2) % 3
        sine, cosine = matrix[..., r, q] - matrix[..., q, r], matrix[..., q, q] + matrix[..., r, r]
        return torch.atan2(sine, cosine)[..., None]
    if len(axes) == 2:
        return torch.stack(_two_angles(matrix, *axes), dim=-1)
    i, j, k = axes
    other, sign = 3 - i - j, 1.0 if (j - i) % 3 == 1 else -1.0
    # The third axis, turned, has no part along j once the first turn is undone.
    along, across = matrix[..., other, k], matrix[..., j, k]
    first = torch.atan2(across, -sign * along) if i == k else torch.atan2(-sign * across, along)
    pole = torch.hypot(along, across) < max(POLE, 8 * torch.finfo(matrix.dtype).eps)
    first = torch.where(pole, torch.zeros_like(first) if at_pole is None else at_pole, first)
    rest = axis_rotation(order[0], -first) @ matrix
    return torch.stack((first, *_two_angles(rest, j, k)), dim=-1)


def _two_angles(matrix: Tensor, i: int, j: int) -> tuple[Tensor, Tensor]:
    """Angles about axes i and j of a matrix that is made of these two turns; there are no poles."""
    k, sign = 3 - i - j, 1.0 if (j - i) % 3 == 1 else -1.0
    first = torch.atan2(sign * matrix[..., k, j], matrix[..., j, j])
    second = torch.atan2(sign * matrix[..., i, k], matrix[..., i, i])
    return first, second


def unwrap(angles: Tensor, dim: int = 0) -> Tensor:
    """Remove jumps of a full turn along a dimension, so that neighbouring frames lie within pi of each other."""
    step = torch.diff(angles, dim=dim)
    turns = torch.round(step / (2 * torch.pi))
    correction = torch.cumsum(turns, dim=dim) * (2 * torch.pi)
    head = torch.zeros_like(angles.narrow(dim, 0, 1))
    return angles - torch.cat((head, correction), dim=dim)
