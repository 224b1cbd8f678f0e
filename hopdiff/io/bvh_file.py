"""A BVH file as it is, the motion that it means, and the file again with another motion."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import torch
from torch import Tensor

from hopdiff.geometry.clip import Clip
from hopdiff.geometry.skeleton import Skeleton
from hopdiff.io.bvh_carrier import above_of, below_of, carried, give_back, movers, raises
from hopdiff.io.bvh_channels import BvhJoint, columns, encode, offsets_of, rotations_of
from hopdiff.io.bvh_layout import Layout
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
    carrier: the joint that carries the body over the ground, which is joint 0 of the clip. What it hangs on is part of
    its way there; what else hangs on that has no part in the clip, and stays as it is.
    notes: sentences for the user on what was read other than it is written. layout: how these joints are written.
    """

    joints: tuple[BvhJoint, ...]
    values: Tensor
    frame_time: float
    decimals: int
    offset_decimals: int
    unit: float = 1.0
    up: str = "y"
    encoding: str = "utf-8"
    carrier: int = 0
    notes: tuple[str, ...] = ()
    layout: tuple[tuple[BvhJoint, ...], Layout] | None = None

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

    def whole_skeleton(self) -> Skeleton:
        """All joints of the file in metres, y up; of several end sites of a joint the first."""
        names = self.names
        offsets = self._metres(torch.tensor([joint.offset for joint in self.joints], dtype=torch.float64))
        ends = {
            name: self._metres(torch.tensor(joint.end_sites[0], dtype=torch.float64))
            for name, joint in zip(names, self.joints, strict=True)
            if joint.end_sites
        }
        return Skeleton(names, tuple(joint.parent for joint in self.joints), offsets, ends)

    def skeleton(self) -> Skeleton:
        """The joints of the clip: the carrier, and those below it, in metres, y up."""
        whole = self.whole_skeleton()
        if not self.carrier:
            return whole
        kept, (place, basis) = self._kept, self._held
        offsets = whole.offsets[kept] @ basis.T
        offsets[0] = place
        names = tuple(whole.names[joint] for joint in kept)
        parents = (-1, *(kept.index(whole.parents[joint]) for joint in kept[1:]))
        return Skeleton(names, parents, offsets, {n: basis @ end for n, end in whole.end_sites.items() if n in names})

    def moving(self, some: Sequence[int] | None = None) -> tuple[Tensor, Tensor]:
        """Places (T, K, 3) [m] and rotations (T, K, 3, 3) of joints in their parents' frames, y up. some: all if None.

        Position channels take the place of OFFSET, they are not added to it.
        """
        joints, values = self.joints, self.values
        if some is not None:
            first = columns(joints)
            values = values[:, [column for joint in some for column in range(first[joint], first[joint + 1])]]
            joints = tuple(joints[joint] for joint in some)
        rotations = rotations_of(joints, values)
        if self.up != "y":
            rotations = self._axes() @ rotations @ self._axes().T
        return self._metres(offsets_of(joints, values)), rotations

    def clip(self) -> Clip:
        """The motion in metres, y up, of the carrier and the joints below it."""
        offsets, rotations = self.moving()
        kept = self._kept
        moving = any(self.joints[joint].places for joint in kept[1:])
        if not self.carrier:
            return Clip(self.skeleton(), offsets[:, 0].clone(), rotations, self.frame_time, offsets if moving else None)
        # Frames of joints are turned such that the body stands at rest if it stands at rest in the file's first frame.
        _, basis = self._held
        chain = above_of(self.joints, self.carrier)
        place, turn = carried(offsets[:, chain], rotations[:, chain])
        own = torch.cat(((turn @ basis.T)[:, None], basis @ rotations[:, kept[1:]] @ basis.T), dim=1)
        return Clip(self.skeleton(), place, own, self.frame_time, offsets[:, kept] @ basis.T if moving else None)

    def with_motion(self, clip: Clip) -> BvhFile:
        """The same file with another motion: names, offsets, channels and frame time stay.

        clip: the same joints, any number of frames. If there are as many as before, numbers that mean what they meant
        are kept; new angles go on from them without jumps. Joints above the carrier stay as they are, but for what its
        own channels cannot express; if there are other frames than before they stay as in the first. Raises
        HopdiffError if the clip has other joints, bones or frame times, a number that is not finite, or needs a channel
        that the file does not have.
        """
        self._check(clip)
        rotations = clip.rotations.detach().double().cpu()
        bones = (clip.skeleton.offsets if clip.offsets is None else clip.offsets).detach().double().cpu()
        bones = bones.expand(clip.frames, *bones.shape[-2:]).clone()
        bones[:, 0] = clip.root_position.detach().double().cpu()
        if self.carrier:
            bones, rotations = self._given_back(bones, rotations)
        axes = self._axes()
        if self.up != "y":
            rotations = axes.T @ rotations @ axes
        decimals = max(self.decimals, FEWEST_DECIMALS)
        values, changed = encode(self.joints, bones @ axes / self.unit, rotations, self.values, decimals)
        return replace(self, values=values, decimals=decimals if changed else self.decimals)

    def _given_back(self, bones: Tensor, rotations: Tensor) -> tuple[Tensor, Tensor]:
        """Places (T, J, 3) [m] and rotations (T, J, 3, 3) of all joints for those of the clip's, y up."""
        kept, (_, basis), chain = self._kept, self._held, above_of(self.joints, self.carrier)
        own_places, own_turns = self.moving()
        who = movers(self.joints, chain, own_places, up=1)
        if len(bones) != self.frames:
            own_places, own_turns = (
                own[:1].repeat(len(bones), *[1] * (own.ndim - 1)) for own in (own_places, own_turns)
            )
        turn = rotations[:, 0] @ basis
        own_places[:, kept[1:]] = bones[:, 1:] @ basis
        own_turns[:, kept[1:]] = basis.T @ rotations[:, 1:] @ basis
        give_back(self.joints, chain, own_places, own_turns, bones[:, 0], turn, who)
        return own_places, own_turns

    def write(self, path: str | os.PathLike[str]) -> None:
        """Write the file, whole or not at all; reading it gives the same numbers.

        What was read is written as it stood there: all above the numbers but how many frames there are, and frames that
        have not changed. Raises HopdiffError if it cannot be written.
        """
        if self.layout is not None and self.layout[0] == self.joints:
            write_whole(path, self.layout[1].text(self.values.numpy(), self.frame_time, self.decimals))
            return
        lines = [*self._hierarchy(), "MOTION", f"Frames: {self.frames}", f"Frame Time: {exact(self.frame_time, 0)}"]
        lines += written(self.values.numpy(), self.decimals)
        write_whole(path, ("\n".join(lines) + "\n").encode(self.encoding))

    @cached_property
    def _kept(self) -> list[int]:
        """The joints of the clip."""
        return below_of(self.joints, self.carrier)

    @cached_property
    def _held(self) -> tuple[Tensor, Tensor]:
        """Where the carrier's OFFSET has it (3,) [m], and how the body is turned to stand at rest (3, 3).

        Both by the first frame's turn of what it hangs on, which the body may need to stand, or its hips take back.
        """
        chain = above_of(self.joints, self.carrier)
        places, turns = replace(self, values=self.values[:1]).moving(chain)
        whole = self.whole_skeleton()
        places[:, -1] = whole.offsets[self.carrier]
        place, _ = carried(places, turns)
        _, basis = carried(places[:, :-1], turns[:, :-1])
        return place[0], basis[0] if raises(whole, basis[0]) else torch.eye(3, dtype=torch.float64)

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
        moving = [bool(self.joints[joint].places) for joint in self._kept]
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
