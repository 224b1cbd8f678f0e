"""A run that goes on for ever, and the finished stride made from it with everything that plots and metrics show."""

from __future__ import annotations

import math
from typing import NamedTuple, Protocol

import torch
from torch import Tensor

from hopdiff.character import Character
from hopdiff.geometry.clip import Clip
from hopdiff.motion import SIDES, Motion, Phase
from hopdiff.types import HopdiffError

LEAST_FRAMES = 4  # of a stride
SLACK = 1e-9  # s; frame times carry rounding, and touchdown and take-off frames belong to the stance


class Pose(NamedTuple):
    """Runs of P candidates sampled at T moments.

    channels: name -> (P, T) [rad]. height: (P, T) of HIP above the ground [m]. travel: (P, T) of HIP since the left
    touchdown at time 0 [m]. target: (P, T, 2) target of the centre of mass to the left and forward of HIP [m].
    leg_force: (P, T) force along the leg that stands, in body weights.
    """

    channels: dict[str, Tensor]
    height: Tensor
    travel: Tensor
    target: Tensor
    leg_force: Tensor


class Gait(Protocol):
    """Solved runs of P candidates.

    contact_times, flight_times: (P, 2) stance of the left and the right leg, and the flight after each [s].
    """

    @property
    def character(self) -> Character: ...

    @property
    def contact_times(self) -> Tensor: ...

    @property
    def flight_times(self) -> Tensor: ...

    def sample(self, times: Tensor) -> Pose:
        """The runs at times (T,) since left touchdown, anywhere in their endless course [s]."""
        ...


def stride_time(gait: Gait) -> Tensor:
    """Duration of a stride (P,) [s]."""
    return (gait.contact_times + gait.flight_times).sum(-1)


def stride_frames(duration: float, fps: float) -> int:
    """Number of frame intervals of a stride that comes nearest to `fps`; raises HopdiffError if there is none."""
    intervals = round(duration * fps)
    if intervals < LEAST_FRAMES:
        raise HopdiffError(f"fps={fps:g} is too low for a stride of {duration:.3f} s: at least {enough_fps(duration)}.")
    return intervals


def enough_fps(duration: float) -> int:
    """Frames/s that surely show a stride of so many seconds."""
    return math.ceil(LEAST_FRAMES / duration)


def phases(gait: Gait, strides: int) -> tuple[Phase, ...]:
    """The phases of the first candidate's strides, in order of time."""
    found = []
    spans = torch.stack((gait.contact_times[0], gait.flight_times[0]), dim=-1).tolist()
    whole = float(stride_time(gait)[0])
    for stride in range(strides):
        # From the whole, so that nothing adds up over many strides.
        start = stride * whole
        for side, lengths in zip(SIDES, spans, strict=True):
            for kind, length in zip(("stance", "flight"), lengths, strict=True):
                found.append(Phase(kind, side, start, start + length))
                start += length
    return tuple(found)


def contacts(times: Tensor, course: tuple[Phase, ...]) -> Tensor:
    """(T, 2) bool, which foot stands at times (T,); the moment after the last flight is a left touchdown."""
    standing = torch.zeros(len(times), 2, dtype=torch.bool, device=times.device)
    for phase in (*course, Phase("stance", "left", course[-1].end, course[-1].end)):
        if phase.kind == "stance":
            standing[:, SIDES.index(phase.side)] |= (times >= phase.start - SLACK) & (times <= phase.end + SLACK)
    return standing


def stride_motion(gait: Gait, fps: float) -> Motion:
    """Frames of one stride of the first candidate; the last frame is the first of the next stride.

    The frame time is the stride over a whole number of frames. Raises HopdiffError if `fps` is too low.
    """
    duration = stride_time(gait)[0]
    intervals = stride_frames(float(duration), fps)
    times = torch.arange(intervals + 1, dtype=duration.dtype, device=duration.device) / intervals * duration
    pose = gait.sample(times)
    zero = torch.zeros_like(times)
    root = torch.stack((zero, pose.height[0], pose.travel[0]), dim=-1)
    rotations = gait.character.rotations({name: values[0] for name, values in pose.channels.items()})
    target = torch.stack((pose.target[0, :, 0], zero, pose.travel[0] + pose.target[0, :, 1]), dim=-1)
    return finish(gait.character, root, rotations, times, pose, target, phases(gait, 1))


def finish(
    character: Character,
    root: Tensor,
    rotations: Tensor,
    times: Tensor,
    pose: Pose,
    target: Tensor,
    course: tuple[Phase, ...],
) -> Motion:
    """The motion of frames at even times (T,). root: (T, 3) [m]. rotations: (T, J, 3, 3). target: (T, 3) [m].

    pose: what was sampled at these times, for the curves of the first candidate.
    """
    clip = Clip(character.skeleton, root, rotations, float(times[1] - times[0]))
    positions, orientations = character.skeleton.forward(root, rotations)
    ends = character.skeleton.end_positions(positions, orientations)
    contact = contacts(times, course)
    channels = {name: values[0] for name, values in pose.channels.items()}
    curves = {"trunk": channels["trunk_lean"], "trunk_side": channels["trunk_side"]}
    for side in SIDES:
        curves[f"{side}_hip"] = channels[f"{side}_thigh"]
        for joint in ("knee", "shoulder", "elbow"):
            curves[f"{side}_{joint}"] = channels[f"{side}_{joint}"]
    return Motion(
        clip,
        times,
        contact,
        torch.stack((ends["left_knee"], ends["right_knee"]), dim=1),
        character.centre_of_mass(positions, orientations),
        target,
        torch.where(contact, pose.leg_force[0].unsqueeze(-1), 0.0),
        curves,
        course,
    )
