"""From genes and sway to the motion channels of the upper body, and from channels to points of the body.

The search needs the centre of mass and the feet only, many thousand times: here they are written out component by
component, left and right at once. `Character.rotations` with `Skeleton.forward` gives the same points and all others.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import Any, NamedTuple

import torch
from torch import Tensor

from hopdiff.channels import CHANGING, ELBOWS, HIPS, KNEES, NECK, PELVIS, SHOULDERS, TRUNK, Turn
from hopdiff.character import Character
from hopdiff.models.trajectory import JOINT_CHANNELS
from hopdiff.numerics import constant
from hopdiff.physics.legs import knee_offset, leg_reach

LOWER = tuple(name for name, _, _ in JOINT_CHANNELS[:8])  # channels of legs and pelvis
UPPER = tuple(name for name, _, _ in JOINT_CHANNELS[8:])  # of everything above the waist

Vector = tuple[Any, Any, Any]  # left, up, forward: tensors, or floats for what is fixed in the body


class Answer(NamedTuple):
    """What the upper body does, in the order of UPPER: angles = base + gains times the sway.

    base: (11, P, M) [rad]. gains: (2, 11, P) of the sway forward and to the left [rad/(m s)]: eta over speed, each
    joint answers it with its own eta, Kang (1999) eq. (11).
    """

    base: Tensor
    gains: Tensor

    @classmethod
    def of(cls, genes: dict[str, Tensor], stride_phase: Tensor, trunk_yaw: Tensor, speed: Tensor) -> Answer:
        """stride_phase: (P, M) [rad], 0 at left touchdown, pi at right touchdown. trunk_yaw: (P, M) [rad]."""
        zero = torch.zeros_like(speed)

        def rows(trunk: tuple[Tensor, ...], *arms: tuple[Tensor, Tensor]) -> Tensor:
            """(11, P) of lean, side, yaw, neck_flex and neck_side, and of left and right arm."""
            return torch.stack((*trunk, *(value for pair in arms for value in pair)))

        def pair(name: str, sign: float = 1.0) -> tuple[Tensor, Tensor]:
            return genes[name], genes[name] if sign > 0 else -genes[name]

        still, none = (zero,) * 5, (zero, zero)
        rest = rows(
            (zero, zero, zero, genes["neck_flex"], zero),
            pair("arm_offset"),
            pair("arm_abduction"),
            pair("elbow_flexion"),
        )
        # Each arm swings against the leg of its own side: the left arm is back at left touchdown.
        swing = rows(still, pair("arm_swing", -1.0), none, pair("elbow_swing", -1.0))
        forward = rows(
            (genes["eta_trunk_lean"], zero, zero, genes["eta_neck_flex"], zero),
            pair("eta_shoulder"),
            none,
            pair("eta_elbow"),
        )
        sideways = rows(
            (zero, -genes["eta_trunk_side"], zero, zero, -genes["eta_neck_side"]),
            none,
            pair("eta_abduction", -1.0),
            none,
        )
        arm = torch.cos(stride_phase - genes["arm_phase"].unsqueeze(-1))
        base = rest.unsqueeze(-1) - swing.unsqueeze(-1) * arm
        yaw = UPPER.index("trunk_yaw")
        base = torch.cat((base[:yaw], trunk_yaw.unsqueeze(0), base[yaw + 1 :]))
        return cls(base, torch.stack((forward, sideways)) / speed)

    def angles(self, sway: Tensor) -> Tensor:
        """(11, P, M) [rad]. sway: (P, 2, M) integrals of the balance error forward and to the left [m s]."""
        (forward, side), (forward_gain, side_gain) = sway.unbind(1), self.gains.unsqueeze(-1).unbind(0)
        return torch.addcmul(torch.addcmul(self.base, forward_gain, forward), side_gain, side)


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

    def of_turn(self, turn: Turn) -> Angle:
        """What a turn with this channel turns by. Pairs (2, P, M) are told by the turn of the left side."""
        if turn.sided:
            signs = constant((turn.sign, -turn.sign), self.sin.dtype, self.sin.device)
            return Angle(self.cos, self.sin * signs[:, None, None])
        return self if turn.sign > 0 else Angle(self.cos, -self.sin)

    def about(self, axis: str, v: Vector) -> Vector:
        """A vector turned about one of the axes of `hopdiff.channels`."""
        if axis == "X":
            return v[0], self.cos * v[1] - self.sin * v[2], self.sin * v[1] + self.cos * v[2]
        if axis == "Y":
            return self.cos * v[0] + self.sin * v[2], v[1], self.cos * v[2] - self.sin * v[0]
        return self.cos * v[0] - self.sin * v[1], self.sin * v[0] + self.cos * v[1], v[2]


def _angles(values: Tensor, names: Sequence[str]) -> dict[str, Angle]:
    """Channels (C, P, M) by name: (P, M), and (2, P, M) of left and right by the name of the left one."""
    kept = [name for name in names if not name.startswith("right_")]
    sizes = [2 if name.startswith("left_") else 1 for name in kept]
    # A split comes back from autograd as one piece; many slices would each come back as a whole.
    parts = (part.split(sizes) for part in (torch.cos(values), torch.sin(values)))
    return {
        name: Angle(cos, sin) if len(cos) == 2 else Angle(cos[0], sin[0])
        for name, cos, sin in zip(kept, *parts, strict=True)
    }


def _add(a: Vector, b: Vector) -> Vector:
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


def _both(pair: Vector) -> Vector:
    """The sum (P, M) of what left and right (2, P, M) add."""
    return pair[0].sum(0), pair[1].sum(0), pair[2].sum(0)


def _turned(angles: dict[str, Angle], turns: Sequence[Turn], v: Vector) -> Vector:
    """A vector of a joint's frame in the frame outside of its turns."""
    for turn in reversed(turns):
        v = angles[turn.channel].of_turn(turn).about(turn.axis, v)
    return v


def lower_centre(character: Character, lower: Tensor, pelvis_tilt: Tensor) -> Vector:
    """What pelvis, legs and the place of the waist add to the centre of mass, relative to HIP (P, M) each [m].

    lower: (8, P, M) in the order of LOWER. pelvis_tilt: (P,) [rad].
    """
    m = _moments(character)
    angles = _angles(lower, LOWER) | {"pelvis_tilt": Angle.of(pelvis_tilt.unsqueeze(-1))}
    pelvis = _turned(angles, PELVIS, _add(m.pelvis, m.waist))
    (tilt, hip), (knee,) = HIPS["left"], KNEES["left"]
    upper = _turned(angles, (hip,), m.thigh)
    # Hip and knee turn about one axis.
    thigh, flexion, _ = lower.split((2, 2, 4))
    bend = knee.sign * flexion + hip.sign * thigh
    shank = Angle.of(bend).about(knee.axis, m.shank)
    # The hip joints mirror each other about HIP and carry equal legs: their own places cancel.
    return _add(pelvis, _both(_turned(angles, (tilt,), _add(upper, shank))))


def upper_centre(character: Character, upper: Tensor, arm_inward: Tensor) -> Vector:
    """What everything above the waist adds to the centre of mass, relative to the waist (P, M) each [m].

    upper: (11, P, M) in the order of UPPER. arm_inward: (P,) [rad].
    """
    m = _moments(character)
    angles = _angles(upper, UPPER) | {"left_inward": Angle.of(arm_inward.unsqueeze(-1))}
    arms = _add(m.upper_arm, _turned(angles, ELBOWS["left"], m.forearm))
    arms = _both(_turned(angles, SHOULDERS["left"], arms))
    return _turned(angles, TRUNK, _add(_add(m.trunk, _turned(angles, NECK, m.neck)), arms))


def sway_sensitivity(character: Character, gains: Tensor) -> Tensor:
    """How far the centre of mass moves per unit of sway, forward and to the left (2, P) [1/s].

    gains: (2, 11, P) of an `Answer`. Linear in them, at the rest pose: the sum over joints of the gain times the moment
    arm of what hangs on it.
    """
    m = _moments(character)
    forearm, arm = -m.forearm[1], -(m.upper_arm[1] + m.forearm[1])
    neck, trunk = m.neck[1], m.trunk[1] + m.neck[1] - 2.0 * arm
    forward = (trunk, 0.0, 0.0, neck, 0.0, arm, arm, 0.0, 0.0, forearm, forearm)
    sideways = (0.0, -trunk, 0.0, 0.0, -neck, 0.0, 0.0, arm, -arm, 0.0, 0.0)
    levers = torch.stack([constant(row, gains.dtype, gains.device) for row in (forward, sideways)])
    return (gains * levers.unsqueeze(-1)).sum(1)


def hip_joint(character: Character, channels: dict[str, Tensor], side: str) -> Vector:
    """Hip joint of one side relative to HIP, the middle between both (P, M) each [m]."""
    half = character.hip_half_width if side == "left" else -character.hip_half_width
    roll, yaw = Angle.of(channels["pelvis_roll"]), Angle.of(channels["pelvis_yaw"])
    return half * roll.cos * yaw.cos, half * roll.sin, -half * roll.cos * yaw.sin


def foot_height(character: Character, lower: Tensor, height: Tensor) -> Tensor:
    """Height of the left and the right contact point above the ground (2, P, M) for a height of HIP (P, M) [m].

    lower: (8, P, M) in the order of LOWER.
    """
    thigh, knee, tilt, roll, _ = lower.split((2, 2, 2, 1, 1))
    angle = thigh - knee_offset(knee, character.thigh, character.shank)
    down = leg_reach(knee, character.thigh, character.shank) * torch.cos(angle) * torch.cos(tilt)
    half = constant((character.hip_half_width, -character.hip_half_width), lower.dtype, lower.device)
    hips = half[:, None, None] * torch.sin(roll)
    return height + hips - down


def by_name(lower: Tensor, upper: Tensor, genes: dict[str, Tensor]) -> dict[str, Tensor]:
    """All channels (P, M) of `hopdiff.channels`. lower, upper: (C, P, M) in the order of LOWER and UPPER."""
    channels = dict(zip((*LOWER, *UPPER), (*lower.unbind(0), *upper.unbind(0)), strict=True))
    constants = {"pelvis_tilt": "pelvis_tilt", "left_inward": "arm_inward", "right_inward": "arm_inward"}
    like = lower[0]
    return channels | {name: genes[gene].unsqueeze(-1).expand_as(like) for name, gene in constants.items()}


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
