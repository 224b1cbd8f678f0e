"""A motion ready to leave hopdiff: a clip, and what else is known of it frame by frame."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import Any

import torch
from torch import Tensor

from hopdiff.editing.leg_joints import find_legs
from hopdiff.editing.loop import Repetition, is_loop, repeated, repetitions
from hopdiff.feet.contacts import contact_points, find_contacts
from hopdiff.geometry.clip import Clip
from hopdiff.geometry.quaternion import slerp
from hopdiff.models.gait import LEAST_FRAMES, enough_fps
from hopdiff.motion import Motion
from hopdiff.numerics import GRAVITY
from hopdiff.types import HopdiffError

CLOSED = 1e-3  # m by which joints may be off where a loop goes on: standing feet would slip by as much
RIGID = 1e-3  # m by which joints may move against their parents and still be taken for fixed
MAX_FRAMES = 1_000_000
PLACES = ("feet", "com", "cop")  # fields that are points in the world
DIGITS = 6  # behind the point, of numbers in files


@dataclass(frozen=True)
class ContactEvent:
    """A foot that comes down, or leaves the ground. time [s] from the first frame; phase: of the stride, 0 and 1 at
    left touchdowns, None where there is no stride; position: (x, y, z) of the foot's contact point [m], if known."""

    foot: str
    down: bool
    time: float
    phase: float | None
    position: tuple[float, ...] | None

    @property
    def name(self) -> str:
        """LeftDown, LeftUp, RightDown or RightUp: what sync markers are called."""
        return f"{self.foot.capitalize()}{'Down' if self.down else 'Up'}"

    def plain(self) -> dict[str, Any]:
        """The event for a file."""
        return {
            "name": self.name,
            "foot": self.foot,
            "event": "touchdown" if self.down else "takeoff",
            "time": round(self.time, DIGITS),
            "phase": None if self.phase is None else round(self.phase, DIGITS),
            "position": None if self.position is None else [round(value, DIGITS) for value in self.position],
        }


@dataclass(frozen=True, eq=False)
class Segments:
    """The rigid parts of a body.

    joints: (S,) that carry them. masses: (S,) [kg]. centres: (S, 3) of mass in the joints' frames [m]. inertias: (S, 3)
    principal moments about them, along the frames' axes [kg m^2]. heel: (3,) from the ankle of a level foot [m], None
    for a body without feet.
    """

    joints: tuple[str, ...]
    masses: Tensor
    centres: Tensor
    inertias: Tensor
    heel: Tensor | None


@dataclass(frozen=True, eq=False)
class Take:
    """A clip with a name, in float64 on the CPU.

    loop: whether the last frame is the first of a repetition. contact: (T, 2) bool, left and right foot on the ground.
    feet: (T, 2, 3) their contact points [m]. com: (T, 3) centre of mass [m]. leg_force: (T, 2) along each leg [N].
    masses: of the body's eleven segments by joint [kg]. force, cop: (T, 2, 3) ground force on each foot [N] and its
    centre of pressure [m]. segments: the rigid parts that its joints move. way: (T, 3) of a motion on the spot the way
    that was left out: x, z [m] and yaw [rad]. parts: of the body, by the names of `full_body`, -> joint; None where
    names and shape tell them. events: when feet come down and leave, as known from the frames that the clip was made
    of; None where `contact_events` shall find them in its own. What is not known is None. numbers: about the motion,
    for people (what metrics.json holds). notes: sentences for the user on how its file was read.
    """

    name: str
    clip: Clip
    loop: bool
    contact: Tensor | None = None
    feet: Tensor | None = None
    com: Tensor | None = None
    leg_force: Tensor | None = None
    masses: Mapping[str, float] | None = None
    numbers: Mapping[str, Any] = field(default_factory=dict)
    force: Tensor | None = None
    cop: Tensor | None = None
    segments: Segments | None = None
    notes: tuple[str, ...] = ()
    way: Tensor | None = None
    parts: Mapping[str, str] | None = None
    events: tuple[ContactEvent, ...] | None = None

    @property
    def frames(self) -> int:
        return self.clip.frames

    @classmethod
    def of_motion(
        cls,
        name: str,
        motion: Motion,
        masses: Mapping[str, float],
        numbers: Mapping[str, Any],
        segments: Segments | None = None,
    ) -> Take:
        """A run of hopdiff's own. masses: of the character's eleven segments by joint [kg]."""
        clip = _plain(motion.clip)
        weight = sum(masses.values()) * GRAVITY
        return cls(
            name,
            clip,
            closes(clip),
            motion.contact.cpu(),
            motion.feet.double().cpu(),
            motion.com.double().cpu(),
            motion.leg_force.double().cpu() * weight,
            dict(masses),
            dict(numbers),
            None if motion.force is None else motion.force.double().cpu() * weight,
            None if motion.cop is None else motion.cop.double().cpu(),
            segments,
        )

    @classmethod
    def of_clip(cls, name: str, clip: Clip, numbers: Mapping[str, Any], contact: Tensor | None = None) -> Take:
        """Any clip. contact: (T, 2), found where it is not given."""
        clip = _plain(clip)
        legs = find_legs(clip.skeleton)
        if not legs or clip.frames < 2:
            return cls(name, clip, closes(clip), numbers=dict(numbers))
        contacts = find_contacts(clip, legs)
        points = contact_points(clip, contacts)
        own = [[i for i, (leg, _) in enumerate(contacts.points) if leg == k] for k in range(len(legs))]
        if contact is None:
            contact = torch.stack([contacts.touching[:, one].any(dim=-1) for one in own], dim=-1)
        feet = torch.stack([points[:, one].mean(dim=1) for one in own], dim=1)
        return cls(name, clip, closes(clip), contact, feet, numbers=dict(numbers))

    def repeated(self, count: int) -> Take:
        """A loop laid end to end. Raises HopdiffError, naming the take, for a motion that is no loop."""
        if count == 1:
            return self
        if not self.loop:
            raise HopdiffError(f"cycles={count}: {self.name} is no loop, it does not end as it began.")
        if count * (self.frames - 1) >= MAX_FRAMES:
            raise HopdiffError(f"cycles={count} makes more than {MAX_FRAMES} frames of {self.name}.")
        places = repetitions(self.clip, count)
        others: dict[str, Any] = {
            entry: torch.cat(
                (values[:1], *(one.points(values[1:]) if entry in PLACES else values[1:] for one in places))
            )
            for entry, values in _along(self).items()
        }
        if self.way is not None:
            further = self.way[-1] - self.way[0]
            others["way"] = torch.cat((self.way[:1], *(self.way[1:] + k * further for k in range(count))))
        clip = repeated(self.clip, count)
        if (moving := self.clip.offsets) is not None:
            clip = replace(clip, offsets=torch.cat((moving[:1], *(moving[1:] for _ in range(count)))))
        return replace(self, clip=clip, events=self._events_in(places), **others)

    def _events_in(self, places: Sequence[Repetition]) -> tuple[ContactEvent, ...] | None:
        """Events of a loop that is laid end to end in these places."""
        if self.events is None:
            return None
        found = []
        for k, one in enumerate(places):
            for event in self.events:
                there = None if event.position is None else one.points(one.here.new_tensor(event.position))
                place = None if there is None else tuple(there.tolist())
                found.append(replace(event, time=event.time + k * self.clip.duration, position=place))
        return tuple(found)

    def resampled(self, fps: float, exact: bool) -> Take:
        """The same motion, as fast, at other frames a second.

        exact: whether frames lie exactly 1 / fps apart, and a loop then ends up to a frame early; otherwise a whole
        number of frames fills the duration, and the time between them is as near to 1 / fps as that allows. Events that
        the take carries stay when they are.
        """
        duration = self.clip.duration
        if duration <= 0.0:
            return self
        if duration * fps >= MAX_FRAMES:
            raise HopdiffError(f"fps={fps:g} makes more than {MAX_FRAMES} frames of {self.name}.")
        count = max(1, math.floor(duration * fps + 1e-6) if exact else round(duration * fps))
        if self.loop and count < LEAST_FRAMES <= self.frames:
            raise HopdiffError(
                f"fps={fps:g} is too low for the loop {self.name} of {duration:.3f} s: at least {enough_fps(duration)}."
            )
        frame_time = 1.0 / fps if exact else duration / count
        times = torch.arange(count + 1, dtype=torch.float64) * frame_time / self.clip.frame_time
        if len(times) == self.frames and float((times - torch.arange(self.frames)).abs().max()) < 1e-9:
            return self
        found = self.at(times, frame_time)
        return replace(found, events=self._events_until(found.clip.duration))

    def at(self, times: Tensor, frame_time: float) -> Take:
        """The motion at times (T,) [frames, from the first to the last], told to be frame_time [s] apart."""
        before = times.floor().long().clamp(0, self.frames - 2)
        share = (times - before).clamp(0.0, 1.0)
        share = torch.where(share < 1e-9, 0.0, torch.where(share > 1.0 - 1e-9, 1.0, share))

        def between(values: Tensor) -> Tensor:
            wide = share.reshape(-1, *[1] * (values.ndim - 1))
            return torch.lerp(values[before], values[before + 1], wide)

        clip = self.clip
        resampled = replace(
            clip,
            root_position=between(clip.root_position),
            rotations=slerp(clip.rotations[before], clip.rotations[before + 1], share[:, None]),
            frame_time=frame_time,
            offsets=None if clip.offsets is None else between(clip.offsets),
        )
        nearest = torch.where(share < 0.5, before, before + 1)
        others: dict[str, Any] = {
            entry: values[nearest] if entry == "contact" else between(values) for entry, values in _along(self).items()
        }
        return replace(self, clip=resampled, events=None, **others)

    def _events_until(self, end: float) -> tuple[ContactEvent, ...] | None:
        """Events of the same motion that ends at `end` [s], up to a frame early; those of a loop are all in it."""
        if self.events is None or not self.loop:
            return self.events and tuple(event for event in self.events if event.time < end + 1e-9)
        return tuple(replace(event, time=min(event.time, end)) for event in self.events)


def _along(take: Take) -> dict[str, Any]:
    """What is known for every frame besides the clip, by field."""
    values = {entry.name: getattr(take, entry.name) for entry in fields(take)}
    return {name: value for name, value in values.items() if isinstance(value, Tensor)}


def closes(clip: Clip) -> bool:
    """Whether a clip goes on where it began without a jump."""
    if not is_loop(clip):
        return False
    places = torch.cat((clip.joint_positions(), *(end.unsqueeze(1) for end in clip.end_positions().values())), dim=1)
    again = repetitions(clip, 2)[1].points(places[0])
    return bool(((places[-1] - again).norm(dim=-1) < CLOSED).all())


def _plain(clip: Clip) -> Clip:
    """The clip in float64 on the CPU, its joints fixed to their parents where they hardly move against them."""
    skeleton = clip.skeleton
    ends = {name: end.detach().double().cpu() for name, end in skeleton.end_sites.items()}
    bones, moving = skeleton.offsets.detach().double().cpu(), clip.offsets
    if moving is not None:
        moving = moving.detach().double().cpu()
        mean = moving[:, 1:].mean(dim=0)
        bones = torch.cat((bones[:1], mean))
        moving = None if bool(((moving[:, 1:] - mean).abs() < RIGID).all()) else moving
    return replace(
        clip,
        skeleton=replace(skeleton, offsets=bones, end_sites=ends),
        root_position=clip.root_position.detach().double().cpu(),
        rotations=clip.rotations.detach().double().cpu(),
        offsets=moving,
    )
