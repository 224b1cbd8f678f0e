"""Angles of a body frame by frame, from the places of its joints [deg], and its centre of mass."""

from __future__ import annotations

import numpy as np

from experiments.realism.recording import Array, Recording

SIDES = ("left", "right")
# Share of the body's mass, and place between two points as a share of their distance: de Leva (1996), table 4, male.
# Heads are taken at their joint, feet half-way from ankle to ball, hands at the wrist.
TRUNK, HEAD = (0.4346, 0.5138), 0.0694
LIMBS = {
    ("shoulder", "elbow"): (0.0271, 0.5772),
    ("elbow", "wrist"): (0.0162, 0.4574),
    ("wrist", "wrist"): (0.0061, 0.0),
    ("hip", "knee"): (0.1416, 0.4095),
    ("knee", "ankle"): (0.0433, 0.4459),
    ("ankle", "toe"): (0.0137, 0.5),
}


def other(side: str) -> str:
    return SIDES[1 - SIDES.index(side)]


def mid_hip(recording: Recording) -> Array:
    """(T, 3) [m]"""
    return (recording.point("left_hip") + recording.point("right_hip")) / 2


def forward(recording: Recording, start: float, end: float) -> Array:
    """(3,) level unit vector along the way from one moment [s] to another"""
    way = (place(recording, mid_hip(recording), end) - place(recording, mid_hip(recording), start)) * (1, 0, 1)
    return way / np.linalg.norm(way)


def place(recording: Recording, points: Array, moment: float) -> Array:
    """(3,) where a point (T, 3) is at a moment [s]"""
    return np.array([np.interp(moment, recording.times, points[:, axis]) for axis in range(3)])


def attitude(rod: Array, ahead: Array) -> Array:
    """(T,) angle of a hanging rod (T, 3) from the vertical in the sagittal plane, positive where its end is ahead."""
    return np.degrees(np.unwrap(np.arctan2(rod @ ahead, -rod[:, 1])))


def angles(recording: Recording, ahead: Array) -> dict[str, Array]:
    """Angles (T,) [deg] by name, of somebody who goes the way of `ahead` (3,).

    SIDE_thigh, SIDE_shank, SIDE_arm: attitudes from the vertical, forward positive. SIDE_knee: flexion in the sagittal
    plane. SIDE_foot: toes up positive; of feet whose frame is not level, the line from ankle to ball. SIDE_elbow:
    flexion. pelvis_yaw, thorax_yaw: positive where the left side is ahead. pelvis_roll: positive where the left side
    is high. lean: of the line from mid-hip to neck, forward positive.
    """
    left = np.cross((0.0, 1.0, 0.0), ahead)
    found: dict[str, Array] = {}
    for side in SIDES:
        hip, knee, ankle = (recording.point(f"{side}_{joint}") for joint in ("hip", "knee", "ankle"))
        shoulder, elbow, wrist = (recording.point(f"{side}_{joint}") for joint in ("shoulder", "elbow", "wrist"))
        found[f"{side}_thigh"] = attitude(knee - hip, ahead)
        shank = attitude(ankle - knee, ahead)
        knee_flexion = (found[f"{side}_thigh"] - shank + 180.0) % 360.0 - 180.0
        found[f"{side}_knee"], found[f"{side}_shank"] = knee_flexion, found[f"{side}_thigh"] - knee_flexion
        if recording.level_feet:
            sole = recording.turn(f"{side}_ankle")[..., 2]
        else:
            sole = recording.point(f"{side}_toe") - ankle
        found[f"{side}_foot"] = np.degrees(np.unwrap(np.arctan2(sole[:, 1], sole @ ahead)))
        found[f"{side}_arm"] = attitude(elbow - shoulder, ahead)
        found[f"{side}_elbow"] = between(elbow - shoulder, wrist - elbow)
    for part, joint in (("pelvis", "hip"), ("thorax", "shoulder")):
        line = recording.point(f"left_{joint}") - recording.point(f"right_{joint}")
        found[f"{part}_yaw"] = np.degrees(np.arctan2(line @ ahead, line @ left))
        found[f"{part}_roll"] = np.degrees(np.arcsin(line[:, 1] / np.linalg.norm(line, axis=-1)))
    found["lean"] = attitude(mid_hip(recording) - recording.point("neck"), -ahead)
    return found


def between(first: Array, second: Array) -> Array:
    """(T,) angle between vectors (T, 3) [deg]"""
    lengths = np.linalg.norm(first, axis=-1) * np.linalg.norm(second, axis=-1)
    return np.degrees(np.arccos(np.clip((first * second).sum(axis=-1) / lengths, -1.0, 1.0)))


def centre_of_mass(recording: Recording) -> Array:
    """(T, 3) [m] from the segments of the file; without them, from the shares of a mean body."""
    if recording.centres is not None and recording.masses is not None:
        places = [
            recording.point(segment) + recording.turn(segment) @ centre
            for segment, centre in zip(recording.segments, recording.centres, strict=True)
        ]
        return np.einsum("s,stk->tk", recording.masses / recording.masses.sum(), np.stack(places))
    neck, hips = recording.point("neck"), mid_hip(recording)
    total = TRUNK[0] * (neck + TRUNK[1] * (hips - neck)) + HEAD * recording.point("head")
    weight = TRUNK[0] + HEAD
    for (near, far), (share, place) in LIMBS.items():
        for side in SIDES:
            begin, end = recording.point(f"{side}_{near}"), recording.point(f"{side}_{far}")
            total, weight = total + share * (begin + place * (end - begin)), weight + share
    return total / weight
