"""People who walk and run, made by rule from foot prints, and captured clips where there are any.

The ones that are made stand in for captured clips in every clone; they are not people, but move as such for all that
is looked at here: feet that roll from heel to toe and slide a little, hips that sway, walks that bend, begin and end.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial
from pathlib import Path

import numpy as np
import pytest
import torch
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from hopdiff.geometry.clip import Clip
from hopdiff.geometry.skeleton import Skeleton
from hopdiff.io.bvh import read_bvh, write_bvh

CAPTURED = Path(__file__).resolve().parents[2] / "shared" / "mocap"
Floats = NDArray[np.float64]

# Joints, what they hang on, and where [m]; the left ones are mirrored.
TRUNK = {"Hips": ("", 0.0, 0.0, 0.0), "Spine": ("Hips", 0.0, 0.12, -0.01), "Spine1": ("Spine", 0.0, 0.24, 0.0)}
HEAD = {"Neck": ("Spine1", 0.0, 0.16, 0.0), "Head": ("Neck", 0.0, 0.1, 0.01)}
LEG = {"UpLeg": ("Hips", 0.09, -0.08, 0.0), "Leg": ("UpLeg", 0.0, -0.43, 0.0), "Foot": ("Leg", 0.0, -0.42, 0.0)}
TOE = {"ToeBase": ("Foot", 0.0, -0.07, 0.13)}
ARM = {"Arm": ("Spine1", 0.18, 0.11, 0.0), "ForeArm": ("Arm", 0.27, 0.0, 0.0), "Hand": ("ForeArm", 0.24, 0.0, 0.0)}
ENDS = {
    "Spine1": (0.0, 0.22, 0.02),
    "Head": (0.0, 0.18, 0.01),
    "Foot": (0.0, -0.05, 0.1),
    "ToeBase": (0.0, -0.01, 0.06),
    "Hand": (0.15, 0.0, 0.0),
}
HEEL, BALL = np.array([0.0, -0.09, -0.05]), np.array([0.0, -0.09, 0.13])  # of the sole, from the ankle [m]
HIP, THIGH, SHANK = np.array(LEG["UpLeg"][1:]), 0.43, 0.42


@dataclass(frozen=True)
class Gait:
    """How someone goes. speed [m/s]; stride: seconds of one; duty: share of it that a foot stands; facing: of the body
    off its way, to the left [degrees]; slide: of a foot while it stands [m]; pelvis: its mean height [m]."""

    speed: float = 1.25
    stride: float = 1.07
    duty: float = 0.62
    facing: float = 0.0
    slide: float = 0.01
    pelvis: float = 0.89
    lift: float = 0.06
    frame_time: float = 1.0 / 30.0
    whole: bool = True  # with toes, neck and head, as against trunk, legs and arms alone


WALK = Gait()
RUN = Gait(speed=2.8, stride=0.74, duty=0.37, pelvis=0.83, lift=0.2, frame_time=1.0 / 120.0)


def body(whole: bool = True) -> Skeleton:
    """22 joints, or 15 that end at feet, hands and the top of the trunk."""
    joints = dict(TRUNK) | (HEAD if whole else {})
    for side, sign in (("Left", 1.0), ("Right", -1.0)):
        for name, (parent, x, y, z) in (LEG | (TOE if whole else {}) | ARM).items():
            joints[side + name] = (parent if parent in TRUNK else side + parent, sign * x, y, z)
    names = tuple(joints)
    parents = tuple(names.index(parent) if parent else -1 for parent, *_ in joints.values())
    ends = {}
    tips = set(names) - {names[parent] for parent in parents if parent >= 0}
    # Where there is no head, the trunk ends between the arms.
    for name in tips | (set() if whole else {"Spine1"}):
        x, y, z = ENDS[name.removeprefix("Left").removeprefix("Right")]
        ends[name] = torch.tensor([-x if name.startswith("Right") else x, y, z], dtype=torch.float64)
    offsets = torch.tensor([place for _, *place in joints.values()], dtype=torch.float64)
    return Skeleton(names, parents, offsets, {name: ends[name] for name in names if name in ends})


@dataclass(frozen=True, eq=False)
class Way:
    """The middle of a body over time, and beyond both ends of the clip: strides made, place on the ground as z + ix
    [m], heading [rad], and the share of the full pace."""

    phase: Floats
    place: NDArray[np.complex128]
    yaw: Floats
    pace: Floats


def way_of(gait: Gait, bends: Sequence[tuple[float, float | None]]) -> tuple[Way, slice]:
    """bends: seconds and degrees a second, or None to stand. Also which frames lie inside the clip."""
    rate = gait.frame_time / gait.stride
    paces: list[Floats] = []
    turns: list[Floats] = []

    def go(pace: Floats, turn: float = 0.0) -> None:
        paces.append(pace)
        turns.append(np.full(len(pace), np.radians(turn) * gait.frame_time))

    around = (2.0 * gait.stride, 0.0)
    first = last = 0
    stood = False
    for k, (seconds, turn) in enumerate([around, *bends, around]):
        last = sum(map(len, paces))
        if turn is None:
            # The last steps bring both feet to the ground.
            strides = rate * sum(pace.sum() for pace in paces)
            left = 0.3 + (0.5 * (gait.duty - 0.5) - strides - 0.3) % 0.5
            slower = np.linspace(1.0, 0.0, round(2.0 * left / rate))
            go(slower * left / rate / slower.sum())
        elif stood:
            go(np.linspace(0.0, 1.0, round(0.7 * gait.stride / gait.frame_time)))
        if k == 1:
            first = sum(map(len, paces))
        count = round(seconds / gait.frame_time)
        go(np.zeros(count)) if turn is None else go(np.ones(count), turn)
        stood = turn is None
    pace = np.concatenate(paces)
    # Bends begin and end softly.
    yaw = np.convolve(np.concatenate(turns), np.ones(9) / 9.0, "same").cumsum()
    place = (gait.speed * gait.frame_time * pace * np.exp(1j * yaw)).cumsum()
    return Way((rate * pace).cumsum(), place - place[first], yaw - yaw[first], pace), slice(first, last)


def turned(axis: str, angle: Floats | float) -> Rotation:
    """[rad]"""
    return Rotation.from_euler(axis, np.atleast_1d(angle)[:, None] if np.ndim(angle) else [angle])


def on_ground(place: NDArray[np.complex128], height: Floats) -> Floats:
    return np.stack((place.imag, height, place.real), axis=-1)


def eased(share: Floats) -> Floats:
    """From 0 to 1 with no speed at the ends."""
    share = share.clip(0.0, 1.0)
    return share**2 * (3.0 - 2.0 * share)


def foot_motion(gait: Gait, way: Way, sign: float) -> tuple[Floats, Rotation, Floats]:
    """Places of one ankle (T, 3) [m], how its foot is turned in the world, and how far its toes are bent [rad]."""
    own = way.phase - (0.0 if sign > 0 else 0.5)
    step, share = np.floor(own), own % 1.0
    stood, swung = share / gait.duty, eased((share - gait.duty) / (1.0 - gait.duty))
    tip, rise = -0.25, 0.75  # rad; toes up when the heel comes down, heel up when the toes leave

    def print_of(step: Floats) -> tuple[NDArray[np.complex128], Floats]:
        """Where and how a foot stands: beside the body as it comes by."""
        middle = step + 0.5 * gait.duty + (0.0 if sign > 0 else 0.5)
        yaw = np.interp(middle, way.phase, way.yaw) + np.radians(gait.facing)
        place = np.interp(middle, way.phase, way.place.real) + 1j * np.interp(middle, way.phase, way.place.imag)
        return place + 1j * sign * 0.09 * np.exp(1j * yaw), yaw

    def ankle(step: Floats, tilt: Floats, slid: Floats) -> Floats:
        """Of a foot that stands on its heel or, tilted forwards, on its ball."""
        place, yaw = print_of(step)
        place = place + gait.slide * slid * np.exp(1j * (yaw - np.radians(gait.facing)))
        flat = on_ground(place, np.full(len(place), -HEEL[1]))
        on = np.where(tilt[:, None] > 0.0, BALL, HEEL)
        facing = turned("y", yaw)
        return flat + facing.apply(on - turned("x", tilt).apply(on))

    tilt = np.where(stood < 0.2, tip * (1.0 - eased(stood / 0.2)), rise * eased((stood - 0.55) / 0.45))
    tilt = np.where(stood < 1.0, tilt, rise + (tip - rise) * swung)
    ends = (
        ankle(step, np.full_like(tilt, rise), np.ones_like(tilt)),
        ankle(step + 1.0, np.full_like(tilt, tip), 0.0 * tilt),
    )
    flying = ends[0] + (ends[1] - ends[0]) * swung[:, None]
    flying[:, 1] += gait.lift * np.sin(np.pi * swung) ** 2
    place = np.where(stood[:, None] < 1.0, ankle(step, tilt, stood), flying)
    (_, yaw), (_, then) = print_of(step), print_of(step + 1.0)
    bent = -tilt.clip(0.0) * np.where(stood < 1.0, 1.0, 1.0 - swung)
    return place, turned("y", yaw + (then - yaw) * swung) * turned("x", tilt), bent


def person(gait: Gait, bends: Sequence[tuple[float, float | None]]) -> Clip:
    way, inside = way_of(gait, bends)
    time = gait.frame_time * np.arange(len(way.phase))
    cycle = 2.0 * np.pi * way.phase
    skeleton = body(gait.whole)
    left = 1j * np.exp(1j * (way.yaw + np.radians(gait.facing)))
    bob = 0.012 if gait.duty > 0.5 else 0.035
    # Lowest in the middle of double support when walking, of each stance when running.
    low = 0.5 * (gait.duty - 0.5) if gait.duty > 0.5 else 0.5 * gait.duty
    height = gait.pelvis - bob * np.cos(2.0 * (cycle - 2.0 * np.pi * low))
    root = on_ground(way.place + 0.02 * np.sin(cycle) * left, height)
    wander = 0.03 * np.sin(1.3 * time) + 0.02 * np.sin(2.9 * time + 1.0)  # so that no stride is quite like another
    turns = {
        "Hips": turned("y", way.yaw + np.radians(gait.facing) + 0.05 * np.sin(cycle)) * turned("x", 0.03 + 0.3 * wander)
    }
    turns["Spine"] = turned("y", -0.04 * np.sin(cycle)) * turned("x", 0.03 + wander)
    turns["Spine1"] = turned("y", -0.06 * np.sin(cycle))
    for side, sign in (("Left", 1.0), ("Right", -1.0)):
        swing = 0.4 * sign * np.cos(cycle) + wander
        turns[side + "Arm"] = turned("x", swing) * turned("z", -1.25 * sign + 0.0 * swing)
        turns[side + "ForeArm"] = turned("y", -sign * (0.5 + 0.2 * np.cos(cycle)))
        ankle, foot, toe = foot_motion(gait, way, sign)
        hip = root + turns["Hips"].apply(HIP * [sign, 1.0, 1.0])
        thigh, shank = leg_turns(hip, ankle, foot)
        turns[side + "UpLeg"] = turns["Hips"].inv() * thigh
        turns[side + "Leg"] = thigh.inv() * shank
        turns[side + "Foot"] = shank.inv() * foot
        turns[side + "ToeBase"] = turned("x", toe)
    straight = Rotation.from_rotvec(np.zeros((len(time), 3)))
    rotations = np.stack([turns.get(name, straight).as_matrix() for name in skeleton.names], axis=1)
    return Clip(skeleton, torch.from_numpy(root[inside]), torch.from_numpy(rotations[inside]), gait.frame_time)


def leg_turns(hip: Floats, ankle: Floats, foot: Rotation) -> tuple[Rotation, Rotation]:
    """Of thigh and shank in the world, with the knee ahead of the line between hip and ankle (T, 3)."""
    reach = ankle - hip
    length = np.linalg.norm(reach, axis=-1, keepdims=True)
    assert length.max() < THIGH + SHANK, f"a leg that is stretched to {length.max():.3f} m"
    down = reach / length
    side = np.cross(-down, foot.apply([0.0, 0.0, 1.0]))
    side /= np.linalg.norm(side, axis=-1, keepdims=True)
    ahead = np.cross(side, -down)
    along = (THIGH**2 - SHANK**2 + length**2) / (2.0 * length)
    knee = hip + along * down + np.sqrt(THIGH**2 - along**2) * ahead

    def frame(up: Floats) -> Rotation:
        up = up / np.linalg.norm(up, axis=-1, keepdims=True)
        return Rotation.from_matrix(np.stack((side, up, np.cross(side, up)), axis=-1))

    return frame(hip - knee), frame(knee - ankle)


AROUND = [(3.0, 0.0), (1.5, 60.0), (2.0, 0.0), (1.5, -60.0), (1.0, 0.0), (2.0, 90.0), (1.5, 0.0), (2.0, -90.0)]
MADE: dict[str, Callable[[], Clip]] = {
    "walk": partial(person, replace(WALK, frame_time=1.0 / 120.0), [(6.0, 0.0)]),
    "walk without toes": partial(
        person, replace(WALK, whole=False, slide=0.03, pelvis=0.915, speed=1.1), [(0.8, None), (3.5, 0.0), (0.8, None)]
    ),
    "walk with a turn": partial(person, WALK, [(0.5, None), (1.5, 0.0), (1.5, 60.0), (1.5, 0.0), (0.5, None)]),
    "walk sideways": partial(
        person, replace(WALK, speed=0.5, stride=1.6, facing=-65.0, whole=False), [(1.0, None), (5.0, 3.0), (1.0, None)]
    ),
    "run": partial(person, RUN, [(2.4, 0.0)]),
    "wander": partial(
        person,
        replace(WALK, stride=1.0713),
        [(1.0, None), *AROUND, (2.0, 30.0), (2.0, -30.0), (1.0, None), *AROUND, (2.0, 0.0), (1.0, None)],
    ),
}


@cache
def made(name: str) -> Clip:
    return MADE[name]()


@cache
def captured(name: str) -> Clip:
    """A captured clip; skips the test where it is not there."""
    return read_bvh(captured_file(name)).clip()


def captured_file(name: str) -> Path:
    file = CAPTURED / f"{name}.bvh"
    if not file.is_file():
        pytest.skip(f"more of the same with {file.name}, which is not part of the project")
    return file


def clip_of(name: str) -> Clip:
    """One that is made, or else a captured one."""
    return made(name) if name in MADE else captured(name)


def file_of(name: str, folder: Path, unit: float = 100.0) -> Path:
    """The same as a file. unit: of the file, in a metre, if it is made."""
    if name not in MADE:
        return captured_file(name)
    path = folder / f"{name.replace(' ', '_')}.bvh"
    write_bvh(path, made(name), "ZYX", unit)
    return path
