"""Whether a motion with new feet still looks like the one it was made of: numbers, and sentences where it does not."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import torch
from torch import Tensor
from torch.nn import functional

from hopdiff.feet.contacts import Contacts, contact_points, slide_numbers
from hopdiff.feet.planting import Planted
from hopdiff.feet.track import LegTrack, leg_tracks, turned
from hopdiff.geometry.clip import Clip
from hopdiff.terrain.ground import Ground

AT_ONCE = 4096  # frames whose whole bodies are looked at together
GLANCE = 1.0 / 30.0  # s over which speeds and accelerations are taken, so that cameras' noise does not count
# Beyond these a user is told. [m], [m], [m], [m], times the source's, times the source's, degrees, share.
BARS = {
    "first_pose_error": 1e-4,
    "last_pose_error": 1e-4,
    "root_drop": 0.08,
    "foot_float": 0.01,
    "foot_sink": 0.01,
    "joint_speed_ratio": 1.5,
    "joint_acceleration_ratio": 2.0,
    "hyperextension_deg": 1.0,
    "given_up": 0.05,
}


@dataclass(frozen=True)
class Quality:
    """numbers: by the names of BARS, and where and what was worst. sentences: for a user, one for each bar passed."""

    numbers: dict[str, float]
    sentences: list[str]


def quality_of(source: Clip, planted: Planted, contacts: Contacts, ground: Ground | None = None) -> Quality:
    """How a planted clip compares with its source.

    first_pose_error, last_pose_error: farthest that a joint is from where the source's is, seen from the root [m];
    legs are left out on uneven ground, where they stand otherwise. root_drop: farthest that the root comes down against
    the source, less what the ground does [m]. foot_float, foot_sink: farthest that a point of a standing foot is above
    or below its height in the source, over the ground [m]. joint_speed_ratio, joint_acceleration_ratio: largest of any
    joint, seen from the root, against the source's largest. hyperextension_deg: largest bend of a knee beyond straight,
    more than the source's. given_up: share of the source's contacts in which the foot does not stand.
    """
    clip = planted.clip
    (speed, jolt), (old_speed, old_jolt) = _rates(clip), _rates(source)
    ends, old_ends = _ends(clip), _ends(source)
    over, old_over = _over_ground(clip, contacts, ground)
    stands = planted.kept(contacts)
    off = torch.where(stands, over - (contact_points(source, contacts)[..., 1] - old_over), torch.zeros_like(over))
    drop = planted.lowered
    tracks = zip(leg_tracks(clip, contacts.legs), leg_tracks(source, contacts.legs), strict=True)
    beyond = [_straight(new, was) - _straight(was, was) for new, was in tracks]
    stood = planted.touching | planted.given_up
    rest = torch.ones(len(clip.skeleton.names), dtype=torch.bool)
    if ground is not None:
        rest[[k for leg in contacts.legs for k in _below(clip, leg.hip)]] = False
    numbers = {
        "first_pose_error": float((ends[0] - old_ends[0])[rest].norm(dim=-1).max()),
        "last_pose_error": float((ends[1] - old_ends[1])[rest].norm(dim=-1).max()),
        "root_drop": float(drop.max()),
        "foot_float": float(off.max().clamp_min(0.0)) if off.numel() else 0.0,
        "foot_sink": float((-off).max().clamp_min(0.0)) if off.numel() else 0.0,
        "joint_speed_ratio": _ratio(speed, old_speed),
        "joint_acceleration_ratio": _ratio(jolt, old_jolt),
        "hyperextension_deg": max((math.degrees(float(more)) for more in beyond), default=0.0),
        "given_up": float(planted.given_up.sum()) / max(1, int(stood.sum())),
    }
    where = {
        "root_drop": int(drop.argmax()),
        "joint_speed_ratio": speed.frame,
        "joint_acceleration_ratio": jolt.frame,
        "given_up": int(planted.given_up.any(dim=-1).int().argmax()),
    }
    names = clip.skeleton.names
    fastest = names[speed.joint]
    sentences = [
        _sentence(name, value, where.get(name, 0), fastest) for name, value in numbers.items() if value > BARS[name]
    ]
    return Quality(numbers, sentences)


def standing_numbers(planted: Planted, contacts: Contacts) -> dict[str, float]:
    """`slide_numbers` of a planted clip, in the contacts that it keeps."""
    return slide_numbers(planted.clip, replace(contacts, touching=planted.kept(contacts)))


def _sentence(name: str, value: float, frame: int, joint: str) -> str:
    """What a user is told of a bar that was passed."""
    times = f"{value:.1f} times"
    return {
        "first_pose_error": f"the first pose is {1000 * value:.1f} mm off the clip's.",
        "last_pose_error": f"the last pose is {1000 * value:.1f} mm off the clip's.",
        "root_drop": f"around frame {frame} the body comes down by {100 * value:.0f} cm, as its steps are too long.",
        "foot_float": f"a standing foot floats {100 * value:.1f} cm above the ground.",
        "foot_sink": f"a standing foot sinks {100 * value:.1f} cm into the ground.",
        "joint_speed_ratio": f"{joint} moves {times} as fast as anything in the clip, around frame {frame}.",
        "joint_acceleration_ratio": f"a joint is jerked {times} as hard as any in the clip, around frame {frame}.",
        "hyperextension_deg": f"a knee bends {value:.1f} degrees farther back than in the clip.",
        "given_up": (
            f"in {100 * value:.0f} % of the frames in which feet stand in the clip they had to step or leave the ground"
            f" sooner, first around frame {frame}: the way asks for longer or other steps."
        ),
    }[name]


def _over_ground(clip: Clip, contacts: Contacts, ground: Ground | None) -> tuple[Tensor, Tensor]:
    """(T, P) heights of points of the feet over the ground, and (T, P) of the ground under them in the source [m]."""
    points = contact_points(clip, contacts)
    level = contacts.at_points(contacts.level)
    if ground is None:
        return points[..., 1] - level, level
    return points[..., 1] - ground.height(points[..., [0, 2]]), level


@dataclass(frozen=True)
class _Largest:
    """The largest of some rates, its frame and its joint."""

    value: float = 0.0
    frame: int = 0
    joint: int = 0


def _rates(clip: Clip) -> list[_Largest]:
    """Largest speed [m/s] and acceleration [m/s^2] of a joint, seen from the root, over a glance."""
    apart = max(1, round(GLANCE / clip.frame_time))
    found = [_Largest(), _Largest()]
    for first in range(0, clip.frames, AT_ONCE):
        seen = _from_root(clip, slice(first, first + AT_ONCE + 2 * apart))
        for order in (0, 1):
            if len(seen) <= apart:
                break
            seen = (seen[apart:] - seen[:-apart]) / (apart * clip.frame_time)
            sizes = seen.norm(dim=-1)
            best = int(sizes.argmax())
            if float(sizes.flatten()[best]) > found[order].value:
                frame, joint = divmod(best, sizes.shape[1])
                found[order] = _Largest(float(sizes.flatten()[best]), first + frame, joint)
    return found


def _ends(clip: Clip) -> list[Tensor]:
    """(J, 3) joints of the first and the last frame, seen from the root [m]."""
    return [_from_root(clip, here)[0] for here in (slice(0, 1), slice(clip.frames - 1, clip.frames))]


def _from_root(clip: Clip, here: slice) -> Tensor:
    """(T', J, 3) joints of some frames as the root sees them [m]."""
    root, turns = clip.root_position[here].double(), clip.rotations[here].double()
    offsets = None if clip.offsets is None else clip.offsets[here]
    places = clip.skeleton.forward(root, turns, offsets)[0]
    return (places - root[:, None]) @ turns[:, 0]


def _ratio(new: _Largest, old: _Largest) -> float:
    return new.value / old.value if old.value > 1e-9 else 1.0


def _straight(track: LegTrack, source: LegTrack) -> Tensor:
    """By how much a knee is bent back beyond straight at most, about the axis that the source's is bent about [rad]."""
    thigh, shank = track.knee - track.hip, track.ankle - track.knee
    normal = torch.linalg.cross(source.knee - source.hip, source.ankle - source.knee)
    usual = functional.normalize(turned(source.upper.transpose(-1, -2), normal).sum(dim=0), dim=0)
    axis = track.upper @ usual
    sine = (torch.linalg.cross(thigh, shank) * axis).sum(-1)
    return (-torch.atan2(sine, (thigh * shank).sum(-1))).amax().clamp_min(0.0)


def _below(clip: Clip, joint: int) -> list[int]:
    """A joint and all that hangs on it."""
    found = [joint]
    for k, parent in enumerate(clip.skeleton.parents):
        if parent in found:
            found.append(k)
    return found
