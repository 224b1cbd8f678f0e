"""Binary glTF 2.0: a skinned body and its motions, metres, +y up, facing +z.

Khronos Group, glTF 2.0 specification (2021). Axes and units are hopdiff's own, so that nothing is turned or scaled.
"""

from __future__ import annotations

import json
import os
import struct
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from hopdiff import __version__
from hopdiff.export.axes import joint_axes
from hopdiff.export.body.loft import Surface
from hopdiff.export.body_mesh import body_mesh
from hopdiff.export.colours import COLOURS, linear
from hopdiff.export.contact_events import told
from hopdiff.export.pose import root_height
from hopdiff.export.take import Take
from hopdiff.geometry.quaternion import quaternions
from hopdiff.geometry.skeleton import Skeleton
from hopdiff.io.files import write_whole
from hopdiff.types import HopdiffError

STILL = 1e-9  # m or of a quaternion by which a channel may vary and still be written as two keys
ALIKE = 1e-6  # m by which the bones of one skeleton may differ
FLOAT, BYTE, SHORT, INT = 5126, 5121, 5123, 5125  # component types of glTF
VERTICES, INDICES = 34962, 34963  # its buffer targets


def write_glb(path: str | os.PathLike[str], takes: Sequence[Take], axes: str = "world") -> None:
    """Write takes as one GLB file, whole or not at all; see `glb_bytes`. Raises HopdiffError."""
    write_whole(path, glb_bytes(takes, axes))


def glb_bytes(
    takes: Sequence[Take],
    axes: str = "world",
    swapped: bool = True,
    bare: bool = False,
    extensions: Mapping[str, Any] | None = None,
) -> bytes:
    """The GLB file of some takes: a skinned body for each that is among them, an animation for each take.

    axes, swapped: of the joints in the rest pose, see `joint_axes`; the body moves alike whatever they are.
    Every joint is a node and belongs to the skin; the root joint carries the translation. Keys are linear, at the
    takes' own frames from time 0. bare: whether there are joints alone, without skin and mesh. extensions: of the file,
    by their names. Raises HopdiffError if there is no take, a take has no frame, or holds a number that
    is not finite, or two takes have one name.
    """
    if not takes:
        raise HopdiffError("cannot write a GLB file without a motion.")
    names = [take.name for take in takes]
    for take in takes:
        check(take)
        if names.count(take.name) > 1:
            raise HopdiffError(f"two motions are called {take.name!r}; a GLB file needs different names.")
    file = _Writer(lambda skeleton: joint_axes(skeleton, axes, swapped))
    file.extensions |= extensions or {}
    bodies, whose = bodies_of(takes)
    firsts = [file.add_body(body, f"body_{k + 1}" if k else "body", bare) for k, body in enumerate(bodies)]
    for take, body in zip(takes, whose, strict=True):
        file.add_animation(take, firsts[body])
    return file.bytes()


def check(take: Take) -> None:
    """Raises HopdiffError if a take has no frame, or holds a number that is not finite."""
    tensors = (take.clip.root_position, take.clip.rotations, take.clip.skeleton.offsets)
    if take.frames == 0:
        raise HopdiffError(f"cannot write {take.name}: it has no frames.")
    if not all(bool(torch.isfinite(values).all()) for values in tensors):
        raise HopdiffError(f"cannot write {take.name}: the motion holds a number that is not finite.")


def bodies_of(takes: Sequence[Take]) -> tuple[list[Take], list[int]]:
    """The first take of each body among takes, and for every take which of these has its body: the same bones, as
    heavy."""
    bodies: list[Take] = []
    whose: list[int] = []
    for take in takes:
        k = next((k for k, other in enumerate(bodies) if _same(other, take)), len(bodies))
        if k == len(bodies):
            bodies.append(take)
        whose.append(k)
    return bodies, whose


def body_bytes(take: Take) -> bytes:
    """The GLB file of a take's skinned body alone, at rest."""
    file = _Writer(lambda skeleton: joint_axes(skeleton, "world"))
    file.add_body(take, "body")
    return file.bytes()


class _Writer:
    """A glTF file in the making. axes: gives the (J, 3, 3) frames of a skeleton's joints in the rest pose."""

    def __init__(self, axes: Callable[[Skeleton], Tensor]) -> None:
        self.axes = axes
        self.nodes: list[dict[str, Any]] = []
        self.roots: list[int] = []
        self.meshes: list[dict[str, Any]] = []
        self.skins: list[dict[str, Any]] = []
        self.animations: list[dict[str, Any]] = []
        self.accessors: list[dict[str, Any]] = []
        self.views: list[dict[str, Any]] = []
        self.data = bytearray()
        self.extensions: dict[str, Any] = {}

    def add_body(self, take: Take, name: str, bare: bool = False) -> int:
        """Nodes, skin and mesh of a take's skeleton, or nodes alone; returns the node of its root joint."""
        skeleton = take.clip.skeleton
        first = len(self.nodes)
        rest = skeleton.offsets.clone()
        rest[0] = torch.tensor([0.0, root_height(skeleton), 0.0])
        axes = self.axes(skeleton)
        above = _above(skeleton, axes)
        places_here = (above.transpose(-1, -2) @ rest.unsqueeze(-1)).squeeze(-1)
        turns = quaternions((above.transpose(-1, -2) @ axes).unsqueeze(0))[0]
        for joint, joint_name in enumerate(skeleton.names):
            node: dict[str, Any] = {"name": joint_name, "translation": _numbers(places_here[joint])}
            if not torch.equal(above[joint], axes[joint]):
                node["rotation"] = _numbers(turns[joint])
            if children := skeleton.children(joint):
                node["children"] = [first + child for child in children]
            self.nodes.append(node)
        self.roots.append(first)
        if bare:
            return first
        straight = torch.eye(3, dtype=torch.float64).expand(1, len(rest), 3, 3)
        places = skeleton.forward(rest[:1], straight)[0][0].numpy()
        # From the rest pose to a joint's own frame: moved, then turned; glTF has columns one after the other.
        inverse = np.tile(np.eye(4, dtype=np.float32), (len(rest), 1, 1))
        inverse[:, :3, :3] = axes.numpy()
        inverse[:, 3, :3] = -np.einsum("jk,jkl->jl", places, axes.numpy())
        matrices = self._add(inverse.reshape(-1, 16), FLOAT, "MAT4")
        joints = [first + joint for joint in range(len(rest))]
        self.skins.append({"name": name, "joints": joints, "inverseBindMatrices": matrices, "skeleton": first})
        wide = SHORT if len(rest) > 256 else BYTE
        primitives = [
            self._primitive(surface, places[0], list(COLOURS).index(side), wide)
            for side, surface in body_mesh(skeleton, take.masses, take.parts).items()
        ]
        node = {"name": name, "skin": len(self.skins) - 1}
        if primitives:
            self.meshes.append({"name": name, "primitives": primitives})
            self.nodes.append({**node, "mesh": len(self.meshes) - 1})
            self.roots.append(len(self.nodes) - 1)
        return first

    def _primitive(self, surface: Surface, root: NDArray[np.float64], material: int, wide: int) -> dict[str, Any]:
        kind = np.uint16 if wide == SHORT else np.uint8
        small = len(surface.vertices) < 65535
        weights = surface.weights.astype(np.float32)
        # Their sum is 1 in the precision of the file, too.
        weights[:, 0] = 1.0 - weights[:, 1:].sum(axis=-1)
        attributes = {
            "POSITION": self._add((surface.vertices + root).astype(np.float32), FLOAT, "VEC3", VERTICES, bounds=True),
            "NORMAL": self._add(surface.normals.astype(np.float32), FLOAT, "VEC3", VERTICES),
            "JOINTS_0": self._add(surface.joints.astype(kind), wide, "VEC4", VERTICES),
            "WEIGHTS_0": self._add(weights, FLOAT, "VEC4", VERTICES),
        }
        flat = surface.faces.reshape(-1, 1).astype(np.uint16 if small else np.uint32)
        indices = self._add(flat, SHORT if small else INT, "SCALAR", INDICES)
        return {"attributes": attributes, "indices": indices, "material": material}

    def add_animation(self, take: Take, first: int) -> None:
        """The motion of a take on the nodes from `first` on."""
        clip = take.clip
        times = clip.frame_time * np.arange(take.frames, dtype=np.float64)
        axes = self.axes(clip.skeleton)
        back = _above(clip.skeleton, axes).transpose(-1, -2)
        turns = quaternions(back @ clip.rotations @ axes).numpy()
        whole = self._times(times)
        ends = self._times(times[[0, -1]]) if take.frames > 1 else whole
        channels: list[dict[str, Any]] = []
        samplers: list[dict[str, Any]] = []

        def add(node: int, path: str, values: NDArray[np.float64]) -> None:
            still = bool((np.ptp(values, axis=0) < STILL).all())
            kept = values[[0, -1]] if still and take.frames > 1 else values
            output = self._add(kept.astype(np.float32), FLOAT, f"VEC{values.shape[-1]}")
            channels.append({"sampler": len(samplers), "target": {"node": node, "path": path}})
            samplers.append({"input": ends if still else whole, "output": output, "interpolation": "LINEAR"})

        add(first, "translation", clip.root_position.numpy())
        for joint in range(turns.shape[1]):
            add(first + joint, "rotation", turns[:, joint])
        if clip.offsets is not None:
            moving = (back @ clip.offsets.unsqueeze(-1)).squeeze(-1)
            for joint in range(1, turns.shape[1]):
                add(first + joint, "translation", moving[:, joint].numpy())
        entry = {"name": take.name, "channels": channels, "samplers": samplers, "extras": clip_extras(take)}
        self.animations.append(entry)

    def _times(self, times: NDArray[Any]) -> int:
        return self._add(times.astype(np.float32)[:, None], FLOAT, "SCALAR", bounds=True)

    def _add(self, values: NDArray[Any], kind: int, shape: str, target: int | None = None, bounds: bool = False) -> int:
        """Put values (n, width) into the buffer; returns their accessor."""
        data = np.ascontiguousarray(values, dtype=values.dtype.newbyteorder("<")).tobytes()
        view: dict[str, Any] = {"buffer": 0, "byteOffset": len(self.data), "byteLength": len(data)}
        self.views.append(view | ({} if target is None else {"target": target}))
        self.data += data + b"\0" * (-len(data) % 4)
        accessor = {"bufferView": len(self.views) - 1, "componentType": kind, "count": len(values), "type": shape}
        if bounds:
            accessor |= {"min": values.min(axis=0).tolist(), "max": values.max(axis=0).tolist()}
        self.accessors.append(accessor)
        return len(self.accessors) - 1

    def bytes(self) -> bytes:
        content = {
            "asset": {"version": "2.0", "generator": f"hopdiff {__version__}"},
            "scene": 0,
            "scenes": [{"nodes": self.roots}],
            "nodes": self.nodes,
            **({"animations": self.animations} if self.animations else {}),
            "accessors": self.accessors,
            "bufferViews": self.views,
            "buffers": [{"byteLength": len(self.data)}],
        }
        if self.skins:
            content["skins"] = self.skins
        if self.extensions:
            content |= {"extensionsUsed": list(self.extensions), "extensions": self.extensions}
        if self.meshes:
            content |= {"meshes": self.meshes, "materials": [_material(side) for side in COLOURS]}
        text = json.dumps(content, separators=(",", ":"), allow_nan=False).encode()
        text += b" " * (-len(text) % 4)
        size = 12 + 8 + len(text) + 8 + len(self.data)
        return b"".join(
            (
                struct.pack("<4sII", b"glTF", 2, size),
                struct.pack("<I4s", len(text), b"JSON") + text,
                struct.pack("<I4s", len(self.data), b"BIN\0") + bytes(self.data),
            )
        )


def _same(one: Take, other: Take) -> bool:
    """Whether two takes have the same joints, bones, ends, masses and parts; where their roots are says nothing."""
    a, b = one.clip.skeleton, other.clip.skeleton
    alike = (a.names, a.parents, one.masses, one.parts) == (b.names, b.parents, other.masses, other.parts)
    if not alike or a.end_sites.keys() != b.end_sites.keys():
        return False
    gaps = [(a.offsets - b.offsets)[1:], *(a.end_sites[name] - b.end_sites[name] for name in a.end_sites)]
    return all(bool((gap.abs() < ALIKE).all()) for gap in gaps)


def _above(skeleton: Skeleton, axes: Tensor) -> Tensor:
    """(J, 3, 3) the frame that each joint hangs in: its parent's, of the root the world's."""
    straight = torch.eye(3, dtype=torch.float64)
    return torch.stack([axes[parent] if parent >= 0 else straight for parent in skeleton.parents])


def _material(side: str) -> dict[str, Any]:
    # Colours of materials are linear in glTF, not as on screen.
    shade = {"baseColorFactor": [*linear(side).tolist(), 1.0], "metallicFactor": 0.0, "roughnessFactor": 0.7}
    return {"name": side, "pbrMetallicRoughness": shade}


def clip_extras(take: Take) -> dict[str, Any]:
    """What is told with the animation of a take: its time, travel, contacts, and what is known of the run."""
    clip, numbers = take.clip, take.numbers
    names = ("speed", "beta", "step_frequency", "stride_time", "energy_rate", "contact_time", "flight_time")
    return {
        "loop": take.loop,
        "duration_s": clip.duration,
        "frame_time_s": clip.frame_time,
        "travel_m": _numbers(clip.root_position[-1] - clip.root_position[0]),
        **{name: numbers[name] for name in names if isinstance(numbers.get(name), int | float)},
        **told(take),
    }


def _numbers(values: Tensor) -> list[float]:
    return [float(value) for value in values.tolist()]
