"""One motion of three: a clip, a walk that was edited to begin where that ends, and a clip that begins where it
ends."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from hopdiff.editing.leg_joints import Leg
from hopdiff.editing.root_path import root_path, with_root_path
from hopdiff.feet.contacts import Contacts, contact_points, find_contacts, spans
from hopdiff.feet.planting import Planted, clean_feet
from hopdiff.feet.prints import GroundMove
from hopdiff.geometry.clip import Clip
from hopdiff.joins.blend import blend_time, blended, reversed_clip

GAP, SHORTEST = 0.1, 0.15  # s of a contact that is interrupted, and of one, at least
SLOW = 0.3  # m/s that a blend may move a foot for it to stand
LEVEL = 0.02  # m by which a blend may lift a foot or press it down for it to stand as in the walk


@dataclass(frozen=True, eq=False)
class Joined:
    """clip: before, walk and after, edited, feet as blends leave them. source: the same as if the walk were not edited.

    contacts: of all of it, None without legs. head: the last frame of the clip before; tail: the first of the clip
    after; 0 and the last frame if there is none. blends: (T,) bool, where poses are mixed.
    """

    clip: Clip
    source: Clip
    contacts: Contacts | None
    head: int
    tail: int
    blends: Tensor

    @property
    def kept(self) -> tuple[int, int]:
        return self.head, self.tail

    def planted(self, everywhere: bool = False, by: str = "fast") -> Planted | None:
        """With feet that stand still, None without legs; frames up to head and from tail on are what they were.

        everywhere: whether slides of the walk itself are held, too, and not only those of blends. by: see `clean_feet`.
        """
        if self.contacts is None:
            return None
        still = self.blends.clone()
        if everywhere:
            still[self.head + 1 : self.tail] = True
        return clean_feet(self.source, self.clip, self.contacts, still=still, kept=self.kept, by=by)


def joined(
    source: Clip,
    walk: Clip,
    before: Clip | None,
    after: Clip | None,
    legs: Sequence[Leg] = (),
    contacts: Contacts | None = None,
) -> Joined:
    """Clips put together, of one skeleton and frame time.

    source: the walk before it was edited. walk: on a path that begins about where before ends and ends about where
    after begins; its first and its last frame are theirs then, and come once. contacts: of the source.
    """
    edit = GroundMove.between(root_path(source), root_path(walk))
    mixed, frames = walk, torch.zeros(walk.frames, dtype=torch.bool)
    stands = None if contacts is None else contacts.standing()
    others = [None if contacts is None or one is None else find_contacts(one, contacts.legs) for one in (before, after)]
    stood = [None if one is None else one.standing() for one in others]
    if before is not None:
        seconds = blend_time(walk, before, 0)
        mixed = blended(mixed, before, seconds, legs, stands, None if stood[0] is None else stood[0][-1])
        frames[: round(seconds / walk.frame_time) + 1] = True
    if after is not None:
        seconds = blend_time(walk, after, -1)
        back = None if stands is None else stands.flip(0)
        mixed = blended(
            reversed_clip(mixed), reversed_clip(after), seconds, legs, back, None if stood[1] is None else stood[1][0]
        )
        mixed = reversed_clip(mixed)
        frames[-round(seconds / walk.frame_time) - 1 :] = True
    first, stop = int(before is not None), walk.frames - int(after is not None)
    parts = [one for one in (before, mixed.part(slice(first, stop)), after) if one is not None]
    clip = _together(parts)
    count, rest = 0 if before is None else before.frames, 0 if after is None else after.frames
    at = torch.cat((torch.zeros(count, dtype=torch.long), torch.arange(first, stop)))
    at = torch.cat((at, torch.full((rest,), walk.frames - 1)))
    path = root_path(clip)
    whole = with_root_path(clip, path, GroundMove(edit.turn[at], edit.shift[at]).back().path(path))
    made = None if contacts is None else _contacts(contacts, mixed, walk, slice(first, stop), *others)
    head, tail = max(0, count - 1), clip.frames - max(1, rest)
    blends = frames[at]
    blends[:count], blends[clip.frames - rest :] = False, False
    return Joined(clip, whole, made, head, tail, blends)


def _together(clips: Sequence[Clip]) -> Clip:
    offsets = None if clips[0].offsets is None else torch.cat([one.offsets for one in clips if one.offsets is not None])
    root = torch.cat([one.root_position.double() for one in clips])
    return replace(
        clips[0], root_position=root, rotations=torch.cat([one.rotations.double() for one in clips]), offsets=offsets
    )


def _contacts(
    own: Contacts, mixed: Clip, walk: Clip, here: slice, before: Contacts | None, after: Contacts | None
) -> Contacts:
    """Contacts of the whole: of each clip its own, but for feet that a blend keeps off the ground or moves."""
    points = contact_points(mixed, own)
    off = points - contact_points(walk, own)
    moved = torch.gradient(off[..., [0, 2]], spacing=walk.frame_time, dim=0)[0].norm(dim=-1)
    stays = own.touching & (off[..., 1].abs() < LEVEL)
    slow = moved < SLOW
    for k, column in enumerate(stays.unbind(-1)):
        for first, last in list(spans(column)):
            # One that goes on from the clip before, or into the one after, is held there, however far a blend is off.
            joined_on = first == 0 and before is not None and bool(before.touching[-1, k])
            joined_on |= last == len(column) - 1 and after is not None and bool(after.touching[0, k])
            if not joined_on:
                column[first : last + 1] &= slow[first : last + 1, k]
    parts, levels = [stays[here]], [own.level[here]]
    for place, found in ((0, before), (2, after)):
        if found is not None:
            parts.insert(place, found.touching)
            levels.insert(place, found.level)
    first = 0 if before is None else len(before.touching)
    free = slice(first, first + here.stop - here.start)
    touching = torch.stack([_whole(one, free, walk.frame_time) for one in torch.cat(parts).unbind(-1)], dim=-1)
    return replace(own, touching=touching, level=torch.cat(levels))


def _whole(touching: Tensor, free: slice, frame_time: float) -> Tensor:
    """(T,) without the scraps of contacts that blends leave. free: the frames of the walk."""
    found = touching.clone()
    for first, last in spans(~touching):
        inside = first > 0 and last < len(touching) - 1 and first < free.stop and last >= free.start
        if inside and (last - first + 1) * frame_time < GAP:
            found[first : last + 1] = True
    for first, last in list(spans(found)):
        if first >= free.start and last < free.stop and (last - first + 1) * frame_time < SHORTEST:
            found[first : last + 1] = False
    return found
