"""From the single steps of the thesis model to a run that goes on for ever."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import torch
from torch import Tensor

from hopdiff.character import Character
from hopdiff.models.body import mirror
from hopdiff.models.gait import Pose, stride_time
from hopdiff.models.steps import Steps
from hopdiff.physics.stepping import Hops

OTHERS = ("height", "travel", "target_side", "target_forward", "leg_force")  # of a pose, beside its channels


class Frames(NamedTuple):
    """All steps on frames (B, F): left stance and the flight after it. Targets are relative to HIP [m]."""

    steps: Steps
    hops: Hops
    base: dict[str, Tensor]
    stride_phase: Tensor
    target_side: Tensor
    target_forward: Tensor
    reach: Tensor
    stance_frames: Tensor
    step_frames: Tensor


class Course(NamedTuple):
    """Many steps in a row: of every frame (P, F) the step of the batch, the frame in it, the number of the step."""

    row: Tensor
    frame: Tensor
    number: Tensor


def lay_out(steps: Steps, step_frames: Tensor, count: int) -> Course:
    """The frames of `count` steps of every candidate, left first; shorter candidates repeat their last frame."""
    candidates = len(step_frames) // steps.count
    rows = []
    for p in range(candidates):
        which = [p + candidates * (k % steps.count) for k in range(count)]
        lengths = [int(step_frames[i]) for i in which]
        rows.append(
            torch.stack(
                [
                    torch.tensor(which).repeat_interleave(torch.tensor(lengths)),
                    torch.cat([torch.arange(n) for n in lengths]),
                    torch.arange(count).repeat_interleave(torch.tensor(lengths)),
                ]
            )
        )
    longest = max(row.shape[-1] for row in rows)
    padded = [torch.cat((row, row[:, -1:].expand(-1, longest - row.shape[-1])), dim=-1) for row in rows]
    return Course(*torch.stack(padded, dim=1).to(step_frames.device))


def along(course: Course, f: Frames, step: float) -> dict[str, Tensor]:
    """What the frames of a course hold (P, F), by name; every second step is seen in the mirror."""
    hops, cycle = f.hops, f.steps.cycle
    second = course.number % 2 == 1

    def at(values: Tensor) -> Tensor:
        return values[course.row, course.frame]

    ahead = hops.forward - hops.foot
    force = torch.where(hops.in_flight, torch.zeros_like(ahead), cycle.leg_force_bw(ahead, hops.height).clamp_min(0.0))
    # A step ends one frame after its last.
    last = (f.step_frames - 1).clamp_min(0).unsqueeze(-1)
    ways = hops.forward.gather(1, last)[:, 0] + cycle.speed * step - hops.forward[:, 0]
    starts = course.frame == 0
    gone = torch.cumsum(torch.where(starts[:, 1:], ways[course.row[:, :-1]], 0.0), dim=-1)
    gone = torch.cat((torch.zeros_like(gone[:, :1]), gone), dim=-1)
    side = at(f.target_side)
    return {
        **mirror({name: at(values) for name, values in f.base.items()}, second),
        "stride_phase": at(f.stride_phase) + math.pi * course.number.to(side),
        "target_side": torch.where(second, -side, side),
        "target_forward": at(f.target_forward),
        "height": at(hops.height),
        "travel": gone + at(hops.forward) - hops.forward[:, 0][course.row],
        "leg_force": at(force),
    }


def last_stride(character: Character, values: dict[str, Tensor], f: Frames, strides: int, step: float) -> ThesisGait:
    """The stride after `strides` strides, with the frame after it."""
    by_leg = (
        torch.stack(n.chunk(2) if f.steps.count == 2 else (n, n), dim=-1) for n in (f.stance_frames, f.step_frames)
    )
    stance, whole = by_leg
    length = whole.sum(-1, keepdim=True)
    index = torch.arange(int(length.max()) + 1, device=length.device)
    kept = strides * length + torch.minimum(index, length)
    table = {name: value.gather(1, kept) for name, value in values.items() if name != "stride_phase"}
    table["travel"] = table["travel"] - table["travel"][:, :1]
    like = table["travel"]
    return ThesisGait(character, table, step, stance.to(like) * step, (whole - stance).to(like) * step)


@dataclass(frozen=True, eq=False)
class ThesisGait:
    """One stride of P candidates on frames, and the frame after it. Implements `hopdiff.models.gait.Gait`.

    table: name -> (P, F), channels and OTHERS; shorter strides repeat their last frame. step: frame interval h [s].
    contact_times, flight_times: (P, 2) by leg [s].
    """

    character: Character
    table: dict[str, Tensor]
    step: float
    contact_times: Tensor
    flight_times: Tensor

    def sample(self, times: Tensor) -> Pose:
        """The runs at times (T,) since left touchdown, linear between frames [s]."""
        whole = stride_time(self).unsqueeze(-1)
        # The last frame of a stride shows what has not settled; the first of the next one would hide it.
        turns = times / whole
        count = torch.floor(torch.where(turns > 0, turns - 1e-9, turns + 1e-9))
        place = ((times - count * whole) / self.step).clamp_min(0.0)
        below = torch.minimum(place.floor().long(), (whole / self.step).round().long() - 1)
        share = place - below

        def at(values: Tensor) -> Tensor:
            return values.gather(1, below) * (1.0 - share) + values.gather(1, below + 1) * share

        values = {name: at(column) for name, column in self.table.items()}
        height, travel, side, forward, force = (values.pop(name) for name in OTHERS)
        end = self.table["travel"].amax(-1, keepdim=True)
        return Pose(values, height, travel + count * end, torch.stack((side, forward), dim=-1), force)
