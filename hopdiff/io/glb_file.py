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
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from hopdiff.geometry.quaternion import from_quaternions, quaternions
from hopdiff.geometry.skeleton import Skeleton
from hopdiff.io.glb_accessors import BIN
from hopdiff.io.glb_parse import JSON, Matrix, ParsedGlb, parse_glb
from hopdiff.io.glb_rest import turn_of
from hopdiff.types import HopdiffError

FLOAT = 5126  # component type of glTF
STILL = 1e-6  # m by which a joint may move against its parent and still stay
STOOD = 1e-6  # of its size by which a joint may be off its node and still be as that is
Keys = dict[int, Matrix]


@dataclass(frozen=True, eq=False)
class Animation:
    """A motion of a file's joints. times: (T,) from 0 on [s]. places: (T, J, 3) in the world [m]. turns: (T, J, 3, 3)
    of the joints since the pose of `skeleton`, in the world. extras: told with it."""

    name: str
    times: Tensor
    places: Tensor
    turns: Tensor
    extras: Mapping[str, Any] = field(default_factory=dict)


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
        """The joints in metres as their nodes stand. Their frames are aligned with the world's axes in this pose,
        whatever the file's own are; the root's offset is its place in the world."""
        places = torch.from_numpy(self.matrices[:, :3, 3].copy())
        offsets = torch.stack([places[k] - (places[p] if p >= 0 else 0.0) for k, p in enumerate(self.parents)])
        names = self.names
        ends = {names[k]: torch.from_numpy(end[:3, 3].copy()) - places[k] for k, end in self.ends.items()}
        return Skeleton(names, self.parents, offsets, ends)

    def in_pose(self, matrices: Matrix) -> GlbFile:
        """The same with joints (J, 4, 4) in the world that stand otherwise: see `rest_poses`. What is written into it
        starts from this pose; nodes in the file stay as they are."""
        # Ends hang on their joint as they did.
        ends = {k: matrices[k] @ np.linalg.pinv(self.matrices[k]) @ end for k, end in self.ends.items()}
        return self._replace(matrices=matrices, ends=ends)

    def with_animations(self, motions: Sequence[Animation]) -> bytes:
        """The same file with more animations; all that was in it stays.

        Keys are linear, at the animations' own times; joints turn, and those that move against their parents, or stand
        elsewhere than their nodes, have places, too. Raises HopdiffError without frames, for numbers that are not
        finite, or a file of more than 4 GiB.
        """
        writer = _Writer(self)
        for node in self.nodes:
            writer.plain_node(node)
        for motion in motions:
            if len(motion.times) == 0 or not all(
                bool(torch.isfinite(values).all()) for values in (motion.times, motion.places, motion.turns)
            ):
                raise HopdiffError(
                    f"cannot write {motion.name!r} into {self.path}: it has no frames, or numbers that are not finite."
                )
            writer.animate(motion, *self._channels(motion, writer.content["nodes"]))
        return writer.bytes()

    def _channels(self, motion: Animation, nodes: list[dict[str, Any]]) -> tuple[Keys, Keys, Keys]:
        """Places (T, 3), turns (T, 4) and sizes (T, 3) by node, each against its parent. nodes: without matrices."""
        places, turned = (values.detach().double().cpu().numpy() for values in (motion.places, motion.turns))
        moved, turns, sizes = Keys(), Keys(), Keys()
        for k, (node, parent) in enumerate(zip(self.nodes, self.parents, strict=True)):
            own = nodes[node]
            place, turn, size = _parts(own)
            over = self.matrices[parent] if parent >= 0 else self.above
            if parent in self.uneven:
                # It stays against what stretches or flattens it.
                turns[node] = np.tile(turn, (len(places), 1))
                continue
            back, sign = np.linalg.inv(over[:3, :3]), np.where(size < 0.0, -1.0, 1.0)
            stand = back @ self.matrices[k, :3, :3]
            if np.linalg.det(stand) * sign.prod() < 0.0:
                sign[0] *= -1.0  # its skin is mirrored against its node
            stand = stand * sign
            lengths = np.linalg.norm(stand, axis=0)
            if np.abs(stand - _matrix(turn) * np.abs(size)).max() > STOOD * lengths.max():
                turn = quaternions(torch.from_numpy(turn_of(stand / lengths))[None])[0].numpy()
            hidden = np.abs(size).min() < STOOD
            if not hidden and np.abs(sign * lengths - size).max() > STOOD * lengths.max():
                sizes[node] = np.tile(sign * lengths, (len(places), 1))
            frame = turn_of(over)
            above = turned[:, parent] if parent >= 0 else np.eye(3)[None]
            change = frame.T @ (np.swapaxes(above, -1, -2) @ turned[:, k]) @ frame @ _matrix(turn)
            turns[node] = quaternions(torch.from_numpy(np.ascontiguousarray(change))).numpy()
            if parent < 0:
                moved[node] = (places[:, k] - over[:3, 3]) @ back.T
                continue
            line = (np.swapaxes(above, -1, -2) @ (places[:, k] - places[:, parent])[..., None])[..., 0] @ back.T
            reach = STILL / max(float(np.cbrt(abs(np.linalg.det(over[:3, :3])))), 1e-12)
            if max(np.ptp(line, axis=0).max(), np.abs(line - place).max()) > reach:
                moved[node] = line
        return moved, turns, sizes


def read_glb(path: str | os.PathLike[str]) -> GlbFile:
    """Read a GLB file with a skin.

    Raises HopdiffError, naming the file, where it cannot be read, is no whole GLB file of version 2, keeps its data in
    other files, has no skin with joints, or is scaled unevenly above all joints.
    """
    try:
        data = Path(path).read_bytes()
    except OSError as error:
        raise HopdiffError(f"cannot read {path}: {(error.strerror or str(error)).lower()}.") from error
    return GlbFile(*parse_glb(data, str(path)))


def _matrix(turn: Matrix) -> Matrix:
    """(3, 3) of a unit quaternion x y z w."""
    found: Matrix = from_quaternions(torch.from_numpy(turn)).numpy()
    return found


def _parts(node: Mapping[str, Any]) -> tuple[Matrix, Matrix, Matrix]:
    """Place (3,), turn (4,) and size (3,) of a node without a matrix."""
    turn = np.array(node.get("rotation", (0.0, 0.0, 0.0, 1.0)), dtype=np.float64)
    place, size = (
        np.array(node.get(name, default), dtype=np.float64)
        for name, default in (("translation", np.zeros(3)), ("scale", np.ones(3)))
    )
    return place, turn / np.linalg.norm(turn), size


class _Writer:
    """A copy of a file in which things are added at the ends of its lists and of its data."""

    def __init__(self, file: GlbFile) -> None:
        self.content = copy.deepcopy(file.content)
        self.chunks = list(file.chunks)
        buffers = self.content.setdefault("buffers", [])
        if not buffers:
            if not self.chunks or self.chunks[0][0] != BIN:
                self.chunks.insert(0, (BIN, b""))
            buffers.append({"byteLength": len(self.chunks[0][1])})
        self.whole = bool(self.chunks) and self.chunks[0][0] == BIN and "uri" not in buffers[0]
        if not self.whole:
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
        size = np.linalg.norm(matrix[:3, :3], axis=0)
        if np.linalg.det(matrix[:3, :3]) < 0.0:
            size[0] *= -1.0  # a mirror image
        turn = turn_of(matrix[:3, :3] * np.sign(size))
        node["translation"] = matrix[:3, 3].tolist()
        node["rotation"] = quaternions(torch.from_numpy(turn)[None])[0].tolist()
        node["scale"] = size.tolist()

    def animate(self, motion: Animation, moved: Keys, turns: Keys, sizes: Keys) -> None:
        """Keys by node, each in its parent's frame."""
        animations = self.content.setdefault("animations", [])
        taken = {str(animation.get("name")) for animation in animations}
        new, number = motion.name, 1
        while new in taken:
            number += 1
            new = f"{motion.name}_{number}"
        times = motion.times.detach().double().cpu().numpy()
        whole = self.add(times[:, None], bounds=True)
        ends = self.add(times[[0, -1], None], bounds=True) if len(times) > 1 else whole
        samplers: list[dict[str, Any]] = []
        channels: list[dict[str, Any]] = []
        for path, keys in (("translation", moved), ("rotation", turns), ("scale", sizes)):
            for node, own in keys.items():
                still = len(times) > 1 and float(np.ptp(own, axis=0).max()) < STOOD * max(float(np.abs(own).max()), 1.0)
                channels.append({"sampler": len(samplers), "target": {"node": node, "path": path}})
                output = self.add(own[[0, -1]] if still else own)
                samplers.append({"input": ends if still else whole, "output": output, "interpolation": "LINEAR"})
        entry: dict[str, Any] = {"name": new, "channels": channels, "samplers": samplers}
        animations.append(entry | ({"extras": dict(motion.extras)} if motion.extras else {}))

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
        try:
            written = json.dumps(self.content, separators=(",", ":"), ensure_ascii=False, allow_nan=False).encode()
        except UnicodeEncodeError:
            # Half a letter in a name can be written as its number only.
            written = json.dumps(self.content, separators=(",", ":"), allow_nan=False).encode()
        chunks = [(JSON, written + b" " * (-len(written) % 4)), *self.chunks]
        size = 12 + sum(8 + len(data) for _, data in chunks)
        if size >= 2**32:
            raise HopdiffError("a GLB file cannot be larger than 4 GiB.")
        parts = [struct.pack("<4sII", b"glTF", 2, size)]
        for kind, data in chunks:
            parts += [struct.pack("<II", len(data), kind), data]
        return b"".join(parts)
