"""A joint tree and its forward kinematics."""

from __future__ import annotations

from dataclasses import dataclass, field

import torch
from torch import Tensor


@dataclass(frozen=True)
class Skeleton:
    """Joints in an order in which every parent comes before its children; joint 0 is the root.

    names: J joint names. parents: J parent indices, -1 for the root.
    offsets: (J, 3) position of each joint in its parent's frame [m] (the root's is its rest position).
    end_sites: joint name -> (3,) end point in that joint's frame [m], for joints without children.
    """

    names: tuple[str, ...]
    parents: tuple[int, ...]
    offsets: Tensor
    end_sites: dict[str, Tensor] = field(default_factory=dict)

    def index(self, name: str) -> int:
        return self.names.index(name)

    def children(self, joint: int) -> list[int]:
        return [child for child, parent in enumerate(self.parents) if parent == joint]

    def above(self, joint: int) -> list[int]:
        """The joints that a joint hangs on, nearest first."""
        found = []
        while (joint := self.parents[joint]) >= 0:
            found.append(joint)
        return found

    def below(self, joint: int) -> list[int]:
        """A joint and all that hang on it, parents first."""
        found = {joint: None}
        for child in range(joint + 1, len(self.names)):
            if self.parents[child] in found:
                found[child] = None
        return list(found)

    def forward(self, root_position: Tensor, rotations: Tensor, offsets: Tensor | None = None) -> tuple[Tensor, Tensor]:
        """Forward kinematics.

        root_position: (..., 3) [m]. rotations: (..., J, 3, 3), each in its parent's frame. offsets: (..., J, 3) [m],
        in place of the skeleton's where joints move against their parents.
        Returns joint positions (..., J, 3) [m] and orientations (..., J, 3, 3), both in the world.
        """
        offsets = (self.offsets if offsets is None else offsets).to(rotations)
        positions: list[Tensor] = [root_position]
        orientations: list[Tensor] = [rotations[..., 0, :, :]]
        for joint in range(1, len(self.names)):
            parent = self.parents[joint]
            positions.append(positions[parent] + (orientations[parent] @ offsets[..., joint, :, None])[..., 0])
            orientations.append(orientations[parent] @ rotations[..., joint, :, :])
        return torch.stack(positions, dim=-2), torch.stack(orientations, dim=-3)

    def end_positions(self, positions: Tensor, orientations: Tensor) -> dict[str, Tensor]:
        """World positions (..., 3) of the end sites, from what `forward` returned."""
        ends = {}
        for name, offset in self.end_sites.items():
            joint = self.index(name)
            ends[name] = positions[..., joint, :] + orientations[..., joint, :, :] @ offset.to(orientations)
        return ends
