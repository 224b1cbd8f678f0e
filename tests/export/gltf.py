"""A reading of GLB files for tests, by the words of the specification: nodes, skin and animations at any time."""

from __future__ import annotations

import json
import struct
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation, Slerp

KINDS = {5126: "<f4", 5121: "<u1", 5123: "<u2", 5125: "<u4"}
WIDTHS = {"SCALAR": 1, "VEC3": 3, "VEC4": 4, "MAT4": 16}


@dataclass
class Gltf:
    content: dict[str, Any]
    data: bytes

    @classmethod
    def of(cls, file: bytes) -> Gltf:
        magic, version, size = struct.unpack_from("<4sII", file)
        assert (magic, version, size) == (b"glTF", 2, len(file))
        length, kind = struct.unpack_from("<I4s", file, 12)
        assert kind == b"JSON"
        content = json.loads(file[20 : 20 + length])
        more, kind = struct.unpack_from("<I4s", file, 20 + length)
        assert kind == b"BIN\0"
        assert len(file) == 28 + length + more
        return cls(content, file[28 + length :])

    def values(self, index: int) -> NDArray[Any]:
        accessor = self.content["accessors"][index]
        view = self.content["bufferViews"][accessor["bufferView"]]
        dtype, width = np.dtype(KINDS[accessor["componentType"]]), WIDTHS[accessor["type"]]
        start = view.get("byteOffset", 0)
        found = np.frombuffer(self.data[start : start + view["byteLength"]], dtype)
        assert len(found) == accessor["count"] * width
        return found.reshape(-1, width)

    def animation(self, name: str) -> dict[str, Any]:
        return next(one for one in self.content["animations"] if one["name"] == name)

    def places(self, name: str, time: float) -> dict[str, NDArray[np.float64]]:
        """World places of all nodes that an animation moves, by name, at a time [s]."""
        return {node: place for node, (place, _) in self.frames(name, time).items()}

    def frames(self, name: str, time: float) -> dict[str, tuple[NDArray[np.float64], Rotation]]:
        """World places and rotations of the same."""
        content, moved = self.content, {}
        animation = self.animation(name)
        for channel in animation["channels"]:
            sampler = animation["samplers"][channel["sampler"]]
            times, values = self.values(sampler["input"])[:, 0], self.values(sampler["output"])
            assert sampler["interpolation"] == "LINEAR"
            if channel["target"]["path"] == "rotation":
                at = min(max(time, float(times[0])), float(times[-1]))
                found: Any = (
                    Slerp(times, Rotation.from_quat(values))(at) if len(times) > 1 else Rotation.from_quat(values[0])
                )
            else:
                found = np.array([np.interp(time, times, values[:, k]) for k in range(3)])
            moved[channel["target"]["node"], channel["target"]["path"]] = found
        parents = {child: k for k, node in enumerate(content["nodes"]) for child in node.get("children", ())}

        def world(node: int) -> tuple[NDArray[np.float64], Rotation, float]:
            own = content["nodes"][node]
            assert "matrix" not in own  # such nodes must not be animated
            place = moved.get((node, "translation"), np.array(own.get("translation", (0.0, 0.0, 0.0))))
            turn = moved.get((node, "rotation"), Rotation.from_quat(own.get("rotation", (0.0, 0.0, 0.0, 1.0))))
            size = float(own.get("scale", (1.0, 1.0, 1.0))[0])
            if node not in parents:
                return place, turn, size
            above, turned, sized = world(parents[node])
            return above + sized * turned.apply(place), turned * turn, sized * size

        nodes = {node for node, _ in moved}
        return {content["nodes"][node]["name"]: world(node)[:2] for node in sorted(nodes)}

    def skinned(self, name: str, time: float) -> NDArray[np.float64]:
        """(V, 3) vertices of the first body's mesh, as an animation moves them, at a time [s]."""
        skin, frames = self.content["skins"][0], self.frames(name, time)
        inverse = self.values(skin["inverseBindMatrices"]).reshape(-1, 4, 4).transpose(0, 2, 1)
        whole = []
        for joint, node in enumerate(skin["joints"]):
            place, turn = frames[self.content["nodes"][node]["name"]]
            matrix = np.eye(4)
            matrix[:3, :3], matrix[:3, 3] = turn.as_matrix(), place
            whole.append(matrix @ inverse[joint])
        found = []
        for primitive in self.content["meshes"][0]["primitives"]:
            points, joints, weights = (
                self.values(primitive["attributes"][name]) for name in ("POSITION", "JOINTS_0", "WEIGHTS_0")
            )
            points = np.concatenate((points, np.ones((len(points), 1))), axis=1)
            found.append(np.einsum("vk,vkij,vj->vi", weights, np.array(whole)[joints], points)[:, :3])
        return np.concatenate(found)
