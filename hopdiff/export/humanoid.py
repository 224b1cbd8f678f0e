"""The bones of a VRM human as parts of a body."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from itertools import pairwise

from hopdiff.export.anatomy import CHAINS, REQUIRED, parts_of
from hopdiff.geometry.joint_names import SIDES
from hopdiff.geometry.skeleton import Skeleton
from hopdiff.io.glb_file import GlbFile
from hopdiff.io.glb_humanoid import vrm_bones

# Part -> bone. VRM Consortium, VRMC_vrm 1.0 (2022), humanoid.
BONES: Mapping[str, str] = {
    "pelvis": "hips",
    "waist": "spine",
    "chest": "chest",
    "upper_chest": "upperChest",
    "neck": "neck",
    "head": "head",
    **{
        f"{side}_{ours}": f"{side}{theirs}"
        for side in SIDES
        for ours, theirs in (
            ("collar", "Shoulder"),
            ("shoulder", "UpperArm"),
            ("elbow", "LowerArm"),
            ("wrist", "Hand"),
            ("hip", "UpperLeg"),
            ("knee", "LowerLeg"),
            ("ankle", "Foot"),
            ("toe", "Toes"),
        )
    },
}


def parts_in(file: GlbFile, skeleton: Skeleton, skin: Collection[int]) -> tuple[dict[str, int], str]:
    """Part of the body -> joint, as the file's VRM map says, or as `parts_of` finds them where there is none that makes
    sense; and why the map does not count, or "".

    skeleton: the file's. skin: joints that carry the skin, as far as that is known.
    """
    bones, wrong = vrm_bones(file)
    parts = {part: bones[bone] for part, bone in BONES.items() if bone in bones}
    if bones and not wrong:
        wrong = _wrong(skeleton, parts)
    if bones and not wrong:
        return parts, ""
    return parts_of(skeleton, skin), wrong and f"{wrong}, so that names and shape count"


def _wrong(skeleton: Skeleton, parts: Mapping[str, int]) -> str:
    """What of a map is no body, or ""."""
    if missing := [BONES[part] for part in REQUIRED if part not in parts]:
        return f"its VRM map lacks {missing[0]}"
    for chain in CHAINS:
        for upper, lower in pairwise(part for part in chain if part in parts):
            if parts[upper] not in skeleton.above(parts[lower]):
                return f"{BONES[lower]} of its VRM map does not hang on {BONES[upper]}"
    return ""
