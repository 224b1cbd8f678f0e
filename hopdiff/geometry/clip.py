"""A motion as frames of joint rotations: what every reader makes and every writer takes."""

from __future__ import annotations

from dataclasses import dataclass, replace

from torch import Tensor

from hopdiff.geometry.skeleton import Skeleton


@dataclass(frozen=True)
class Clip:
    """Frames at equal intervals; immutable.

    root_position: (T, 3) world position of joint 0 [m]. rotations: (T, J, 3, 3), each in its parent's frame.
    frame_time: seconds between frames. Axes: x left, y up, z forward.
    offsets: (T, J, 3) position of each joint in its parent's frame [m] where joints move against their parents; None
    if all stay at the skeleton's offsets. The root's entry is not used.
    """

    skeleton: Skeleton
    root_position: Tensor
    rotations: Tensor
    frame_time: float
    offsets: Tensor | None = None

    @property
    def frames(self) -> int:
        return self.root_position.shape[0]

    @property
    def duration(self) -> float:
        """Seconds from the first frame to the last."""
        return (self.frames - 1) * self.frame_time

    def forward(self) -> tuple[Tensor, Tensor]:
        """World positions (T, J, 3) [m] and orientations (T, J, 3, 3) of all joints."""
        return self.skeleton.forward(self.root_position, self.rotations, self.offsets)

    def joint_positions(self) -> Tensor:
        """(T, J, 3) world positions [m]."""
        return self.forward()[0]

    def end_positions(self) -> dict[str, Tensor]:
        """World positions (T, 3) of the end sites by joint name [m]."""
        return self.skeleton.end_positions(*self.forward())

    def part(self, frames: slice) -> Clip:
        """Some of its frames."""
        offsets = None if self.offsets is None else self.offsets[frames]
        return replace(
            self, root_position=self.root_position[frames], rotations=self.rotations[frames], offsets=offsets
        )

    def in_place(self) -> Clip:
        """The same motion with the steady travel from first to last frame removed from the ground plane."""
        travel = self.root_position[-1] - self.root_position[0]
        travel = travel.clone()
        travel[1] = 0.0
        share = self.root_position.new_tensor(range(self.frames)) / max(self.frames - 1, 1)
        return replace(self, root_position=self.root_position - share[:, None] * travel)
