"""Which way the frames of joints point in the rest pose: along the world's axes, or as in other programs' skeletons.

A clip is a list of turns of these frames, so a clip made on one skeleton moves another of the same names only where
the frames of both lie alike on their bones. Mixamo's were read from the bind poses of three.js's examples Xbot.glb and
Soldier.glb, those of Unreal Engine 4's mannequin from Epic's SK_Mannequin.FBX.
"""

from __future__ import annotations

import torch
from torch import Tensor

from hopdiff.export.anatomy import SPINE, parts_of
from hopdiff.geometry.joint_names import SIDES
from hopdiff.geometry.skeleton import Skeleton

AXES = ("world", "bone", "mixamo", "unreal")
SHORT = 1e-6  # m: shorter bones have no direction
SIMILAR = 0.05  # of a unit vector's square that a second direction must be off the first

_FOOT, _ARM = ("ankle", "toe"), ("collar", "shoulder", "elbow", "wrist")
_LEFT, _UP, _AHEAD = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)


def joint_axes(skeleton: Skeleton, axes: str, swapped: bool = False) -> Tensor:
    """(J, 3, 3) the frames of the joints in the rest pose, in which the body faces +z and its own are not turned.

    axes: `world`: as they are. `bone`: y along the bone to its child, or its end; legs, arms and trunk bend about x.
    `mixamo`: the same, but for arms, whose z points down. `unreal`: x along the bones of trunk, left arm and right leg,
    against those of right arm and left leg, whose frames are the mirror images; feet stand upright.
    swapped: of `unreal` the frames of a file whose y and z its importer swaps, as it does with glTF, where of FBX it
    turns y round.
    """
    if axes == "world":
        return torch.eye(3, dtype=torch.float64).repeat(len(skeleton.names), 1, 1)
    parts = {joint: part for part, joint in parts_of(skeleton).items()}
    frames = []
    for joint in range(len(skeleton.names)):
        bone, part = _bone(skeleton, joint, parts), parts.get(joint, "")
        if axes == "unreal":
            frames.append(_unreal(bone, part, swapped))
        else:
            frames.append(_along_y(bone, part, axes == "mixamo"))
    return torch.stack(frames)


def _along_y(bone: Tensor, part: str, mixamo: bool) -> Tensor:
    """(3, 3) a frame with y along a bone, as Blender and Mixamo have it."""
    side, name = _split(part)
    ahead = name not in _FOOT and float(bone[2]) ** 2 < 1.0 - SIMILAR
    z = (0.0, -1.0, 0.0) if mixamo and side and name in _ARM else _AHEAD if ahead else _UP
    y, z_axis = bone, _beside(bone, z)
    return torch.stack((torch.linalg.cross(y, z_axis), y, z_axis), dim=-1)


def _unreal(bone: Tensor, part: str, swapped: bool) -> Tensor:
    """(3, 3) a frame as the mannequin has it; of joints that it lacks, as of its trunk."""
    side, name = _split(part)
    if not part and float(bone[1]) > 1.0 - SIMILAR:
        x, y = torch.tensor(_LEFT).double(), torch.tensor((0.0, 0.0, -1.0)).double()  # the root on the ground
    else:
        x, y = _of_left(_mirrored(bone) if side == "right" else bone, name if side else "")
    frame = torch.stack((x, y, torch.linalg.cross(x, y)), dim=-1)
    if side == "right":
        # A rotation again: all three axes are turned round in the mirror.
        frame = -torch.stack([_mirrored(axis) for axis in frame.unbind(-1)], dim=-1)
    if swapped:
        x, y, z = frame.unbind(-1)
        frame = torch.stack((x, z, -y), dim=-1)
    return frame


def _of_left(bone: Tensor, name: str) -> tuple[Tensor, Tensor]:
    """x and y of a joint of the mannequin's left side or its middle."""
    back = (0.0, 0.0, -1.0)
    match name:
        case "hip" | "knee":
            return -bone, _beside(bone, back)
        case "ankle":
            # The foot's heading on the ground counts, not how far the toes are below the ankle.
            level = bone * bone.new_tensor((1.0, 0.0, 1.0))
            heading = level / level.norm() if float(level.norm()) > SIMILAR else bone.new_tensor(_AHEAD)
            return bone.new_tensor(_UP), -heading
        case "toe":
            return bone, _beside(bone, _UP)
        case "collar":
            return bone, torch.linalg.cross(_beside(bone, _UP), bone)
        case "wrist":
            # Hands are turned a quarter about the forearm: y points out of the palm.
            return bone, torch.linalg.cross(_beside(bone, back), bone)
        case _:
            return bone, _beside(bone, back)


def _split(part: str) -> tuple[str, str]:
    side, _, name = part.partition("_")
    return (side, name) if side in SIDES else ("", part)


def _bone(skeleton: Skeleton, joint: int, parts: dict[int, str]) -> Tensor:
    """(3,) from a joint to the one that goes on from it, to its end, or on from its parent; up if there is none."""
    children = [child for child in skeleton.children(joint) if float(skeleton.offsets[child].norm()) > SHORT]
    end = skeleton.end_sites.get(skeleton.names[joint])
    # Where several joints hang on one of the back, its bone leads to the next of the back.
    above = SPINE[SPINE.index(parts[joint]) + 1 :] if parts.get(joint) in SPINE else ()
    if back := [child for child in children if parts.get(child) in above]:
        line = skeleton.offsets[back[0]]
    elif children:
        carried = {
            child: sum(child in skeleton.above(other) for other in range(len(skeleton.names))) for child in children
        }
        line = skeleton.offsets[[child for child in children if carried[child] == max(carried.values())]].mean(dim=0)
    elif end is not None and float(end.norm()) > SHORT:
        line = end
    else:
        line = skeleton.offsets[joint] if skeleton.parents[joint] >= 0 else skeleton.offsets.new_tensor(_UP)
    line = line.double()
    return line / line.norm() if float(line.norm()) > SHORT else torch.tensor(_UP, dtype=torch.float64)


def _beside(bone: Tensor, wanted: tuple[float, float, float]) -> Tensor:
    """(3,) the direction across a bone that is nearest to another one."""
    line = bone.new_tensor(wanted)
    line = line - (line @ bone) * bone
    across: Tensor = line / line.norm()
    return across


def _mirrored(line: Tensor) -> Tensor:
    image: Tensor = line * line.new_tensor((-1.0, 1.0, 1.0))
    return image
