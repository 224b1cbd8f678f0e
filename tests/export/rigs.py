"""Skeletons of users: files made by hand that motions are put on."""

from __future__ import annotations

import json
import struct
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from scipy.spatial.transform import Rotation

from hopdiff.export.anatomy import renamed
from hopdiff.export.full_body import full_body
from hopdiff.export.pose import root_height, with_rest_pose
from hopdiff.geometry.clip import Clip
from hopdiff.geometry.skeleton import Skeleton
from hopdiff.io.bvh import write_bvh
from tests.export.takes import own

LEGS = ("hip", "knee", "ankle", "toe")


def skeleton(names: str = "mixamo", rest: str = "t") -> Skeleton:
    """The 22 joints of our own runs in a rest pose, called as in another program."""
    return renamed(with_rest_pose(full_body(own()), rest).clip.skeleton, names)


def with_legs(body: Skeleton, factor: float) -> Skeleton:
    """A body with longer or shorter legs; feet and all."""
    words = ("Leg", "Foot", "Toe")
    lengths = [factor if any(word in name for word in words) and "UpLeg" not in name else 1.0 for name in body.names]
    ends = {name: end * (factor if "Toe" in name else 1.0) for name, end in body.end_sites.items()}
    return replace(body, offsets=body.offsets * torch.tensor(lengths)[:, None], end_sites=ends)


def write_rest(path: Path, body: Skeleton, unit: float = 1.0, up: str = "y") -> Path:
    """A BVH file with a body at rest, standing on the ground."""
    straight = torch.eye(3, dtype=torch.float64).expand(2, len(body.names), 3, 3)
    root = torch.tensor([[0.0, root_height(body), 0.0]], dtype=torch.float64).expand(2, 3)
    write_bvh(path, Clip(body, root.clone(), straight.clone(), 1.0 / 30.0), "ZXY", unit, up)
    return path


def without(body: Skeleton, *names: str) -> Skeleton:
    """A body without some joints and all that hangs on them."""
    gone = {
        joint for joint in range(len(body.names)) for name in names if body.index(name) in (joint, *body.above(joint))
    }
    kept = [joint for joint in range(len(body.names)) if joint not in gone]
    return Skeleton(
        tuple(body.names[joint] for joint in kept),
        tuple(kept.index(body.parents[joint]) if body.parents[joint] >= 0 else -1 for joint in kept),
        body.offsets[kept],
        {name: end for name, end in body.end_sites.items() if body.index(name) in kept},
    )


def armature(body: Skeleton, matrix_node: int | None = None, seed: int = 0) -> bytes:
    """A GLB file as Mixamo's come: centimetres below a node that is scaled by 0.01 and turned, joints with frames of
    their own, a mesh, and an animation. matrix_node: a joint that is given as a matrix."""
    count = len(body.names)
    straight = torch.eye(3, dtype=torch.float64).expand(1, count, 3, 3)
    places = body.forward(torch.tensor([[0.0, root_height(body), 0.0]], dtype=torch.float64), straight)[0][0].numpy()
    turns = Rotation.random(count, random_state=seed)
    above = Rotation.from_euler("x", -90.0, degrees=True)
    world = [transform(0.01, turn, place) for turn, place in zip(turns, places, strict=True)]
    top = transform(0.01, above, np.zeros(3))
    nodes: list[dict[str, Any]] = [
        {"name": "Armature", "rotation": above.as_quat().tolist(), "scale": [0.01] * 3, "children": [1, count + 1]}
    ]
    for joint, name in enumerate(body.names):
        parent = body.parents[joint]
        local = np.linalg.inv(top if parent < 0 else world[parent]) @ world[joint]
        node: dict[str, Any] = {"name": name}
        if joint == matrix_node:
            node["matrix"] = local.T.ravel().tolist()
        else:
            node["translation"] = local[:3, 3].tolist()
            node["rotation"] = Rotation.from_matrix(local[:3, :3]).as_quat().tolist()
        if children := body.children(joint):
            node["children"] = [1 + child for child in children]
        nodes.append(node)
    nodes.append({"name": "Body", "mesh": 0, "skin": 0})
    inverse = np.stack([np.linalg.inv(one).T for one in world]).astype("<f4")
    points = np.eye(3, dtype="<f4")
    arrays = {
        "inverse": inverse,
        "points": points,
        "joints": np.zeros((3, 4), "<u1"),
        "weights": np.tile(np.array([1, 0, 0, 0], "<f4"), (3, 1)),
        "times": np.array([[0.0], [1.0]], "<f4"),
        "turns": np.tile(np.array([0, 0, 0, 1], "<f4"), (2, 1)),
    }
    kinds = {"inverse": "MAT4", "points": "VEC3", "times": "SCALAR"}
    data, views, accessors = b"", [], []
    for name, array in arrays.items():
        views.append({"buffer": 0, "byteOffset": len(data), "byteLength": array.nbytes})
        width = 16 if name == "inverse" else array.shape[-1]
        accessor = {
            "bufferView": len(views) - 1,
            "componentType": 5121 if array.dtype == np.uint8 else 5126,
            "count": array.size // width,
            "type": kinds.get(name, "VEC4"),
        }
        if name in ("points", "times"):
            accessor |= {"min": array.min(axis=0).tolist(), "max": array.max(axis=0).tolist()}
        accessors.append(accessor)
        data += array.tobytes()
    old = {"sampler": 0, "target": {"node": 2, "path": "rotation"}}
    content = {
        "asset": {"version": "2.0", "generator": "by hand"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": nodes,
        "meshes": [{"primitives": [{"attributes": {"POSITION": 1, "JOINTS_0": 2, "WEIGHTS_0": 3}, "material": 0}]}],
        "materials": [{"name": "skin", "extras": {"kept": ["as", "it", "is"]}}],
        "skins": [{"joints": list(range(1, count + 1)), "inverseBindMatrices": 0}],
        "animations": [{"name": "idle", "channels": [old], "samplers": [{"input": 4, "output": 5}]}],
        "accessors": accessors,
        "bufferViews": views,
        "buffers": [{"byteLength": len(data)}],
    }
    return glb(content, data)


def transform(scale: float, turn: Rotation, place: Sequence[float] | np.ndarray) -> np.ndarray:
    """(4, 4)"""
    found = np.eye(4)
    found[:3, :3] = scale * turn.as_matrix()
    found[:3, 3] = place
    return found


def glb(content: Mapping[str, Any], data: bytes = b"") -> bytes:
    """The bytes of a GLB file."""
    text = json.dumps(content).encode()
    text += b" " * (-len(text) % 4)
    data += b"\0" * (-len(data) % 4)
    chunks = struct.pack("<I4s", len(text), b"JSON") + text
    if data:
        chunks += struct.pack("<I4s", len(data), b"BIN\0") + data
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks


def parted(data: bytes) -> tuple[dict[str, Any], bytes]:
    """The JSON and the data of a GLB file."""
    length = struct.unpack_from("<I", data, 12)[0]
    return json.loads(data[20 : 20 + length]), data[28 + length :]


def edited(data: bytes, change: Callable[[dict[str, Any]], object]) -> bytes:
    """A GLB file whose JSON was changed."""
    content, binary = parted(data)
    change(content)
    return glb(content, binary)
