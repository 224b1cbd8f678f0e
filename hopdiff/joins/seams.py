"""Where a walk goes on from the clip before it, and where it goes over to the clip after it.

Frames are compared as Kovar et al. (2002) do, by their joints once one is turned about y and moved over the ground
onto the other; in place of a window of frames by where the joints are and how they move, so that the first and the last
frame of a clip, which have no whole window, can be chosen too.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from hopdiff.editing.root_path import root_path, with_root_path
from hopdiff.feet.prints import GroundMove
from hopdiff.geometry.clip import Clip
from hopdiff.graph.distance import Windows, alignment, as_complex, distances
from hopdiff.types import HopdiffError

AHEAD = 0.15  # s that a joint's velocity counts for
GLANCE = 1.0 / 30.0  # s over which it is taken
SKIPPED = 0.02  # m that a second of the walk that is left out counts as
MOST_SKIPPED, SHARE = 1.5, 1.0 / 3.0  # s, and of the walk, that are left out at an end at most
ASTRAY = 0.3  # m that a walk counts as that must be bent by as much as it is long
ARM = 0.5  # m; a turn by a radian counts as so far
FREE = 0.5  # s between a seam and a frame of the walk that is bound


@dataclass(frozen=True, eq=False)
class Seam:
    """frame: of the walk, that becomes the last of the clip before, or the first of the clip after. distance: root mean
    square between their joints [m], velocities included. move: takes the walk there."""

    frame: int
    distance: float
    move: GroundMove


def seams(
    walk: Clip, before: Clip | None, after: Clip | None, bound: Sequence[int] = ()
) -> tuple[Seam | None, Seam | None]:
    """The frame of a walk near its beginning that is likest to the end of the clip before, and the one near its end
    that is likest to the beginning of the clip after; None where there is no such clip.

    Of those that are about as like, the two between which the walk goes about as far, and to the same side, as it
    shall. bound: frames of the walk that must not be left out, nor lie near a seam. Raises HopdiffError, naming the
    frame, if one does.
    """
    most, room, end = _most(walk), round(FREE / walk.frame_time), walk.frames - 1
    first = last = None
    if before is not None:
        high = min([most, *(frame - room for frame in bound)])
        if high < 0:
            raise HopdiffError(_too_near(min(bound), "before", f"{room} or a later"))
        first = _Choices(walk, before, torch.arange(high + 1), at_end=True)
    if after is not None:
        low = max([end - most, *(frame + room for frame in bound)])
        if low > end:
            raise HopdiffError(_too_near(max(bound), "after", f"{end - room} or an earlier"))
        last = _Choices(walk, after, torch.arange(low, end + 1), at_end=False)
    if first is None or last is None:
        begin, stop = (None if one is None else one.seam(int(one.cost.argmin())) for one in (first, last))
        return begin, stop
    cost = first.cost[:, None] + last.cost
    if not bound:
        cost = cost + ASTRAY * _astray(walk, first, last)
    best = int(cost.argmin())
    return first.seam(best // len(last.cost)), last.seam(best % len(last.cost))


def _too_near(frame: int, which: str, may: str) -> str:
    return (
        f"frame {frame} is bound, which leaves no {FREE:g} s between it and the clip {which}: frame {may} one may be."
    )


class _Choices:
    """Frames (K,) of a walk that may become the end of a clip before it (at_end) or the beginning of one after.

    far: (K,) distances [m]. cost: (K,) the same with what is left out. turn (K,), shift (K,) complex: see `alignment`.
    """

    def __init__(self, walk: Clip, other: Clip, frames: Tensor, at_end: bool) -> None:
        target = moments(other, torch.tensor([other.frames - 1 if at_end else 0]))
        own = moments(walk, frames)
        self.frames, self.far = frames, distances(target, own)[0]
        left_out = frames if at_end else walk.frames - 1 - frames
        self.cost = self.far + SKIPPED * walk.frame_time * left_out
        self.turn, self.shift = alignment(target, torch.zeros_like(frames), own, torch.arange(len(frames)))

    def there(self, walk: Clip) -> Tensor:
        """(K,) complex: where the walk's root is at these frames, once it is laid there [m]."""
        root = as_complex(walk.root_position.double()[self.frames][:, [0, 2]])
        return torch.polar(torch.ones_like(self.turn), self.turn) * root + self.shift

    def seam(self, k: int) -> Seam:
        move = GroundMove(self.turn[k], torch.stack((self.shift[k].imag, self.shift[k].real)))
        return Seam(int(self.frames[k]), float(self.far[k]), move)


def _astray(walk: Clip, first: _Choices, last: _Choices) -> Tensor:
    """(K, L) how far the walk between two frames, laid to the clip before, would end from where it shall and how far
    turned, as a share of its way there."""
    root = as_complex(walk.root_position.double()[:, [0, 2]])
    way = torch.cat((torch.zeros(1, dtype=torch.float64), root.diff().abs().cumsum(0)))
    turn = torch.polar(torch.ones_like(first.turn), first.turn)[:, None]
    end = turn * root[last.frames] + first.shift[:, None]
    turned = torch.remainder(last.turn - first.turn[:, None] + math.pi, math.tau) - math.pi
    off = (last.there(walk) - end).abs() + ARM * turned.abs()
    found: Tensor = off / (way[last.frames] - way[first.frames][:, None]).clamp_min(ARM)
    return found


def placed(clip: Clip, move: GroundMove) -> Clip:
    """A clip turned and moved over the ground as one."""
    path = root_path(clip)
    return with_root_path(clip, path, move.path(path))


def moments(clip: Clip, frames: Tensor | slice = slice(None)) -> Windows:
    """Frames of a clip as windows of `hopdiff.graph.distance`: where joints are and what they move in AHEAD."""
    places = clip.joint_positions().detach().double()
    half = max(1, round(0.5 * GLANCE / clip.frame_time))
    numbers = torch.arange(clip.frames)[frames]
    moved = AHEAD * _speeds(places, half)[numbers] / clip.frame_time
    root = math.sqrt(0.5 / places.shape[1])
    ground = as_complex(places[numbers][..., [0, 2]])
    centre = ground.mean(dim=1)
    ground = torch.cat((ground - centre[:, None], as_complex(moved[..., [0, 2]])), dim=1) * root
    return Windows(ground, torch.cat((places[numbers][..., 1], moved[..., 1]), dim=1) * root, centre)


def _speeds(places: Tensor, half: int) -> Tensor:
    """(T, ...) changes of places (T, ...) in a frame, taken half a glance to either side; at the ends to one side, by
    the parabola through three places."""
    half = min(half, (len(places) - 1) // 2)
    if half < 1:
        return places.diff(dim=0).mean(dim=0, keepdim=True).expand_as(places) if len(places) > 1 else 0.0 * places
    middle = (places[2 * half :] - places[: -2 * half]) / (2.0 * half)
    first, last = (
        (4.0 * one[half : 2 * half] - 3.0 * one[:half] - one[2 * half : 3 * half]) / (2.0 * half)
        if len(one) >= 3 * half
        else middle[:1].expand(half, *one.shape[1:])
        for one in (places, places.flip(0))
    )
    return torch.cat((first, middle, -last.flip(0)))


def _most(walk: Clip) -> int:
    """Frames that may be left out."""
    return int(min(MOST_SKIPPED / walk.frame_time, SHARE * (walk.frames - 1)))
