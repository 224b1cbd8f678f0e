"""What a BVH file does not say: how long its unit is and which of its axes points up."""

from __future__ import annotations

import math
from collections.abc import Sequence

import torch
from torch import Tensor

from hopdiff.geometry.body_parts import legs_of
from hopdiff.geometry.joint_names import is_like, named
from hopdiff.geometry.skeleton import Skeleton
from hopdiff.io.bvh_channels import BvhJoint, offsets_of, rotations_of
from hopdiff.types import HopdiffError

# Metres in one unit. "cmu" is the unit of the CMU motion capture database, an inch divided by 0.45.
UNITS = {"m": 1.0, "cm": 0.01, "mm": 0.001, "inch": 0.0254, "cmu": 0.0254 / 0.45}
UPS = ("y", "z")
HIP_HEIGHT = math.sqrt(0.8 * 1.1)  # m, the middle of what grown-up people have
LEG_LENGTH = 0.84  # m, of thigh and shank of a grown-up
TALLER = 2.0  # times as unlikely as by how much people are too small are they too tall: there are children, no giants
LOOKS = 30  # frames that are looked at
CLEAR = 0.8  # share of the height in a direction from which on it is upright
STRETCHED = 0.7  # of the bones from foot to head, by which a rest pose is that of a body that stands
ON_GROUND = 0.06  # of the same, by which a body's lowest point may be off zero, and go up and down


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

    It is the axis that separates head and feet at rest, if the body stands there. Where the body stands along the other
    one as it moves, the root's channels may have raised it: then it is the axis on whose zero the body is all the time.
    A skeleton that says nothing at rest is looked at in motion.
    """
    rest, posed = _rest(joints), _posed(joints, values)
    size = _size(joints, values)
    ways = _upright(joints, posed)
    share = (ways / torch.linalg.vector_norm(ways, dim=-1, keepdim=True).clamp(min=1e-12)).median(dim=0).values
    grounded = dict(zip("xyz", _grounded(posed, size), strict=True))
    way = _upright(joints, rest)[0]
    stands = bool(way.max() > 0.0) and (size is None or float(way.max()) > STRETCHED * size)
    at_rest = "xyz"[int(way.argmax())] if stands else "x"
    likely = "y" if share[1] >= share[2] else "z"
    if at_rest == "x":
        # Who stands along an axis on which he has no ground lies on the other.
        other = "z" if likely == "y" else "y"
        return other if grounded[other] and not grounded[likely] else likely
    if at_rest == "z":
        return "y" if share[1] > CLEAR and (grounded["y"] or not grounded["z"]) else "z"
    return "z" if share[2] > CLEAR and grounded["z"] and not grounded["y"] else "y"


def guess_unit(joints: Sequence[BvhJoint], values: Tensor, up: str) -> float:
    """Metres in a file unit: of `UNITS` the one that makes the body most like a person, children less than grown-ups.

    By the length of its legs, which no pose changes; where they are not found, by how high the hips get. Without any
    height to go by, it is a metre.
    """
    size, usual = _legs(joints, values, up), LEG_LENGTH
    if size is None:
        hips, axis = _hips(joints), "xyz".index(up)
        size = max(
            float((points[:, hips, axis] - points[:, :, axis].amin(dim=1)).quantile(0.9))
            for points in (_rest(joints), _posed(joints, values))
        )
        usual = HIP_HEIGHT
    if not size > 1e-9:
        return 1.0

    def unlike(metres: float) -> float:
        taller = math.log(size * metres / usual)
        return TALLER * taller if taller > 0.0 else -taller

    return min(UNITS.values(), key=unlike)


def _legs(joints: Sequence[BvhJoint], values: Tensor, up: str) -> float | None:
    """Length of a stretched leg from hip to ankle in file units, if there are two."""
    bones = _bones(joints, values)
    rest = torch.tensor([joint.offset for joint in joints], dtype=torch.float64)
    if up == "z":
        rest = rest @ torch.tensor([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]], dtype=torch.float64)
    scale = float(bones[1:].max()) if len(bones) > 1 else 0.0
    if not scale > 0.0:
        return None
    names = tuple(f"{joint.name}" for joint in joints)
    if len(set(names)) < len(names):
        return None
    ends = {joint.name: rest.new_tensor(joint.end_sites[0]) / scale for joint in joints if joint.end_sites}
    skeleton = Skeleton(names, tuple(joint.parent for joint in joints), rest / scale, ends)
    lengths = []
    for leg in legs_of(skeleton):
        lowest = leg.knee if leg.ankle is None else leg.ankle
        # Twisting joints may lie between hip, knee and ankle.
        chain = _above(joints, lowest)
        length = float(bones[chain[: chain.index(leg.hip)]].sum())
        lengths.append(length + (scale * float(ends[names[leg.knee]].norm()) if leg.ankle is None else 0.0))
    return max(lengths, default=None)


def _bones(joints: Sequence[BvhJoint], values: Tensor) -> Tensor:
    """(J,) how far each joint is from its parent, where position channels take the place of OFFSET."""
    some = values[torch.linspace(0, len(values) - 1, min(len(values), LOOKS)).round().long()]
    lengths: Tensor = torch.linalg.vector_norm(offsets_of(joints, some), dim=-1)
    return lengths.median(dim=0).values


def _size(joints: Sequence[BvhJoint], values: Tensor) -> float | None:
    """Length of the bones from foot to head in file units, if both are named."""
    bones = _bones(joints, values)
    heads = [at for at, joint in enumerate(joints) if is_like("head", joint.name)]
    feet = [at for at, joint in enumerate(joints) if is_like("foot", joint.name)]
    if not heads or not feet:
        return None
    ways = [_above(joints, at) for at in (heads[0], feet[0])]
    return float(sum(bones[at] for at in set(ways[0]) ^ set(ways[1])))


def _above(joints: Sequence[BvhJoint], joint: int) -> list[int]:
    """A joint and what it hangs on."""
    found = [joint]
    while (joint := joints[joint].parent) >= 0:
        found.append(joint)
    return found


def _grounded(points: Tensor, size: float | None) -> list[bool]:
    """Of each axis, whether the lowest of points (S, K, 3) stays about zero, of a body of a size."""
    lowest = points.amin(dim=1)
    size = float((points.amax(dim=1) - lowest).amax(dim=-1).median()) if size is None else size
    off = lowest.median(dim=0).values.abs()
    spread = lowest.quantile(0.9, dim=0) - lowest.quantile(0.1, dim=0)
    return [bool(one) for one in (off < ON_GROUND * size) & (spread < ON_GROUND * size)]


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
    hips = named(tuple(joint.name for joint in joints), "pelvis")
    parents = [joint.parent for joint in joints]
    branching = (at for at in range(len(joints)) if parents.count(at) > 1)
    return min(hips, default=next(branching, 0))


def _upright(joints: Sequence[BvhJoint], points: Tensor) -> Tensor:
    """(S, 3) size along each axis of the way from the feet to the head, or of the whole body if no name tells them."""
    feet = [at for at, joint in enumerate(joints) if is_like("foot", joint.name)]
    if not feet:
        size = points.amax(dim=1) - points.amin(dim=1)
        return size * torch.tensor([0.0, 1.0, 1.0], dtype=torch.float64)  # x is where arms are spread
    heads = [at for at, joint in enumerate(joints) if is_like("head", joint.name)] or [_hips(joints)]
    return (points[:, heads].mean(dim=1) - points[:, feet].mean(dim=1)).abs()
