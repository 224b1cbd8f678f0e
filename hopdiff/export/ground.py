"""The steady way of a body over the ground: what a root bone on the ground carries, and what in-place motion lacks."""

from __future__ import annotations

import torch
from torch import Tensor

from hopdiff.editing.root_path import RootPath, root_path
from hopdiff.export.take import Take

STRIDE = 1.0  # s over which the way is averaged where the time of a stride is not known


def ground_path(take: Take) -> RootPath:
    """Place (T, 2) [m] and yaw (T,) [rad] of a take, averaged over a stride so that sway and bounce are left out.

    Of one stride that repeats itself this is the straight way from its first frame to its last.
    """
    path = root_path(take.clip)
    stride = float(take.numbers.get("stride_time") or STRIDE)
    window = min(max(1, round(stride / take.clip.frame_time)), take.frames - 1)
    values = torch.cat((path.place, path.yaw[:, None]), dim=-1)
    if take.frames < 3:
        return path
    return _split(_averaged(values, window, take.loop))


def _averaged(values: Tensor, window: int, loop: bool) -> Tensor:
    """(T, D) the mean over a window of frames about each; the window is a number of intervals."""
    reach = window // 2 + 1
    first, last = values[:1], values[-1:]
    if loop:
        # A loop goes on as it began, from where it ends. (A turn of a closed path is in its yaw alone: its places come
        # back by themselves.)
        before, after = values[-1 - reach : -1] - last + first, values[1 : 1 + reach] - first + last
    else:
        # Mirrored through the end, so that the way ends where it ended.
        before = 2.0 * first - values[1 : 1 + reach].flip(0)
        after = 2.0 * last - values[-1 - reach : -1].flip(0)
    padded = torch.cat((before, values, after))
    # Trapezoid sums: the ends of the window count half, or share what an odd number of intervals leaves over.
    sums = torch.cat((torch.zeros_like(padded[:1]), (0.5 * (padded[1:] + padded[:-1])).cumsum(0)))
    frames = torch.arange(len(values)) + len(before)
    if window % 2 == 0:
        return (sums[frames + window // 2] - sums[frames - window // 2]) / window
    low, high = window // 2, window // 2 + 1
    wide = sums[frames + high] - sums[frames - low] + sums[frames + low] - sums[frames - high]
    return 0.5 * wide / window


def _split(values: Tensor) -> RootPath:
    return RootPath(values[:, :2], values[:, 2])
