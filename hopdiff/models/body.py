"""From genes and sway to the motion channels of the upper body, and from channels to points of the body.

The search needs the centre of mass and the feet only, many thousand times: here they are written out component by
component. `Character.rotations` with `Skeleton.forward` gives the same points and all others.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import Any, NamedTuple

import torch
from torch import Tensor

from hopdiff.channels import CHANGING, ELBOWS, HIPS, KNEES, NECK, PELVIS, SHOULDERS, SIDES, TRUNK, Turn
from hopdiff.character import Character
from hopdiff.physics.legs import knee_offset, leg_reach

Vector = tuple[Any, Any, Any]  # left, up, forward: tensors, or floats for what is fixed in the body


def upper_channels(
    genes: dict[str, Tensor], stride_phase: Tensor, sway: Tensor, side_sway: Tensor, speed: Tensor
) -> dict[str, Tensor]:
    """Trunk, neck and arm channels (P, M).

    stride_phase: (P, M) [rad], 0 at left touchdown, pi at right touchdown. sway, side_sway: (P, M) integrals of the
    balance error forward and to the left [m s]; each joint answers them with its own gain, Kang (1999) eq. (11).
    """
    g = {name: value.unsqueeze(-1) for name, value in genes.items()}
    lean, side = sway / speed.unsqueeze(-1), side_sway / speed.unsqueeze(-1)
    # Each arm swings against the leg of its own side: the left arm is back at left touchdown.
    arm = torch.cos(stride_phase - g["arm_phase"])
    channels = {
        "trunk_lean": g["eta_trunk_lean"] * lean,
        "trunk_side": -g["eta_trunk_side"] * side,
        "neck_flex": g["neck_flex"] + g["eta_neck_flex"] * lean,
        "neck_side": -g["eta_neck_side"] * side,
    }
    shoulder = g["arm_offset"] + g["eta_shoulder"] * lean
    elbow = g["elbow_flexion"] + g["eta_elbow"] * lean
    for name, sign in (("left", 1.0), ("right", -1.0)):
        channels[f"{name}_shoulder"] = shoulder - sign * g["arm_swing"] * arm
        channels[f"{name}_abduction"] = g["arm_abduction"] + sign * g["eta_abduction"] * side
        channels[f"{name}_inward"] = g["arm_inward"].expand_as(stride_phase)
        channels[f"{name}_elbow"] = elbow - sign * g["elbow_swing"] * arm
    return channels


class _Moments(NamedTuple):
    """First moments of the segments about their joints, as shares of the body mass times m; rest-pose axes."""

    pelvis: tuple[float, float, float]
    waist: tuple[float, float, float]  # where the upper body hangs on the pelvis, times its mass share
    trunk: tuple[float, float, float]
    neck: tuple[float, float, float]
    upper_arm: tuple[float, float, float]
    forearm: tuple[float, float, float]
    thigh: tuple[float, float, float]
    shank: tuple[float, float, float]


@lru_cache(maxsize=32)
def _moments(character: Character) -> _Moments:
    skeleton = character.skeleton
    share = (character.masses / character.mass).double().cpu()
    com, offset = character.coms.double().cpu(), skeleton.offsets.double().cpu()
    i = skeleton.index

    def own(name: str) -> Tensor:
        return share[i(name)] * com[i(name)]

    arm_mass = share[i("left_shoulder")] + share[i("left_elbow")]
    upper = share[i("waist")] + share[i("neck")] + 2.0 * arm_mass
    vectors = (
        own("pelvis"),
        upper * offset[i("waist")],
        own("waist")
        + share[i("neck")] * offset[i("neck")]
        # Left and right shoulder mirror each other: their sideways parts cancel.
        + arm_mass * (offset[i("left_shoulder")] + offset[i("right_shoulder")]),
        own("neck"),
        own("left_shoulder") + share[i("left_elbow")] * offset[i("left_elbow")],
        own("left_elbow"),
        own("left_hip") + share[i("left_knee")] * offset[i("left_knee")],
        own("left_knee"),
    )
    return _Moments(*((float(v[0]), float(v[1]), float(v[2])) for v in vectors))


class Angle(NamedTuple):
    """Cosine and sine of an angle, computed once and used for many vectors."""

    cos: Tensor
    sin: Tensor

    @classmethod
    def of(cls, angle: Tensor) -> Angle:
        return cls(torch.cos(angle), torch.sin(angle))

    def about(self, axis: str, v: Vector) -> Vector:
        """A vector turned about one of the axes of `hopdiff.channels`."""
        if axis == "X":
            return v[0], self.cos * v[1] - self.sin * v[2], self.sin * v[1] + self.cos * v[2]
        if axis == "Y":
            return self.cos * v[0] + self.sin * v[2], v[1], self.cos * v[2] - self.sin * v[0]
        return self.cos * v[0] - self.sin * v[1], self.sin * v[0] + self.cos * v[1], v[2]


def _add(*vectors: Vector) -> Vector:
    total = vectors[0]
    for v in vectors[1:]:
        total = (total[0] + v[0], total[1] + v[1], total[2] + v[2])
    return total


def _turned(channels: dict[str, Tensor], turns: Sequence[Turn], v: Vector) -> Vector:
    """A vector of a joint's frame in the frame outside of its turns."""
    angles = [Angle.of(turn.angle(channels)) for turn in turns]
    for turn, angle in zip(reversed(turns), reversed(angles), strict=True):
        v = angle.about(turn.axis, v)
    return v


def lower_centre(character: Character, channels: dict[str, Tensor]) -> Vector:
    """What pelvis, legs and the place of the waist add to the centre of mass, relative to HIP (P, M) each [m]."""
    m = _moments(character)
    own = (m.pelvis[0] + m.waist[0], m.pelvis[1] + m.waist[1], m.pelvis[2] + m.waist[2])
    total = _turned(channels, PELVIS, own)
    for side in SIDES:
        (tilt, hip), (knee,) = HIPS[side], KNEES[side]
        upper = Angle.of(hip.angle(channels)).about(hip.axis, m.thigh)
        # Hip and knee turn about one axis.
        lower = Angle.of(knee.angle(channels) + hip.angle(channels)).about(knee.axis, m.shank)
        total = _add(total, _turned(channels, (tilt,), _add(upper, lower)))
    # The hip joints mirror each other about HIP and carry equal legs: their own places cancel.
    return total


def upper_centre(character: Character, channels: dict[str, Tensor]) -> Vector:
    """What everything above the waist adds to the centre of mass, relative to the waist (P, M) each [m]."""
    m = _moments(character)
    total = _add(m.trunk, _turned(channels, NECK, m.neck))
    for side in SIDES:
        forearm = _turned(channels, ELBOWS[side], m.forearm)
        total = _add(total, _turned(channels, SHOULDERS[side], _add(m.upper_arm, forearm)))
    return _turned(channels, TRUNK, total)


def sway_sensitivity(character: Character, genes: dict[str, Tensor]) -> tuple[Tensor, Tensor]:
    """How far the centre of mass moves per unit of sway times speed, forward and to the left (P,) [m].

    Linear in the gains, at the rest pose: the sum over joints of eta times the moment arm of what hangs on it.
    """
    m = _moments(character)
    arm = -2.0 * (m.upper_arm[1] + m.forearm[1])
    trunk = m.trunk[1] + m.neck[1] - arm
    forward = (
        genes["eta_trunk_lean"] * trunk
        + genes["eta_neck_flex"] * m.neck[1]
        + genes["eta_shoulder"] * arm
        - genes["eta_elbow"] * 2.0 * m.forearm[1]
    )
    sideways = genes["eta_trunk_side"] * trunk + genes["eta_neck_side"] * m.neck[1] + genes["eta_abduction"] * arm
    return forward, sideways


def hip_joint(character: Character, channels: dict[str, Tensor], side: str) -> Vector:
    """Hip joint of one side relative to HIP, the middle between both (P, M) each [m]."""
    half = character.hip_half_width if side == "left" else -character.hip_half_width
    roll, yaw = Angle.of(channels["pelvis_roll"]), Angle.of(channels["pelvis_yaw"])
    return half * roll.cos * yaw.cos, half * roll.sin, -half * roll.cos * yaw.sin


def foot_height(character: Character, channels: dict[str, Tensor], height: Tensor, side: str) -> Tensor:
    """Height of one contact point above the ground (P, M) for a height of HIP [m]."""
    knee = channels[f"{side}_knee"]
    angle = channels[f"{side}_thigh"] - knee_offset(knee, character.thigh, character.shank)
    down = leg_reach(knee, character.thigh, character.shank) * torch.cos(angle) * torch.cos(channels[f"{side}_tilt"])
    found: Tensor = height + hip_joint(character, channels, side)[1] - down
    return found


def mirror(channels: dict[str, Tensor], where: Tensor) -> dict[str, Tensor]:
    """Channels with left and right exchanged at the moments `where` is true."""
    mirrored = {}
    for name in channels:
        twin = name
        if name.startswith("left_"):
            twin = "right_" + name[5:]
        elif name.startswith("right_"):
            twin = "left_" + name[6:]
        other = -channels[twin] if name in CHANGING else channels[twin]
        mirrored[name] = torch.where(where, other, channels[name])
    return mirrored
