"""Clips of one body over speed and briskness, alike in phase, and what becomes of them where they are blended.

Blends are those of game engines: turns of joints by normalised sums of quaternions, places and the time of the stride
by weighted means, all at one phase.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import torch
from torch import Tensor

from hopdiff.export.anatomy import parts_of
from hopdiff.export.contact_events import contact_events, root_motion
from hopdiff.export.glb import same_body
from hopdiff.export.prepare import in_place
from hopdiff.export.take import Take
from hopdiff.geometry.joint_names import SIDES
from hopdiff.geometry.quaternion import from_quaternions, quaternions
from hopdiff.types import HopdiffError

FLAT = 0.01  # m above where it is lowest up to which the ball of a standing foot lies on the ground
DIGITS = 6  # behind the point, of numbers in files


@dataclass(frozen=True, eq=False)
class BlendSpace:
    """Clips by (speed [m/s], briskness), one stride each, on the spot, with their left touchdowns at their first keys.

    speeds, betas: the lines of the grid, from low to high; not every crossing need have a clip.
    """

    speeds: tuple[float, ...]
    betas: tuple[float, ...]
    clips: dict[tuple[float, float], Take]

    @classmethod
    def of(cls, takes: Sequence[Take]) -> BlendSpace:
        """Raises HopdiffError for takes that cannot be blended, or that have no place or one place in the grid."""
        clips: dict[tuple[float, float], Take] = {}
        for take in takes:
            place = _number(take, "speed"), _number(take, "beta")
            if place in clips:
                at = f"speed {place[0]:g} and beta {place[1]:g}"
                raise HopdiffError(f"{clips[place].name} and {take.name} are both of {at}: leave one of them out.")
            if take.frames != takes[0].frames or not take.loop:
                raise HopdiffError(f"{take.name} is no loop of as many keys as {takes[0].name}: set keys.")
            if not same_body(take.clip.skeleton, takes[0].clip.skeleton):
                raise HopdiffError(f"{take.name} is of another body than {takes[0].name}.")
            clips[place] = take if take.way is not None else in_place(take)
        speeds, betas = (tuple(sorted({place[k] for place in clips})) for k in range(2))
        return cls(speeds, betas, clips)

    @property
    def missing(self) -> list[tuple[float, float]]:
        """The crossings of the grid without a clip."""
        return [(speed, beta) for speed in self.speeds for beta in self.betas if (speed, beta) not in self.clips]

    def edges(self) -> list[tuple[Take, Take]]:
        """Neighbours along speed and along briskness."""
        found = []
        for (speed, beta), take in self.clips.items():
            places = (_after(speed, self.speeds), beta), (speed, _after(beta, self.betas))
            found += [(take, self.clips[place]) for place in places if place in self.clips]
        return found

    def index(self) -> dict[str, Any]:
        """What a game has to know of the clips, for a file."""
        clips = [
            {
                "name": take.name,
                "speed": speed,
                "beta": beta,
                "turn": 0.0,
                "stride_time": round(take.clip.duration, DIGITS),
                "stride_length": round(stride_length(take), DIGITS),
                "contacts": [
                    {"name": event.name, "phase": None if event.phase is None else round(event.phase, DIGITS)}
                    for event in contact_events(take)
                ],
            }
            for (speed, beta), take in self.clips.items()
        ]
        edges = self.edges()
        between = [slide for pair in edges if (slide := sliding(blend(pair, (0.5, 0.5)))) is not None]
        own = [slide for take in self.clips.values() if (slide := sliding(take)) is not None]
        return {
            "keys": next(iter(self.clips.values())).frames - 1,
            "speeds": list(self.speeds),
            "betas": list(self.betas),
            "missing": [{"speed": speed, "beta": beta} for speed, beta in self.missing],
            "clips": clips,
            "sliding": {
                "clips": round(max(own), DIGITS) if own else None,
                "between": round(max(between), DIGITS) if between else None,
            },
        }


def blend(takes: Sequence[Take], weights: Sequence[float]) -> Take:
    """The stride that an engine shows between clips on the spot, which are alike in phase. weights: their sum is 1."""
    first, clips = takes[0], [take.clip for take in takes]
    turns = torch.stack([quaternions(clip.rotations) for clip in clips])
    # Of a turn and its opposite, which are the same, that nearer to the first clip's.
    turns = turns * torch.where((turns * turns[:1]).sum(dim=-1, keepdim=True) < 0.0, -1.0, 1.0)
    share = torch.tensor(weights, dtype=torch.float64)

    def mean(values: Sequence[Tensor]) -> Tensor:
        found: Tensor = torch.tensordot(share, torch.stack(list(values)), dims=1)
        return found

    duration = float(mean([torch.tensor(clip.duration).double() for clip in clips]))
    offsets = None if first.clip.offsets is None else mean([clip.offsets for clip in clips if clip.offsets is not None])
    clip = replace(
        first.clip,
        root_position=mean([clip.root_position for clip in clips]),
        rotations=from_quaternions(mean(list(turns))),
        frame_time=duration / (first.frames - 1),
        offsets=offsets,
    )
    ways = [take.way for take in takes if take.way is not None]
    contacts = [take.contact for take in takes if take.contact is not None]
    # A foot stands where it does in all of them.
    contact = torch.stack(contacts).all(dim=0) if len(contacts) == len(takes) else None
    way = mean(ways) if len(ways) == len(takes) else None
    others: dict[str, Any] = dict.fromkeys(("feet", "com", "leg_force", "force", "cop"))
    return replace(first, name="blend", clip=clip, contact=contact, way=way, numbers={}, **others)


def stride_length(take: Take) -> float:
    """How far a clip goes [m]."""
    return float(root_motion(take).distance[-1])


def sliding(take: Take) -> float | None:
    """How fast the balls of standing feet move over the ground, the mean over both [m/s], of a stride on the spot that
    goes on along z as far as its way says; None where feet or contacts are not known."""
    parts = parts_of(take.clip.skeleton)
    balls = [parts.get(f"{side}_toe") for side in SIDES]
    if take.contact is None or take.way is None or None in balls:
        return None
    frames = torch.arange(take.frames, dtype=torch.float64) / (take.frames - 1)
    places = take.clip.joint_positions()[:, balls]
    gone = places + stride_length(take) * frames[:, None, None] * places.new_tensor((0.0, 0.0, 1.0))
    speed = gone.diff(dim=0)[..., [0, 2]].norm(dim=-1) / take.clip.frame_time
    flat = take.contact & (places[..., 1] < places[..., 1].amin(dim=0) + FLAT)
    standing = flat[1:] & flat[:-1]
    return float(speed[standing].mean()) if bool(standing.any()) else None


def _number(take: Take, entry: str) -> float:
    found = take.numbers.get(entry)
    if not isinstance(found, int | float):
        raise HopdiffError(f"{take.name} has no place in a blend space: its {entry} is not known.")
    return round(float(found), DIGITS)


def _after(value: float, line: Sequence[float]) -> float:
    """The next value of a line of the grid; beyond its end none that any clip has."""
    return next((other for other in line if other > value), float("inf"))
