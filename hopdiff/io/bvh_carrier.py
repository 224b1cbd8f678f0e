"""Which joint of a BVH file carries the body over the ground, where that is not the root, and motions given back to it.

Studios write bodies below a root that stands still at the origin, or below joints without channels. The way of such a
body is that of its hips.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import torch
from torch import Tensor

from hopdiff.editing.leg_joints import facing
from hopdiff.geometry.body_parts import legs_of
from hopdiff.geometry.skeleton import Skeleton
from hopdiff.io.bvh_channels import BvhJoint

SHARE = 0.2  # of the hips' way below which a joint above them stands still
STEADY = math.radians(0.1)  # a turn that is none
ASIDE = math.radians(30.0)  # from which on hips face elsewhere than the joint that carries them
NO_WAY = 1e-9  # m
UPRIGHT = 0.1  # of a thigh's length, for a difference that is one
SWAY = 1e-3  # m by which hips move over a root that carries them by design


def carrier_of(
    joints: Sequence[BvhJoint], skeleton: Skeleton, moving: Callable[[Sequence[int]], tuple[Tensor, Tensor]]
) -> int:
    """The joint whose way over the ground and whose heading are the body's: the root, or one between it and the hips.

    It is the first that goes as far as the hips do and turns, if they turn. skeleton: of all joints [m]. moving: of
    joints, places (T, K, 3) [m] and rotations (T, K, 3, 3) in their parents' frames, y up.
    """
    chain = _to_the_hips(joints, skeleton)
    if len(chain) < 2 or not any(joints[joint].places for joint in chain):
        return 0
    offsets, rotations = moving(chain)
    places, turns = _along(offsets, rotations)
    extent = _extent(places)
    turned = _turned(turns)
    alone = _extent(offsets) > SWAY
    for k, joint in enumerate(chain[:-1]):
        goes = bool(extent[k] >= SHARE * extent[-1]) and any(joints[above].places for above in chain[: k + 1])
        can_turn = any(joints[above].turns for above in chain[: k + 1])
        # A root on the ground that goes straight ahead below hips that sway is no less the body's root.
        led = can_turn and bool(alone[k + 1 :].any()) and not _faces_aside(skeleton, turns[:, k], turns[:, -1])
        if goes and (led or bool(turned[k] > STEADY) or bool(turned[-1] <= STEADY)):
            return joint
    return chain[-1]


def above_of(joints: Sequence[BvhJoint], joint: int) -> list[int]:
    """The joints that a joint hangs on, from the root down, and itself."""
    chain = [joint]
    while (parent := joints[chain[0]].parent) >= 0:
        chain.insert(0, parent)
    return chain


def below_of(joints: Sequence[BvhJoint], joint: int) -> list[int]:
    """A joint and all that hangs on it, in the file's order."""
    inside = {joint}
    for at, one in enumerate(joints):
        if one.parent in inside:
            inside.add(at)
    return sorted(inside)


def carried(offsets: Tensor, rotations: Tensor) -> tuple[Tensor, Tensor]:
    """World place (T, 3) and orientation (T, 3, 3) of the last joint of a chain (T, K, ...) that begins at the root."""
    places, turns = _along(offsets, rotations)
    return places[:, -1], turns[:, -1]


def raises(skeleton: Skeleton, turn: Tensor) -> bool:
    """Whether legs hang down at rest (more) once the whole body is turned (3, 3)."""
    thighs = [skeleton.offsets[leg.knee] for leg in legs_of(skeleton)]
    return bool(thighs) and bool((turn @ thighs[0])[1] < thighs[0][1] - UPRIGHT * thighs[0].norm())


def give_back(
    joints: Sequence[BvhJoint],
    chain: list[int],
    offsets: Tensor,
    rotations: Tensor,
    place: Tensor,
    turn: Tensor,
    moved_by: Sequence[int],
) -> None:
    """Change joints of a chain, in place, such that its last one has another world place and orientation.

    offsets (T, J, 3), rotations (T, J, 3, 3): of all joints. place (T, 3), turn (T, 3, 3): what is wanted. moved_by:
    joints of the chain with position channels, the first of which takes what it can. The turn goes to the lowest joint
    that can turn any way. What the channels do not allow is left to the last of them, for the writer to refuse.
    """
    able = [k for k, joint in enumerate(chain) if len(set(joints[joint].order)) == 3]
    turning = able[-1] if able else max(range(len(chain)), key=lambda k: (len(joints[chain[k]].turns), k))
    _, turns = _along(offsets[:, chain], rotations[:, chain])
    above = turns[:, turning - 1] if turning else torch.eye(3, dtype=turns.dtype).expand_as(turn)
    below = turns[:, turning].transpose(-1, -2) @ turns[:, -1]
    rotations[:, chain[turning]] = above.transpose(-1, -2) @ turn @ below.transpose(-1, -2)
    places, turns = _along(offsets[:, chain], rotations[:, chain])
    missing = place - places[:, -1]
    for joint in moved_by:
        k = chain.index(joint)
        frame = turns[:, k - 1] if k else torch.eye(3, dtype=turns.dtype).expand_as(turn)
        local = (frame.transpose(-1, -2) @ missing[..., None])[..., 0]
        if joint != moved_by[-1]:
            local = local * torch.tensor([float(axis in joints[joint].places) for axis in range(3)], dtype=local.dtype)
        offsets[:, joint] += local
        missing = missing - (frame @ local[..., None])[..., 0]


def movers(joints: Sequence[BvhJoint], chain: Sequence[int], offsets: Tensor, up: int) -> list[int]:
    """Joints of a chain with position channels, who goes farthest over the ground first, of equals the lowest.

    offsets: (T, J, 3). up: the axis that points up.
    """
    able = [joint for joint in chain if joints[joint].places] or [chain[-1]]
    ground = [axis for axis in range(3) if axis != up]
    ways = {joint: float(_range(offsets[:, joint][:, ground])) for joint in able}
    return sorted(able, key=lambda joint: (-ways[joint], -len(joints[joint].places), -chain.index(joint)))


def _to_the_hips(joints: Sequence[BvhJoint], skeleton: Skeleton) -> list[int]:
    """From the root down to the joint that both legs hang on.

    Without legs it is the last with position channels before the skeleton branches; the root if it never does.
    """
    legs = legs_of(skeleton)
    if legs:
        shared = [joint for joint in skeleton.above(legs[0].hip) if joint in skeleton.above(legs[1].hip)]
        return [*reversed(skeleton.above(shared[0])), shared[0]] if shared else [0]
    chain = [0]
    while len(children := skeleton.children(chain[-1])) == 1:
        chain += children
    if not children:
        return [0]
    while len(chain) > 1 and not joints[chain[-1]].places:
        chain.pop()
    return chain


def _along(offsets: Tensor, rotations: Tensor) -> tuple[Tensor, Tensor]:
    """World places (T, K, 3) and orientations (T, K, 3, 3) of a chain that begins at the root."""
    places, turns = [offsets[:, 0]], [rotations[:, 0]]
    for k in range(1, offsets.shape[1]):
        places.append(places[-1] + (turns[-1] @ offsets[:, k, :, None])[..., 0])
        turns.append(turns[-1] @ rotations[:, k])
    return torch.stack(places, dim=1), torch.stack(turns, dim=1)


def _extent(places: Tensor) -> Tensor:
    """(K,) how far joints (T, K, 3) get about on the ground, y up."""
    return _range(places[..., [0, 2]])


def _range(places: Tensor) -> Tensor:
    found: Tensor = torch.linalg.vector_norm(places.amax(dim=0) - places.amin(dim=0), dim=-1)
    return torch.where(found > NO_WAY, found, 0.0)


def _turned(turns: Tensor) -> Tensor:
    """(K,) the largest angle between the first frame and another of (T, K, 3, 3) [rad]."""
    angles: Tensor = torch.linalg.matrix_norm(turns - turns[:1]) / math.sqrt(2)
    return angles.amax(dim=0)


def _faces_aside(skeleton: Skeleton, leader: Tensor, hips: Tensor) -> bool:
    """Whether the body faces elsewhere than its leader (T, 3, 3) does in any frame."""
    turn = leader.transpose(-1, -2) @ hips
    yaw = torch.atan2(turn[:, 0, 2] - turn[:, 2, 0], turn[:, 0, 0] + turn[:, 2, 2])
    yaw = yaw + facing(skeleton, legs_of(skeleton))
    return bool(torch.atan2(torch.sin(yaw), torch.cos(yaw)).abs().max() > ASIDE)
