"""Motions as they lie in files, read and put into the world by this study's own means: NPZ archives and BVH files."""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

AXES = {"x": 0, "y": 1, "z": 2}
UNITS = (1.0, 0.01, 0.001, 0.0254, 0.0254 / 0.45)  # m; the last one of the CMU database
LEG = 0.85  # m, thigh and shank of a grown person, to tell the unit of a file by
# Joints of captured files by the names that are used here.
CAPTURED = {"Hips": "pelvis", "Neck": "neck", "Head": "head"} | {
    f"{side.title()}{theirs}": f"{side}_{ours}"
    for side in ("left", "right")
    for theirs, ours in (
        *(("UpLeg", "hip"), ("Leg", "knee"), ("Foot", "ankle"), ("ToeBase", "toe")),
        *(("Arm", "shoulder"), ("ForeArm", "elbow"), ("Hand", "wrist")),
    )
}


@dataclass(frozen=True, eq=False)
class Recording:
    """A motion of T frames and J joints in the world: x left, y up, z forward.

    positions: (T, J, 3) [m]. turns: (T, J, 3, 3) from each joint's frame to the world. frame_time [s].
    level_feet: whether the z axis of an ankle's frame is level when the foot is. contact: (T, 2) bool, left first.
    force: (T, 2, 3) on each foot [N]. cop: (T, 2, 3) [m]. segments: of masses (S,) [kg] and centres (S, 3) [m] in the
    frame of the joint of that name. stored: (T, J, 3) positions as the file has them, to compare with. numbers: what
    the file says about itself. What a file does not say is None.
    """

    name: str
    names: tuple[str, ...]
    positions: Array
    turns: Array
    frame_time: float
    level_feet: bool
    contact: NDArray[np.bool_] | None = None
    force: Array | None = None
    cop: Array | None = None
    segments: tuple[str, ...] = ()
    masses: Array | None = None
    centres: Array | None = None
    stored: Array | None = None
    numbers: dict[str, Any] = field(default_factory=dict)

    @property
    def times(self) -> Array:
        """(T,) [s]"""
        return np.arange(len(self.positions)) * self.frame_time

    def point(self, joint: str) -> Array:
        """(T, 3) place of a joint [m]"""
        return self.positions[:, self._index(joint)]

    def turn(self, joint: str) -> Array:
        """(T, 3, 3) frame of a joint"""
        return self.turns[:, self._index(joint)]

    def _index(self, joint: str) -> int:
        if joint not in self.names:
            raise ValueError(f"{self.name}: has no joint {joint}")
        return self.names.index(joint)


def read(path: Path) -> Recording:
    """A motion from a file. Raises ValueError for an ending that is not known here."""
    readers = {".npz": read_npz, ".bvh": read_bvh}
    if path.suffix.lower() not in readers:
        raise ValueError(f"{path.name}: neither .npz nor .bvh")
    return readers[path.suffix.lower()](path)


def read_npz(path: Path) -> Recording:
    """An archive with names, parents, offsets, root_position, rotations (x y z w) and frame_time."""
    with np.load(path, allow_pickle=False) as file:
        data = {name: file[name] for name in file.files}
    names = tuple(str(name) for name in data["names"])
    offsets = data.get("moving_offsets", np.broadcast_to(data["offsets"], (len(data["rotations"]), len(names), 3)))
    positions, turns = placed(data["parents"], offsets, data["root_position"], matrices(data["rotations"]))
    return Recording(
        path.stem,
        names,
        positions,
        turns,
        float(data["frame_time"]),
        level_feet=True,
        contact=data["contact"].astype(bool) if "contact" in data else None,
        force=force_of(data),
        cop=data.get("cop"),
        segments=tuple(str(name) for name in data.get("segments", ())),
        masses=data.get("masses"),
        centres=data.get("centres"),
        stored=data.get("positions"),
        numbers=json.loads(str(data["numbers"])) if "numbers" in data else {},
    )


def force_of(data: dict[str, Any]) -> Array | None:
    """(T, 2, 3) [N]; of archives that know only its upward part, with nothing else."""
    if "force" in data or "ground_force" not in data:
        return data.get("force")
    return np.stack(
        [np.zeros_like(data["ground_force"]), data["ground_force"], np.zeros_like(data["ground_force"])], -1
    )


def matrices(quaternions: Array) -> Array:
    """(..., 3, 3) of (..., 4) quaternions x y z w."""
    x, y, z, w = np.moveaxis(quaternions / np.linalg.norm(quaternions, axis=-1, keepdims=True), -1, 0)
    rows = (
        (1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)),
        (2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)),
        (2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)),
    )
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def placed(parents: Any, offsets: Array, root: Array, local: Array) -> tuple[Array, Array]:
    """World positions (T, J, 3) and frames (T, J, 3, 3) of joints, each turned against its parent by `local`."""
    positions, turns = np.zeros(local.shape[:3]), np.zeros(local.shape)
    for joint, parent in enumerate(parents):
        if parent < 0:
            positions[:, joint], turns[:, joint] = root, local[:, joint]
        else:
            step = (turns[:, parent] @ offsets[:, joint, :, None])[..., 0]
            positions[:, joint], turns[:, joint] = positions[:, parent] + step, turns[:, parent] @ local[:, joint]
    return positions, turns


def read_bvh(path: Path) -> Recording:
    """A BVH file that points its y axis up; its unit is told by the length of the legs."""
    head, _, motion = path.read_text(encoding="utf-8").partition("MOTION")
    names, parents, offsets, channels = hierarchy(head.split())
    words = motion.split()
    frames, frame_time = int(words[1]), float(words[4])
    values = np.array(words[5:], dtype=np.float64).reshape(frames, -1)
    local = np.broadcast_to(np.eye(3), (frames, len(names), 3, 3)).copy()
    root = np.broadcast_to(offsets[0], (frames, 3)).copy()
    column = 0
    for joint, owned in enumerate(channels):
        for channel in owned:
            if channel.endswith("rotation"):
                local[:, joint] = local[:, joint] @ about(AXES[channel[0]], np.radians(values[:, column]))
            elif joint == 0:
                root[:, AXES[channel[0]]] = values[:, column]
            column += 1
    own = {CAPTURED.get(name, name): index for index, name in enumerate(names)}
    leg = sum(float(np.linalg.norm(offsets[own[part]])) for part in ("left_knee", "left_ankle"))
    unit = min(UNITS, key=lambda one: abs(np.log(one * leg / LEG)))
    many = np.broadcast_to(offsets, (frames, len(names), 3))
    positions, turns = placed(parents, many * unit, root * unit, local)
    return Recording(path.stem, tuple(own), positions, turns, frame_time, level_feet="left_ankle" in names)


def hierarchy(words: list[str]) -> tuple[list[str], list[int], Array, list[list[str]]]:
    """Joints of a BVH file in order: names, parents (-1 of the root), offsets (J, 3), channels in small letters."""
    names: list[str] = []
    parents: list[int] = []
    offsets: list[list[float]] = []
    channels: list[list[str]] = []
    open_joints: list[int] = []  # -1 stands for the end of a limb, which is no joint
    place = 0
    while place < len(words):
        word = words[place]
        if word in ("ROOT", "JOINT"):
            parents.append(open_joints[-1] if open_joints else -1)
            open_joints.append(len(names))
            names.append(words[place + 1])
        elif word == "End":
            open_joints.append(-1)
        elif word == "}":
            open_joints.pop()
        elif word == "OFFSET" and open_joints[-1] >= 0:
            offsets.append([float(one) for one in words[place + 1 : place + 4]])
        elif word == "CHANNELS":
            count = int(words[place + 1])
            channels.append([one.lower() for one in words[place + 2 : place + 2 + count]])
        place += 1
    return names, parents, np.array(offsets), channels


def about(axis: int, angles: Array) -> Array:
    """(T, 3, 3) turns about a coordinate axis by angles (T,) [rad]."""
    first, second = (axis + 1) % 3, (axis + 2) % 3
    turn = np.broadcast_to(np.eye(3), (len(angles), 3, 3)).copy()
    turn[:, first, first] = turn[:, second, second] = np.cos(angles)
    turn[:, second, first] = np.sin(angles)
    turn[:, first, second] = -np.sin(angles)
    return turn
