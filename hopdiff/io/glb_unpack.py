"""Compressed data of glTF files, unpacked by packages of the extras `meshopt` and `draco` where they are installed.

EXT_meshopt_compression (Kapoulkine 2021) and KHR_draco_mesh_compression (Khronos 2018).
"""

from __future__ import annotations

from importlib import import_module
from typing import Any

import numpy as np
from numpy.typing import NDArray

MESHOPT = ("EXT_meshopt_compression", "KHR_meshopt_compression")
DRACO = "KHR_draco_mesh_compression"
MOST = 2**28  # bytes or numbers that one view or mesh may be unpacked to


def unpacked_view(packed: dict[str, Any], data: bytes) -> bytes | None:
    """The bytes of a buffer view. packed: what its extension says. data: of the buffer that this names. None where the
    package is missing or the data broken."""
    try:
        meshoptimizer = import_module("meshoptimizer")
    except ImportError:
        return None
    start, size = packed.get("byteOffset", 0), packed.get("byteLength", 0)
    stride, count = packed.get("byteStride", 0), packed.get("count", 0)
    numbers = (start, size, stride, count)
    if not all(isinstance(number, int) and 0 <= number < MOST for number in numbers) or not 0 < stride * count < MOST:
        return None
    own = data[start : start + size]
    try:
        match packed.get("mode"):
            case "ATTRIBUTES":
                raw = np.dtype((np.void, stride))
                found = meshoptimizer.decode_vertex_buffer(count, stride, own, raw).view(np.uint8)
                filters = {"OCTAHEDRAL": "oct", "QUATERNION": "quat", "EXPONENTIAL": "exp"}
                if (name := filters.get(packed.get("filter", "NONE"))) is not None:
                    found = getattr(meshoptimizer, f"decode_filter_{name}")(found, count, stride)
            case "TRIANGLES" | "INDICES" as mode if stride in (2, 4):
                decode = "decode_index_buffer" if mode == "TRIANGLES" else "decode_index_sequence"
                found = getattr(meshoptimizer, decode)(count, 4, own).astype(f"<u{stride}")
            case _:
                return None
    except (RuntimeError, ValueError):
        return None
    unpacked: bytes = found.tobytes()
    return unpacked


def unpacked_mesh(
    packed: dict[str, Any], data: bytes | None
) -> tuple[dict[str, NDArray[np.float64]], NDArray[np.int64]] | None:
    """Attributes (V, width) by name as stored, and faces (F, 3), of a primitive. packed: what its extension says. data:
    of the buffer view that this names. None where the package is missing or the data broken."""
    names = packed.get("attributes")
    try:
        draco = import_module("DracoPy")
    except ImportError:
        return None
    if data is None or not isinstance(names, dict):
        return None
    try:
        mesh = draco.decode(data)
        by_id = {one["unique_id"]: np.asarray(one["data"], dtype=np.float64) for one in mesh.attributes}
        found = {name: by_id[number] for name, number in names.items() if number in by_id}
        return found, np.asarray(mesh.faces, dtype=np.int64)
    except Exception:  # its errors are of kinds of its own
        return None
