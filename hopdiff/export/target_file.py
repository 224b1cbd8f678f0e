"""Bodies read from files: in the pose that their skin was made in, their joints hung as anatomy says."""

from __future__ import annotations

import math
import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import torch

from hopdiff.export.hanging import TRUNK, loose_parts, rehung
from hopdiff.export.humanoid import parts_in
from hopdiff.export.mapping import few
from hopdiff.export.skin import Skin, with_stumps
from hopdiff.export.target import Target, named_parts, target_of
from hopdiff.extras import install
from hopdiff.geometry.trunk_parts import trunk_parts
from hopdiff.io.bvh import read_bvh
from hopdiff.io.glb_file import GlbFile, read_glb
from hopdiff.io.glb_humanoid import vrm_bones
from hopdiff.io.glb_mesh import skinned_meshes
from hopdiff.io.glb_rest import rest_poses
from hopdiff.io.glb_unpack import DRACO, MESHOPT
from hopdiff.types import HopdiffError

STRAIGHT = 0.99  # cosine from which on a pose in which a mesh was made is taken without looking at others
LOPSIDED = 0.25  # of its length by which a foot goes further ahead of its joint than back
UNPACKERS = {DRACO: "draco", **dict.fromkeys(MESHOPT, "meshopt")}  # extension of glTF -> extra
BACKWARDS = -0.3  # cosine of feet and body up to which feet point back


def read_target(path: str | os.PathLike[str], names: str = "auto") -> Target:
    """The body in a BVH, GLB or VRM file.

    names: how its joints are called: auto, a name of SCHEMES, or a YAML file with lines part: joint name. With auto a
    file's own VRM map counts, if it has one.
    Raises HopdiffError, naming file and joint, if it cannot be read, lacks a leg, or does not stand upright.
    """
    match Path(path).suffix.lower():
        case ".bvh":
            file = read_bvh(path)
            skeleton = file.skeleton()
            pose = file.clip().rotations[0] if file.frames else None
            return target_of(str(path), skeleton, named_parts(skeleton, names, str(path)), pose, file)
        case ".glb" | ".vrm":
            return _in_rest_pose(str(path), names, read_glb(path))
        case _:
            raise HopdiffError(f"{path}: a skeleton is read from a .bvh, .glb or .vrm file.")


def _in_rest_pose(path: str, names: str, file: GlbFile) -> Target:
    """The body in a GLB file in the pose that its mesh was made in, or as its nodes stand where that is none."""
    meshes = skinned_meshes(file)
    notes = []
    if meshes.unread:
        lacking = sorted({UNPACKERS[name] for name in meshes.why})
        why = f" ({', '.join(meshes.why)}: {' and '.join(map(install, lacking))} reads it)" if lacking else ""
        notes.append(
            f"{Path(path).name}: the mesh of {few(meshes.unread)} cannot be read{why}: soles are where joints say, and"
            " how the skin follows was not looked at."
        )
    if meshes.aside:
        notes.append(f"{Path(path).name}: not on the skeleton, so that it does not move: {few(meshes.aside)}.")
    if loose := sum(mesh.loose for mesh in meshes.meshes):
        notes.append(f"{Path(path).name}: {loose} vertices of its skin are held by no joint, and stay where they are.")
    found: list[Target] = []
    failed: HopdiffError | None = None
    holding = {int(joint) for mesh in meshes.meshes for joint in np.unique(mesh.joints[mesh.weights > 0.0])}
    for matrices in rest_poses(file, holding):
        try:
            target = _posed(path, names, file.in_pose(matrices), Skin.of(meshes.meshes, matrices))
        except HopdiffError as error:
            failed = failed or error
            continue
        found.append(replace(target, notes=(*notes, *target.notes)))
        if target.upright() > STRAIGHT:
            break
    if not found:
        assert failed is not None
        raise failed
    return max(found, key=lambda one: one.upright())


def _posed(path: str, names: str, file: GlbFile, skin: Skin | None) -> Target:
    """The body in a GLB file in one pose."""
    own = with_stumps(file.skeleton(), skin)
    note = ""
    if names == "auto":
        parts, note = parts_in(file, own, frozenset() if skin is None else skin.carriers())
        if note or not vrm_bones(file)[0]:
            parts = loose_parts(own, parts, skin)
    else:
        parts = named_parts(own, names, path)
    for part, joint in parts.items():
        if (over := file.parents[joint]) in file.uneven:
            raise HopdiffError(
                f"{path}: joint {own.names[over]!r} is scaled unevenly, and {own.names[joint]!r} ({part}) hangs on it;"
                " apply its scale before export."
            )
    skeleton = rehung(path, own, parts, skin)
    order = [own.index(name) for name in skeleton.names]
    parts = {part: order.index(joint) for part, joint in parts.items()}
    if skin is not None:
        skin = skin.reordered(order)
    if not set(TRUNK) & set(parts):
        # Of a body whose legs hung elsewhere before.
        parts = {**trunk_parts(skeleton, parts), **parts}
    notes = (f"{Path(path).name}: {note}.",) if note else ()
    try:
        target = replace(target_of(path, skeleton, parts, None, file), skin=skin, notes=notes)
    except HopdiffError as error:
        raise HopdiffError(f"{error} ({note})" if note else str(error)) from error
    if skin is not None and not any(target.sole(leg) for leg in target.legs):
        said = f"{Path(path).name}: no soles were found on its skin, so that feet stand where joints say."
        target = replace(target, notes=(*target.notes, said))
    return _with_sides(target)


def _with_sides(target: Target) -> Target:
    """The body with left and right as its feet tell: those of a mirrored one are named the other way round."""
    angle = target.facing()
    ahead = torch.tensor((math.sin(angle), 0.0, math.cos(angle)), dtype=torch.float64)
    cosines = []
    for leg in target.legs:
        sole = target.sole(leg)
        # A foot whose joint is in its middle tells nothing.
        uneven = sole is not None and sole.tip - sole.heel > LOPSIDED * (sole.tip + sole.heel)
        line = sole.ahead if sole is not None and uneven else None
        if leg.toe is not None and leg.ankle is not None:
            line = (target.places[leg.toe] - target.places[leg.ankle]) * ahead.new_tensor((1.0, 0.0, 1.0))
        if line is None or float(line.norm()) < 1e-6:
            return target
        cosines.append(float(line @ ahead / line.norm()))
    if max(cosines) > BACKWARDS:
        return target
    other = {"left": "right", "right": "left"}
    parts = {}
    for part, joint in target.parts.items():
        side, _, name = part.rpartition("_")
        parts[f"{other[side]}_{name}" if side in other else part] = joint
    note = f"{Path(target.name).name}: its feet point back, so that what it calls left is taken for right."
    return replace(target, parts=parts, notes=(*target.notes, note))
