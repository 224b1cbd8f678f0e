"""Foot prints: where a foot stands after the way of the body was changed, and how it gets from one to the next."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from hopdiff.editing.root_path import RootPath
from hopdiff.feet.track import smooth_step

FAR = 0.4  # m that the edit may lead a foot astray in one contact
ARM = 0.4  # m; a turn by a radian counts as so far
STEP_TIME = 0.45  # s of a step that is made where there was none
LEAST_STAND = 0.12  # s that a foot stands between two of them
# s, a frame at least, before and after a contact in which a foot moves as in it: its ends are a matter of thresholds
HOLD = 0.02
SOON = 0.3  # s: a contact that begins in half of that, or ended in it, has no time to be elsewhere
QUICK = 1.0  # m/s by which a foot gets from one print to the next at most
QUICKER = 0.6  # of its own largest speed, if that is more
SPIN = 9.0  # rad/s by which it turns on the way
RAMP = 0.8  # s at most in which a foot goes over from its own place to the place of a contact


@dataclass(frozen=True, eq=False)
class GroundMove:
    """A turn about y (...,) [rad] and then a shift (..., 2) over the ground [m]."""

    turn: Tensor
    shift: Tensor

    @classmethod
    def between(cls, before: RootPath, after: RootPath) -> GroundMove:
        """What takes every frame of a path to another one."""
        turn = after.yaw - before.yaw
        return cls(turn, after.place - _about_y(turn, before.place))

    @classmethod
    def about(cls, turn: Tensor, start: Tensor, end: Tensor) -> GroundMove:
        """The move with a turn that takes a place (2,) to another [m]."""
        return cls(turn, end - _about_y(turn, start))

    def at(self, frame: int | slice) -> GroundMove:
        """That of some frames: itself where it is the same in all."""
        return GroundMove(self.turn[frame], self.shift[frame]) if self.turn.dim() else self

    def shifted(self, by: Tensor) -> GroundMove:
        return GroundMove(self.turn, self.shift + by)

    def path(self, path: RootPath) -> RootPath:
        """A path moved."""
        return RootPath(_about_y(self.turn, path.place) + self.shift, path.yaw + self.turn)

    def back(self) -> GroundMove:
        """What takes it back."""
        return GroundMove(-self.turn, -_about_y(-self.turn, self.shift))

    def __call__(self, places: Tensor) -> Tensor:
        """Points (..., 3) moved [m]."""
        x, z = (_about_y(self.turn, places[..., [0, 2]]) + self.shift).unbind(-1)
        return torch.stack((x, places[..., 1].expand_as(x), z), dim=-1)


def _about_y(turn: Tensor, place: Tensor) -> Tensor:
    c, s = torch.cos(turn), torch.sin(turn)
    x, z = place.unbind(-1)
    return torch.stack((c * x + s * z, c * z - s * x), dim=-1)


@dataclass(frozen=True, eq=False)
class FootPrint:
    """A contact. first, last: frames. move: of the foot since the source, the same in all frames, or (T',) where a
    contact lasts from the first to the last frame of the clip. pinned: whether an end of the clip says where it is."""

    first: int
    last: int
    move: GroundMove
    pinned: bool

    @property
    def frames(self) -> slice:
        return slice(self.first, self.last + 1)


def steps_in(
    edit: GroundMove,
    foot: Tensor,
    plants: Sequence[tuple[int, int]],
    others: Tensor,
    frame_time: float,
    kept: tuple[int, int] | None = None,
) -> list[tuple[int, int]]:
    """Contacts of one foot, those taken apart by a step in which the edit leads the body too far from where it stands.

    edit, foot, plants, kept: as `foot_prints` takes them. others: (T,) bool, whether another foot stands. A step is
    made where half of the way is gone, or as near to that as another foot stands.
    """
    found = []
    head, tail = kept or (0, len(foot) - 1)
    gap, least = max(2, round(STEP_TIME / frame_time)), max(2, round(LEAST_STAND / frame_time))
    for first, last in plants:
        middle = foot[first : last + 1].mean(dim=0)
        here = edit.at(slice(first, last + 1))
        gone = (
            here(middle.expand(last + 1 - first, 3))[:, [0, 2]].diff(dim=0).norm(dim=-1) + ARM * here.turn.diff().abs()
        )
        gone = torch.cat((gone.new_zeros(1), gone.cumsum(0)))
        count = min(int(float(gone[-1]) / FAR), (last + 1 - first - least) // (gap + least))
        start = first
        for k in range(1, count + 1):
            best = first + int(torch.searchsorted(gone, gone[-1] * k / (count + 1))) - gap // 2
            low, high = start + least, last + 1 - (count - k + 1) * least - (count - k + 1) * gap
            choices = [at for at in range(low, high + 1) if bool(others[at : at + gap].all())]
            choices = [at for at in choices if head < at and at + gap <= tail]
            if not choices:
                continue
            at = min(choices, key=lambda frame: abs(frame - best))
            found.append((start, at - 1))
            start = at + gap
        found.append((start, last))
    return found


def foot_prints(
    edit: GroundMove,
    foot: Tensor,
    plants: Sequence[tuple[int, int]],
    frame_time: float,
    kept: tuple[int, int] | None = None,
) -> list[FootPrint]:
    """The prints of one foot.

    edit: of the body, in T frames. foot: (T, 3) the middle of the foot in the source [m]. plants: first and last frame
    of every contact. kept: up to which frame and from which on all stay as they are; None: the first and the last
    frame of the clip. Contacts which these belong to, or which are so near that there is no time to go over, stand
    where these say. Others stand at the mean of where the edit puts them.
    """
    moved, end = edit(foot), len(foot) - 1
    head, tail = kept or (0, end)
    found = []
    for number, (first, last) in enumerate(plants):
        before = first - (plants[number - 1][1] if number else -end)
        after = (plants[number + 1][0] if number + 1 < len(plants) else 2 * end) - last
        at_start = first - head <= 0.5 * min(SOON / frame_time, before)
        at_end = tail - last <= 0.5 * min(SOON / frame_time, after)
        # One that lies in what is kept has nothing to do with the other end.
        at_start, at_end = at_start and first < tail, at_end and last > head
        if at_start and at_end:
            # From the last frame that is kept to the next one.
            ends = max(first, head), min(last, tail)
            frames = torch.arange(first, last + 1, dtype=foot.dtype)
            share = smooth_step((frames - ends[0]) / max(ends[1] - ends[0], 1))
            start, stop = edit.at(0), edit.at(-1)
            turn = torch.lerp(start.turn, stop.turn, share)
            own = foot[first : last + 1]
            place = torch.lerp(start(own), stop(own), share[:, None])[:, [0, 2]]
            move = GroundMove(turn, place - _about_y(turn, own[:, [0, 2]]))
        elif at_start or at_end:
            move = edit.at(0 if at_start else -1)
        else:
            here = slice(first, last + 1)
            means = foot[here].mean(dim=0)[[0, 2]], moved[here].mean(dim=0)[[0, 2]]
            move = GroundMove.about(edit.turn[here].mean(), *means)
        found.append(FootPrint(first, last, move, at_start or at_end))
    return found


def unhurried(
    edit: GroundMove,
    prints: Sequence[FootPrint],
    foot: Tensor,
    others: Tensor,
    frame_time: float,
    kept: tuple[int, int] | None = None,
) -> list[FootPrint]:
    """The prints, contacts made shorter between which a foot has no time to get from one to the next, or to where it is
    in frames that are kept.

    edit, foot, kept: as `foot_prints` takes them. others: (T,) bool, whether another foot stands, without which none
    leaves.
    """
    head, tail = kept or (0, len(foot) - 1)
    found, least = list(prints), max(2, round(LEAST_STAND / frame_time))
    begin = int(not found or found[0].first > head)
    if begin:
        found.insert(0, FootPrint(head, head, edit.at(head), True))
    if found[-1].last < tail:
        found.append(FootPrint(tail, tail, edit.at(tail), True))
    if len(found) < 2:
        return list(prints)
    step = foot.diff(dim=0)[:, [0, 2]].norm(dim=-1).max()
    ends = foot[torch.tensor([[one.last for one in found[:-1]], [one.first for one in found[1:]]])]
    before, after = _ends([one.move for one in found[:-1]], -1), _ends([one.move for one in found[1:]], 0)
    shift = (after(ends) - before(ends)).norm(dim=-1).amax(0)
    fastest = torch.clamp(QUICKER * step / frame_time, min=QUICK)
    needs = torch.maximum(shift / fastest, (after.turn - before.turn).abs() / SPIN) / frame_time
    for k, need in enumerate(needs.tolist()):
        one, other = found[k], found[k + 1]
        first, last = one.last, other.first
        while last - first < need:
            sooner = first - one.first >= least and first > head + 1 and bool(others[first])
            later = other.last - last >= least and last < tail - 1 and bool(others[last])
            if sooner and (not later or first - one.first >= other.last - last):
                first -= 1
            elif later:
                last += 1
            else:
                break
        if first < one.last:
            found[k] = shortened(one, one.first, first)
        if last > other.first:
            found[k + 1] = shortened(other, last, other.last)
    # Without the ends of the clip.
    return found[begin : begin + len(prints)]


def _ends(moves: Sequence[GroundMove], frame: int) -> GroundMove:
    """Moves (K,) at the beginning or the end of their contacts."""
    single = [one.at(frame) for one in moves]
    return GroundMove(torch.stack([one.turn for one in single]), torch.stack([one.shift for one in single]))


def weights(
    prints: Sequence[FootPrint], frames: int, frame_time: float, kept: tuple[int, int] | None = None
) -> list[tuple[slice, Tensor]]:
    """For each print the frames in which it counts, and how much: 1 in its contact, less and less on the ways to and
    from it; those of two prints that share a swing sum to 1 at most. Frames up to one and from another one on (kept)
    are nobody's unless they belong to a contact; None: all may change."""
    found = []
    for number, one in enumerate(prints):
        sooner = prints[number - 1].last if number else -frames
        later = prints[number + 1].first if number + 1 < len(prints) else 2 * frames
        room_before, room_after = min(RAMP / frame_time, one.first - sooner), min(RAMP / frame_time, later - one.last)
        if kept is not None and one.first > kept[0]:
            room_before = min(room_before, one.first - kept[0])
        if kept is not None and one.last < kept[1]:
            room_after = min(room_after, kept[1] - one.last)
        here = slice(max(0, math.floor(one.first - room_before)), min(frames, math.ceil(one.last + room_after) + 1))
        times = torch.arange(here.start, here.stop, dtype=torch.float64)
        share = torch.ones_like(times)
        for off, room in ((one.first - times, room_before), (times - one.last, room_after)):
            held = min(max(HOLD / frame_time, 1.0), 0.2 * room)
            share = share * smooth_step(1.0 - (off - held).clamp_min(0.0) / max(room - 2.0 * held, 1e-9))
        found.append((here, share))
    return found


def spread(move: GroundMove, one: FootPrint, here: slice) -> GroundMove:
    """The move of a print in the frames around it."""
    if move.turn.dim() == 0:
        return move
    at = torch.arange(here.start, here.stop).clamp(one.first, one.last) - one.first
    return GroundMove(move.turn[at], move.shift[at])


def shortened(one: FootPrint, first: int, last: int) -> FootPrint:
    """The print of a contact of which only some frames are left."""
    move = one.move.at(slice(first - one.first, last + 1 - one.first))
    return replace(one, first=first, last=last, move=move)
