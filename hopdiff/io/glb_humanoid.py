"""What a GLB file itself says of the body in it: which nodes are which bones of a VRM human, and which carry the skin.

VRM Consortium, VRM 0.0 (2018) and VRMC_vrm 1.0 (2022); Khronos Group, glTF 2.0 specification (2021).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hopdiff.io.glb_parse import BIN, ParsedGlb

WEIGHT = 0.05  # of a point of the skin, above which a joint carries it
_TYPES = {5121: "<u1", 5123: "<u2", 5126: "<f4"}


def vrm_bones(file: ParsedGlb) -> tuple[dict[str, int], str]:
    """Bone of VRM 0 or 1 -> index of its joint among the file's, and what is wrong with the map: "" where nothing is.
    Neither where there is no map."""
    bones, joints = _humanoid(file.content), {node: joint for joint, node in enumerate(file.nodes)}
    found: dict[str, int] = {}
    wrong = ""
    for bone, node in bones.items():
        if isinstance(node, int) and not isinstance(node, bool) and node in joints:
            found[bone] = joints[node]
        else:
            wrong = wrong or f"its VRM map has {bone} at {node!r}, which is no joint of its skeleton"
    return found, wrong


def skin_joints(file: ParsedGlb) -> frozenset[int]:
    """The joints that carry the skin of a file's meshes; none where its weights cannot be read, as compressed ones."""
    joints, found = {node: joint for joint, node in enumerate(file.nodes)}, set[int]()
    try:
        for node in file.content["nodes"]:
            if "mesh" not in node or "skin" not in node:
                continue
            own = file.content["skins"][node["skin"]]["joints"]
            for part in file.content["meshes"][node["mesh"]]["primitives"]:
                given = part["attributes"]
                for number in range(len(given)):
                    if f"JOINTS_{number}" not in given:
                        break
                    used = _values(file, given[f"JOINTS_{number}"])
                    weights = _values(file, given[f"WEIGHTS_{number}"])
                    scale = 1.0 if weights.dtype.kind == "f" else float(np.iinfo(weights.dtype).max)
                    found |= {joints[own[k]] for k in np.unique(used[weights > WEIGHT * scale]) if own[k] in joints}
    except (KeyError, IndexError, TypeError, ValueError, AttributeError):
        return frozenset()
    return frozenset(found)


def _humanoid(content: Mapping[str, Any]) -> dict[str, Any]:
    """Bone -> node, as written; of both versions the later."""
    extensions = content.get("extensions")
    if not isinstance(extensions, dict):
        return {}
    for version in ("VRMC_vrm", "VRM"):
        given = extensions.get(version)
        humanoid = given.get("humanoid") if isinstance(given, dict) else None
        bones = humanoid.get("humanBones") if isinstance(humanoid, dict) else None
        if isinstance(bones, dict):
            return {str(bone): one.get("node") if isinstance(one, dict) else one for bone, one in bones.items()}
        if isinstance(bones, list):
            return {str(one.get("bone")): one.get("node") for one in bones if isinstance(one, dict)}
    return {}


def _values(file: ParsedGlb, accessor: Any) -> NDArray[Any]:
    """(N, 4) of an accessor of vectors. Raises one of the errors of looking things up where it cannot be read."""
    entry = file.content["accessors"][accessor]
    view = file.content["bufferViews"][entry["bufferView"]]
    if view["buffer"] != 0 or "uri" in file.content["buffers"][0] or file.chunks[0][0] != BIN or "sparse" in entry:
        raise ValueError("not in the file's own data")
    kind = np.dtype(_TYPES[entry["componentType"]])
    start = view.get("byteOffset", 0) + entry.get("byteOffset", 0)
    if (stride := view.get("byteStride", 4 * kind.itemsize)) < 4 * kind.itemsize:
        raise ValueError("vectors that lie in each other")
    found: NDArray[Any] = np.ndarray((entry["count"], 4), kind, file.chunks[0][1], start, (stride, kind.itemsize))
    return found
