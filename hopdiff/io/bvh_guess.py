"""What a BVH file does not say: how long its unit is and which of its axes points up."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence

import torch
from torch import Tensor

from hopdiff.geometry.skeleton import Skeleton
from hopdiff.io.bvh_channels import BvhJoint, offsets_of, rotations_of
from hopdiff.types import HopdiffError

# Metres in one unit. "cmu" is the unit of the CMU motion capture database, an inch divided by 0.45.
UNITS = {"m": 1.0, "cm": 0.01, "mm": 0.001, "inch": 0.0254, "cmu": 0.0254 / 0.45}
UPS = ("y", "z")
HIP_HEIGHT = math.sqrt(0.8 * 1.1)  # m, the middle of what grown-up people have
LOOKS = 30  # frames that are looked at
CLEAR = 0.8  # share of the height in a direction from which on it is upright
HEAD = re.compile(r"head", re.IGNORECASE)
FEET = re.compile(r"foot|feet|toe|ankle", re.IGNORECASE)
HIPS = re.compile(r"hips?$|pelvis$", re.IGNORECASE)


def unit_of(unit: float | str) -> float:
    """Metres in a file unit, from a number or a name of `UNITS`. Raises HopdiffError for anything else."""
    if isinstance(unit, str) and unit.strip().lower() in UNITS:
        return UNITS[unit.strip().lower()]
    try:
        metres = float(unit)
    except (TypeError, ValueError):
        metres = math.nan
    if not (math.isfinite(metres) and metres > 0):
        raise HopdiffError(
            f"unit must be {', '.join(UNITS)} or a positive number of metres in a file unit, not {unit!r}."
        )
    return metres


def up_of(up: str) -> str:
    """ "y" or "z". Raises HopdiffError for anything else."""
    if not isinstance(up, str) or up.strip().lower() not in UPS:
        raise HopdiffError(f"up must be y or z, not {up!r}.")
    return up.strip().lower()


def guess_up(joints: Sequence[BvhJoint], values: Tensor) -> str:
    """Which axis of the file points up, "y" or "z".

    It is the axis that separates head and feet at rest. Where that is z, but the body stands along y as it moves, the
    root's channels raise it, and up is y. A skeleton that says nothing at rest is looked at in motion.
    """
    rest, posed = _upright(joints, _rest(joints)), _upright(joints, _posed(joints, values))
    share = (posed / torch.linalg.vector_norm(posed, dim=-1, keepdim=True).clamp(min=1e-12)).median(dim=0).values
    at_rest = "xyz"[int(rest[0].argmax())] if bool(rest.any()) else "x"
    if at_rest == "x":
        return "y" if share[1] >= share[2] else "z"
    return "y" if at_rest == "z" and share[1] > CLEAR else at_rest


def guess_unit(joints: Sequence[BvhJoint], values: Tensor, up: str) -> float:
    """Metres in a file unit: of `UNITS` the one that brings the height of the hips nearest to a grown-up's.

    Nearest is meant as a ratio. Without any height to go by, it is a metre.
    """
    hips = _hips(joints)
    axis = "xyz".index(up)
    heights = [
        (points[:, hips, axis] - points[:, :, axis].amin(dim=1)).quantile(0.9)
        for points in (_rest(joints), _posed(joints, values))
    ]
    height = float(max(heights))
    if not height > 1e-9:
        return 1.0
    return min(UNITS.values(), key=lambda metres: abs(math.log(height * metres / HIP_HEIGHT)))


def _rest(joints: Sequence[BvhJoint]) -> Tensor:
    """(1, K, 3) joints, then end sites, with no rotation."""
    offsets = torch.tensor([[joint.offset for joint in joints]], dtype=torch.float64)
    return _points(joints, offsets, torch.eye(3, dtype=torch.float64).expand(1, len(joints), 3, 3))


def _posed(joints: Sequence[BvhJoint], values: Tensor) -> Tensor:
    """(S, K, 3) joints, then end sites, in frames spread over the motion."""
    some = values[torch.linspace(0, len(values) - 1, min(len(values), LOOKS)).round().long()]
    return _points(joints, offsets_of(joints, some), rotations_of(joints, some))


def _points(joints: Sequence[BvhJoint], offsets: Tensor, rotations: Tensor) -> Tensor:
    skeleton = Skeleton(tuple(joint.name for joint in joints), tuple(joint.parent for joint in joints), offsets[0])
    places, orientations = skeleton.forward(offsets[:, 0], rotations, offsets)
    ends = [(at, end) for at, joint in enumerate(joints) for end in joint.end_sites]
    if not ends:
        return places
    holders = [at for at, _ in ends]
    tips = torch.tensor([end for _, end in ends], dtype=torch.float64)
    return torch.cat((places, places[:, holders] + (orientations[:, holders] @ tips[..., None])[..., 0]), dim=1)


def _hips(joints: Sequence[BvhJoint]) -> int:
    """The joint whose height tells the size: by name, else where the skeleton first branches, else the root."""
    named = (at for at, joint in enumerate(joints) if HIPS.search(joint.name))
    parents = [joint.parent for joint in joints]
    branching = (at for at in range(len(joints)) if parents.count(at) > 1)
    return next(named, next(branching, 0))


def _upright(joints: Sequence[BvhJoint], points: Tensor) -> Tensor:
    """(S, 3) size along each axis of the way from the feet to the head, or of the whole body if no name tells them."""
    feet = [at for at, joint in enumerate(joints) if FEET.search(joint.name)]
    if not feet:
        size = points.amax(dim=1) - points.amin(dim=1)
        return size * torch.tensor([0.0, 1.0, 1.0], dtype=torch.float64)  # x is where arms are spread
    heads = [at for at, joint in enumerate(joints) if HEAD.search(joint.name)] or [_hips(joints)]
    return (points[:, heads].mean(dim=1) - points[:, feet].mean(dim=1)).abs()
