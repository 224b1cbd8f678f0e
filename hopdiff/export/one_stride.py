"""A stride of a loop from one touchdown of the left foot to the next, in equal parts: what clips have to be alike in to
be blended, or to go on from one to the other."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import torch
from torch import Tensor

from hopdiff.export.contact_events import SAME, contact_events
from hopdiff.export.ground import ground_path
from hopdiff.export.take import PLACES, ContactEvent, Take, closes
from hopdiff.geometry.joint_names import SIDES
from hopdiff.types import HopdiffError


def one_stride(take: Take, keys: int) -> Take:
    """The first stride of a loop that begins with the left foot's touchdown, in `keys` equal parts.

    Its way begins at x = z = 0, and its last frame is the first of the next stride. Contacts begin and end where
    `contact_events` has them, between frames of the take. Raises HopdiffError, naming setting and take, for what is no
    loop, or where feet are not known.
    """
    if not take.loop:
        raise HopdiffError(f"keys={keys}: {take.name} is no loop, it does not end as it began.")
    events = contact_events(take)
    downs = [event.time for event in events if event.name == "LeftDown"]
    if not downs:
        raise HopdiffError(f"keys={keys}: {take.name} has no touchdown of the left foot, with which a stride begins.")
    step, duration = take.clip.frame_time, take.clip.duration
    if take.frames == keys + 1 and len(downs) == 1 and downs[0] < SAME * step:
        return _from_origin(take)
    stride = (downs[1] if len(downs) > 1 else downs[0] + duration) - downs[0]
    times = downs[0] + stride * torch.arange(keys + 1, dtype=torch.float64) / keys
    found = take.repeated(2).at(times / step, stride / keys)
    stands = torch.stack([_standing(events, foot, times, duration) for foot in SIDES], dim=-1)
    if take.leg_force is not None:
        forces = [_force(take, events, side, times) for side in range(len(SIDES))]
        found = replace(found, leg_force=torch.where(stands, torch.stack(forces, dim=-1), 0.0))
    found = replace(found, contact=stands)
    if len(downs) > 1:
        found = replace(found, loop=closes(found.clip))
    return _from_origin(found)


def _standing(events: list[ContactEvent], foot: str, times: Tensor, duration: float) -> Tensor:
    """(T,) whether a foot of a loop stands at times [s]."""
    own = [event for event in events if event.foot == foot]
    if not own:
        return torch.zeros(len(times), dtype=torch.bool)
    changes = torch.tensor([event.time for event in own], dtype=torch.float64)
    last = torch.searchsorted(changes, (times + SAME * duration) % duration, right=True) - 1
    return torch.tensor([event.down for event in own])[last]


def _force(take: Take, events: list[ContactEvent], side: int, times: Tensor) -> Tensor:
    """(T,) force along a leg of a loop [N], which begins and ends with the contacts and not with frames."""
    assert take.contact is not None
    assert take.leg_force is not None
    frames = torch.nonzero(take.contact[:-1, side]).squeeze(-1)
    changes = [event.time for event in events if event.foot == SIDES[side]]
    at = np.concatenate((frames.double().numpy() * take.clip.frame_time, changes))
    force = np.concatenate((take.leg_force[frames, side].numpy(), np.zeros(len(changes))))
    # A touchdown may fall on a frame: there the force is zero.
    order = np.lexsort((force, at))
    at, force = at[order], force[order]
    kept = np.concatenate(([True], np.diff(at) > SAME * take.clip.frame_time))
    return torch.from_numpy(np.interp(times.numpy(), at[kept], force[kept], period=take.clip.duration))


def _from_origin(take: Take) -> Take:
    """The take moved over the ground so that its steady way begins at x = z = 0."""
    start = ground_path(take).place[0]
    away = torch.stack((start[0], torch.zeros_like(start[0]), start[1]))
    moved = {entry: getattr(take, entry) - away for entry in PLACES if getattr(take, entry) is not None}
    return replace(take, clip=replace(take.clip, root_position=take.clip.root_position - away), events=None, **moved)
