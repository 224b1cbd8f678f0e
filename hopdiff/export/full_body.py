"""The runner's body with the joints that other programs expect: spine, collarbones, wrists, head, ankles and toes.

The model has eleven joints (Kang 1999, figure 2.1). The others are put on its bones and turn with them, so that the
eleven stay where they are; ankles alone are bent, which the model does not do: a foot that stands is level.
"""

from __future__ import annotations

import math
from dataclasses import replace

import torch
from scipy.ndimage import maximum_filter1d, uniform_filter1d
from torch import Tensor
from torch.nn import functional

from hopdiff.character import REQUIRED_PARENTS
from hopdiff.export.take import Take
from hopdiff.geometry.rotation import axis_rotation
from hopdiff.geometry.skeleton import Skeleton
from hopdiff.types import HopdiffError

# Lengths of body parts in body heights: Drillis and Contini (1966), figure 1; those of the leg in lengths of the shank
# with the foot, .285 body heights, those of the arm in lengths of forearm and hand, .254.
ANKLE = 0.039 / 0.285  # height of the ankle above the sole
HEEL = 0.04 / 0.285  # from the ankle back to the heel
BALL = 0.072 / 0.285  # from the ankle ahead to the ball of the foot
TOE_TIP = 0.112 / 0.285  # and to the tips of the toes
WRIST = 0.146 / 0.254  # from the elbow to the wrist
CHEST, UPPER_CHEST = 1.0 / 3.0, 2.0 / 3.0  # of the way from waist to neck
COLLAR = 0.2  # of the way to the shoulder where a collarbone begins
HEAD = 0.35  # of the way from the neck to the crown
POINTED = 0.35  # rad by which toes point down from the shank's right angle in mid-swing
LIFT = 0.06  # s in which toes are lifted that would scrape
EASE = 0.35  # of a swing in which a foot leaves its level, and comes back to it

JOINTS = (
    "pelvis",
    "waist",
    "chest",
    "upper_chest",
    "neck",
    "head",
    *(f"left_{part}" for part in ("collar", "shoulder", "elbow", "wrist")),
    *(f"right_{part}" for part in ("collar", "shoulder", "elbow", "wrist")),
    *(f"left_{part}" for part in ("hip", "knee", "ankle", "toe")),
    *(f"right_{part}" for part in ("hip", "knee", "ankle", "toe")),
)
_PARENTS = {
    "waist": "pelvis",
    "chest": "waist",
    "upper_chest": "chest",
    "neck": "upper_chest",
    "head": "neck",
    **{f"{side}_{joint}": parent for side in ("left", "right") for joint, parent in (("collar", "upper_chest"),)},
    **{f"{side}_hip": "pelvis" for side in ("left", "right")},
    **{
        f"{side}_{joint}": f"{side}_{parent}"
        for side in ("left", "right")
        for joint, parent in (
            ("shoulder", "collar"),
            ("elbow", "shoulder"),
            ("wrist", "elbow"),
            ("knee", "hip"),
            ("ankle", "knee"),
            ("toe", "ankle"),
        )
    },
}


def is_model_body(skeleton: Skeleton) -> bool:
    """Whether a skeleton has the joints of hopdiff's characters."""
    parents = {
        name: None if parent < 0 else skeleton.names[parent]
        for name, parent in zip(skeleton.names, skeleton.parents, strict=True)
    }
    return parents == dict(REQUIRED_PARENTS)


def full_body(take: Take) -> Take:
    """A run of hopdiff's own on 22 joints. Raises HopdiffError for another skeleton, or contacts that are not known."""
    skeleton = take.clip.skeleton
    if not is_model_body(skeleton) or take.contact is None:
        raise HopdiffError(f"{take.name}: only runs of hopdiff's own have the joints that joints=full begins with.")
    whole = full_skeleton(skeleton)
    straight = torch.eye(3, dtype=torch.float64).expand(take.frames, 3, 3)
    rotations = dict.fromkeys(JOINTS, straight)
    rotations |= {name: take.clip.rotations[:, k] for k, name in enumerate(skeleton.names)}
    positions, orientations = take.clip.forward()
    for k, side in enumerate(("left", "right")):
        joint, size = skeleton.index(f"{side}_knee"), float(skeleton.end_sites[f"{side}_knee"].norm())
        knee, shank = positions[:, joint], orientations[:, joint]
        rotations[f"{side}_ankle"] = _ankle(knee, shank, size, take.contact[:, k], take.loop, take.clip.frame_time)
    clip = replace(take.clip, skeleton=whole, rotations=torch.stack([rotations[name] for name in JOINTS], dim=1))
    return replace(take, clip=clip)


def full_skeleton(skeleton: Skeleton) -> Skeleton:
    """The 22 joints of a body of eleven."""

    def old(name: str) -> Tensor:
        return skeleton.offsets[skeleton.index(name)]

    spine, crown = old("neck"), skeleton.end_sites["neck"]
    places = {
        "pelvis": old("pelvis"),
        "waist": old("waist"),
        "chest": CHEST * spine,
        "upper_chest": (UPPER_CHEST - CHEST) * spine,
        "neck": (1.0 - UPPER_CHEST) * spine,
        "head": HEAD * crown,
    }
    ends = {"head": (1.0 - HEAD) * crown}
    for side in ("left", "right"):
        shoulder = old(f"{side}_shoulder")
        collar = torch.stack((COLLAR * shoulder[0], shoulder[1], shoulder[2])) - UPPER_CHEST * spine
        hand, shank = skeleton.end_sites[f"{side}_elbow"], skeleton.end_sites[f"{side}_knee"]
        size = float(shank.norm())
        places |= {
            f"{side}_collar": collar,
            f"{side}_shoulder": shoulder - UPPER_CHEST * spine - collar,
            f"{side}_elbow": old(f"{side}_elbow"),
            f"{side}_wrist": WRIST * hand,
            f"{side}_hip": old(f"{side}_hip"),
            f"{side}_knee": old(f"{side}_knee"),
            f"{side}_ankle": (1.0 - ANKLE) * shank,
            f"{side}_toe": shank.new_tensor((0.0, -ANKLE * size, BALL * size)),
        }
        ends[f"{side}_wrist"] = (1.0 - WRIST) * hand
        ends[f"{side}_toe"] = shank.new_tensor((0.0, 0.0, (TOE_TIP - BALL) * size))
    parents = tuple(JOINTS.index(_PARENTS[name]) if name in _PARENTS else -1 for name in JOINTS)
    return Skeleton(JOINTS, parents, torch.stack([places[name] for name in JOINTS]), ends)


def _ankle(knee: Tensor, shank: Tensor, size: float, contact: Tensor, loop: bool, frame_time: float) -> Tensor:
    """(T, 3, 3) how the foot is turned against the shank, whose knee is at (T, 3) and orientation (T, 3, 3).

    It is level while it stands and hangs from the shank in mid-swing, with its tip above the ground.
    """
    # Level, and heading as the shank does: its left axis, laid down.
    across = functional.normalize(shank[:, :, 0] * torch.tensor([1.0, 0.0, 1.0], dtype=shank.dtype), dim=-1)
    up = torch.tensor([0.0, 1.0, 0.0], dtype=shank.dtype).expand_as(across)
    level = torch.stack((across, up, torch.linalg.cross(across, up)), dim=-1)
    hanging = torch.atan2(-shank[:, 1, 2], shank[:, 1, 1]) + POINTED
    height = knee[:, 1] - (1.0 - ANKLE) * size * shank[:, 1, 1]
    reach = size * math.hypot(ANKLE, TOE_TIP)
    steepest = math.atan2(TOE_TIP, ANKLE) - torch.acos((height / reach).clamp(-1.0, 1.0))
    steepest = torch.where(height < reach, steepest, math.pi)
    pitch = _swing(contact, loop) * hanging
    pitch = pitch - _eased((pitch - steepest).clamp_min(0.0), round(LIFT / frame_time), loop)
    return shank.transpose(-1, -2) @ level @ axis_rotation("X", pitch)


def _eased(excess: Tensor, half: int, loop: bool) -> Tensor:
    """(T,) no less than what is given, and smooth: the largest of neighbours, averaged over as many."""
    values = (excess[:-1] if loop else excess).numpy()
    mode, wide = "wrap" if loop else "nearest", 2 * half + 1
    smooth = uniform_filter1d(maximum_filter1d(values, wide, mode=mode), wide, mode=mode)
    smooth = torch.from_numpy(smooth)
    return torch.cat((smooth, smooth[:1])) if loop else smooth


def _swing(contact: Tensor, loop: bool) -> Tensor:
    """(T,) 0 while a foot stands, 1 in the middle of its swing, without corners between."""
    frames = len(contact)
    if not bool(contact.any()):
        return torch.ones(frames, dtype=torch.float64)
    # Frames of one more repetition on either side tell when the swing began that a loop ends in.
    period = frames - 1 if loop else 0
    stands = contact.nonzero().flatten()
    if loop:
        stands = torch.cat((stands - period, stands, stands + period)).unique()
    times = torch.arange(frames)
    after = torch.searchsorted(stands, times)
    before = torch.searchsorted(stands, times, right=True) - 1
    far = float(frames)
    since = torch.where(before >= 0, (times - stands[before.clamp_min(0)]).double(), far)
    until = torch.where(after < len(stands), (stands[after.clamp_max(len(stands) - 1)] - times).double(), far)
    length = (since + until).clamp_min(1.0)
    share = (torch.minimum(since, until) / (EASE * length)).clamp(0.0, 1.0)
    return share**2 * (3.0 - 2.0 * share)
