"""What a GLB file itself says of the body in it: which nodes are which bones of a VRM human.

VRM Consortium, VRM 0.0 (2018) and VRMC_vrm 1.0 (2022).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from hopdiff.io.glb_parse import ParsedGlb


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
