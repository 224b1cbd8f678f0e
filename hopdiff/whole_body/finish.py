"""The finished stride of a whole-body movement."""

from __future__ import annotations

import torch
from torch import Tensor

from hopdiff.geometry.clip import Clip
from hopdiff.motion import SIDES, Motion, Phase
from hopdiff.types import HopdiffError
from hopdiff.whole_body.gait import BodyGait, BodyPose


def stride_times(gait: BodyGait, fps: float) -> Tensor:
    """(T,) frames of one stride of the first candidate, both ends included; a whole number of them fills it [s].

    Raises HopdiffError if `fps` is too low.
    """
    duration = gait.stride_time[0]
    intervals = round(float(duration) * fps)
    if intervals < 4:
        least = 4 / float(duration)
        raise HopdiffError(f"fps={fps:g} is too low for a stride of {float(duration):.3f} s: at least {least:.0f}.")
    return torch.arange(intervals + 1, dtype=duration.dtype, device=duration.device) / intervals * duration


def stride_motion(gait: BodyGait, fps: float) -> Motion:
    """One stride of the first candidate; the last frame is the first of the next stride."""
    times = stride_times(gait, fps)
    return finish(gait, times, gait.sample(times), phases(gait, 1))


def phases(gait: BodyGait, strides: int) -> tuple[Phase, ...]:
    """Stances and flights of the first candidate's strides in order of time, those of a run."""
    contacts, whole = gait.contacts[0].tolist(), float(gait.stride_time[0])
    found = []
    for stride in range(strides):
        start = stride * whole
        for k, side in enumerate(SIDES):
            down, off = contacts[k]
            following = contacts[1][0] if k == 0 else whole + contacts[0][0]
            found.append(Phase("stance", side, start + down, start + off))
            found.append(Phase("flight", side, start + off, start + following))
    return tuple(found)


def finish(gait: BodyGait, times: Tensor, pose: BodyPose, course: tuple[Phase, ...]) -> Motion:
    """The motion of the first candidate's frames at even times (T,) [s]."""
    skeleton = gait.layout.skeleton
    clip = Clip(skeleton, pose.root[0], pose.rotations[0], float(times[1] - times[0]))
    places, _ = clip.forward()
    contact = pose.contact[0]
    balls = torch.stack([places[:, skeleton.index(f"{side}_toe")] for side in SIDES], dim=1)
    return Motion(
        clip,
        times,
        contact,
        torch.where(contact.unsqueeze(-1), pose.cop[0], balls),
        pose.com[0],
        _supports(times, pose.cop[0], contact),
        pose.force[0].norm(dim=-1),
        {name: curve[0] for name, curve in pose.curves.items()},
        course,
        force=pose.force[0],
        cop=pose.cop[0],
    )


def _supports(times: Tensor, cop: Tensor, contact: Tensor) -> Tensor:
    """(T, 3) where the body is held up: the centre of pressure, and between two of them in the air."""
    standing = contact.any(dim=-1)
    share = contact.to(cop) / contact.sum(-1, keepdim=True).clamp_min(1)
    place = (cop * share.unsqueeze(-1)).sum(1)
    frames = standing.nonzero().flatten()
    after = torch.searchsorted(frames, torch.arange(len(times), device=frames.device)).clamp(max=len(frames) - 1)
    before = (after - 1).clamp_min(0)
    first, last = frames[before], frames[after]
    first = torch.where(standing, torch.arange(len(times), device=frames.device), first)
    last = torch.where(standing, first, last)
    span = (times[last] - times[first]).clamp_min(1e-9)
    mix = ((times - times[first]) / span).clamp(0.0, 1.0).unsqueeze(-1)
    return place[first] * (1.0 - mix) + place[last] * mix
