"""From a model that can be sampled in time to a finished stride with everything that plots and metrics show."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import torch
from torch import Tensor

from hopdiff.character import Character
from hopdiff.geometry.clip import Clip
from hopdiff.motion import Motion, Phase
from hopdiff.types import HopdiffError


class Pose(NamedTuple):
    """A run sampled at T moments.

    channels: name -> (T,) [rad]. height: (T,) of HIP above the ground [m].
    target: (T, 2) target of the centre of mass to the left and forward of HIP [m].
    leg_force: (T,) force along the leg that stands, in body weights.
    """

    channels: dict[str, Tensor]
    height: Tensor
    target: Tensor
    leg_force: Tensor


def stride_frames(duration: float, fps: float) -> int:
    """Number of frame intervals of a stride that comes nearest to `fps`; raises HopdiffError if there is none."""
    intervals = round(duration * fps)
    if intervals < 4:
        raise HopdiffError(f"fps={fps:g} is too low for a stride of {duration:.3f} s: at least {4 / duration:.0f}.")
    return intervals


def finish_stride(
    character: Character,
    sample: Callable[[Tensor], Pose],
    contact_time: float,
    flight_time: float,
    speed: float,
    fps: float,
    like: Tensor,
) -> Motion:
    """Frames of one stride: left stance, flight, right stance, flight; the last frame is the first of the next.

    like: a tensor that gives dtype and device. The frame time is the stride over a whole number of frames.
    """
    step = contact_time + flight_time
    intervals = stride_frames(2.0 * step, fps)
    frame_time = 2.0 * step / intervals
    times = torch.arange(intervals + 1, dtype=like.dtype, device=like.device) * frame_time
    pose = sample(times)
    travel = speed * times
    zero = torch.zeros_like(times)
    root = torch.stack((zero, pose.height, travel), dim=-1)
    rotations = character.rotations(pose.channels)
    clip = Clip(character.skeleton, root, rotations, frame_time)
    positions, orientations = character.skeleton.forward(root, rotations)
    ends = character.skeleton.end_positions(positions, orientations)
    # Frame times carry rounding; touchdown and take-off frames belong to the stance.
    slack = 1e-9
    local = torch.remainder(times + slack, step) - slack
    which = torch.floor((times + slack) / step) % 2
    standing = local <= contact_time + slack
    contact = torch.stack((standing & (which == 0), standing & (which == 1)), dim=-1)
    force = torch.where(contact, pose.leg_force.unsqueeze(-1), 0.0)
    target = torch.stack((pose.target[:, 0], zero, travel + pose.target[:, 1]), dim=-1)
    bounds = (0.0, contact_time, step, step + contact_time, 2.0 * step)
    kinds = (("stance", "left"), ("flight", "left"), ("stance", "right"), ("flight", "right"))
    curves = {"trunk": pose.channels["trunk_lean"]}
    for side in ("left", "right"):
        curves[f"{side}_hip"] = pose.channels[f"{side}_thigh"]
        for joint in ("knee", "shoulder", "elbow"):
            curves[f"{side}_{joint}"] = pose.channels[f"{side}_{joint}"]
    return Motion(
        clip,
        times,
        contact,
        torch.stack((ends["left_knee"], ends["right_knee"]), dim=1),
        character.centre_of_mass(positions, orientations),
        target,
        force,
        curves,
        tuple(Phase(kind, side, bounds[i], bounds[i + 1]) for i, (kind, side) in enumerate(kinds)),
    )
