"""When feet come down and leave the ground in a clip, and its root motion: what game engines sync and move by."""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import torch
from torch import Tensor

from hopdiff.export.ground import ground_path
from hopdiff.export.take import DIGITS, ContactEvent, Take
from hopdiff.geometry.joint_names import SIDES

SAME = 1e-6  # frames by which times may differ and be the same


def contact_events(take: Take) -> list[ContactEvent]:
    """The touchdowns and take-offs of a take in their order; of a loop those of one repetition, none twice.

    Where the force of the legs is known, the time is where it reaches zero, between two frames; otherwise that of the
    first frame in which the foot stands, or does no more. What a motion that is no loop begins with is no event. A take
    that carries its events, as of the frames that it was made of, keeps them.
    """
    if take.events is not None:
        return list(take.events)
    if take.contact is None or take.frames < 2:
        return []
    found = [(time, side, down, place) for side in range(2) for time, down, place in _of_foot(take, side)]
    found.sort(key=lambda one: one[:2])
    strides = _strides([time for time, side, down, _ in found if side == 0 and down], take)
    return [
        ContactEvent(SIDES[side], down, time * take.clip.frame_time, _phase(time, strides), place)
        for time, side, down, place in found
    ]


def with_events(take: Take) -> Take:
    """The take with its events, so that it has the same ones at other frames."""
    return replace(take, events=tuple(contact_events(take)))


def with_feet(take: Take, events: Sequence[ContactEvent]) -> Take:
    """The take with the events of another body that moves alike, where its own feet stand then."""
    found = []
    for event in events:
        place = None
        if take.feet is not None and take.contact is not None:
            side, at, last = SIDES.index(event.foot), event.time / take.clip.frame_time, take.frames - 1
            # The first frame of the contact from the event on, or its last one up to it.
            near = math.ceil(at - SAME) if event.down else math.floor(at + SAME)
            frames = [min(max(near + step, 0), last) for step in ((0, 1, -1) if event.down else (0, -1, 1))]
            frame = next((one for one in frames if take.contact[one, side]), frames[0])
            place = tuple(take.feet[frame, side].tolist())
        found.append(replace(event, position=place))
    return replace(take, events=tuple(found))


def _of_foot(take: Take, side: int) -> list[tuple[float, bool, tuple[float, ...] | None]]:
    """When [frames], whether it comes down, and where, of every event of a foot."""
    assert take.contact is not None
    stands, last = take.contact[:, side].tolist(), take.frames - 1
    found = []
    for frame in range(1, take.frames):
        if stands[frame] != stands[frame - 1]:
            down = stands[frame]
            time, standing = _at_zero_force(take, side, frame, down), frame if down else frame - 1
            if take.loop and time > last - SAME:
                # With the last frame of a loop it begins again.
                time, standing = 0.0, 0
            place = None if take.feet is None else tuple(take.feet[standing, side].tolist())
            found.append((time, down, place))
    return found


def _at_zero_force(take: Take, side: int, frame: int, down: bool) -> float:
    """When a leg's force, drawn on from the two nearest frames of its contact, is zero [frames]; frame: the first one
    after the event."""
    if take.leg_force is None:
        return float(frame)
    force, count = take.leg_force[:, side], take.frames - 1
    near, far = (frame, frame + 1) if down else (frame - 1, frame - 2)
    ends = [float(force[k % count if take.loop else min(max(k, 0), count)]) for k in (near, far)]
    # The event lies between the frame before and this one.
    share = ends[0] / (ends[1] - ends[0]) if ends[1] > ends[0] else 0.0
    return frame - min(share, 1.0) if down else frame - 1 + min(share, 1.0)


def _strides(touchdowns: Sequence[float], take: Take) -> list[float]:
    """Left touchdowns one after the other [frames], those of a loop from before it to after it."""
    if take.loop and touchdowns:
        count = take.frames - 1
        return [touchdowns[-1] - count, *touchdowns, touchdowns[0] + count]
    return list(touchdowns)


def _phase(time: float, strides: Sequence[float]) -> float | None:
    """Phase of the stride that a time [frames] falls into; before the first and after the last as in those."""
    if len(strides) < 2:
        return None
    k = min(max(bisect_right(strides, time + 1e-9) - 1, 0), len(strides) - 2)
    return ((time - strides[k]) / (strides[k + 1] - strides[k]) + 1e-12) % 1.0


@dataclass(frozen=True, eq=False)
class RootMotion:
    """A body's steady way over the ground. place: (T, 2) x and z from where it began [m]; yaw: (T,) where it heads,
    from +z towards +x [rad]; speed: (T,) [m/s]; distance: (T,) along the way [m]."""

    place: Tensor
    yaw: Tensor
    speed: Tensor
    distance: Tensor

    def plain(self) -> dict[str, list[float]]:
        """The curves for a file, a number for each key."""
        curves = {"x": self.place[:, 0], "z": self.place[:, 1], "yaw": self.yaw}
        curves |= {"speed": self.speed, "distance": self.distance}
        return {name: [round(value, DIGITS) for value in values.tolist()] for name, values in curves.items()}


def root_motion(take: Take) -> RootMotion:
    """The way of a take; of one on the spot the way that was left out."""
    if take.way is None:
        path = ground_path(take)
        way = torch.cat((path.place, path.yaw[:, None]), dim=-1)
    else:
        way = take.way
    place = way[:, :2] - way[:1, :2]
    steps = place.diff(dim=0).norm(dim=-1)
    distance = torch.cat((torch.zeros(1).double(), steps.cumsum(0)))
    if take.frames < 2:
        return RootMotion(place, way[:, 2], torch.zeros(1).double(), distance)
    # Half a frame before and after a key, at the ends on the one side that there is.
    rates = steps / take.clip.frame_time
    speed = torch.cat((rates[:1], 0.5 * (rates[1:] + rates[:-1]), rates[-1:]))
    return RootMotion(place, way[:, 2], speed, distance)


def told(take: Take) -> dict[str, Any]:
    """Events and root motion of a take for a file."""
    return {"events": [event.plain() for event in contact_events(take)], "root_motion": root_motion(take).plain()}
