"""Rest poses of a skeleton, and its mirror image."""

from __future__ import annotations

import math
from dataclasses import replace

import torch
from torch import Tensor

from hopdiff.export.anatomy import parts_of
from hopdiff.export.take import Take
from hopdiff.geometry.body_parts import may_have_arms
from hopdiff.geometry.joint_names import SIDES, plain_name
from hopdiff.geometry.rotation import between_directions
from hopdiff.geometry.skeleton import Skeleton
from hopdiff.types import HopdiffError

ARMS = {"straight": -90.0, "a": -45.0, "t": 0.0}  # rest pose -> degrees of the arms above the horizontal
LIKE = 0.02  # of the longest bone by which two bones may differ and still be mirror images
_OPPOSITE = {"left": "right", "right": "left"}


def with_rest_pose(take: Take, pose: str) -> Take:
    """The same motion on a skeleton whose joints are straight in another pose: a, t or straight (arms hang).

    Joints are where they were in every frame; their frames are aligned with the axes in the new rest pose. Raises
    HopdiffError if the arms cannot be told.
    """
    skeleton = take.clip.skeleton
    turned = _arms_at(skeleton, math.radians(ARMS[pose]))
    above = torch.stack([turned[parent] if parent >= 0 else torch.eye(3).double() for parent in skeleton.parents])
    offsets = (above @ skeleton.offsets.unsqueeze(-1)).squeeze(-1)
    ends = {name: turned[skeleton.index(name)] @ end for name, end in skeleton.end_sites.items()}
    # A joint's frame is turned by G, its parent's by G_p: R becomes G_p R G^T, so that it leads to the same place.
    rotations = above @ take.clip.rotations @ turned.transpose(-1, -2)
    moving = None if take.clip.offsets is None else (above @ take.clip.offsets.unsqueeze(-1)).squeeze(-1)
    whole = Skeleton(skeleton.names, skeleton.parents, offsets, ends)
    clip = replace(take.clip, skeleton=whole, rotations=rotations, offsets=moving)
    return replace(take, clip=clip)


def root_height(skeleton: Skeleton) -> float:
    """Height of the root joint with which the rest pose stands on the ground [m]."""
    straight = torch.eye(3, dtype=torch.float64).expand(1, len(skeleton.names), 3, 3)
    places, frames = skeleton.forward(torch.zeros(1, 3, dtype=torch.float64), straight)
    ends = skeleton.end_positions(places, frames)
    return -min(float(places[..., 1].min()), *(float(end[..., 1].min()) for end in ends.values()), 0.0)


def _arms_at(skeleton: Skeleton, angle: float) -> Tensor:
    """(J, 3, 3) orientations of all joints in the rest pose with arms at an angle above the horizontal [rad]; as they
    are for a body that has no arms."""
    parts = parts_of(skeleton)
    turned = torch.eye(3, dtype=torch.float64).repeat(len(skeleton.names), 1, 1)
    if not any(f"{side}_shoulder" in parts for side in SIDES) and not may_have_arms(skeleton):
        return turned
    for side, sign in zip(SIDES, (1.0, -1.0), strict=True):
        if f"{side}_shoulder" not in parts or f"{side}_elbow" not in parts:
            raise HopdiffError("rest: the arms of this skeleton cannot be told by its joints' names or its shape.")
        wanted = torch.tensor([sign * math.cos(angle), math.sin(angle), 0.0], dtype=torch.float64)
        upper = between_directions(skeleton.offsets[parts[f"{side}_elbow"]], wanted)
        below = _end_of(skeleton, parts[f"{side}_elbow"], parts.get(f"{side}_wrist"))
        lower = between_directions(upper @ below, wanted) @ upper
        for joint in range(len(skeleton.names)):
            over = (joint, *skeleton.above(joint))
            if parts[f"{side}_elbow"] in over:
                turned[joint] = lower
            elif parts[f"{side}_shoulder"] in over:
                turned[joint] = upper
    return turned


def _end_of(skeleton: Skeleton, joint: int, child: int | None) -> Tensor:
    """(3,) from a joint to its child, or to its end site."""
    if child is not None and child in skeleton.children(joint):
        return skeleton.offsets[child]
    children = skeleton.children(joint)
    return skeleton.offsets[children[0]] if children else skeleton.end_sites[skeleton.names[joint]]


def mirrored(take: Take) -> Take:
    """The mirror image: left and right change places. Raises HopdiffError if the bones of both sides differ."""
    skeleton = take.clip.skeleton
    twins = _twins(skeleton)
    flip = torch.tensor([-1.0, 1.0, 1.0], dtype=torch.float64)
    longest = float(skeleton.offsets[1:].norm(dim=-1).max()) if len(twins) > 1 else 1.0
    unlike = (skeleton.offsets[twins] * flip - skeleton.offsets)[1:].norm(dim=-1) > LIKE * longest
    if take.clip.offsets is not None or bool(unlike.any()):
        joint = 1 + int(unlike.int().argmax()) if bool(unlike.any()) else 0
        raise HopdiffError(
            f"mirrored: {take.name} has no mirror image, its bones at {skeleton.names[joint]!r} and"
            f" {skeleton.names[twins[joint]]!r} differ."
        )
    mirror = torch.diag(flip)
    clip = replace(
        take.clip,
        root_position=take.clip.root_position * flip,
        rotations=mirror @ take.clip.rotations[:, twins] @ mirror,
    )

    def sides(values: Tensor | None) -> Tensor | None:
        return None if values is None else values.flip(1)

    feet, com = sides(take.feet), take.com
    numbers = dict(take.numbers)
    if isinstance(turn := numbers.get("turn"), int | float):
        numbers["turn"] = -turn
    return replace(
        take,
        numbers=numbers,
        clip=clip,
        events=None,
        contact=sides(take.contact),
        leg_force=sides(take.leg_force),
        feet=None if feet is None else feet * flip,
        com=None if com is None else com * flip,
        force=None if take.force is None else take.force.flip(1) * flip,
        cop=None if take.cop is None else take.cop.flip(1) * flip,
    )


def _twins(skeleton: Skeleton) -> list[int]:
    """For every joint the one of the same name on the other side, or itself."""
    plain = [plain_name(name) for name in skeleton.names]
    twins = []
    for joint, (side, word) in enumerate(plain):
        opposite = (None if side is None else _OPPOSITE[side], word)
        # Of several of a name the one as deep in the tree.
        same = [k for k, other in enumerate(plain) if other == opposite]
        depth = len(skeleton.above(joint))
        own = side is None or not same
        twins.append(joint if own else min(same, key=lambda k: abs(len(skeleton.above(k)) - depth)))
    return twins
