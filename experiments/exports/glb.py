"""Motions read back from GLB files, by the letter of the glTF specification and no code of the writer's."""

from __future__ import annotations

import json
import struct
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from hopdiff.geometry.clip import Clip
from hopdiff.geometry.skeleton import Skeleton

KINDS = {5120: "i1", 5121: "u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}


def read_glb(path: Path) -> dict[str, Clip]:
    """Every animation of a GLB file by name, on the joints of the skin that it moves.

    Channels may have fewer keys than others of their animation; they are looked up between their keys at the times of
    the one with the most.
    """
    data = path.read_bytes()
    length = struct.unpack_from("<I", data, 12)[0]
    content: dict[str, Any] = json.loads(data[20 : 20 + length])
    binary = data[28 + length :]
    parents = {child: k for k, node in enumerate(content["nodes"]) for child in node.get("children", ())}
    return {animation["name"]: _clip(content, binary, parents, animation) for animation in content["animations"]}


def _clip(content: dict[str, Any], binary: bytes, parents: dict[int, int], animation: dict[str, Any]) -> Clip:
    channels = [
        (one["target"]["node"], one["target"]["path"], animation["samplers"][one["sampler"]])
        for one in animation["channels"]
    ]
    moved = {node for node, _, _ in channels}
    joints = next(skin["joints"] for skin in content["skins"] if moved <= set(skin["joints"]))
    nodes = [content["nodes"][joint] for joint in joints]
    skeleton = Skeleton(
        tuple(node["name"] for node in nodes),
        tuple(joints.index(parents[joint]) if parents.get(joint) in joints else -1 for joint in joints),
        torch.tensor([node.get("translation", (0.0, 0.0, 0.0)) for node in nodes], dtype=torch.float64),
        {},
    )
    times = max((_values(content, binary, sampler["input"])[:, 0] for _, _, sampler in channels), key=len)
    turns = np.tile(np.array([0.0, 0.0, 0.0, 1.0]), (len(times), len(joints), 1))
    places = np.tile(skeleton.offsets.numpy(), (len(times), 1, 1))
    for node, path, sampler in channels:
        keys, values = (_values(content, binary, sampler[end]) for end in ("input", "output"))
        target = {"rotation": turns, "translation": places}[path]
        between = [np.interp(times, keys[:, 0], column) for column in values.T]
        target[:, joints.index(node)] = np.stack(between, axis=-1)
    rotations = torch.from_numpy(Rotation.from_quat(turns.reshape(-1, 4)).as_matrix()).reshape(*turns.shape[:2], 3, 3)
    offsets = torch.from_numpy(places)
    frame_time = float(times[-1]) / max(len(times) - 1, 1)
    return Clip(skeleton, offsets[:, 0].clone(), rotations, frame_time, offsets)


def _values(content: dict[str, Any], binary: bytes, index: int) -> NDArray[np.float64]:
    """(n, width) what an accessor holds."""
    accessor = content["accessors"][index]
    view = content["bufferViews"][accessor["bufferView"]]
    start = view.get("byteOffset", 0) + accessor.get("byteOffset", 0)
    count, width = accessor["count"], WIDTHS[accessor["type"]]
    flat = np.frombuffer(binary, KINDS[accessor["componentType"]], count * width, start)
    return flat.reshape(count, width).astype(np.float64)
