"""Clips of one body over speed, briskness and turn, alike in phase, and what becomes of them where they are blended.

Blends are those of game engines: turns of joints by normalised sums of quaternions, places and the time of the stride
by weighted means, all at one phase.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import Any

import torch
from torch import Tensor

from hopdiff.export.anatomy import parts_of
from hopdiff.export.contact_events import contact_events, root_motion
from hopdiff.export.glb import bodies_of
from hopdiff.export.prepare import in_place
from hopdiff.export.take import DIGITS, Take
from hopdiff.geometry.joint_names import SIDES
from hopdiff.geometry.quaternion import from_quaternions, quaternions
from hopdiff.geometry.rotation import axis_rotation
from hopdiff.types import HopdiffError

FLAT = 0.01  # m above where it is lowest up to which the ball of a standing foot lies on the ground
STRAIGHT = 1e-6  # rad: less than that is no turn


Place = tuple[float, float, float]
AXES = ("speed", "beta", "turn")


@dataclass(frozen=True, eq=False)
class BlendSpace:
    """Clips by (speed [m/s], briskness, turn to the left [deg/s]), one stride each, on the spot, with their left
    touchdowns at their first keys.

    speeds, betas, turns: the lines of the grid, from low to high; not every crossing need have a clip.
    """

    speeds: tuple[float, ...]
    betas: tuple[float, ...]
    turns: tuple[float, ...]
    clips: dict[Place, Take]

    @classmethod
    def of(cls, takes: Sequence[Take]) -> BlendSpace:
        """Raises HopdiffError for takes that cannot be blended, or that have no place or one place in the grid."""
        clips: dict[Place, Take] = {}
        for take in takes:
            place = _number(take, "speed"), _number(take, "beta"), _number(take, "turn", 0.0)
            if place in clips:
                at = f"speed {place[0]:g}, beta {place[1]:g} and turn {place[2]:g}"
                raise HopdiffError(f"{clips[place].name} and {take.name} are both of {at}: leave one of them out.")
            if not take.loop:
                raise HopdiffError(f"{take.name} is no loop, it does not end as it began.")
            if take.frames != takes[0].frames:
                raise HopdiffError(f"{take.name} has other keys than {takes[0].name}: set keys.")
            if len(bodies_of([takes[0], take])[0]) > 1:
                raise HopdiffError(
                    f"{take.name} is of another body than {takes[0].name}: bones, ends or masses differ."
                )
            clips[place] = take if take.way is not None else in_place(take)
        speeds, betas, turns = (tuple(sorted({place[axis] for place in clips})) for axis in range(len(AXES)))
        return cls(speeds, betas, turns, clips)

    @property
    def missing(self) -> list[Place]:
        """The crossings of the grid without a clip."""
        return [place for place in product(self.speeds, self.betas, self.turns) if place not in self.clips]

    def edges(self) -> list[tuple[Take, Take]]:
        """Neighbours along each line of the grid."""
        found = []
        for (speed, beta, turn), take in self.clips.items():
            places = (
                (_after(speed, self.speeds), beta, turn),
                (speed, _after(beta, self.betas), turn),
                (speed, beta, _after(turn, self.turns)),
            )
            found += [(take, self.clips[place]) for place in places if place in self.clips]
        return found

    def index(self) -> dict[str, Any]:
        """What a game has to know of the clips, for a file."""
        clips = [
            {
                "name": take.name,
                "speed": speed,
                "beta": beta,
                "turn": turn,
                "stride_time": round(take.clip.duration, DIGITS),
                "stride_length": round(stride_length(take), DIGITS),
                "contacts": [
                    {"name": event.name, "phase": None if event.phase is None else round(event.phase, DIGITS)}
                    for event in contact_events(take)
                ],
            }
            for (speed, beta, turn), take in self.clips.items()
        ]
        edges = self.edges()
        between = [slide for pair in edges if (slide := sliding(blend(pair, (0.5, 0.5)))) is not None]
        own = [slide for take in self.clips.values() if (slide := sliding(take)) is not None]
        return {
            "keys": next(iter(self.clips.values())).frames - 1,
            "speeds": list(self.speeds),
            "betas": list(self.betas),
            "turns": list(self.turns),
            "missing": [dict(zip(AXES, place, strict=True)) for place in self.missing],
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
    offsets = None
    if any(clip.offsets is not None for clip in clips):
        still = [clip.skeleton.offsets.expand(clip.frames, -1, -1) for clip in clips]
        offsets = mean([one if clip.offsets is None else clip.offsets for clip, one in zip(clips, still, strict=True)])
    clip = replace(
        first.clip,
        root_position=mean([clip.root_position for clip in clips]),
        rotations=from_quaternions(mean(list(turns))),
        frame_time=duration / (first.frames - 1),
        offsets=offsets,
    )
    contacts = [take.contact for take in takes if take.contact is not None]
    # A foot stands where it does in all of them.
    contact = torch.stack(contacts).all(dim=0) if len(contacts) == len(takes) else None
    way = None
    if all(take.way is not None for take in takes):
        ends = torch.tensor([(stride_length(take), _turned(take)) for take in takes], dtype=torch.float64)
        length, turned = (share @ ends).tolist()
        way = _arc(length, turned, first)
    others: dict[str, Any] = dict.fromkeys(("feet", "com", "leg_force", "force", "cop", "events"))
    return replace(first, name="blend", clip=clip, contact=contact, way=way, numbers={}, **others)


def stride_length(take: Take) -> float:
    """How far a clip goes [m]."""
    return float(root_motion(take).distance[-1])


def sliding(take: Take) -> float | None:
    """How fast the balls of standing feet move over the ground, the mean over both [m/s], of a stride on the spot that
    goes on as its way says; None where feet, contacts or way are not known."""
    parts = parts_of(take.clip.skeleton)
    balls = [parts.get(f"{side}_toe") for side in SIDES]
    if take.contact is None or take.way is None or None in balls:
        return None
    places = take.clip.joint_positions()[:, balls]
    zero = torch.zeros_like(take.way[:, 0])
    gone = torch.stack((take.way[:, 0], zero, take.way[:, 1]), dim=-1)
    world = places @ axis_rotation("Y", take.way[:, 2]).transpose(-1, -2) + gone.unsqueeze(1)
    speed = world.diff(dim=0)[..., [0, 2]].norm(dim=-1) / take.clip.frame_time
    flat = take.contact & (places[..., 1] < places[..., 1].amin(dim=0) + FLAT)
    standing = flat[1:] & flat[:-1]
    return float(speed[standing].mean()) if bool(standing.any()) else None


def _turned(take: Take) -> float:
    """By how much a stride on the spot turns to the left [rad]."""
    assert take.way is not None
    return float(take.way[-1, 2] - take.way[0, 2])


def _arc(length: float, turned: float, take: Take) -> Tensor:
    """(T, 3) x, z and yaw of the way of that length [m] that turns steadily [rad], for every frame of a take."""
    done = torch.linspace(0.0, 1.0, take.frames, dtype=torch.float64)
    if abs(turned) < STRAIGHT:
        return torch.stack((0.0 * done, length * done, 0.0 * done), dim=-1)
    radius = length / turned
    yaw = turned * done
    return torch.stack((radius * (1.0 - torch.cos(yaw)), radius * torch.sin(yaw), yaw), dim=-1)


def _number(take: Take, entry: str, unknown: float | None = None) -> float:
    found = take.numbers.get(entry, unknown)
    if not isinstance(found, int | float):
        raise HopdiffError(f"{take.name} has no place in a blend space: its {entry} is not known.")
    return round(float(found), DIGITS)


def _after(value: float, line: Sequence[float]) -> float:
    """The next value of a line of the grid; beyond its end none that any clip has."""
    return next((other for other in line if other > value), float("inf"))
