"""What every GLB file is put together from: chunks, and arrays of numbers in a buffer.

Khronos Group, glTF 2.0 specification (2021), sections 3.6 and 4.
"""

from __future__ import annotations

import json
import struct
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hopdiff.types import HopdiffError

JSON, BIN = 0x4E4F534A, 0x004E4942  # kinds of chunks
FLOAT = 5126
COMPONENTS = {"f4": FLOAT, "u1": 5121, "u2": 5123, "u4": 5125}  # component types of glTF by those of numpy
LARGEST = 2**32  # bytes


class Arrays:
    """Arrays at the end of a buffer. accessors, views: lists of a file's content that they are entered in; buffer: its
    index; data: what is in it."""

    def __init__(
        self, accessors: list[dict[str, Any]], views: list[dict[str, Any]], buffer: int = 0, data: bytes = b""
    ):
        self.accessors = accessors
        self.views = views
        self.buffer = buffer
        self.data = bytearray(data)

    def add(self, values: NDArray[Any], shape: str, target: int | None = None, bounds: bool = False) -> int:
        """Put values (n, width) of a type of COMPONENTS into the buffer; returns the index of their accessor.

        shape: SCALAR, VEC3 and so on. target: of the view, for vertices and indices. bounds: whether the accessor has
        min and max.
        """
        self.pad()
        data = np.ascontiguousarray(values, dtype=values.dtype.newbyteorder("<")).tobytes()
        view = {"buffer": self.buffer, "byteOffset": len(self.data), "byteLength": len(data)}
        self.views.append(view | ({} if target is None else {"target": target}))
        self.data += data
        kind = COMPONENTS[values.dtype.str[1:]]
        accessor = {
            "bufferView": len(self.views) - 1,
            "componentType": kind,
            "count": len(values),
            "type": shape,
        }
        if bounds:
            accessor |= {"min": values.min(axis=0).tolist(), "max": values.max(axis=0).tolist()}
        self.accessors.append(accessor)
        return len(self.accessors) - 1

    def pad(self) -> None:
        """Fill the buffer up to whole groups of four bytes."""
        self.data += b"\0" * (-len(self.data) % 4)


def joined(content: Mapping[str, Any], chunks: Sequence[tuple[int, bytes]]) -> bytes:
    """A whole file. chunks: (kind, bytes) after the JSON chunk, of whole groups of four bytes.

    Raises HopdiffError for a file of more than 4 GiB.
    """
    text = json.dumps(content, separators=(",", ":"), ensure_ascii=False, allow_nan=False).encode()
    every = [(JSON, text + b" " * (-len(text) % 4)), *chunks]
    size = 12 + sum(8 + len(data) for _, data in every)
    if size >= LARGEST:
        raise HopdiffError("a GLB file cannot be larger than 4 GiB.")
    parts = [struct.pack("<4sII", b"glTF", 2, size)]
    for kind, data in every:
        parts += [struct.pack("<II", len(data), kind), data]
    return b"".join(parts)
