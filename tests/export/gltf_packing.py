"""Bodies of tests as GLB files, by the words of the specification, in the ways that exporters have."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from tests.export.rigs import glb

if TYPE_CHECKING:
    from tests.export.stand_ins import Rig

KINDS = {"f4": 5126, "u1": 5121, "u2": 5123, "i2": 5122, "u4": 5125}
VERTICES, INDICES = 34962, 34963
WIDTHS = {1: "SCALAR", 3: "VEC3", 4: "VEC4", 16: "MAT4"}


class Data:
    """Buffer, views and accessors in the making."""

    def __init__(self) -> None:
        self.bytes = bytearray()
        self.views: list[dict[str, Any]] = []
        self.accessors: list[dict[str, Any]] = []

    def view(self, values: NDArray[Any], **more: int) -> int:
        self.bytes += b"\0" * (-len(self.bytes) % 4)
        self.views.append({"buffer": 0, "byteOffset": len(self.bytes), "byteLength": values.nbytes} | more)
        self.bytes += np.ascontiguousarray(values).tobytes()
        return len(self.views) - 1

    def add(
        self, values: NDArray[Any], normalised: bool = False, sparse: bool = False, target: int | None = None
    ) -> int:
        """target: what the buffer is for, 34962 of vertices, 34963 of indices."""
        values = values.reshape(len(values), -1)
        kind = KINDS[values.dtype.str[1:]]
        aim = {} if target is None else {"target": target}
        entry: dict[str, Any] = {"componentType": kind, "count": len(values), "type": WIDTHS[values.shape[1]]}
        entry |= (
            {"min": values.min(axis=0).tolist(), "max": values.max(axis=0).tolist()} if values.shape[1] == 3 else {}
        )
        if sparse:
            at = np.arange(1, len(values), 2)
            base = values.copy()
            base[at] = 0.0
            entry["bufferView"] = self.view(base, **aim)
            entry["sparse"] = {
                "count": len(at),
                "indices": {"bufferView": self.view(at.astype("<u2")), "componentType": 5123},
                "values": {"bufferView": self.view(values[at])},
            }
        else:
            size = values.dtype.itemsize * values.shape[1]
            wide = values
            if size % 4 and values.shape[1] > 1:
                # Vertices begin at multiples of four bytes.
                wide = np.zeros((len(values), (size + 3) // 4 * 4 // values.dtype.itemsize), values.dtype)
                wide[:, : values.shape[1]] = values
                entry["bufferView"] = self.view(wide, byteStride=wide.strides[0], **aim)
            else:
                more = {"byteStride": size} if target == VERTICES else {}
                entry["bufferView"] = self.view(wide, **more, **aim)
        self.accessors.append(entry | ({"normalized": True} if normalised else {}))
        return len(self.accessors) - 1


def packed(rig: Rig) -> bytes:
    """The GLB file of a body."""
    marks, count = rig.packing, len(rig.names)
    bind = np.tile(np.eye(4), (count, 1, 1))
    bind[:, :3, :3] = rig.frames * rig.size[:, None]
    bind[:, :3, 3] = rig.places
    world = rig.pose @ bind
    unit = 0.01 if marks.get("centimetres") else 1.0
    above = rig.top.copy()
    above[:3, :3] = above[:3, :3] * unit
    lie = Rotation.from_euler("x", -90.0, degrees=True).as_matrix() if marks.get("centimetres") else np.eye(3)
    back = np.eye(4)
    back[:3, :3] = lie.T / unit
    above[:3, :3] = above[:3, :3] @ lie
    world, bound = back @ world, back @ bind
    mesh = rig.vertices @ back[:3, :3].T
    data = Data()
    nodes: list[dict[str, Any]] = [{"name": "Armature", **_placed(above, rig.top)}]
    for joint, name in enumerate(rig.names):
        parent = rig.parents[joint]
        local = world[joint] if parent < 0 else np.linalg.inv(world[parent]) @ world[joint]
        held = [1 + k for k in range(count) if rig.parents[k] == joint]
        entry = {"matrix": local.T.ravel().tolist()} if marks.get("matrices") else _placed(local)
        nodes.append({"name": name, **entry, **({"children": held} if held else {})})
    nodes[0]["children"] = [1 + k for k in range(count) if rig.parents[k] < 0]
    shift = np.eye(4)
    if marks.get("quantised"):
        size = float(np.abs(mesh).max())
        shift[:3, :3] *= size
        mesh = mesh / size
    groups = _groups(rig) if marks.get("skins") else {"Body": np.arange(len(rig.faces))}
    content: dict[str, Any] = {"meshes": [], "skins": []}
    for number, (name, faces) in enumerate(groups.items()):
        used = np.unique(rig.faces[faces])
        own = np.arange(count)
        if len(groups) > 1:
            own = np.random.default_rng(number).permutation(np.flatnonzero(rig.weights[used].any(axis=0)))
        inverse = np.linalg.inv(bound[own]) @ shift
        order = np.argsort(-rig.weights[used][:, own], axis=1)[:, :4]
        order = np.pad(order, ((0, 0), (0, 4 - order.shape[1])))
        weights = np.take_along_axis(rig.weights[used][:, own], order, axis=1)
        if len(own) < 4:
            weights[:, len(own) :] = 0.0
        order[weights == 0.0] = 0
        attributes = {"JOINTS_0": data.add(order.astype("<u2" if count > 255 else "u1"), target=VERTICES)}
        if marks.get("quantised"):
            attributes["POSITION"] = data.add(
                np.round(mesh[used] * 32767).astype("<i2"), normalised=True, target=VERTICES
            )
            whole = np.round(weights * 255).astype(np.int64)
            whole[:, 0] += 255 - whole.sum(axis=1)
            attributes["WEIGHTS_0"] = data.add(whole.astype("u1"), normalised=True, target=VERTICES)
        else:
            attributes["POSITION"] = data.add(
                mesh[used].astype("<f4"), sparse=bool(marks.get("sparse")), target=VERTICES
            )
            attributes["WEIGHTS_0"] = data.add(weights.astype("<f4"), target=VERTICES)
        at = {old: new for new, old in enumerate(used.tolist())}
        line = np.array([at[k] for k in rig.faces[faces].ravel().tolist()], dtype="<u2")
        primitive: dict[str, Any] = {"attributes": attributes, "indices": data.add(line, target=INDICES), "material": 0}
        shape: dict[str, Any] = {"primitives": [primitive]}
        if marks.get("morphs"):
            primitive["targets"] = [{"POSITION": data.add(np.full((len(used), 3), 0.5, "<f4"), target=VERTICES)}]
            shape["weights"] = [0.0]
        content["skins"].append(
            {"joints": (1 + own).tolist(), "inverseBindMatrices": data.add(inverse.swapaxes(1, 2).astype("<f4"))}
        )
        content["meshes"].append(shape)
        nodes.append({"name": name, "mesh": number, "skin": number})
    buffers: list[dict[str, Any]] = [{"byteLength": len(data.bytes)}]
    used_extensions = ["KHR_mesh_quantization"] if marks.get("quantised") else []
    if marks.get("fallback"):
        used_extensions.append("EXT_meshopt_compression")
        buffers.append({"byteLength": 1000, "extensions": {"EXT_meshopt_compression": {"fallback": True}}})
    whole_content = {
        "asset": {"version": "2.0", "generator": "by hand"},
        "scene": 0,
        "scenes": [{"nodes": [0, *range(count + 1, len(nodes))]}],
        "nodes": nodes,
        "materials": [{"name": "skin"}],
        "accessors": data.accessors,
        "bufferViews": data.views,
        "buffers": buffers,
        **content,
    }
    if used_extensions:
        whole_content["extensionsUsed"] = used_extensions
    if marks.get("quantised"):
        whole_content["extensionsRequired"] = ["KHR_mesh_quantization"]
    return glb(whole_content, bytes(data.bytes))


def _placed(matrix: NDArray[np.float64], signs: NDArray[np.float64] | None = None) -> dict[str, Any]:
    """Translation, rotation and scale of a matrix (4, 4); those of a mirror image are negative along x."""
    size = np.linalg.norm(matrix[:3, :3], axis=0)
    if np.linalg.det(matrix[:3, :3]) < 0.0:
        size[0] *= -1.0
    turn = Rotation.from_matrix(matrix[:3, :3] / size)
    return {
        "translation": matrix[:3, 3].tolist(),
        "rotation": turn.as_quat().tolist(),
        "scale": size.tolist(),
    }


def _groups(rig: Rig) -> dict[str, NDArray[np.int64]]:
    """Faces of legs, trunk and head by the height of their lowest vertex, each a mesh of its own."""
    low = rig.vertices[rig.faces][:, :, 1].min(axis=1)
    hips, neck = (rig.places[rig.parts[part]][1] for part in ("left_hip", "head"))
    kinds = np.where(low < hips - 0.1, 0, np.where(low < neck, 1, 2))
    return {name: np.flatnonzero(kinds == k) for k, name in enumerate(("Legs", "Trunk", "Head")) if (kinds == k).any()}
