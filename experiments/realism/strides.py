"""Where strides begin and end: in runs from their contacts, in captured clips from the feet themselves."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from experiments.realism.angles import SIDES, other
from experiments.realism.recording import Array, Recording

# A captured foot stands while its ankle or its ball is this near to the lowest it gets and this slow over the ground.
# On a captured jog this agrees to three frames (25 ms) with when its centre of mass begins and ends to fall freely.
NEAR = 0.05  # m
SLOW = 0.5  # of the speed of the hips
LOWEST = 5.0  # percentile of heights that counts as the ground
SHORTEST = 0.08  # s; shorter contacts and gaps are noise


@dataclass(frozen=True)
class Stride:
    """From a touchdown of the leading foot to its next one; moments in s from the first frame of the recording."""

    lead: str
    start: float
    end: float
    take_off: float
    other_touchdown: float
    other_take_off: float

    @property
    def time(self) -> float:
        return self.end - self.start

    @property
    def contact(self) -> float:
        """s, mean of the two feet"""
        return (self.take_off - self.start + self.other_take_off - self.other_touchdown) / 2


def whole_stride(recording: Recording) -> Stride:
    """The stride that a run's file holds: from left touchdown to the next. Raises ValueError for any other file."""
    contact, end = recording.contact, float(recording.times[-1])
    if contact is None or not contact[0, 0] or contact[-2, 0]:
        raise ValueError(f"{recording.name}: does not begin at a touchdown of the left foot")
    left, right = (stances(contact[:-1, foot]) for foot in (0, 1))
    if len(left) != 1 or len(right) != 1:
        raise ValueError(f"{recording.name}: is not one stride")
    upward = None if recording.force is None else recording.force[..., 1]
    step = recording.frame_time
    take_off = edge(upward, 0, left[0][1] - 1, 1) * step
    touchdown = edge(upward, 1, right[0][0], -1) * step
    return Stride("left", 0.0, end, take_off, touchdown, edge(upward, 1, right[0][1] - 1, 1) * step)


def edge(upward: Array | None, foot: int, last: int, direction: int) -> float:
    """Moment, in frames, at which a contact ends beyond its last frame: where its force comes to nothing on a
    straight line through the last two frames, half a frame on without forces, never more than a frame."""
    if upward is None:
        return last + direction * 0.5
    outer, inner = upward[last, foot], upward[last - direction, foot]
    return last + direction * (float(np.clip(outer / (inner - outer), 0.0, 1.0)) if inner > outer else 1.0)


def captured_strides(recording: Recording) -> list[Stride]:
    """Every whole stride of a captured run, in order of time."""
    step = recording.frame_time
    # Where a recording begins or ends during a contact, only the other end of it is known.
    inside = {
        side: [(a - 0.5, b - 0.5) for a, b in stances(standing(recording, side)) if b < len(recording.positions)]
        for side in SIDES
    }
    found = []
    for lead in SIDES:
        for (start, take_off), (end, _) in pairwise(inside[lead]):
            between = [one for one in inside[other(lead)] if start < one[0] < end]
            if start > 0 and len(between) == 1:
                moments = (start, end, take_off, *between[0])
                found.append(Stride(lead, *(float(moment * step) for moment in moments)))
    return sorted(found, key=lambda stride: stride.start)


def standing(recording: Recording, side: str) -> NDArray[np.bool_]:
    """(T,) whether a captured foot is on the ground."""
    hips = np.gradient(recording.point("pelvis"), recording.frame_time, axis=0)
    speed = np.linalg.norm(hips[:, [0, 2]], axis=-1).mean()
    stands = np.zeros(len(hips), dtype=bool)
    for joint in ("ankle", "toe"):
        place = recording.point(f"{side}_{joint}")
        rate = np.linalg.norm(np.gradient(place, recording.frame_time, axis=0)[:, [0, 2]], axis=-1)
        low = place[:, 1] < np.percentile(place[:, 1], LOWEST) + NEAR
        stands |= low & (rate < SLOW * speed)
    return without_blinks(stands, round(SHORTEST / recording.frame_time))


def without_blinks(flags: NDArray[np.bool_], shortest: int) -> NDArray[np.bool_]:
    """Flags whose gaps, and then spells, of fewer frames are gone."""
    for value in (False, True):
        flags = flags.copy()
        for first, end in stances(flags == value):
            if end - first < shortest and first > 0 and end < len(flags):
                flags[first:end] = not value
    return flags


def stances(flags: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """First frame, and the one after the last, of every spell of true flags."""
    edges = np.flatnonzero(np.diff(np.r_[False, flags, False]))
    return [(int(a), int(b)) for a, b in edges.reshape(-1, 2)]
