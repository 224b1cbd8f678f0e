"""The meshes on a GLB file's skeleton, with a skin or hung on a joint: vertices, what holds them, and their edges.

Khronos Group, glTF 2.0 specification (2021), section 3.7.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hopdiff.io.glb_accessors import Accessors, extension
from hopdiff.io.glb_parse import GlbSkin, Matrix, ParsedGlb, local_matrix
from hopdiff.io.glb_unpack import DRACO, unpacked_mesh

TRIANGLES, STRIP, FAN = 4, 5, 6  # modes of glTF's primitives
LEAST = 1e-4  # weight below which a joint does not hold a vertex
MOST_WEIGHTS = 8  # a vertex: sets of four that are read are two


@dataclass(frozen=True, eq=False)
class SkinnedMesh:
    """name: of its node. vertices: (V, 3) in the mesh's own frame. joints: (V, K) of the skeleton, weights: (V, K) that
    add up to 1. inverse: (J, 4, 4) what takes the mesh into each joint's frame; 0 for joints that hold nothing. edges:
    (E, 2) of its triangles, each once. loose: how many more vertices of triangles no joint holds."""

    name: str
    vertices: Matrix
    joints: NDArray[np.int64]
    weights: Matrix
    inverse: Matrix
    edges: NDArray[np.int64]
    loose: int = 0


@dataclass(frozen=True, eq=False)
class Meshes:
    """What could be read of a file's skinned meshes. unread: names of nodes whose mesh could not be, and why: names of
    extensions, none where the data itself is broken. aside: names of nodes with a mesh that is not on the skeleton."""

    meshes: tuple[SkinnedMesh, ...]
    unread: tuple[str, ...]
    why: tuple[str, ...]
    aside: tuple[str, ...]


def skinned_meshes(file: ParsedGlb) -> Meshes:
    """The meshes on a file's skeleton, at their own shape: morph targets count for nothing."""
    content = file.content
    accessors = Accessors(content, file.chunks)
    skins = {skin.number: skin for skin in file.skins}
    found, unread, aside = [], list[str](), list[str]()
    carried = _carried(file)
    for at, node in enumerate(content["nodes"]):
        if "mesh" not in node:
            continue
        name = str(node.get("name") or f"node_{at}")
        skin = skins.get(node["skin"]) if isinstance(node.get("skin"), int) else None
        if skin is None:
            if at not in carried or "skin" in node:
                aside.append(name)
            else:
                found += _hung(file, name, node["mesh"], carried[at], accessors)
            continue
        for primitive in _primitives(content, node["mesh"]):
            mesh = _mesh(name, primitive, skin, accessors, len(file.nodes))
            if mesh is not None:
                found.append(mesh)
            elif name not in unread:
                unread.append(name)
    return Meshes(tuple(found), tuple(unread), tuple(sorted(accessors.compressed)), tuple(aside))


def _hung(file: ParsedGlb, name: str, index: Any, line: list[int], accessors: Accessors) -> list[SkinnedMesh]:
    """What can be read of a mesh without a skin, at the end of a line of nodes from a joint, as one that follows it."""
    joint, inverse = line[0], np.zeros((len(file.nodes), 4, 4))
    inverse[joint] = local_matrix(file, line[1:])
    found = []
    for primitive in _primitives(file.content, index):
        shape = _shape(primitive, accessors)
        if shape is not None:
            vertices, faces, _ = shape
            joints, ones = np.full((len(vertices), 1), joint, dtype=np.int64), np.ones((len(vertices), 1))
            found.append(SkinnedMesh(name, vertices, joints, ones, inverse, _edges(faces)))
    return found


def _primitives(content: dict[str, Any], index: Any) -> list[dict[str, Any]]:
    """Of a mesh, those with an area."""
    meshes = content.get("meshes", [])
    if not isinstance(meshes, list) or not isinstance(index, int) or not 0 <= index < len(meshes):
        return []
    found = meshes[index].get("primitives", []) if isinstance(meshes[index], dict) else []
    entries = [one for one in found if isinstance(one, dict)] if isinstance(found, list) else []
    return [one for one in entries if one.get("mode", TRIANGLES) in (TRIANGLES, STRIP, FAN)]


def _mesh(name: str, primitive: dict[str, Any], skin: GlbSkin, accessors: Accessors, count: int) -> SkinnedMesh | None:
    """One primitive, None if it cannot be read or tells nothing. count: of the skeleton's joints."""
    shape = _shape(primitive, accessors)
    if shape is None or skin.inverse is None:
        return None
    vertices, faces, values = shape
    joints, weights = [], []
    for number in range(MOST_WEIGHTS // 4):
        if f"JOINTS_{number}" not in primitive["attributes"]:
            break
        own, heavy = (values(f"{kind}_{number}") for kind in ("JOINTS", "WEIGHTS"))
        if own is None or heavy is None or own.shape != (len(vertices), 4) or heavy.shape != own.shape:
            return None
        joints.append(own)
        weights.append(heavy)
    if not joints:
        return None
    numbers, heavy = np.concatenate(joints, axis=1), np.concatenate(weights, axis=1)
    heavy = np.where(heavy < LEAST, 0.0, heavy)
    # Where nothing is held a number may be any.
    numbers = np.where(heavy > 0.0, numbers, 0.0)
    if numbers.min() < 0.0 or numbers.max() >= len(skin.joints):
        return None
    which = numbers.astype(np.int64)
    if (skin.inverse[which[heavy > 0.0], 3, 3] == 0.0).any():
        return None
    total = heavy.sum(axis=1, keepdims=True)
    held = total[:, 0] > 0.0
    if not held.any():
        return None
    heavy = heavy / np.where(total > 0.0, total, 1.0)
    inverse = np.zeros((count, 4, 4))
    inverse[list(skin.joints)] = skin.inverse
    edges = _edges(faces)
    # What nothing holds goes nowhere.
    loose = len(np.unique(edges[~held[edges]]))
    edges = (held.cumsum() - 1)[edges[held[edges].all(axis=1)]]
    return SkinnedMesh(name, vertices[held], np.array(skin.joints)[which[held]], heavy[held], inverse, edges, loose)


def _shape(
    primitive: dict[str, Any], accessors: Accessors
) -> tuple[Matrix, NDArray[np.int64], Callable[[str], Matrix | None]] | None:
    """Vertices (V, 3) and faces (F, 3) of a primitive, and what gives its attributes by name. None where they cannot be
    read."""
    attributes = primitive.get("attributes")
    read = _attributes(primitive, attributes, accessors) if isinstance(attributes, dict) else None
    if read is None:
        return None
    values, faces = read
    vertices = values("POSITION")
    if vertices is None or vertices.shape[1] != 3 or len(vertices) == 0:
        return None
    faces = _faces(primitive, accessors, len(vertices)) if faces is None else faces
    return None if faces is None else (vertices, faces, values)


def _attributes(
    primitive: dict[str, Any], attributes: dict[str, Any], accessors: Accessors
) -> tuple[Callable[[str], Matrix | None], NDArray[np.int64] | None] | None:
    """What gives a primitive's attributes (V, width) by name, and its faces (F, 3) where these are packed with them.
    None where they cannot be unpacked."""
    packed = extension(primitive, DRACO)
    if packed is None:
        return lambda name: accessors.values(attributes.get(name)), None
    mesh = unpacked_mesh(packed, accessors.bytes_of(packed.get("bufferView")))
    if mesh is None:
        accessors.compressed.add(DRACO)
        return None
    found, faces = mesh
    return lambda name: accessors.scaled(attributes.get(name), found.get(name)), faces


def _edges(faces: NDArray[np.int64]) -> NDArray[np.int64]:
    """(E, 2) of faces (F, 3), each once."""
    pairs = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    return np.unique(np.sort(pairs, axis=1), axis=0)


def _faces(primitive: dict[str, Any], accessors: Accessors, count: int) -> NDArray[np.int64] | None:
    """(F, 3) of a primitive."""
    if "indices" in primitive:
        values = accessors.values(primitive["indices"])
        if values is None or values.shape[1] != 1 or (len(values) and values.max() >= count):
            return None
        line = values[:, 0].astype(np.int64)
    else:
        line = np.arange(count)
    mode = primitive.get("mode", TRIANGLES)
    if mode == STRIP:
        return np.stack([line[k : max(len(line) - 2 + k, 0)] for k in range(3)], axis=1)
    if mode == FAN:
        return np.stack([np.full(max(len(line) - 2, 0), line[:1].sum()), line[1:-1], line[2:]], axis=1)
    return line[: len(line) // 3 * 3].reshape(-1, 3)


def _carried(file: ParsedGlb) -> dict[int, list[int]]:
    """Nodes that hang on the skeleton, and for each the joint nearest above it and the nodes from there on."""
    found: dict[int, list[int]] = {}
    waiting = [(node, [joint]) for joint, node in enumerate(file.nodes)]
    own = set(file.nodes)
    while waiting:
        node, line = waiting.pop()
        if node not in found:
            found[node] = line
            below = file.content["nodes"][node].get("children", [])
            waiting += [(child, [*line, child]) for child in below if child not in own]
    return found
