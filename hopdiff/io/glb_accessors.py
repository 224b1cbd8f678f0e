"""Numbers out of the buffers of a glTF file.

Khronos Group, glTF 2.0 specification (2021), sections 3.6 and 5.1; KHR_mesh_quantization.
"""

from __future__ import annotations

import base64
import binascii
from collections.abc import Mapping, Sequence
from typing import Any, TypeGuard, TypeVar

import numpy as np
from numpy.typing import NDArray

from hopdiff.io.glb_unpack import MESHOPT, unpacked_view

BIN = 0x004E4942  # kind of a chunk with data
KINDS = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}
T = TypeVar("T")
MOST = 12_000_000  # numbers of one accessor that are read: those of four million vertices


class Accessors:
    """The accessors of a file. content: its JSON. chunks: (kind, bytes) that follow it.

    compressed: extensions whose data was asked for and cannot be read.
    """

    def __init__(self, content: dict[str, Any], chunks: Sequence[tuple[int, bytes]]) -> None:
        self.content = content
        self.binary = chunks[0][1] if chunks and chunks[0][0] == BIN else None
        self.compressed: set[str] = set()
        self._buffers: dict[int, bytes | None] = {}
        self._unpacked: dict[int, bytes | None] = {}

    def values(self, index: Any) -> NDArray[np.float64] | None:
        """(count, width) numbers, those of normalised integers between -1 and 1; None where they cannot be had."""
        accessor = _entry(self.content, "accessors", index)
        if accessor is None:
            return None
        kind, width = _known(KINDS, accessor.get("componentType")), _known(WIDTHS, accessor.get("type"))
        count = accessor.get("count")
        if kind is None or width is None or not _is_size(count) or count * width > MOST:
            return None
        found: NDArray[Any] | None
        if "bufferView" in accessor:
            found = self._rows(accessor["bufferView"], accessor.get("byteOffset", 0), kind, count, width)
        else:
            found = np.zeros((count, width), np.dtype(kind))
        if found is not None and "sparse" in accessor:
            found = self._replaced(found, accessor["sparse"], kind, width)
        if found is None:
            return None
        return self.scaled(index, found.astype(np.float64))

    def scaled(self, index: Any, stored: NDArray[np.float64] | None) -> NDArray[np.float64] | None:
        """Numbers as they are meant of those that are stored for an accessor."""
        accessor = _entry(self.content, "accessors", index)
        if stored is None or accessor is None or not bool(np.isfinite(stored).all()):
            return None
        kind = _known(KINDS, accessor.get("componentType")) or "<f4"
        if accessor.get("normalized") and np.dtype(kind).kind in "iu":
            return np.maximum(stored / np.iinfo(kind).max, -1.0)
        return stored

    def bytes_of(self, index: Any) -> bytes | None:
        """Of a whole buffer view."""
        data, start = self.view(index)
        entry = _entry(self.content, "bufferViews", index)
        size = None if entry is None else entry.get("byteLength")
        if data is None or not _is_size(start) or not _is_size(size) or start + size > len(data):
            return None
        return data[start : start + size]

    def _replaced(self, found: NDArray[Any], sparse: Any, kind: str, width: int) -> NDArray[Any] | None:
        """Rows with those of a sparse accessor in their places."""
        if not isinstance(sparse, dict) or not _is_size(count := sparse.get("count")):
            return None
        places, values = sparse.get("indices"), sparse.get("values")
        if not isinstance(places, dict) or not isinstance(values, dict) or count > len(found):
            return None
        own = _known(KINDS, places.get("componentType"))
        if own is None or np.dtype(own).kind != "u":
            return None
        at = self._rows(places.get("bufferView"), places.get("byteOffset", 0), own, count, 1)
        new = self._rows(values.get("bufferView"), values.get("byteOffset", 0), kind, count, width)
        if at is None or new is None or (count and int(at.max()) >= len(found)):
            return None
        whole = found.copy()
        whole[at[:, 0].astype(np.int64)] = new
        return whole

    def _rows(self, index: Any, offset: Any, kind: str, count: int, width: int) -> NDArray[Any] | None:
        """(count, width) numbers of a buffer view."""
        view = _entry(self.content, "bufferViews", index)
        if view is None or not _is_size(offset):
            return None
        data, start = self.view(index)
        size = view.get("byteLength")
        one = np.dtype(kind).itemsize * width
        stride = view.get("byteStride", one)
        if data is None or not all(_is_size(number) for number in (start, size, stride)) or stride < one:
            return None
        start += offset
        if count == 0:
            return np.zeros((0, width), np.dtype(kind))
        last = start + (count - 1) * stride + one
        if last > len(data) or last > start - offset + size:
            return None
        strides = (stride, np.dtype(kind).itemsize)
        return np.ndarray((count, width), np.dtype(kind), data, start, strides)

    def view(self, index: Any) -> tuple[bytes | None, Any]:
        """The bytes that hold a buffer view, unpacked if they are compressed, and where it begins in them."""
        entry = _entry(self.content, "bufferViews", index)
        if entry is None:
            return None, 0
        for name in MESHOPT:
            if (packed := extension(entry, name)) is not None:
                if index not in self._unpacked:
                    data = self._buffer(packed.get("buffer"))
                    self._unpacked[index] = None if data is None else unpacked_view(packed, data)
                if self._unpacked[index] is None:
                    self.compressed.add(name)
                return self._unpacked[index], 0
        return self._buffer(entry.get("buffer")), entry.get("byteOffset", 0)

    def _buffer(self, index: Any) -> bytes | None:
        entry = _entry(self.content, "buffers", index)
        if entry is None:
            return None
        if index not in self._buffers:
            uri = entry.get("uri")
            self._buffers[index] = self.binary if uri is None and index == 0 else _inside(uri)
        return self._buffers[index]


def _inside(uri: Any) -> bytes | None:
    """The bytes in a data URI."""
    if not isinstance(uri, str) or not uri.startswith("data:") or ";base64," not in uri:
        return None
    try:
        return base64.b64decode(uri.split(",", 1)[1], validate=True)
    except binascii.Error:
        return None


def extension(entry: Mapping[str, Any], name: str) -> dict[str, Any] | None:
    """What an extension says of something in a file; None where there is none, or no table."""
    marks = entry.get("extensions")
    found = marks.get(name) if isinstance(marks, dict) else None
    return found if isinstance(found, dict) else None


def _known(table: Mapping[Any, T], key: Any) -> T | None:
    return table.get(key) if isinstance(key, int | str) else None


def _entry(content: dict[str, Any], name: str, index: Any) -> dict[str, Any] | None:
    entries: Sequence[Any] = content.get(name, [])
    if not isinstance(entries, list) or not _is_size(index) or index >= len(entries):
        return None
    return entries[index] if isinstance(entries[index], dict) else None


def _is_size(number: Any) -> TypeGuard[int]:
    return isinstance(number, int) and not isinstance(number, bool) and 0 <= number < 2**40
