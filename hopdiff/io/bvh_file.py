"""A BVH file as it is, the motion that it means, and the file again with another motion."""

from __future__ import annotations

import os
from collections import Counter
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from hopdiff.geometry.clip import Clip
from hopdiff.geometry.skeleton import Skeleton
from hopdiff.io.bvh_channels import BvhJoint, encode, offsets_of, rotations_of
from hopdiff.io.bvh_numbers import exact, written
from hopdiff.io.files import write_whole
from hopdiff.types import HopdiffError

FEWEST_DECIMALS = 6  # of the numbers of an edited motion
# Rows: the clip's x, y, z in the file's axes. A body that faces -y in a file with z up faces +z in the clip.
AXES = {
    "y": [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
    "z": [[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]],
}


@dataclass(frozen=True, eq=False)
class BvhFile:
    """A BVH file; immutable.

    joints: J of them, parents first. values: (T, C) float64, the rows of numbers, in file units and degrees.
    frame_time: seconds. decimals, offset_decimals: the most that a number of the motion, and of the hierarchy, is
    written with. unit: metres in a file unit. up: the file's axis that points up, "y" or "z". encoding: of the text.
    """

    joints: tuple[BvhJoint, ...]
    values: Tensor
    frame_time: float
    decimals: int
    offset_decimals: int
    unit: float = 1.0
    up: str = "y"
    encoding: str = "utf-8"

    @property
    def frames(self) -> int:
        return self.values.shape[0]

    @property
    def names(self) -> tuple[str, ...]:
        """Joint names, made different: the second of two called Arm is Arm_2, and so on."""
        given = Counter(joint.name for joint in self.joints)
        taken: set[str] = set()
        names = []
        for joint in self.joints:
            name, number = joint.name, 1
            while name in taken or (number > 1 and name in given):
                number += 1
                name = f"{joint.name}_{number}"
            taken.add(name)
            names.append(name)
        return tuple(names)

    def skeleton(self) -> Skeleton:
        """The joints in metres, y up; of several end sites of a joint the first."""
        names = self.names
        offsets = self._metres(torch.tensor([joint.offset for joint in self.joints], dtype=torch.float64))
        ends = {
            name: self._metres(torch.tensor(joint.end_sites[0], dtype=torch.float64))
            for name, joint in zip(names, self.joints, strict=True)
            if joint.end_sites
        }
        return Skeleton(names, tuple(joint.parent for joint in self.joints), offsets, ends)

    def clip(self) -> Clip:
        """The motion in metres, y up. Position channels take the place of OFFSET, they are not added to it."""
        offsets = self._metres(offsets_of(self.joints, self.values))
        rotations = rotations_of(self.joints, self.values)
        if self.up != "y":
            rotations = self._axes() @ rotations @ self._axes().T
        moving = any(joint.places for joint in self.joints[1:])
        return Clip(self.skeleton(), offsets[:, 0].clone(), rotations, self.frame_time, offsets if moving else None)

    def with_motion(self, clip: Clip) -> BvhFile:
        """The same file with another motion: names, offsets, channels and frame time stay.

        clip: the same joints, any number of frames. If there are as many as before, numbers that mean what they meant
        are kept; new angles go on from them without jumps. Raises HopdiffError if the clip has other joints, bones or
        frame times, a number that is not finite, or needs a channel that the file does not have.
        """
        self._check(clip)
        axes = self._axes()
        rotations = clip.rotations.detach().double().cpu()
        if self.up != "y":
            rotations = axes.T @ rotations @ axes
        bones = (clip.skeleton.offsets if clip.offsets is None else clip.offsets).detach().double().cpu()
        bones = bones.expand(clip.frames, *bones.shape[-2:]).clone()
        bones[:, 0] = clip.root_position.detach().double().cpu()
        decimals = max(self.decimals, FEWEST_DECIMALS)
        values, changed = encode(self.joints, bones @ axes / self.unit, rotations, self.values, decimals)
        return replace(self, values=values, decimals=decimals if changed else self.decimals)

    def write(self, path: str | os.PathLike[str]) -> None:
        """Write the file, whole or not at all; reading it gives the same numbers.

        Raises HopdiffError if it cannot be written.
        """
        lines = [*self._hierarchy(), "MOTION", f"Frames: {self.frames}", f"Frame Time: {exact(self.frame_time, 0)}"]
        lines += written(self.values.numpy(), self.decimals)
        write_whole(path, ("\n".join(lines) + "\n").encode(self.encoding))

    def _axes(self) -> Tensor:
        return torch.tensor(AXES[self.up], dtype=torch.float64)

    def _metres(self, places: Tensor) -> Tensor:
        return places @ self._axes().T * self.unit

    def _check(self, clip: Clip) -> None:
        """Raise HopdiffError if the clip is not one of these joints."""
        skeleton = self.skeleton()
        if (clip.skeleton.names, clip.skeleton.parents) != (skeleton.names, skeleton.parents):
            raise HopdiffError("the motion has other joints than the BVH file that it shall be written into.")
        longest = float(skeleton.offsets.abs().max())
        moving = [bool(joint.places) for joint in self.joints]
        moving[0] = True
        change = (clip.skeleton.offsets.detach().double().cpu() - skeleton.offsets).abs().amax(dim=-1)
        change[torch.tensor(moving)] = 0.0
        if float(change.max()) > 1e-6 * longest:
            name = skeleton.names[int(change.argmax())]
            raise HopdiffError(f"the motion has another bone at joint {name!r} than the BVH file.")
        if abs(clip.frame_time - self.frame_time) > 1e-3 * self.frame_time:
            raise HopdiffError(f"the motion has {clip.frame_time} s a frame, but the BVH file {self.frame_time} s.")
        tensors = (clip.root_position, clip.rotations, *([] if clip.offsets is None else [clip.offsets]))
        if not all(bool(torch.isfinite(tensor).all()) for tensor in tensors):
            raise HopdiffError("the motion holds a number that is not finite.")

    def _hierarchy(self) -> list[str]:
        depth: list[int] = []
        lines, open_blocks = ["HIERARCHY"], 0

        def close(level: int) -> None:
            nonlocal open_blocks
            while open_blocks > level:
                open_blocks -= 1
                lines.append("  " * open_blocks + "}")

        def offset(place: tuple[float, float, float]) -> str:
            return "OFFSET " + " ".join(exact(value, self.offset_decimals) for value in place)

        for joint in self.joints:
            level = 0 if joint.parent < 0 else depth[joint.parent] + 1
            depth.append(level)
            close(level)
            outer, inner = "  " * level, "  " * (level + 1)
            lines += [f"{outer}{'ROOT' if joint.parent < 0 else 'JOINT'} {joint.name}", outer + "{"]
            lines += [inner + offset(joint.offset)]
            lines += [f"{inner}CHANNELS {' '.join((str(len(joint.channels)), *joint.channels))}"]
            for end in joint.end_sites:
                lines += [inner + "End Site", inner + "{", inner + "  " + offset(end), inner + "}"]
            open_blocks = level + 1
        close(0)
        return lines
