"""The pose in which the skin of a GLB file was made, and the ground below it.

Nodes of a file may stand as in any frame of any animation. What takes the skin's vertices into a joint, its inverse
bind matrix, tells where the joint was when the skin was made, up to one transform of the whole skin.
"""

from __future__ import annotations

import base64
import binascii
import itertools
import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hopdiff.io.glb_parts import BIN, FLOAT

Matrix = NDArray[np.float64]

ALIKE = 1e-2  # share by which the scales of joints may differ
TURNED = math.radians(1.0)  # by which a joint may be turned from how it was bound and still count as in that pose
MOVED = 1e-3  # m, likewise
UPRIGHT = math.radians(45.0)  # by which the first joint may be turned from how it was bound


def rotation(matrix: Matrix) -> Matrix:
    """(3, 3) the turn in a matrix (4, 4)."""
    left, _, right = np.linalg.svd(matrix[:3, :3])
    return left @ right


def inverse_bind(content: Mapping[str, Any], chunks: Sequence[tuple[int, bytes]], skin: Mapping[str, Any]) -> Matrix:
    """(K, 4, 4) of a skin's joints; of none, (0, 4, 4), where they are not given, packed, or no sensible matrices."""
    nothing = np.empty((0, 4, 4))
    if "inverseBindMatrices" not in skin:
        return nothing
    accessor = content["accessors"][skin["inverseBindMatrices"]]
    kind = (accessor.get("componentType"), accessor.get("type"))
    if kind != (FLOAT, "MAT4") or "sparse" in accessor or "bufferView" not in accessor:
        return nothing
    view = content["bufferViews"][accessor["bufferView"]]
    data = _data(content["buffers"][view["buffer"]], chunks)
    start, count = view.get("byteOffset", 0), len(skin["joints"])
    offset = accessor.get("byteOffset", 0)
    whole = all(isinstance(value, int) and value >= 0 for value in (start, offset))
    if not whole or "extensions" in view or start + offset + 64 * count > len(data) or accessor.get("count") != count:
        return nothing
    found = np.frombuffer(data, "<f4", 16 * count, start + offset).reshape(-1, 4, 4).transpose(0, 2, 1).astype(float)
    if not np.isfinite(found).all() or np.abs(found).max() > 1e9:
        return nothing
    sound = np.abs(found[:, 3] - [0.0, 0.0, 0.0, 1.0]).max() < 1e-3 and np.abs(np.linalg.det(found)).min() > 1e-18
    return found if sound else nothing


def _data(buffer: Mapping[str, Any], chunks: Sequence[tuple[int, bytes]]) -> bytes:
    if "uri" not in buffer:
        return chunks[0][1] if chunks and chunks[0][0] == BIN else b""
    head, _, text = str(buffer["uri"]).partition(",")
    try:
        return base64.b64decode(text, validate=True) if head.endswith(";base64") else b""
    except binascii.Error:
        return b""


def bound(
    inverses: Mapping[int, Matrix],
    parents: Sequence[int],
    own: Matrix,
    now: Matrix,
    above: Matrix,
    wholes: Sequence[Matrix],
) -> tuple[Matrix, Matrix]:
    """(J, 4, 4) joints in the world as they were bound, and (4, 4) what takes the skin's points there.

    inverses: inverse bind matrices (4, 4) by joint. own, now: (J, 4, 4) nodes in their parents, and in the world;
    above: (4, 4) the first one's parent in the world. wholes: where exporters have the skin.
    Joints that are hardly turned or moved, and those that were not bound, keep what their nodes have.
    """
    if not inverses:
        return now, np.eye(4)
    first = min(inverses)
    whole = now[first] @ inverses[first]
    places = {joint: whole @ np.linalg.inv(inverse) for joint, inverse in inverses.items()}
    if all(_alike(now[joint], place) for joint, place in places.items()):
        return now, whole
    if any(abs(_scale(place) / _scale(now[joint]) - 1.0) > ALIKE for joint, place in places.items()):
        return now, whole  # joints that grow or shrink: a pose cannot be told from their size
    # The first joint may be turned, too: of the places where exporters have a skin the one that this is nearest to.
    fitting = [one for one in wholes if abs(_scale(one) / _scale(whole) - 1.0) < ALIKE]
    nearest = min(fitting, key=lambda one: _angle(whole, one), default=whole)
    whole = nearest if _angle(whole, nearest) < UPRIGHT else whole
    places = {joint: whole @ np.linalg.inv(inverse) for joint, inverse in inverses.items()}
    return _posed(places, parents, own, above), whole


def _posed(places: Mapping[int, Matrix], parents: Sequence[int], own: Matrix, above: Matrix) -> Matrix:
    """(J, 4, 4) joints in the world with some of them turned as in their places (4, 4), scaled as their nodes are."""
    own = own.copy()
    world = np.empty_like(own)
    for joint, parent in enumerate(parents):
        over = above if parent < 0 else world[parent]
        if joint in places:
            local = np.linalg.inv(over) @ places[joint]
            own[joint, :3, :3] = rotation(local) * np.linalg.norm(own[joint, :3, :3], axis=0)
            if np.linalg.norm(local[:3, 3] - own[joint, :3, 3]) * _scale(over) > MOVED:
                own[joint, :3, 3] = local[:3, 3]
        world[joint] = over @ own[joint]
    return world


def lowest(boxes: Sequence[Mapping[str, Any]], whole: Matrix) -> float | None:
    """Height of the lowest corner of boxes, accessors with min and max, that a matrix (4, 4) takes into the world [m];
    None if there is none, or they are not given in plain numbers."""
    heights = []
    for box in boxes:
        ends = [box.get("min"), box.get("max")]
        plain = all(isinstance(end, list) and all(isinstance(x, int | float) for x in end) for end in ends)
        if not plain or box.get("componentType") != FLOAT or [len(end) for end in ends if end is not None] != [3, 3]:
            return None
        corners = np.array(list(itertools.product(*np.transpose(ends))), dtype=float)
        heights.append(float((corners @ whole[1, :3] + whole[1, 3]).min()))
    return min(heights) if heights and math.isfinite(min(heights)) else None


def _scale(matrix: Matrix) -> float:
    return float(np.cbrt(abs(np.linalg.det(matrix[:3, :3]))))


def _angle(a: Matrix, b: Matrix) -> float:
    """Between the turns in two matrices (4, 4) [rad]."""
    cosine = (np.trace(rotation(a) @ rotation(b).T) - 1.0) / 2.0
    return math.acos(min(1.0, max(-1.0, float(cosine))))


def _alike(a: Matrix, b: Matrix) -> bool:
    return _angle(a, b) < TURNED and float(np.linalg.norm(a[:3, 3] - b[:3, 3])) < MOVED
