"""A binary glTF 2.0 file of somebody else's: its skeleton, and the file again with one more animation.

Khronos Group, glTF 2.0 specification (2021). Its axes and unit are hopdiff's own: x left, y up, z forward, metres.
"""

from __future__ import annotations

import base64
import copy
import json
import os
import struct
from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from hopdiff.geometry.quaternion import quaternions
from hopdiff.geometry.skeleton import Skeleton
from hopdiff.io.glb_parse import BIN, JSON, Matrix, ParsedGlb, parse_glb
from hopdiff.types import HopdiffError

FLOAT = 5126  # component type of glTF
STILL = 1e-6  # m by which a joint may move against its parent and still stay


class GlbFile(ParsedGlb):
    """What was read of a GLB file, and what can be made of it."""

    __slots__ = ()

    @property
    def names(self) -> tuple[str, ...]:
        """(J) joint names, made different: the second of two called Arm is Arm_2, and so on."""
        given = [str(self.content["nodes"][node].get("name") or f"node_{node}") for node in self.nodes]
        count, taken, names = Counter(given), set[str](), []
        for name in given:
            new, number = name, 1
            while new in taken or (number > 1 and new in count):
                number += 1
                new = f"{name}_{number}"
            taken.add(new)
            names.append(new)
        return tuple(names)

    def skeleton(self) -> Skeleton:
        """The joints at rest in metres. Their frames are aligned with the world's axes in the rest pose, whatever the
        file's own are; the root's offset is its place in the world."""
        places = torch.from_numpy(self.matrices[:, :3, 3].copy())
        offsets = torch.stack([places[k] - (places[p] if p >= 0 else 0.0) for k, p in enumerate(self.parents)])
        names = self.names
        ends = {names[k]: torch.from_numpy(end[:3, 3].copy()) - places[k] for k, end in self.ends.items()}
        return Skeleton(names, self.parents, offsets, ends)

    def with_animation(
        self, name: str, times: Tensor, root_position: Tensor, rotations: Tensor, offsets: Tensor | None = None
    ) -> bytes:
        """The same file with one more animation; all that was in it stays.

        name: of the animation; made different from those in the file. times: (T,) from 0 on [s]. root_position: (T, 3)
        of the first joint in the world [m]. rotations: (T, J, 3, 3) of the joints of `skeleton`, each in its parent's
        frame. offsets: (T, J, 3) of joints that move against their parents [m]; those of the root count for nothing.
        Keys are linear. Raises HopdiffError without frames, for numbers that are not finite, or a file of more
        than 4 GiB.
        """
        if len(times) == 0 or not all(bool(torch.isfinite(x).all()) for x in (times, root_position, rotations)):
            raise HopdiffError(
                f"cannot write {name!r} into {self.path}: it has no frames, or numbers that are not finite."
            )
        rest = torch.from_numpy(np.stack([_rotation(matrix) for matrix in self.matrices]))
        over = torch.stack([rest[p] if p >= 0 else torch.from_numpy(_rotation(self.above)) for p in self.parents])
        turns = quaternions(over.transpose(-1, -2) @ rotations.detach().double().cpu() @ rest).numpy()
        back = np.linalg.inv(self.above)
        way = root_position.detach().double().cpu().numpy() @ back[:3, :3].T + back[:3, 3]
        writer = _Writer(self)
        for node in self.nodes:
            writer.plain_node(node)
        moved = {self.nodes[0]: way}
        if offsets is not None:
            for joint, own in enumerate(offsets.detach().double().cpu().numpy().swapaxes(0, 1)):
                if joint > 0 and np.ptp(own, axis=0).max() > STILL:
                    moved[self.nodes[joint]] = own @ np.linalg.inv(self.matrices[self.parents[joint], :3, :3]).T
        writer.animate(
            name, times.detach().double().cpu().numpy(), moved, dict(zip(self.nodes, turns.swapaxes(0, 1), strict=True))
        )
        return writer.bytes()


def read_glb(path: str | os.PathLike[str]) -> GlbFile:
    """Read a GLB file with a skin.

    Raises HopdiffError, naming the file, where it cannot be read, is no whole GLB file of version 2, keeps its data in
    other files, has no skin with joints, or joints of uneven scale.
    """
    try:
        data = Path(path).read_bytes()
    except OSError as error:
        raise HopdiffError(f"cannot read {path}: {(error.strerror or str(error)).lower()}.") from error
    return GlbFile(*parse_glb(data, str(path)))


def _rotation(matrix: Matrix) -> Matrix:
    """(3, 3) the turn in a matrix (4, 4)."""
    left, _, right = np.linalg.svd(matrix[:3, :3])
    found: Matrix = left @ right
    return found


class _Writer:
    """A copy of a file in which things are added at the ends of its lists and of its data."""

    def __init__(self, file: GlbFile) -> None:
        self.content = copy.deepcopy(file.content)
        self.chunks = list(file.chunks)
        self.whole = bool(self.chunks) and self.chunks[0][0] == BIN
        buffers = self.content.setdefault("buffers", [])
        if not self.whole and not buffers:
            self.chunks.insert(0, (BIN, b""))
            self.whole = True
            buffers.append({"byteLength": 0})
        elif not self.whole:
            # The first buffer brings its own data, so that there is no place for a chunk: ours do the same.
            buffers.append({"byteLength": 0})
        self.buffer = 0 if self.whole else len(buffers) - 1
        self.data = bytearray(self.chunks[0][1] if self.whole else b"")

    def plain_node(self, index: int) -> None:
        """Give a node that has a matrix its turn, place and scale instead: others must not be animated."""
        node = self.content["nodes"][index]
        if "matrix" not in node:
            return
        matrix = np.array(node.pop("matrix"), dtype=np.float64).reshape(4, 4).T
        turn = torch.from_numpy(_rotation(matrix))
        node["translation"] = matrix[:3, 3].tolist()
        node["rotation"] = quaternions(turn[None])[0].tolist()
        node["scale"] = np.linalg.norm(matrix[:3, :3], axis=0).tolist()

    def animate(self, name: str, times: Matrix, moved: Mapping[int, Matrix], turns: Mapping[int, Matrix]) -> None:
        """times: (T,) [s]. By node, in its parent's frame: moved, (T, 3) places; turns, (T, 4) x y z w."""
        animations = self.content.setdefault("animations", [])
        taken = {str(animation.get("name")) for animation in animations}
        new, number = name, 1
        while new in taken:
            number += 1
            new = f"{name}_{number}"
        keys = self.add(times[:, None], bounds=True)
        samplers: list[dict[str, Any]] = []
        channels: list[dict[str, Any]] = []
        for path, values in (("translation", moved), ("rotation", turns)):
            for node, own in values.items():
                channels.append({"sampler": len(samplers), "target": {"node": node, "path": path}})
                samplers.append({"input": keys, "output": self.add(own), "interpolation": "LINEAR"})
        animations.append({"name": new, "channels": channels, "samplers": samplers})

    def add(self, values: Matrix, bounds: bool = False) -> int:
        """Put values (T, width) into the data; returns their accessor."""
        floats = values.astype("<f4")
        self.data += b"\0" * (-len(self.data) % 4)
        view = {"buffer": self.buffer, "byteOffset": len(self.data), "byteLength": floats.nbytes}
        self.data += floats.tobytes()
        views, accessors = self.content.setdefault("bufferViews", []), self.content.setdefault("accessors", [])
        views.append(view)
        kind = "SCALAR" if values.shape[-1] == 1 else f"VEC{values.shape[-1]}"
        accessor = {"bufferView": len(views) - 1, "componentType": FLOAT, "count": len(values), "type": kind}
        if bounds:
            accessor |= {"min": floats.min(axis=0).tolist(), "max": floats.max(axis=0).tolist()}
        accessors.append(accessor)
        return len(accessors) - 1

    def bytes(self) -> bytes:
        self.data += b"\0" * (-len(self.data) % 4)
        buffer = self.content["buffers"][self.buffer]
        buffer["byteLength"] = len(self.data)
        if self.whole:
            self.chunks[0] = (BIN, bytes(self.data))
        else:
            text = base64.b64encode(self.data).decode()
            buffer["uri"] = f"data:application/octet-stream;base64,{text}"
        written = json.dumps(self.content, separators=(",", ":"), ensure_ascii=False, allow_nan=False).encode()
        chunks = [(JSON, written + b" " * (-len(written) % 4)), *self.chunks]
        size = 12 + sum(8 + len(data) for _, data in chunks)
        if size >= 2**32:
            raise HopdiffError("a GLB file cannot be larger than 4 GiB.")
        parts = [struct.pack("<4sII", b"glTF", 2, size)]
        for kind, data in chunks:
            parts += [struct.pack("<II", len(data), kind), data]
        return b"".join(parts)
