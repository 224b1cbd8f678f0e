"""The steady way of a body over the ground: what a root bone on the ground carries, and what in-place motion lacks."""

from __future__ import annotations

import math
from dataclasses import replace

import torch
from torch import Tensor

from hopdiff.editing.root_path import RootPath, root_path
from hopdiff.export.take import Take

FACING = math.radians(15.0)  # between facing and way up to which a body counts as facing its way
SLOW = 0.2  # m/s below which a way has no direction
TURNED = math.radians(0.5)  # by which a loop's heading changes if it turns
STRIDE = 1.0  # s over which the way is averaged where the time of a stride is not known


def ground_path(take: Take) -> RootPath:
    """Place (T, 2) [m] and yaw (T,) [rad] of a take, averaged over a stride so that sway and bounce are left out.

    Of one stride that repeats itself this is the straight way from its first frame to its last, or the arc if each
    repetition is turned. A body that goes about
    where it faces heads along its way.
    """
    path = root_path(take.clip)
    stride = _stride(take)
    window = min(max(1, round(stride / take.clip.frame_time)), take.frames - 1)
    values = torch.cat((path.place, path.yaw[:, None]), dim=-1)
    if take.frames < 3:
        return path
    if take.loop and (window == take.frames - 1 or "turn" in take.numbers) and _turns(path):
        return _headed(_on_arc(path, _radius(take)), take.clip.frame_time)
    return _headed(_split(_averaged(values, window, take.loop)), take.clip.frame_time)


def _turns(path: RootPath) -> bool:
    """Whether a path ends with another heading than it begins with."""
    return abs(math.sin(0.5 * float(path.yaw[-1] - path.yaw[0]))) > 0.5 * TURNED


def _radius(take: Take) -> float | None:
    """Of the arc on which the feet of a take tread, where it is known [m]."""
    speed, turn = (take.numbers.get(name) for name in ("speed", "turn"))
    if not (isinstance(speed, int | float) and isinstance(turn, int | float)) or turn == 0.0:
        return None
    return abs(speed / math.radians(turn))


def _on_arc(path: RootPath, radius: float | None) -> RootPath:
    """The steady way of a loop that turns: round the point about which each repetition is turned from the last one.

    radius: of the way; that of the root if not given, which leans into the turn.
    """
    turn = path.yaw[-1] - path.yaw[0]
    once = _about(turn)
    centre = torch.linalg.solve(torch.eye(2).double() - once, path.place[-1] - once @ path.place[0])
    done = torch.linspace(0.0, 1.0, path.frames, dtype=torch.float64) * turn
    # Seen from a frame that turns along the body is in one place, but for sway.
    seen = (_about(-done) @ (path.place - centre).unsqueeze(-1)).squeeze(-1)[:-1].mean(dim=0)
    if radius is not None:
        seen = radius * seen / seen.norm()
    place = centre + (_about(done) @ seen.unsqueeze(-1)).squeeze(-1)
    return RootPath(place, done + (path.yaw - done)[:-1].mean())


def _about(yaw: Tensor) -> Tensor:
    """(..., 2, 2) what turns x and z by a yaw, from +z towards +x."""
    c, s = torch.cos(yaw), torch.sin(yaw)
    return torch.stack((torch.stack((c, s), dim=-1), torch.stack((-s, c), dim=-1)), dim=-2)


def _stride(take: Take) -> float:
    """Seconds of a stride, two steps."""
    known = take.numbers.get("stride_time")
    if isinstance(known, int | float) and known > 0.0:
        return float(known)
    # A short loop is one.
    return take.clip.duration if take.loop and take.clip.duration < 2.0 * STRIDE else STRIDE


def _headed(path: RootPath, frame_time: float) -> RootPath:
    """The path with its yaw turned so that it is, on the whole, that of the way, if the two differ little."""
    moved = path.place.diff(dim=0)
    way = moved.norm(dim=-1)
    if float(way.mean()) < SLOW * frame_time:
        return path
    off = 0.5 * (path.yaw[1:] + path.yaw[:-1]) - torch.atan2(moved[:, 0], moved[:, 1])
    aside = torch.atan2((way * torch.sin(off)).sum(), (way * torch.cos(off)).sum())
    return replace(path, yaw=path.yaw - aside) if abs(float(aside)) < FACING else path


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
