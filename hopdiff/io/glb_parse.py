"""What is in the bytes of a GLB file, and where its skeleton is."""

from __future__ import annotations

import json
import math
import struct
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hopdiff.io.glb_accessors import BIN, Accessors, extension
from hopdiff.io.glb_unpack import MESHOPT
from hopdiff.types import HopdiffError

Matrix = NDArray[np.float64]
Chunks = tuple[tuple[int, bytes], ...]

UNEVEN = 0.03  # share by which the scales of a joint may differ between its axes: what nobody sees
FLAT = 1e-9  # of its size to the third that the volume of a matrix must be for it to have an inverse
LONGEST = 1e6  # of any number in a node: what is larger is no place in a character
JSON = 0x4E4F534A  # kind of the first chunk


class GlbSkin(NamedTuple):
    """A skin of the skeleton. number: in the file. joints: (N) of the skeleton. inverse: (N, 4, 4) what takes its mesh
    into the frames of its joints, 0 where that has no inverse itself; None where it cannot be read."""

    number: int
    joints: tuple[int, ...]
    inverse: Matrix | None


class ParsedGlb(NamedTuple):
    """A GLB file. Of several skins the one with the most joints counts, of these the first, with all that share joints
    with it or hang on the same root.

    path: where it was read. content: its JSON. chunks: (kind, bytes) that follow it, in their order.
    nodes: J of them, parents first: the skins' joints, and what lies between them. parents: (J) indices among these.
    above: (4, 4) what takes the parent of the first node into the world. matrices: (J, 4, 4) nodes into the world as
    they stand in the file. ends: nodes (4, 4) at the end of a joint, by joint. skins: of this skeleton, the one that
    counts first. uneven: joints (J) whose scale is not the same along all axes, their own or from above.
    """

    path: str
    content: dict[str, Any]
    chunks: Chunks
    nodes: tuple[int, ...]
    parents: tuple[int, ...]
    above: Matrix
    matrices: Matrix
    ends: dict[int, Matrix]
    skins: tuple[GlbSkin, ...]
    uneven: tuple[int, ...]


def parse_glb(data: bytes, path: str) -> ParsedGlb:
    """The content and the skeleton of a file's bytes. path: for errors. Raises HopdiffError; see `read_glb`."""
    content, chunks = _split(data, path)
    return _Reader(content, path).parsed(chunks)


def local_matrix(file: ParsedGlb, line: Sequence[int]) -> Matrix:
    """(4, 4) what takes the frame of the last of nodes that hang on each other into that which the first hangs in.
    Raises HopdiffError where their numbers make no sense."""
    reader, found = _Reader(file.content, file.path), np.eye(4)
    for node in line:
        found = found @ reader.matrix(node)
    return found


def _split(data: bytes, path: str) -> tuple[dict[str, Any], Chunks]:
    """The JSON of a file and the chunks after it."""
    if data[:4] != b"glTF":
        hint = " It looks like a .gltf text file: save it as one binary .glb file." if data[:1] == b"{" else ""
        raise HopdiffError(f"{path} is not a GLB file.{hint}")
    if len(data) < 20:
        raise HopdiffError(f"{path} is broken: it ends within its first 20 bytes.")
    version, length = struct.unpack_from("<II", data, 4)
    if version != 2:
        raise HopdiffError(f"{path} is glTF of version {version}; only version 2 can be read.")
    if length > len(data):
        raise HopdiffError(f"{path} is broken: it should have {length} bytes and has {len(data)}.")
    chunks, at = [], 12
    while at < length:
        size, kind = struct.unpack_from("<II", data, at) if at + 8 <= length else (length, 0)
        if at + 8 + size > length:
            raise HopdiffError(f"{path} is broken: the chunk at byte {at} is longer than the file.")
        chunks.append((kind, data[at + 8 : at + 8 + size]))
        at += 8 + size
    if not chunks or chunks[0][0] != JSON:
        raise HopdiffError(f"{path} is broken: it does not begin with a JSON chunk.")
    try:
        content = json.loads(chunks[0][1].decode("utf-8"), parse_constant=_no_number, parse_float=_finite)
    except (ValueError, RecursionError) as error:
        raise HopdiffError(f"{path} is broken: its JSON chunk cannot be read ({type(error).__name__}).") from error
    if not isinstance(content, dict):
        raise HopdiffError(f"{path} is broken: its JSON chunk is no table.")
    return content, tuple(chunks[1:])


def _finite(text: str) -> float:
    value = float(text)
    return value if math.isfinite(value) else _no_number(text)


def _no_number(text: str) -> float:
    raise ValueError(f"{text} is no number of JSON")


class _Reader:
    """Finds the skeleton in the JSON of a file; every error names the file."""

    def __init__(self, content: dict[str, Any], path: str) -> None:
        self.content = content
        self.path = path
        self.nodes = self.tables("nodes")
        for node in self.nodes:
            # What is null is not there.
            for name in ("matrix", "translation", "rotation", "scale"):
                if name in node and node[name] is None:
                    del node[name]
        self.parent: dict[int, int] = {}

    def parsed(self, chunks: Chunks) -> ParsedGlb:
        self.check_buffers(chunks)
        self.tables("animations")
        skins = self.skins()
        self.find_parents()
        order, parents = self.tree(skins)
        above = np.eye(4)
        for node in reversed(self.over(order[0])):
            above = above @ self.matrix(node)
        if not self.is_even(above, self.parent.get(order[0], order[0])):
            name = self.nodes[self.parent[order[0]]].get("name", self.parent[order[0]])
            raise self.fail(f"node {name!r}, above all joints, is scaled unevenly or sheared; apply its scale first")
        matrices, uneven = np.empty((len(order), 4, 4)), list[int]()
        for k, (node, parent) in enumerate(zip(order, parents, strict=True)):
            matrices[k] = (matrices[parent] if parent >= 0 else above) @ self.matrix(node)
            if not self.is_even(matrices[k], node):
                uneven.append(k)
        ends = {}
        for k, node in enumerate(order):
            free = [child for child in self.children(node) if "mesh" not in self.nodes[child]]
            if k not in parents and free:
                ends[k] = matrices[k] @ self.matrix(free[0])
        at = {node: k for k, node in enumerate(order)}
        accessors = Accessors(self.content, chunks)
        own = [
            GlbSkin(index, tuple(at[node] for node in joints), self.inverse(index, len(joints), accessors))
            for index, joints in skins.items()
            if set(joints) <= set(at)
        ]
        return ParsedGlb(
            self.path, self.content, chunks, order, parents, above, matrices, ends, tuple(own), tuple(uneven)
        )

    def fail(self, what: str) -> HopdiffError:
        return HopdiffError(f"{self.path}: {what}.")

    def tables(self, name: str) -> list[dict[str, Any]]:
        found = self.content.get(name, [])
        if not isinstance(found, list) or not all(isinstance(entry, dict) for entry in found):
            raise self.fail(f"its {name} are no list of tables")
        return found

    def index(self, value: Any, size: int, what: str) -> int:
        if isinstance(value, bool) or not isinstance(value, int) or not 0 <= value < size:
            raise self.fail(f"it lacks {what} {value!r}")
        return value

    def check_buffers(self, chunks: Chunks) -> None:
        buffers, views = self.tables("buffers"), self.tables("bufferViews")
        for k, buffer in enumerate(buffers):
            uri = buffer.get("uri")
            size = self.index(buffer.get("byteLength"), 2**32, f"the length of buffer {k},")
            if uri is None:
                if any((extension(buffer, name) or {}).get("fallback") for name in MESHOPT):
                    continue  # readers that can unpack the other buffer do not need it
                own = len(chunks[0][1]) if k == 0 and chunks and chunks[0][0] == BIN else -1
                if size > own:
                    raise self.fail(f"it lacks the data of buffer {k}")
            elif not isinstance(uri, str) or not uri.startswith("data:"):
                raise self.fail(f"it keeps data in another file, {str(uri)[:60]!r}; save it as one .glb file")
        for view in views:
            self.index(view.get("buffer"), len(buffers), "buffer")
        for accessor in self.tables("accessors"):
            if "bufferView" in accessor:
                self.index(accessor["bufferView"], len(views), "buffer view")

    def skins(self) -> dict[int, list[int]]:
        """The joints of every skin by its index, the one with the most joints first."""
        skins = self.tables("skins")
        if not skins:
            raise self.fail("it has no skin, so that there is no skeleton to move")
        found: dict[int, list[int]] = {}
        for index, skin in enumerate(skins):
            joints = skin.get("joints")
            if not isinstance(joints, list) or not joints:
                raise self.fail("it has a skin without joints")
            found[index] = [self.index(joint, len(self.nodes), "node") for joint in joints]
            if "inverseBindMatrices" in skin:
                self.index(skin["inverseBindMatrices"], len(self.tables("accessors")), "accessor")
        return dict(sorted(found.items(), key=lambda one: -len(one[1])))

    def inverse(self, index: int, count: int, accessors: Accessors) -> Matrix | None:
        """(count, 4, 4) inverse bind matrices of a skin; without them the mesh is in the joints' own frames."""
        skin = self.tables("skins")[index]
        if "inverseBindMatrices" not in skin:
            return np.tile(np.eye(4), (count, 1, 1))
        values = accessors.values(skin["inverseBindMatrices"])
        if values is None or values.shape[1] != 16 or len(values) < count:
            return None
        found: Matrix = values[:count].reshape(-1, 4, 4).swapaxes(1, 2).copy()
        size = np.linalg.norm(found[:, :3, :3], axis=(1, 2))
        found[np.abs(np.linalg.det(found[:, :3, :3])) <= FLAT * size**3] = 0.0
        return found

    def children(self, node: int) -> list[int]:
        found = self.nodes[node].get("children", [])
        if not isinstance(found, list):
            raise self.fail(f"the children of node {node} are no list")
        return [self.index(child, len(self.nodes), "node") for child in found]

    def find_parents(self) -> None:
        for node in range(len(self.nodes)):
            for child in self.children(node):
                if child in self.parent:
                    raise self.fail(f"node {child} has two parents")
                self.parent[child] = node

    def over(self, node: int) -> list[int]:
        """The nodes above a node, nearest first."""
        found = []
        while (node := self.parent.get(node, -1)) >= 0:
            found.append(node)
            if len(found) > len(self.nodes):
                raise self.fail("its nodes go round in a circle")
        return found

    def tree(self, skins: Mapping[int, Sequence[int]]) -> tuple[tuple[int, ...], tuple[int, ...]]:
        """Joints and what lies between them, parents first, and the index of each one's parent."""
        own, *others = (set(joints) for joints in skins.values())
        while shared := [joints for joints in others if joints & own and not joints <= own]:
            own = own.union(*shared)
        lines = [[node, *self.over(node)] for node in sorted(own)]
        common = set(lines[0]).intersection(*lines[1:])
        if not common:
            raise self.fail("the joints of its skin hang on no node together")
        root = next(node for node in lines[0] if node in common)
        for joints in others:
            more = [[node, *self.over(node)] for node in joints]
            if all(root in line for line in more):
                lines += more
        wanted = {node for line in lines for node in line[: line.index(root) + 1]}
        order, waiting = [], [root]
        while waiting:
            order.append(waiting.pop())
            waiting += [child for child in reversed(self.children(order[-1])) if child in wanted]
        at = {node: k for k, node in enumerate(order)}
        return tuple(order), tuple(-1 if k == 0 else at[self.parent[node]] for k, node in enumerate(order))

    def matrix(self, node: int) -> Matrix:
        """(4, 4) what takes a node's frame into its parent's."""
        entry, found = self.nodes[node], np.eye(4)
        if "matrix" in entry:
            return self.numbers(node, "matrix", np.eye(4).ravel()).reshape(4, 4).T
        x, y, z, w = self.turn(node)
        found[:3, :3] = [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
        found[:3, :3] *= self.numbers(node, "scale", np.ones(3))
        found[:3, 3] = self.numbers(node, "translation", np.zeros(3))
        return found

    def turn(self, node: int) -> Matrix:
        values = self.numbers(node, "rotation", np.array([0.0, 0.0, 0.0, 1.0]))
        if (size := float(np.linalg.norm(values))) < 1e-6:
            raise self.fail(f"the rotation of node {node} is no quaternion")
        return values / size

    def numbers(self, node: int, name: str, default: Matrix) -> Matrix:
        values = self.nodes[node].get(name)
        if values is None:
            return default
        plain = isinstance(values, list) and all(isinstance(x, int | float) and abs(x) < LONGEST for x in values)
        if not plain or len(values) != len(default):
            raise self.fail(f"the {name} of node {node} is not {len(default)} sensible numbers")
        return np.array(values, dtype=np.float64)

    def is_even(self, matrix: Matrix, node: int) -> bool:
        """Whether a matrix turns, mirrors, moves and scales, and nothing else."""
        if not np.isfinite(matrix).all() or np.abs(matrix[3] - [0, 0, 0, 1]).max() > 1e-6:
            raise self.fail(f"the matrix of node {self.nodes[node].get('name', node)!r} is none of a place and a turn")
        product = matrix[:3, :3].T @ matrix[:3, :3]
        square = float(np.trace(product)) / 3.0
        return square > 1e-16 and bool(np.abs(product / square - np.eye(3)).max() <= 2 * UNEVEN)
