"""What is checked: a motion with masses, inertias and contacts, read from a run's NumPy archive.

This study shares no code with what it checks: the reading, the kinematics and the sums of momentum are its own.
World: x left, y up, z forward; SI units.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

Array = NDArray[np.float64]

GRAVITY = 9.81  # m/s^2, as the runs are made with
MARGIN = 5  # frames left out on either side of touchdown and take-off
SIDES = ("left", "right")
NEEDED = ("names", "parents", "offsets", "frame_time", "root_position", "rotations", "contact")
BODY = ("segments", "masses", "centres", "inertias")


class UnfitError(ValueError):
    """A file that cannot be checked; says why."""


@dataclass(frozen=True, eq=False)
class Recording:
    """A motion of T frames, J joints and S segments.

    offsets: (J, 3) of each joint in its parent's frame [m], or (T, J, 3) where joints move against their parents.
    ends: end points by joint, in its frame (3,) [m]. root: (T, 3) [m]. rotations: (T, J, 3, 3), each in its parent's
    frame. contact: (T, 2) left and right foot on the ground. segments: the joint that carries each segment; masses (S,)
    [kg], centres (S, 3) of mass in the joint's frame [m], inertias (S, 3, 3) about them in its axes [kg m^2].
    force: (T, 2, 3) of the ground on each foot [N]; cop: (T, 2, 3) where it acts [m]. heel: (3,) in the ankle's frame
    [m]. feet: (T, 2, 3) contact points [m]. com, positions: (T, 3), (T, J, 3) as the file has them [m]. What is not
    known is None. margin: frames left out on either side of touchdown and take-off.
    """

    name: str
    names: tuple[str, ...]
    parents: tuple[int, ...]
    offsets: Array
    ends: Mapping[str, Array]
    frame_time: float
    loop: bool
    root: Array
    rotations: Array
    contact: NDArray[np.bool_]
    segments: tuple[str, ...]
    masses: Array
    centres: Array
    inertias: Array
    force: Array | None = None
    cop: Array | None = None
    heel: Array | None = None
    feet: Array | None = None
    com: Array | None = None
    positions: Array | None = None
    numbers: Mapping[str, Any] = field(default_factory=dict)
    margin: int = MARGIN

    @property
    def frames(self) -> int:
        return len(self.root)

    @property
    def mass(self) -> float:
        return float(self.masses.sum())

    @property
    def travel(self) -> Array:
        """(3,) how far a stride of a loop gets, straight ahead [m]."""
        return np.array([0.0, 0.0, self.root[-1, 2] - self.root[0, 2]])


def read_recording(path: Path) -> Recording:
    """The motion in a NumPy archive of hopdiff's. Raises UnfitError for a file without what the check needs."""
    try:
        with np.load(path, allow_pickle=False) as file:
            arrays = {name: file[name] for name in file.files}
    except (OSError, ValueError, EOFError) as error:
        raise UnfitError(f"{path.name} is no NumPy archive") from error
    if missing := [name for name in (*NEEDED, *BODY) if name not in arrays]:
        raise UnfitError(f"{path.name} has no {', '.join(missing)}")
    names = tuple(str(name) for name in arrays["names"])
    frames = len(arrays["root_position"])
    if unknown := {str(name) for name in arrays["segments"]} - set(names):
        raise UnfitError(f"{path.name} has segments on joints that it does not have: {', '.join(sorted(unknown))}")

    def known(name: str) -> Array | None:
        return arrays[name].astype(np.float64) if name in arrays else None

    contact = arrays["contact"] > 0.5
    if loop := bool(arrays.get("loop", False)):
        contact[-1] = contact[0]  # the same moment, one stride on
    ends = zip(arrays.get("end_names", ()), arrays.get("ends", ()), strict=True)
    return Recording(
        name=path.parent.name if path.stem in ("motion", "joints") else path.stem,
        names=names,
        parents=tuple(int(parent) for parent in arrays["parents"]),
        offsets=arrays.get("moving_offsets", arrays["offsets"]).astype(np.float64),
        ends={str(name): end.astype(np.float64) for name, end in ends},
        frame_time=float(arrays["frame_time"]),
        loop=loop,
        root=arrays["root_position"].astype(np.float64),
        rotations=matrices(arrays["rotations"]).reshape(frames, len(names), 3, 3),
        contact=contact,
        segments=tuple(str(name) for name in arrays["segments"]),
        masses=arrays["masses"].astype(np.float64),
        centres=arrays["centres"].astype(np.float64),
        inertias=arrays["inertias"].astype(np.float64)[:, :, None] * np.eye(3),
        force=known("force"),
        cop=known("cop"),
        heel=known("heel"),
        feet=known("feet"),
        com=known("com"),
        positions=known("positions"),
        numbers=json.loads(str(arrays["numbers"])) if "numbers" in arrays else {},
    )


def matrices(quaternions: Array) -> Array:
    """(N, 3, 3) rotations of quaternions x y z w (..., 4), in order."""
    return Rotation.from_quat(quaternions.reshape(-1, 4)).as_matrix()


def world(recording: Recording) -> tuple[Array, Array]:
    """Joints in the world (T, J, 3) [m], and how each of them is turned there (T, J, 3, 3)."""
    places = np.empty((recording.frames, len(recording.names), 3))
    turns = np.empty((recording.frames, len(recording.names), 3, 3))
    for joint, parent in enumerate(recording.parents):
        if parent < 0:
            places[:, joint], turns[:, joint] = recording.root, recording.rotations[:, joint]
            continue
        offset = np.broadcast_to(recording.offsets[..., joint, :], (recording.frames, 3))
        places[:, joint] = places[:, parent] + carried(turns[:, parent], offset)
        turns[:, joint] = turns[:, parent] @ recording.rotations[:, joint]
    return places, turns


def carried(turns: Array, vectors: Array) -> Array:
    """Vectors (..., 3) of turned frames (..., 3, 3), in the world."""
    return np.einsum("...ij,...j->...i", turns, np.broadcast_to(vectors, turns.shape[:-1]))
