"""What a program that plays a GLB file shows: its skins in motion, by the words of the specification."""

from __future__ import annotations

import json
import struct
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation, Slerp

Floats = NDArray[np.float64]
TYPES = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
WIDE = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}


@dataclass
class Played:
    """A GLB file. content: its JSON; data: of its binary chunk."""

    content: dict[str, Any]
    data: bytes

    @classmethod
    def of(cls, path: Path) -> Played:
        file = path.read_bytes()
        length = struct.unpack_from("<I", file, 12)[0]
        return cls(json.loads(file[20 : 20 + length]), file[28 + length :])

    def numbers(self, index: int) -> Floats:
        """(count, width) of an accessor."""
        accessor = self.content["accessors"][index]
        kind, wide = np.dtype(TYPES[accessor["componentType"]]), WIDE[accessor["type"]]
        found = np.zeros((accessor["count"], wide))
        if "bufferView" in accessor:
            found = self._strided(accessor["bufferView"], accessor.get("byteOffset", 0), kind, accessor["count"], wide)
        if "sparse" in accessor:
            own = accessor["sparse"]
            places = np.dtype(TYPES[own["indices"]["componentType"]])
            at = self._strided(own["indices"]["bufferView"], 0, places, own["count"], 1)[:, 0].astype(int)
            found[at] = self._strided(own["values"]["bufferView"], 0, kind, own["count"], wide)
        return found / np.iinfo(kind).max if accessor.get("normalized") else found

    def _strided(self, view: int, offset: int, kind: np.dtype[Any], count: int, wide: int) -> Floats:
        own = self.content["bufferViews"][view]
        start, step = own.get("byteOffset", 0) + offset, own.get("byteStride", kind.itemsize * wide)
        rows = np.ndarray((count, wide), kind, self.data, start, (step, kind.itemsize))
        return rows.astype(np.float64)

    @cached_property
    def parents(self) -> dict[int, int]:
        return {child: k for k, node in enumerate(self.content["nodes"]) for child in node.get("children", ())}

    def worlds(self, name: str | None, time: float) -> list[Floats]:
        """(4, 4) of every node while an animation plays, or as the file has it."""
        moved: dict[tuple[int, str], Any] = {}
        animation = next((one for one in self.content.get("animations", ()) if one["name"] == name), {"channels": ()})
        for channel in animation["channels"]:
            sampler, target = animation["samplers"][channel["sampler"]], channel["target"]
            times, values = self.numbers(sampler["input"])[:, 0], self.numbers(sampler["output"])
            at = float(np.clip(time, times[0], times[-1]))
            if target["path"] == "rotation" and len(times) > 1:
                moved[target["node"], "rotation"] = Slerp(times, Rotation.from_quat(values))(at).as_quat()
            else:
                moved[target["node"], target["path"]] = [np.interp(at, times, column) for column in values.T]
        found: dict[int, Floats] = {}

        def world(k: int) -> Floats:
            if k not in found:
                node, own = self.content["nodes"][k], np.eye(4)
                if "matrix" in node:
                    assert all((k, path) not in moved for path in ("translation", "rotation", "scale"))
                    own = np.array(node["matrix"]).reshape(4, 4).T
                else:
                    turn = moved.get((k, "rotation"), node.get("rotation", (0.0, 0.0, 0.0, 1.0)))
                    size = moved.get((k, "scale"), node.get("scale", (1.0, 1.0, 1.0)))
                    own[:3, :3] = Rotation.from_quat(turn).as_matrix() @ np.diag(size)
                    own[:3, 3] = moved.get((k, "translation"), node.get("translation", (0.0, 0.0, 0.0)))
                found[k] = world(self.parents[k]) @ own if k in self.parents else own
            return found[k]

        return [world(k) for k in range(len(self.content["nodes"]))]

    def node(self, name: str) -> int:
        return next(k for k, node in enumerate(self.content["nodes"]) if node.get("name") == name)

    @cached_property
    def skinned(self) -> list[tuple[Floats, NDArray[np.int64], NDArray[np.int64], Floats, Floats, list[int]]]:
        """Of every skinned primitive: vertices as stored, edges, joints (V, 4), weights, inverses, nodes."""
        found = []
        for node in self.content["nodes"]:
            if "mesh" not in node or "skin" not in node:
                continue
            skin = self.content["skins"][node["skin"]]
            inverse = self.numbers(skin["inverseBindMatrices"]).reshape(-1, 4, 4).swapaxes(1, 2)
            for primitive in self.content["meshes"][node["mesh"]]["primitives"]:
                own = {name: self.numbers(index) for name, index in primitive["attributes"].items()}
                faces = self.numbers(primitive["indices"]).astype(np.int64).reshape(-1, 3)
                edges = np.unique(np.sort(faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1), axis=0)
                joints = own["JOINTS_0"].astype(np.int64)
                found.append((own["POSITION"], edges, joints, own["WEIGHTS_0"], inverse, skin["joints"]))
        return found

    def shape(self, worlds: list[Floats]) -> list[Floats]:
        """(V, 3) of every skinned primitive."""
        found = []
        for vertices, _, joints, weights, inverse, nodes in self.skinned:
            whole = np.concatenate((vertices, np.ones((len(vertices), 1))), axis=1)
            moved = np.stack([worlds[node] @ own for node, own in zip(nodes, inverse, strict=True)])
            each = np.einsum("vkij,vj->vki", moved[joints][:, :, :3], whole)
            found.append(np.einsum("vk,vki->vi", weights, each))
        return found
