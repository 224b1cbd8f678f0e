"""Feet that stand still again after the path of a clip was changed.

The edit moves every frame by a turn and a shift of its own, so a foot that stood still over many frames slides. For
the time of a contact one turn and shift is taken for all of its frames instead: the foot then does exactly what it did
in the source, elsewhere. Legs follow by inverse kinematics, as they were bent.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import torch
from torch import Tensor
from torch.nn import functional

from hopdiff.editing.contacts import Contacts, contact_points
from hopdiff.editing.leg_joints import Leg
from hopdiff.editing.root_path import root_path
from hopdiff.geometry.clip import Clip
from hopdiff.geometry.rotation import axis_rotation, between_directions, rotation_about

RAMP = 0.3  # s at most in which a foot goes over from its own place to the place of a contact
SETTLING = 0.3  # s in which the root is lowered and raised again
REACH = 0.995  # of the leg's length: as far as a foot is put, unless the source goes farther
ROUNDS = 3  # of inverse kinematics: the second corrects the first by next to nothing


@dataclass(frozen=True, eq=False)
class _Shift:
    """A turn about y (T,) [rad] and a shift (T, 2) over the ground [m] for every frame."""

    turn: Tensor
    shift: Tensor

    def at(self, frame: int | slice) -> _Shift:
        return _Shift(self.turn[frame], self.shift[frame])

    def __call__(self, places: Tensor) -> Tensor:
        """Points (T, 3) moved [m]."""
        turn, shift = self.turn, self.shift
        c, s = torch.cos(turn), torch.sin(turn)
        x, y, z = places.unbind(-1)
        return torch.stack((c * x + s * z + shift[..., 0], y, c * z - s * x + shift[..., 1]), dim=-1)


def clean_feet(
    source: Clip, edited: Clip, legs: Sequence[Leg], contacts: Contacts, keep: Sequence[int] = (), still: bool = False
) -> Clip:
    """The edited clip with feet that stand where the source's stand.

    edited: the source on another root path; contacts: of the source. keep: frames that must stay as they are.
    still: whether feet that slide in the source, as in a blend of two motions, are held too. Otherwise doing it again
    changes nothing, and neither does it without an edit. Where a leg is too short for a contact, the root is lowered
    for a while.
    """
    before, after = root_path(source), root_path(edited)
    turn = after.yaw - before.yaw
    c, s = torch.cos(turn), torch.sin(turn)
    x, z = before.place.unbind(-1)
    edit = _Shift(turn, after.place - torch.stack((c * x + s * z, c * z - s * x), dim=-1))
    ankles = torch.stack([_ankle(source, leg) for leg in legs], dim=1)
    points = contact_points(source, contacts)
    targets, turns = [], []
    for k in range(len(legs)):
        own = [i for i, (which, _) in enumerate(contacts.points) if which == k]
        slide = _slide(points[:, own], contacts.touching[:, own]) if still else None
        foot = points[:, own].mean(dim=1)
        place, more = _planted(edit, ankles[:, k], foot, contacts.plants(k), keep, source.frame_time, slide)
        targets.append(place)
        turns.append(more)
    height = _lowered(source, edited, legs, targets, keep)
    root = edited.root_position.clone()
    root[:, 1] = height.to(root)
    cleaned = replace(edited, root_position=root)
    rotations = cleaned.rotations.double().clone()
    for leg, target, more in zip(legs, targets, turns, strict=True):
        rotations = reached(cleaned, source, rotations, leg, target, more)
    return replace(cleaned, rotations=rotations.to(edited.rotations))


def _slide(points: Tensor, touching: Tensor) -> Tensor:
    """(T, 2) how far a foot has slid over the ground so far, by those of its points (T, P, 3) that touch it [m]."""
    both = (touching[1:] & touching[:-1]).double()
    moved = (points[:, :, [0, 2]].diff(dim=0) * both.unsqueeze(-1)).sum(dim=1) / both.sum(dim=1).clamp_min(1.0)[:, None]
    return torch.cat((torch.zeros_like(moved[:1]), moved.cumsum(dim=0)))


def _planted(
    edit: _Shift,
    ankle: Tensor,
    foot: Tensor,
    plants: list[tuple[int, int]],
    keep: Sequence[int],
    frame_time: float,
    slide: Tensor | None,
) -> tuple[Tensor, Tensor]:
    """Where the ankle (T, 3) of a leg shall be [m], and the turn of its foot from the source (T,) [rad].

    ankle, foot: (T, 3) of the source; foot: the middle of its contact points. slide: (T, 2) to be taken away.
    """
    frames = len(ankle)
    place, turn = edit(ankle), edit.turn
    moved_foot = edit(foot)
    out, more = place.clone(), turn.clone()
    for number, (first, last) in enumerate(plants):
        # The ways out of one contact and into the next may share a swing: their weights then sum to at most 1.
        sooner = plants[number - 1][1] if number else -frames
        later = plants[number + 1][0] if number + 1 < len(plants) else 2 * frames
        room_before = min(RAMP / frame_time, first - sooner)
        room_after = min(RAMP / frame_time, later - last)
        # Where the foot stands is said by frames that must stay: those of the contact, or one so near to it that there
        # is no time to go over.
        held = [k for k in keep if first <= k <= last]
        if not held and keep:
            gap, nearest = min((max(first - k, k - last), k) for k in keep)
            held = [nearest] if gap <= 0.5 * (room_before if nearest < first else room_after) else []
        if held:
            fixed = edit.at(held[0])
        else:
            mean = edit.turn[first : last + 1].mean()
            middle = foot[first : last + 1].mean(dim=0)
            c, s = torch.cos(mean), torch.sin(mean)
            turned = torch.stack((c * middle[0] + s * middle[2], c * middle[2] - s * middle[0]))
            fixed = _Shift(mean, moved_foot[first : last + 1].mean(dim=0)[[0, 2]] - turned)
        others = [k for k in keep if k not in held]
        room_before = min(room_before, *(first - k for k in others if k < first), frames)
        room_after = min(room_after, *(k - last for k in others if k > last), frames)
        here = slice(max(0, math.floor(first - room_before)), min(frames, math.ceil(last + room_after) + 1))
        times = torch.arange(here.start, here.stop, dtype=torch.float64)
        weight = _smooth(1.0 - (first - times).clamp_min(0.0) / max(room_before, 1e-9))
        weight = weight * _smooth(1.0 - (times - last).clamp_min(0.0) / max(room_after, 1e-9))
        if len(held) > 1:
            # Several frames of one contact must stay: between them the foot goes from one place to the next.
            weight = weight * _smooth(torch.stack([(times - k).abs() for k in held[1:]]).amin(0) * frame_time / RAMP)
        own = ankle[here].clone()
        if slide is not None:
            own[:, [0, 2]] -= slide[here] - (slide[held[0]] if held else slide[first : last + 1].mean(dim=0))
        out[here] += weight[:, None] * (fixed(own) - place[here])
        more[here] += weight * (fixed.turn - turn[here])
    return out, more


def _smooth(x: Tensor) -> Tensor:
    """From 0 to 1 without a corner."""
    x = x.clamp(0.0, 1.0)
    return x**2 * (3.0 - 2.0 * x)


def _ankle(clip: Clip, leg: Leg) -> Tensor:
    """(T, 3) ankle, or end of the shank [m]."""
    positions, orientations = clip.forward()
    if leg.ankle is not None:
        return positions[:, leg.ankle].double()
    end = clip.skeleton.end_sites[clip.skeleton.names[leg.knee]].to(orientations)
    return (positions[:, leg.knee] + orientations[:, leg.knee] @ end).double()


def _lowered(source: Clip, edited: Clip, legs: Sequence[Leg], targets: Sequence[Tensor], keep: Sequence[int]) -> Tensor:
    """Height of the root (T,) [m], low enough for every leg to reach its target, and changing slowly."""
    own, here = source.forward()[0].double(), edited.forward()[0].double()
    # From the height of the source, so that what was lowered before is not lowered again.
    height = source.root_position[:, 1].double()
    here[..., 1] += (height - edited.root_position[:, 1].double())[:, None]
    need = torch.zeros(len(own), dtype=torch.float64)
    for leg, target in zip(legs, targets, strict=True):
        old = (_ankle(source, leg) - own[:, leg.hip]).norm(dim=-1)
        longest = torch.maximum(old, REACH * _length(source, leg))
        gap = target - here[:, leg.hip]
        room = (longest**2 - gap[:, 0] ** 2 - gap[:, 2] ** 2).clamp_min(0.0).sqrt()
        need = torch.maximum(need, -gap[:, 1] - room)
    if float(need.max()) <= 1e-9:
        return height
    half = max(1, round(0.5 * SETTLING / edited.frame_time))
    wide = functional.max_pool1d(
        functional.pad(need[None, None], (2 * half, 2 * half), value=0.0), 4 * half + 1, stride=1
    )
    window = torch.hann_window(2 * half + 1, periodic=False, dtype=torch.float64)
    kernel = (
        (window / window.sum())[None, None] if float(window.sum()) > 0 else torch.ones(1, 1, 1, dtype=torch.float64)
    )
    padded = functional.pad(wide, (kernel.shape[-1] // 2, kernel.shape[-1] // 2), mode="replicate")
    sink = functional.conv1d(padded, kernel)[0, 0]
    times = torch.arange(len(own), dtype=torch.float64) * edited.frame_time
    for k in keep:
        sink = sink * _smooth((times - times[k]).abs() / SETTLING)
    return height - sink


def _length(clip: Clip, leg: Leg) -> Tensor:
    positions = clip.forward()[0].double()
    thigh = (positions[:, leg.knee] - positions[:, leg.hip]).norm(dim=-1)
    found: Tensor = thigh + (_ankle(clip, leg) - positions[:, leg.knee]).norm(dim=-1)
    return found


def reached(clip: Clip, source: Clip, rotations: Tensor, leg: Leg, target: Tensor, turn: Tensor) -> Tensor:
    """Rotations (T, J, 3, 3) with a leg bent and swung so that its ankle is at the target (T, 3), in the plane in
    which it is bent; its foot is that of the source turned about y (T,)."""
    skeleton = clip.skeleton
    longest = torch.maximum(
        REACH * _length(source, leg), (_ankle(source, leg) - source.forward()[0][:, leg.hip]).norm(dim=-1)
    )
    foot = axis_rotation("Y", turn) @ source.forward()[1][:, leg.ankle].double() if leg.ankle is not None else None
    for _ in range(ROUNDS):
        posed = replace(clip, rotations=rotations)
        positions, frames = (x.double() for x in posed.forward())
        hip, knee, ankle = positions[:, leg.hip], positions[:, leg.knee], _ankle(posed, leg)
        thigh, shank = (knee - hip).norm(dim=-1), (ankle - knee).norm(dim=-1)
        now, wanted = ankle - hip, target - hip
        old, new = now.norm(dim=-1), torch.minimum(wanted.norm(dim=-1), longest)
        new = torch.maximum(new, (thigh - shank).abs() * 1.01)
        axis = _bend_axis(knee - hip, now, frames[:, leg.hip])
        at_hip, at_ankle = (
            _angle(side, other, old) - _angle(side, other, new) for side, other in ((thigh, shank), (shank, thigh))
        )
        swing = between_directions(now, wanted)
        upper = swing @ rotation_about(axis, at_hip) @ frames[:, leg.hip]
        lower = swing @ rotation_about(axis, -at_ankle) @ frames[:, leg.knee]
        above = frames[:, skeleton.parents[leg.hip]] if skeleton.parents[leg.hip] >= 0 else torch.eye(3).double()
        rotations = rotations.clone()
        rotations[:, leg.hip] = above.transpose(-1, -2) @ upper
        between = _chain(rotations, skeleton.parents, leg.knee, leg.hip)
        rotations[:, leg.knee] = (upper @ between).transpose(-1, -2) @ lower
        if foot is not None and leg.ankle is not None:
            between = _chain(rotations, skeleton.parents, leg.ankle, leg.knee)
            rotations[:, leg.ankle] = (lower @ between).transpose(-1, -2) @ foot
    return rotations


def _chain(rotations: Tensor, parents: tuple[int, ...], joint: int, ancestor: int) -> Tensor:
    """(T, 3, 3) rotation of the joints between a joint and an ancestor, both left out."""
    found = torch.eye(3, dtype=rotations.dtype).expand(len(rotations), 3, 3)
    while (joint := parents[joint]) != ancestor:
        found = rotations[:, joint] @ found
    return found


def _angle(side: Tensor, other: Tensor, across: Tensor) -> Tensor:
    """(T,) angle of a triangle between a side and the line across from hip to ankle [rad]."""
    cosine = (side**2 + across**2 - other**2) / (2.0 * side * across)
    return torch.acos(cosine.clamp(-1.0, 1.0))


def _bend_axis(thigh: Tensor, line: Tensor, frame: Tensor) -> Tensor:
    """(T, 3) unit normal of the plane in which a leg is bent; where it is straight, that of the other frames in the
    thigh's own axes."""
    normal = torch.linalg.cross(thigh, line)
    local = (frame.transpose(-1, -2) @ normal.unsqueeze(-1)).squeeze(-1)
    usual = functional.normalize(local.sum(dim=0), dim=0)
    spare = (frame @ usual) * (0.01 * thigh.norm(dim=-1) * line.norm(dim=-1))[:, None]
    straight = functional.normalize(line, dim=-1)
    spare = spare - (spare * straight).sum(-1, keepdim=True) * straight
    weak = normal.norm(dim=-1, keepdim=True) < spare.norm(dim=-1, keepdim=True)
    return functional.normalize(torch.where(weak, spare, normal), dim=-1)
