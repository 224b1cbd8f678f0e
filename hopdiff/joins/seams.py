"""Where a walk goes on from the clip before it, and where it goes over to the clip after it.

Frames are compared as Kovar et al. (2002) do, by their joints once one is turned about y and moved over the ground
onto the other; in place of a window of frames by where the joints are and how they move, so that the first and the last
frame of a clip, which have no whole window, can be chosen too.
"""

from __future__ import annotations

import math
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
FREE = 0.5  # s between a seam and a frame of the walk that is bound


@dataclass(frozen=True, eq=False)
class Seam:
    """frame: of the walk, that becomes the last of the clip before, or the first of the clip after. distance: root mean
    square between their joints [m], velocities included. move: takes the walk there."""

    frame: int
    distance: float
    move: GroundMove


def entry(walk: Clip, before: Clip, bound: int | None = None) -> Seam:
    """The frame of a walk that is likest to the end of another clip, near the walk's beginning.

    bound: the first frame that must not be left out. Raises HopdiffError if nothing is left before it.
    """
    last = _most(walk) if bound is None else min(_most(walk), bound - round(FREE / walk.frame_time))
    if last < 0:
        raise HopdiffError(
            f"frame {bound} is bound, which leaves no {FREE:g} s after the clip before to get there (frame"
            f" {round(FREE / walk.frame_time)} or a later one may be)."
        )
    return _likest(walk, torch.arange(last + 1), before, before.frames - 1)


def exit_(walk: Clip, after: Clip, bound: int | None = None) -> Seam:
    """The frame of a walk that is likest to the beginning of another clip, near the walk's end; see `entry`."""
    end = walk.frames - 1
    first = end - _most(walk) if bound is None else max(end - _most(walk), bound + round(FREE / walk.frame_time))
    if first > end:
        raise HopdiffError(
            f"frame {bound} is bound, which leaves no {FREE:g} s to get to the clip after (frame"
            f" {end - round(FREE / walk.frame_time)} or an earlier one may be)."
        )
    return _likest(walk, torch.arange(first, end + 1), after, 0)


def placed(clip: Clip, move: GroundMove) -> Clip:
    """A clip turned and moved over the ground as one."""
    path = root_path(clip)
    return with_root_path(clip, path, move.path(path))


def moments(clip: Clip, frames: Tensor | slice = slice(None)) -> Windows:
    """Frames of a clip as windows of `hopdiff.graph.distance`: where joints are and what they move in AHEAD."""
    places = clip.joint_positions().detach().double()
    half = max(1, round(0.5 * GLANCE / clip.frame_time))
    numbers = torch.arange(clip.frames)[frames]
    sooner, later = (numbers - half).clamp_min(0), (numbers + half).clamp_max(clip.frames - 1)
    times = (later - sooner).clamp_min(1) * clip.frame_time
    moved = AHEAD * (places[later] - places[sooner]) / times[:, None, None]
    root = math.sqrt(0.5 / places.shape[1])
    ground = as_complex(places[numbers][..., [0, 2]])
    centre = ground.mean(dim=1)
    ground = torch.cat((ground - centre[:, None], as_complex(moved[..., [0, 2]])), dim=1) * root
    return Windows(ground, torch.cat((places[numbers][..., 1], moved[..., 1]), dim=1) * root, centre)


def _most(walk: Clip) -> int:
    """Frames that may be left out."""
    return int(min(MOST_SKIPPED / walk.frame_time, SHARE * (walk.frames - 1)))


def _likest(walk: Clip, frames: Tensor, other: Clip, at: int) -> Seam:
    target, found = moments(other, torch.tensor([at])), moments(walk, frames)
    far = distances(target, found)[0]
    left_out = frames if at else walk.frames - 1 - frames
    best = int((far + SKIPPED * walk.frame_time * left_out).argmin())
    turn, shift = alignment(target, torch.tensor([0]), found, torch.tensor([best]))
    move = GroundMove(turn[0], torch.stack((shift[0].imag, shift[0].real)))
    return Seam(int(frames[best]), float(far[best]), move)
