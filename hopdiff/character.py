# No `from __future__ import annotations`: Hydra reads the types of the settings classes.
"""The body: joint tree, segment masses, and how motion channels turn into joint rotations.

A character is data (`conf/character/*.yaml`): lengths in body heights, masses in body masses. The physics needs
the eleven joints of Kang (1999, figure 2.1): pelvis (root), waist, neck, and left and right shoulder, elbow, hip
and knee. In the rest pose the body stands straight with hanging arms, faces +z, and has its left side at +x.
"""

import math
from dataclasses import dataclass, field
from typing import Any

import torch
from torch import Tensor

from hopdiff.channels import ELBOWS, HIPS, KNEES, NECK, PELVIS, SHOULDERS, SIDES, TRUNK, Turn
from hopdiff.geometry.rotation import axis_rotation
from hopdiff.geometry.skeleton import Skeleton
from hopdiff.proportions import ProportionSettings, factors_of, grow
from hopdiff.types import HopdiffError

REQUIRED_PARENTS = {
    "pelvis": None,
    "waist": "pelvis",
    "neck": "waist",
    "left_shoulder": "waist",
    "right_shoulder": "waist",
    "left_elbow": "left_shoulder",
    "right_elbow": "right_shoulder",
    "left_hip": "pelvis",
    "right_hip": "pelvis",
    "left_knee": "left_hip",
    "right_knee": "right_hip",
}

SHORTEST, TALLEST, HEAVIEST, THICKEST = 0.01, 100.0, 1e6, 0.1  # m, m, kg, and body heights of soles
LIMITED = ("hip", "knee", "shoulder", "elbow", "waist", "neck")


@dataclass
class SegmentSettings:
    """The body part that moves with a joint.

    mass: share of the body mass. com: centre of mass in the joint's frame [body heights].
    gyration: radii of gyration about the centre of mass for the left (x), up (y) and forward (z) axes [body heights].
    """

    mass: float = 0.0
    com: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])
    gyration: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])


@dataclass
class JointSettings:
    """One joint. offset: position in the parent's frame [body heights]; end: end point if it has no children."""

    parent: str | None = None
    offset: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])
    end: list[float] | None = None
    segment: SegmentSettings = field(default_factory=SegmentSettings)


@dataclass
class CharacterSettings:
    """A body. height: unit of all lengths, what the unchanged body measures [m]. mass [kg]. shoe: thickness of soles
    [height]. proportions: how it is changed. joint_limits_deg: flexion range (low, high) by joint kind."""

    name: str
    height: float
    mass: float
    proportions: ProportionSettings
    source: str = ""
    shoe: float = 0.0
    joints: dict[str, JointSettings] = field(default_factory=dict)
    joint_limits_deg: dict[str, list[float]] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class Character:
    """A body in SI units, ready for physics.

    height: from sole to crown, standing [m].
    masses: (J,) [kg]. coms, gyrations: (J, 3) centre of mass in the joint's frame, radii of gyration about it [m].
    inertias: (J, 3) moment of inertia of everything that hangs on a joint, body straight, about the joint's
    left, up and forward axes [kg m^2]. limits: flexion range by joint kind [rad].
    """

    name: str
    height: float
    mass: float
    skeleton: Skeleton
    masses: Tensor
    coms: Tensor
    gyrations: Tensor
    inertias: Tensor
    limits: dict[str, tuple[float, float]]
    thigh: float
    shank: float
    hip_half_width: float
    shoe: float = 0.0

    @property
    def leg_length(self) -> float:
        """Length of the straight leg from hip joint to contact point [m]."""
        return self.thigh + self.shank

    @classmethod
    def build(
        cls, settings: Any, dtype: torch.dtype = torch.float64, device: torch.device | str = "cpu"
    ) -> "Character":
        """Check the settings (a `CharacterSettings` or its config) and turn them into tensors.

        Raises HopdiffError, naming the joint, for a missing or unknown joint, a cycle or two roots in the tree, a
        mass or length that is not positive, masses that do not add up, or a vector without three finite numbers.
        """
        where = f"character {settings.name!r}"
        if not _positive(settings.height):
            raise HopdiffError(f"{where}: height must be a positive number of metres, not {settings.height}.")
        if not _positive(settings.mass):
            raise HopdiffError(f"{where}: mass must be a positive number of kilograms, not {settings.mass}.")
        if not (math.isfinite(settings.shoe) and 0.0 <= settings.shoe <= THICKEST):
            raise HopdiffError(f"{where}: shoe must lie between 0 and {THICKEST:g} body heights, not {settings.shoe}.")
        if settings.height < SHORTEST:
            raise HopdiffError(f"{where}: height must be at least {SHORTEST:g} m, not {settings.height}.")
        if settings.height > TALLEST or settings.mass > HEAVIEST:
            raise HopdiffError(f"{where}: height and mass must not be above {TALLEST:g} m and {HEAVIEST:g} kg.")
        joints = dict(settings.joints)
        order = _tree_order(joints, where)
        for name, parent in REQUIRED_PARENTS.items():
            if name not in joints:
                raise HopdiffError(f"{where}: the joint {name!r} is missing.")
            if joints[name].parent != parent:
                raise HopdiffError(f"{where}: joint {name!r} must have the parent {parent!r}.")
        extra = [name for name in joints if name not in REQUIRED_PARENTS]
        if extra:
            raise HopdiffError(f"{where}: unknown joint {extra[0]!r}; known are {', '.join(REQUIRED_PARENTS)}.")

        scale = float(settings.height)
        factors = factors_of(settings.proportions, order)
        offsets = torch.tensor([_vector(joints[n].offset, f"{where}, {n}.offset") for n in order], dtype=torch.float64)
        coms, gyration = (
            torch.tensor(
                [_vector(getattr(joints[n].segment, what), f"{where}, {n}.segment.{what}") for n in order],
                dtype=torch.float64,
            )
            for what in ("com", "gyration")
        )
        shares = []
        for name in order:
            share = joints[name].segment.mass
            if not (isinstance(share, int | float) and math.isfinite(share) and share > 0):
                raise HopdiffError(f"{where}: the mass of {name!r} must be a positive share of the body, not {share}.")
            shares.append(float(share))
        if abs(sum(shares) - 1.0) > 0.01:
            raise HopdiffError(f"{where}: the segment masses must add up to 1, not {sum(shares):.4g}.")
        ends = {}
        for name in order:
            has_child = any(joints[other].parent == name for other in order)
            if not has_child:
                if joints[name].end is None:
                    raise HopdiffError(f"{where}: joint {name!r} has no children and needs an `end` point.")
                end = _vector(joints[name].end, f"{where}, {name}.end")
                ends[name] = torch.tensor(end, dtype=torch.float64) * scale
        parents = tuple(-1 if joints[n].parent is None else order.index(joints[n].parent) for n in order)
        sizes = torch.tensor(factors, dtype=torch.float64)
        offsets, ends = grow(offsets * scale, ends, order, parents, sizes)
        coms, gyration = coms * scale * sizes[:, None], gyration * scale * sizes[:, None]
        masses = torch.tensor(shares, dtype=torch.float64) * sizes
        masses = masses / masses.sum() * float(settings.mass)
        skeleton = Skeleton(tuple(order), parents, offsets, ends)

        thigh = float(offsets[order.index("left_knee")].norm())
        shank = float(ends["left_knee"].norm())
        half_width = float(offsets[order.index("left_hip")][0])
        for name, value in (("thigh (left_knee.offset)", thigh), ("shank (left_knee.end)", shank)):
            if value <= 0:
                raise HopdiffError(f"{where}: the {name} must have a positive length.")
        if half_width <= 0:
            raise HopdiffError(f"{where}: left_hip.offset must point to the left (+x).")
        for joint in ("hip", "knee", "shoulder", "elbow"):
            left, right = offsets[order.index(f"left_{joint}")], offsets[order.index(f"right_{joint}")]
            if not torch.allclose(left * torch.tensor([-1.0, 1.0, 1.0]), right, atol=1e-9):
                raise HopdiffError(f"{where}: left_{joint} and right_{joint} must mirror each other.")
        limits = _limits(settings.joint_limits_deg, where)
        inertias = _distal_inertia(skeleton, masses, coms, gyration)
        ends = {name: point.to(device, dtype) for name, point in ends.items()}
        return cls(
            name=settings.name,
            height=_standing_height(skeleton),
            mass=float(settings.mass),
            skeleton=Skeleton(skeleton.names, parents, offsets.to(device, dtype), ends),
            masses=masses.to(device, dtype),
            coms=coms.to(device, dtype),
            gyrations=gyration.to(device, dtype),
            inertias=inertias.to(device, dtype),
            limits=limits,
            thigh=thigh,
            shank=shank,
            hip_half_width=half_width,
            shoe=float(settings.shoe) * scale,
        )

    def rotations(self, channels: dict[str, Tensor]) -> Tensor:
        """Joint rotations (..., J, 3, 3) from motion channels (...) [rad].

        Midline channels: pelvis_tilt (forward), pelvis_roll (to the right), pelvis_yaw (to the left), the attitude
        of the pelvis in the world; trunk_lean (forward), trunk_side (right), trunk_yaw (left), the attitude of the
        trunk in the world; neck_flex, neck_side, relative to the trunk with its yaw undone.
        Per side: left_thigh and right_thigh (attitude of the thigh from the vertical, forward positive), *_tilt
        (foot to the left), *_knee; *_shoulder (forward), *_abduction (outward), *_inward (turn of the upper arm
        about its own axis, forearm to the inside), *_elbow.
        """
        pelvis, trunk = _turned(channels, PELVIS), _turned(channels, TRUNK)
        to_pelvis = pelvis.transpose(-1, -2)
        parts = {"pelvis": pelvis, "waist": to_pelvis @ trunk, "neck": _turned(channels, NECK)}
        for side in SIDES:
            parts[f"{side}_shoulder"] = _turned(channels, SHOULDERS[side])
            parts[f"{side}_elbow"] = _turned(channels, ELBOWS[side])
            parts[f"{side}_hip"] = _turned(channels, HIPS[side], to_pelvis)
            parts[f"{side}_knee"] = _turned(channels, KNEES[side])
        return torch.stack([parts[name] for name in self.skeleton.names], dim=-3)

    def centre_of_mass(self, positions: Tensor, orientations: Tensor) -> Tensor:
        """(..., 3) centre of mass [m], Kang (1999) equation (8), from what forward kinematics gave."""
        centres = positions + (orientations @ self.coms.to(orientations).unsqueeze(-1)).squeeze(-1)
        return (centres * (self.masses / self.mass).unsqueeze(-1)).sum(-2)


def _turned(channels: dict[str, Tensor], turns: tuple[Turn, ...], inside: Tensor | None = None) -> Tensor:
    """Rotations (..., 3, 3): `inside` and then one turn after the other."""
    found = inside
    for turn in turns:
        step = axis_rotation(turn.axis, turn.angle(channels))
        found = step if found is None else found @ step
    assert found is not None
    return found


def _standing_height(skeleton: Skeleton) -> float:
    """From the ground to the crown in the rest pose [m]."""
    still = torch.eye(3, dtype=skeleton.offsets.dtype).expand(len(skeleton.names), 3, 3)
    ends = skeleton.end_positions(*skeleton.forward(skeleton.offsets[0], still))
    return float(ends["neck"][1])


def _positive(value: Any) -> bool:
    return isinstance(value, int | float) and math.isfinite(value) and value > 0


def _vector(value: Any, where: str) -> list[float]:
    numbers = list(value) if value is not None else []
    if len(numbers) != 3 or not all(isinstance(x, int | float) and math.isfinite(x) for x in numbers):
        raise HopdiffError(f"{where} must be three finite numbers, not {numbers}.")
    return [float(x) for x in numbers]


def _tree_order(joints: dict[str, Any], where: str) -> list[str]:
    """Joint names, parents before children."""
    roots = [name for name, joint in joints.items() if joint.parent is None]
    for name, joint in joints.items():
        if joint.parent is not None and joint.parent not in joints:
            raise HopdiffError(f"{where}: the parent {joint.parent!r} of joint {name!r} is missing.")
    for name in joints:
        seen, current = {name}, joints[name].parent
        while current is not None:
            if current in seen:
                raise HopdiffError(f"{where}: the joint tree has a cycle through {current!r}.")
            seen.add(current)
            current = joints[current].parent
    if len(roots) > 1:
        raise HopdiffError(f"{where}: {roots[1]!r} is a second root besides {roots[0]!r}.")
    order: list[str] = []

    def visit(name: str) -> None:
        order.append(name)
        for child, joint in joints.items():
            if joint.parent == name:
                visit(child)

    for root in roots:
        visit(root)
    return order


def _limits(degrees: Any, where: str) -> dict[str, tuple[float, float]]:
    limits = {}
    for kind in LIMITED:
        if kind not in degrees:
            raise HopdiffError(f"{where}: joint_limits_deg lacks {kind!r}.")
        ends = [float(x) for x in degrees[kind]]
        low, high = ends if len(ends) == 2 else (math.nan, math.nan)
        if not low < high:
            raise HopdiffError(f"{where}: joint_limits_deg.{kind} must be [low, high] with low < high.")
        limits[kind] = (math.radians(low), math.radians(high))
    return limits


def _distal_inertia(skeleton: Skeleton, masses: Tensor, coms: Tensor, gyration: Tensor) -> Tensor:
    """(J, 3) moment of inertia about each joint's axes of all segments beyond it, body straight."""
    identity = torch.eye(3, dtype=torch.float64).expand(len(skeleton.names), 3, 3)
    positions, _ = skeleton.forward(torch.zeros(3, dtype=torch.float64), identity)
    own = masses.unsqueeze(-1) * gyration**2
    inertia = torch.zeros(len(skeleton.names), 3, dtype=torch.float64)
    for joint in range(len(skeleton.names)):
        for distal in range(joint, len(skeleton.names)):
            if joint in (distal, *skeleton.above(distal)):
                arm = positions[distal] + coms[distal] - positions[joint]
                inertia[joint] += own[distal] + masses[distal] * (arm @ arm - arm**2)
    return inertia
