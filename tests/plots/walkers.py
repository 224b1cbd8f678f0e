"""Made-up walkers on skeletons of several makes."""

from __future__ import annotations

import math

import torch

from hopdiff.geometry.clip import Clip
from hopdiff.geometry.rotation import axis_rotation
from hopdiff.geometry.skeleton import Skeleton

Row = tuple[str, str | None, tuple[float, float, float]]

# Joints of one side in the order hip, knee, foot, toe, shoulder, elbow, wrist.
MAKES = {
    "motion builder": ("{Left,Right}", ["UpLeg", "Leg", "Foot", "ToeBase", "Arm", "ForeArm", "Hand"]),
    "lone letter": ("{l,r}", ["femur", "tibia", "foot", "toes", "humerus", "radius", "hand"]),
    "biped": ("Bip01 {L,R} ", ["Thigh", "Calf", "Foot", "Toe0", "UpperArm", "Forearm", "Hand"]),
}
_LIMBS = ((0.1, -0.05, 0), (0, -0.42, 0), (0, -0.42, 0), (0, -0.06, 0.13), (0.17, 0.02, 0), (0.28, 0, 0), (0.25, 0, 0))


def sided(make: str, side: int) -> list[str]:
    """Names of the joints of a side, 0 left and 1 right."""
    pattern, parts = MAKES[make]
    head, _, rest = pattern.partition("{")
    choices, _, tail = rest.partition("}")
    return [f"{head}{choices.split(',')[side]}{tail}{part}" for part in parts]


def skeleton(make: str = "motion builder", head: bool = True, toes: bool = True, fingers: int = 0) -> Skeleton:
    """A body of about 1.7 m with arms spread, its hips in the origin."""
    rows: list[Row] = [("Hips", None, (0, 0, 0)), ("Spine", "Hips", (0, 0.15, 0)), ("Chest", "Spine", (0, 0.3, 0))]
    ends: dict[str, tuple[float, float, float]] = {}
    if head:
        rows += [("Neck", "Chest", (0, 0.08, 0)), ("Head", "Neck", (0, 0.1, 0))]
        ends["Head"] = (0, 0.18, 0)
    else:
        rows.append(("Collar", "Chest", (0, 0.02, 0)))
        ends["Collar"] = (0, 0.01, 0)
    for side in (0, 1):
        names = sided(make, side)
        before = ["Hips", *names[:3], "Chest", *names[4:6]]
        for name, parent, (x, y, z) in zip(names, before, _LIMBS, strict=True):
            if not toes and name == names[3]:
                ends[names[2]] = (0, -0.06, 0.13)
                continue
            rows.append((name, parent, (-x if side else x, y, z)))
        reach = -0.07 if side else 0.07
        ends |= {names[3]: (0, 0, 0.07)} if toes else {}
        for finger in range(fingers):
            base, z = f"{names[6]}Finger{finger}", 0.02 * (finger - 2)
            rows += [(base, names[6], (reach, 0, z)), (f"{base}1", base, (0.4 * reach, 0, 0))]
            ends[f"{base}1"] = (0.3 * reach, 0, 0)
        if not fingers:
            ends[names[6]] = (reach, 0, 0)
    order = [name for name, _, _ in rows]
    return Skeleton(
        tuple(order),
        tuple(-1 if parent is None else order.index(parent) for _, parent, _ in rows),
        torch.tensor([offset for _, _, offset in rows], dtype=torch.float64),
        {name: torch.tensor(offset, dtype=torch.float64) for name, offset in ends.items()},
    )


def walker(
    body: Skeleton, frames: int = 90, way: float = 4.0, bend: float = 0.0, frame_time: float = 1.0 / 30.0
) -> Clip:
    """Legs swing, arms hang. way: length of the way [m]; bend: how far it turns to the left [rad]."""
    share = torch.linspace(0.0, 1.0, frames, dtype=torch.float64)
    heading = bend * share
    ahead = torch.stack((torch.sin(heading), torch.zeros(frames), torch.cos(heading)), dim=-1)
    middle = 0.5 * (ahead[1:] + ahead[:-1]) * way / (frames - 1)
    root = torch.cat((torch.zeros(1, 3), middle.cumsum(0))) + torch.tensor([0.0, 0.97, 0.0])
    rotations = torch.eye(3, dtype=torch.float64).repeat(frames, len(body.names), 1, 1)
    rotations[:, 0] = axis_rotation("Y", heading)
    swing = 0.5 * torch.sin(2.0 * math.pi * way / 1.4 * share)
    roots = [joint for joint, parent in enumerate(body.parents) if parent == 0]
    for joint in roots:
        x = float(body.offsets[joint, 0])
        if x:
            rotations[:, joint] = axis_rotation("X", math.copysign(1.0, x) * swing)
    return Clip(body, root.double(), rotations, frame_time)
