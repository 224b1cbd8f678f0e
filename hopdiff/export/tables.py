"""Motions as tables of numbers: CSV for spreadsheets and statistics, NPZ for NumPy; and NPZ read again.

Columns of a CSV file, one row a frame; World axes: x to the left of the first heading, y up, z forward.

    frame, time                                 number from 0; s
    JOINT.x JOINT.y JOINT.z                     place of every joint in the world, m
    JOINT.qx JOINT.qy JOINT.qz JOINT.qw         its rotation against its parent (the root's: in the world), quaternion
    com.x com.y com.z                           centre of mass, m
    left.contact right.contact                  1 while the foot stands, else 0
    left_foot.x ... right_foot.z                contact point of each foot, m
    left_force.x ... right_force.z              ground force on each foot, N
    left.leg_force right.leg_force              force along the leg, N
    left.ground_force right.ground_force        its vertical part, with which the foot presses on the ground, N

What is not known of a motion (of a captured clip: masses and forces) has no columns.
"""

from __future__ import annotations

import json
import math
import os
from dataclasses import replace
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from hopdiff.export.anatomy import parts_of
from hopdiff.export.take import Segments, Take
from hopdiff.geometry.clip import Clip
from hopdiff.geometry.quaternion import from_quaternions, quaternions
from hopdiff.geometry.skeleton import Skeleton
from hopdiff.io.files import write_whole
from hopdiff.io.record import finite, write_table
from hopdiff.types import HopdiffError

SIDES = ("left", "right")
DIGITS = 9  # significant ones of a number in a CSV file


def write_csv(path: Path, take: Take) -> None:
    """Write a take as a CSV file, whole or not at all. Raises HopdiffError if it cannot be written."""
    clip = take.clip
    frames = np.arange(take.frames)
    names, columns = ["frame", "time"], [frames[:, None].astype(float), (frames * clip.frame_time)[:, None]]
    places, turns = clip.joint_positions().numpy(), quaternions(clip.rotations).numpy()
    for joint, name in enumerate(clip.skeleton.names):
        names += [f"{name}.{axis}" for axis in ("x", "y", "z", "qx", "qy", "qz", "qw")]
        columns += [places[:, joint], turns[:, joint]]
    for entry, what in (("com", "com"), ("feet", "{}_foot"), ("force", "{}_force")):
        if (values := getattr(take, entry)) is not None:
            owners = ("",) if entry == "com" else SIDES
            names += [f"{what.format(owner)}.{axis}" for owner in owners for axis in "xyz"]
            columns.append(values.reshape(take.frames, -1).numpy())
    by_leg = {"contact": take.contact, "leg_force": take.leg_force, "ground_force": ground_force(take)}
    for what, known in by_leg.items():
        if known is not None:
            names += [f"{side}.{what}" for side in SIDES]
            columns.append(known.double().numpy())
    rows = np.concatenate(columns, axis=-1)
    write_table(path, names, ([_short(value) for value in row] for row in rows.tolist()))


def write_npz(path: Path, take: Take) -> None:
    """Write a take as a NumPy archive, whole or not at all; `read_npz` gives the same motion again.

    Arrays (T frames, J joints): names (J,), parents (J,; -1 of the root), offsets (J, 3) of each joint in its parent's
    frame [m], end_names and ends (E, 3) [m]; frame_time [s], loop; root_position (T, 3) [m], rotations (T, J, 4) x y z
    w, each in its parent's frame, positions (T, J, 3) in the world [m]; where joints move against their parents
    moving_offsets (T, J, 3) [m]; where known contact (T, 2), feet (T, 2, 3) [m], com (T, 3) [m], leg_force and
    ground_force (T, 2) [N], force and cop (T, 2, 3), the ground force on each foot [N] and its centre of pressure [m];
    of the body's rigid segments (S) segments: the joints that carry them, masses (S,) [kg], centres (S, 3) of mass in
    the joints' frames [m], inertias (S, 3) principal moments along the frames' axes [kg m^2]; heel (3,) from the ankle
    of a level foot [m]; parts, part_masses: of the character's eleven parts. name, numbers: as JSON text. Left comes
    first.
    Raises HopdiffError if the file cannot be written.
    """
    clip = take.clip
    arrays: dict[str, Any] = {
        "name": np.array(take.name),
        "names": np.array(clip.skeleton.names),
        "parents": np.array(clip.skeleton.parents),
        "offsets": clip.skeleton.offsets.numpy(),
        "end_names": np.array(list(clip.skeleton.end_sites), dtype=str),
        "ends": torch.stack([*clip.skeleton.end_sites.values()]).numpy()
        if clip.skeleton.end_sites
        else np.zeros((0, 3)),
        "frame_time": np.array(clip.frame_time),
        "loop": np.array(take.loop),
        "root_position": clip.root_position.numpy(),
        "rotations": quaternions(clip.rotations).numpy(),
        "positions": clip.joint_positions().numpy(),
        "numbers": np.array(json.dumps(finite(take.numbers), allow_nan=False)),
    }
    known = {
        "moving_offsets": clip.offsets,
        "contact": take.contact,
        "feet": take.feet,
        "com": take.com,
        "leg_force": take.leg_force,
        "ground_force": ground_force(take),
        "force": take.force,
        "cop": take.cop,
    }
    arrays |= {name: values.numpy() for name, values in known.items() if values is not None}
    if take.masses is not None:
        arrays |= {"parts": np.array(list(take.masses)), "part_masses": np.array(list(take.masses.values()))}
    if (body := take.segments) is not None:
        arrays |= {"segments": np.array(body.joints), "masses": body.masses.detach().double().cpu().numpy()}
        arrays |= {name: getattr(body, name).detach().double().cpu().numpy() for name in ("centres", "inertias")}
        if body.heel is not None:
            arrays["heel"] = body.heel.detach().double().cpu().numpy()
    data = BytesIO()
    np.savez_compressed(data, **arrays)
    write_whole(path, data.getvalue())


def read_npz(path: str | os.PathLike[str]) -> Take:
    """A take that `write_npz` wrote. Raises HopdiffError, naming the file, for anything else."""
    try:
        data = Path(path).read_bytes()
    except OSError as error:
        raise HopdiffError(f"cannot read {path}: {(error.strerror or str(error)).lower()}.") from error
    try:
        with np.load(BytesIO(data), allow_pickle=False) as file:
            arrays = {name: file[name] for name in file.files}
    except Exception as error:  # damaged archives end in errors of NumPy, zipfile, zlib, tokenize and others
        raise HopdiffError(f"cannot read {path}: not a NumPy archive of a motion.") from error
    try:
        take = _take(arrays)
    except (KeyError, ValueError, IndexError, TypeError, RuntimeError) as error:
        raise HopdiffError(f"{path} does not hold a motion of hopdiff's ({type(error).__name__}: {error}).") from error
    values = (take.clip.root_position, take.clip.rotations, take.clip.skeleton.offsets)
    if not all(bool(torch.isfinite(one).all()) for one in values) or not take.clip.frame_time > 0.0:
        raise HopdiffError(f"{path} holds a number that is not finite, or a frame time that is not positive.")
    return take


def _take(arrays: dict[str, NDArray[Any]]) -> Take:
    def given(name: str) -> Tensor | None:
        return torch.from_numpy(np.asarray(arrays[name], dtype=np.float64)) if name in arrays else None

    offsets, root, turns = (
        torch.from_numpy(arrays[name].astype(np.float64)) for name in ("offsets", "root_position", "rotations")
    )
    ends = dict(zip(arrays["end_names"].tolist(), torch.from_numpy(arrays["ends"].astype(np.float64)), strict=True))
    parents = tuple(int(parent) for parent in arrays["parents"])
    names = tuple(str(name) for name in arrays["names"])
    if turns.shape != (len(root), len(names), 4) or len(parents) != len(names) or offsets.shape != (len(names), 3):
        raise ValueError("its arrays do not fit each other")
    if any(parent >= joint for joint, parent in enumerate(parents)) or parents[:1] != (-1,):
        raise ValueError("its joints are no tree")
    skeleton = Skeleton(names, parents, offsets, ends)
    clip = Clip(skeleton, root, from_quaternions(turns), float(arrays["frame_time"]), given("moving_offsets"))
    contact = given("contact")
    masses, segments = None, None
    if "part_masses" in arrays:
        masses = dict(zip(arrays["parts"].tolist(), arrays["part_masses"].tolist(), strict=True))
    elif "masses" in arrays:  # as earlier versions wrote them: the parts alone
        masses = dict(zip(arrays["segments"].tolist(), arrays["masses"].tolist(), strict=True))
    if "inertias" in arrays:
        joints = tuple(str(name) for name in arrays["segments"])
        own, centres, inertias = (
            torch.from_numpy(arrays[name].astype(np.float64)) for name in ("masses", "centres", "inertias")
        )
        segments = Segments(joints, own, centres, inertias, given("heel"))
    take = Take(str(arrays["name"]), clip, bool(arrays["loop"]), numbers=json.loads(str(arrays["numbers"])))
    return replace(
        take,
        contact=None if contact is None else contact > 0.5,
        feet=given("feet"),
        com=given("com"),
        leg_force=given("leg_force"),
        masses=masses,
        force=given("force"),
        cop=given("cop"),
        segments=segments,
    )


def ground_force(take: Take) -> Tensor | None:
    """(T, 2) vertical part of the ground force on each foot [N], or None where it is not known.

    Where only the force along the legs is known, a leg pushes along the line from the contact point to the
    hip (Kang 1999, section 3.1, one-leg hopper).
    """
    if take.force is not None:
        return take.force[..., 1]
    parts = parts_of(take.clip.skeleton)
    hips = [parts[f"{side}_hip"] for side in SIDES if f"{side}_hip" in parts]
    if take.leg_force is None or take.feet is None or len(hips) < len(SIDES):
        return None
    leg = take.clip.joint_positions()[:, hips] - take.feet
    found: Tensor | None = take.leg_force * (leg[..., 1] / leg.norm(dim=-1).clamp_min(1e-9)).clamp(0.0, 1.0)
    return found


def _short(value: float) -> float | int:
    """A number without digits that say nothing."""
    if value == math.floor(value) and abs(value) < 1e15:
        return int(value)
    return float(f"{value:.{DIGITS}g}")
