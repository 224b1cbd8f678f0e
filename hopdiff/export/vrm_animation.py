"""VRM animations: a motion on the bones of a VRM human, which any VRM character can play.

VRM Consortium, VRMC_vrm_animation 1.0 (2024): a glTF file of nodes in T pose, without a mesh, one animation, and a map
of bones to nodes. Only hips move against what they hang on; all other bones turn.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import replace

import torch
from torch import Tensor

from hopdiff.export.anatomy import parts_of
from hopdiff.export.glb import glb_bytes
from hopdiff.export.humanoid import BONES
from hopdiff.export.take import Take
from hopdiff.export.target import Target, body_of
from hopdiff.geometry.joint_names import SIDES
from hopdiff.geometry.rotation import axis_rotation, between_directions
from hopdiff.geometry.skeleton import Skeleton
from hopdiff.io.files import write_whole
from hopdiff.types import HopdiffError
from hopdiff.whole_body.skeleton import JOINTS, PARENTS

# What the bones of VRMC_vrm 1.0 (2022) need; a body without one of these parts is none.
NEEDED = (
    *("pelvis", "waist", "head"),
    *(f"{side}_{part}" for side in SIDES for part in ("shoulder", "elbow", "wrist", "hip", "knee", "ankle")),
)


def write_vrma(path: str | os.PathLike[str], take: Take) -> None:
    """Write a take as a VRM animation, whole or not at all; see `vrma_bytes`. Raises HopdiffError."""
    write_whole(path, vrma_bytes(take))


def vrma_bytes(take: Take) -> bytes:
    """The file of a take. Its joints are known by `parts_of`; those between bones count for the bones below them.

    Raises HopdiffError, naming the bone, where a joint is missing that VRM asks for, or as `glb_bytes` does.
    """
    human = on_vrm_bones(take)
    bones = {bone: {"node": node} for node, bone in enumerate(human.clip.skeleton.names)}
    extension = {"specVersion": "1.0", "humanoid": {"humanBones": bones}}
    return glb_bytes([human], bare=True, extensions={"VRMC_vrm_animation": extension})


def on_vrm_bones(take: Take) -> Take:
    """The take on a skeleton of VRM's bones, called so, in T pose where nothing is turned: legs down, arms aside along
    x, feet and face along +z. Raises HopdiffError; see `vrma_bytes`."""
    parts = parts_of(take.clip.skeleton)
    if missing := [part for part in NEEDED if part not in parts]:
        raise HopdiffError(
            f"{take.name}: a VRM animation needs the bone {BONES[missing[0]]!r}, and no joint of this body is known to"
            f" be its {missing[0].replace('_', ' ')}."
        )
    target = body_of(take.name, take.clip)
    parts = {part: target.parts[part] for part in JOINTS if part in target.parts}
    bones = [_bone(part, parts) for part in parts]
    turned = t_pose(target)
    places, end = _standing(target, turned)
    above = [_over(part, parts) for part in parts]
    joints = list(parts.values())
    offsets = torch.stack(
        [
            places[joint] - (places[joints[over]] if over >= 0 else 0.0)
            for joint, over in zip(joints, above, strict=True)
        ]
    )
    ends = {_bone(part, parts): end[joint] - places[joint] for part, joint in parts.items() if joint in end}
    skeleton = Skeleton(tuple(bones), tuple(above), offsets, ends)
    moved, frames = take.clip.skeleton.forward(take.clip.root_position, take.clip.rotations, take.clip.offsets)
    frames = (frames @ turned.transpose(-1, -2))[:, joints]
    rotations = torch.stack(
        [
            frames[:, k] if over < 0 else frames[:, over].transpose(-1, -2) @ frames[:, k]
            for k, over in enumerate(above)
        ],
        dim=1,
    )
    clip = replace(
        take.clip, skeleton=skeleton, root_position=moved[:, parts["pelvis"]], rotations=rotations, offsets=None
    )
    return replace(take, clip=clip)


def t_pose(target: Target) -> Tensor:
    """(J, 3, 3) orientations of a body's joints where it stands in T pose, facing +z."""
    parts, skeleton = target.parts, target.skeleton
    back = axis_rotation("Y", torch.tensor(-target.facing(), dtype=torch.float64))
    places, rest = target.places @ back.T, back @ target.rest
    straight = torch.eye(3, dtype=torch.float64)
    turns: dict[int, Tensor] = {}
    for side, sign in zip(SIDES, (1.0, -1.0), strict=True):
        aside, down = straight.new_tensor((sign, 0.0, 0.0)), straight.new_tensor((0.0, -1.0, 0.0))
        for upper, lower, wanted in (
            ("shoulder", "elbow", aside),
            ("elbow", "wrist", aside),
            ("hip", "knee", down),
            ("knee", "ankle", down),
        ):
            one, other = parts[f"{side}_{upper}"], parts[f"{side}_{lower}"]
            turns[one] = between_directions(places[other] - places[one], wanted)
        turns[parts[f"{side}_ankle"]] = straight
        if (toe := parts.get(f"{side}_toe")) is not None:
            flat = (places[toe] - places[parts[f"{side}_ankle"]]) * straight.new_tensor((1.0, 0.0, 1.0))
            if float(flat.norm()) > 1e-6:
                turns[parts[f"{side}_ankle"]] = between_directions(flat, straight.new_tensor((0.0, 0.0, 1.0)))
    turned = []
    for joint in range(len(skeleton.names)):
        nearest = next((one for one in (joint, *skeleton.above(joint)) if one in turns), None)
        turned.append(rest[joint] if nearest is None else turns[nearest] @ rest[joint])
    return torch.stack(turned)


def _standing(target: Target, turned: Tensor) -> tuple[Tensor, dict[int, Tensor]]:
    """(J, 3) of the joints with these orientations, and the lowest point (3,) of each foot, by its last joint."""
    skeleton = target.skeleton
    above = torch.stack([turned[p] if p >= 0 else torch.eye(3, dtype=torch.float64) for p in skeleton.parents])
    root = torch.zeros(3, dtype=torch.float64)
    places, frames = skeleton.forward(root, above.transpose(-1, -2) @ turned)
    sites = skeleton.end_positions(places, frames)
    ends = {}
    for side in SIDES:
        foot = target.parts.get(f"{side}_toe", target.parts[f"{side}_ankle"])
        held = skeleton.below(target.parts[f"{side}_ankle"])
        points = [places[joint] for joint in held if joint != foot]
        points += [point for name, point in sites.items() if skeleton.index(name) in held]
        if points:
            ends[foot] = min(points, key=lambda point: float(point[1]))
    return places, ends


def _bone(part: str, parts: Mapping[str, int]) -> str:
    """What VRM calls a part; an upper chest without a chest is one."""
    return BONES["chest" if part == "upper_chest" and "chest" not in parts else part]


def _over(part: str, parts: Mapping[str, int]) -> int:
    """The number among the parts of the one that a part hangs on, as VRM has it."""
    while (part := PARENTS.get(part, "")) and part not in parts:
        pass
    return list(parts).index(part) if part else -1
