"""Feet on ground that is not level: prints on treads and slopes, swings over edges, and a body that follows."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import torch
from scipy.ndimage import gaussian_filter1d
from torch import Tensor
from torch.nn import functional

from hopdiff.feet.frames import apart
from hopdiff.feet.prints import FootPrint, GroundMove
from hopdiff.feet.track import LegTrack, smooth_step, turned
from hopdiff.feet.way import smoothed, widest
from hopdiff.geometry.rotation import from_vector
from hopdiff.terrain.ground import Ground

TOES, HEEL = 0.07, 0.07  # m that a sole reaches before the ball and behind the ankle
FOOT = 0.14  # m from ankle to ball where the skeleton does not say
UNEVEN = 0.08  # m by which ground of the source must differ to be taken away
SPARE = 0.03  # m above whatever is under a foot in the air that it keeps, unless the source is lower
REACH = 0.06  # m around the points of a foot in the air that is kept clear
EDGE = 0.01  # m around them that must be
SWING = 0.1  # s in which it gets over an edge
CLEAR = 0.05  # s after a contact from which on it does
EARLY = 1.3  # times sooner than evenly that a foot rises to a higher tread, and later that it comes down to a lower one
FOLLOW = 0.15  # s over which the body follows its feet (standard deviation)


class Footing:
    """The prints of one foot on a ground.

    points: (T, P, 3) of the foot in the source [m]. floors: (P,) their heights while they stand there [m]. level: (T,)
    height of that ground [m]. prints: those given, moved onto treads. rise: (T,) by how much the foot is lifted; even:
    the same without haste over steps [m].
    """

    def __init__(
        self,
        ground: Ground,
        track: LegTrack,
        edit: GroundMove,
        prints: Sequence[FootPrint],
        points: Tensor,
        floors: Tensor,
        level: Tensor,
    ) -> None:
        # A little unevenness of the source is that of its capture.
        level = level if float(level.max()) > UNEVEN else torch.zeros_like(level)
        self.ground, self.track, self.points, self.floors, self.level = ground, track, points, floors, level
        middle = points.mean(dim=1)
        self.middle = middle
        arm = None if track.ball is None else (track.ball - track.ankle)[:, [0, 2]]
        half = 0.5 * (FOOT if arm is None else float(arm.norm(dim=-1).mean()))
        self.ahead, self.behind = half + TOES, half + HEEL
        self.prints, rises, tilts, centres = [], [], [], []
        ends = [(one.first, one.last) for one in prints]
        last = len(middle) - 1
        for one in prints:
            move = one.move.at((one.last + 1 - one.first) // 2)
            centre = move(middle[one.frames].mean(dim=0))[[0, 2]]
            along = _heading(track, one) + move.turn
            by = ground.footing(centre[None], along[None], self.ahead, self.behind)[0]
            if one.pinned and one.first <= last - one.last:
                by = torch.zeros_like(by)
            centre = centre + by
            self.prints.append(replace(one, move=one.move.shifted(by)))
            normal = ground.sole_normal(centre, along, self.ahead, self.behind)
            rises.append(ground.height(centre) - level[one.frames].mean())
            tilts.append(torch.stack((normal[2], torch.zeros_like(normal[0]), -normal[0])))
            centres.append(centre)
        own = edit(middle)[:, [0, 2]]
        # A foot that is in the air at an end of the clip is as high there as the ground below it.
        for frame in (0, last):
            if not any(one.first <= frame <= one.last for one in prints):
                place = 0 if frame == 0 else len(ends)
                here = ground.mean_height(own[frame], REACH) - level[frame]
                rises.insert(place, here)
                tilts.insert(place, torch.zeros(3, dtype=torch.float64))
                centres.insert(place, own[frame])
                ends.insert(place, (frame, frame))
        self.even = between(ends, torch.stack(rises), len(own))
        self.rise = between(ends, torch.stack(rises), len(own), EARLY) if ground.stepped else self.even
        self.tilt = between(ends, torch.stack(tilts), len(own))
        self.centre = between(ends, torch.stack(centres), len(own))

    def lifted(self, ankle: Tensor, frame: Tensor, stands: Tensor, frame_time: float) -> tuple[Tensor, Tensor, Tensor]:
        """The way of an ankle (T, 3) on level ground [m] and the turns (T, 3, 3) of its foot, on this ground; and (T,)
        how high the ankle is at least for the foot to keep off it [m]."""
        # The axis of the tilt is up x normal; its length the sine of the slope.
        sine = self.tilt.norm(dim=-1, keepdim=True).clamp(1e-12, 1.0)
        tilt = from_vector(self.tilt / sine * torch.asin(sine))
        middle = ankle + turned(frame, self.middle - self.track.ankle)
        steep = torch.tan(torch.asin(sine[:, 0])) / sine[:, 0]
        slope = torch.stack((self.tilt[:, 2], -self.tilt[:, 0]), dim=-1) * steep[:, None]
        off = middle[:, [0, 2]] - self.centre
        rise = self.rise + torch.where(stands, (slope * off).sum(-1), (slope * off.clamp(-0.1, 0.1)).sum(-1))
        up = torch.stack((torch.zeros_like(rise), rise, torch.zeros_like(rise)), dim=-1)
        # What is above a slope is square to it, so that a foot that rolls on it does not slip.
        high = middle[:, 1] - self.level
        high = torch.where(stands, high, high.clamp(-0.1, 0.1))
        square = torch.stack((torch.zeros_like(high), high, torch.zeros_like(high)), dim=-1)
        placed = middle + up + turned(tilt, ankle - middle) + turned(tilt, square) - square
        away = apart(stands) * frame_time
        frame = tilt @ frame
        # A foot in the air keeps off the ground under it and around, as far as it did in the source.
        points = placed[:, None] + (frame[:, None] @ (self.points - self.track.ankle[:, None]).unsqueeze(-1)).squeeze(
            -1
        )

        def lacks(reach: float, spare: float) -> Tensor:
            over = self.ground.height_over(points[..., [0, 2]], reach)
            high = (self.points[..., 1] - self.floors - self.level[:, None]).clamp_max(spare)
            return (over + high + self.floors - points[..., 1]).amax(dim=-1).masked_fill(stands, 0.0)

        need, least = lacks(REACH, SPARE).clamp_min(0.0), placed[:, 1] + lacks(EDGE, 0.0)
        wide = 2 * max(1, round(0.5 * SWING / frame_time)) + 1
        clear = smoothed(widest(need, wide), wide) * smooth_step(away / CLEAR)
        placed[:, 1] += clear
        return placed, frame, torch.minimum(least, placed[:, 1])


def body_rise(feet: Sequence[Footing], frame_time: float) -> Tensor:
    """(T,) by how much a body is lifted that follows the ground under its feet [m]."""
    mean = torch.stack([foot.even for foot in feet]).mean(dim=0)
    smooth = torch.from_numpy(gaussian_filter1d(mean.numpy(), FOLLOW / frame_time, mode="nearest"))
    # The first pose stays on its feet.
    times = torch.arange(len(mean), dtype=torch.float64) * frame_time
    return smooth + (mean[0] - smooth[0]) * smooth_step(1.0 - times / (3.0 * FOLLOW))


def between(plants: Sequence[tuple[int, int]], values: Tensor, frames: int, early: float = 1.0) -> Tensor:
    """(T, ...) values (K, ...) of contacts from first to last frame: the same all through one, and from one to the next
    without a corner. early: how many times sooner than evenly heights (K,) rise, and later they fall."""
    firsts, lasts = (torch.tensor(ends, dtype=torch.float64) for ends in zip(*plants, strict=True))
    times = torch.arange(frames, dtype=torch.float64)
    before = (torch.searchsorted(firsts, times, right=True) - 1).clamp_min(0)
    after = (before + 1).clamp_max(len(plants) - 1)
    gap = (firsts[after] - lasts[before]).clamp_min(1.0)
    share = ((times - lasts[before]) / gap).clamp(0.0, 1.0)
    if early > 1.0:
        share = torch.where(values[after] > values[before], early * share, 1.0 - early * (1.0 - share))
    share = torch.where(after > before, smooth_step(share), torch.zeros_like(times))
    return torch.lerp(values[before], values[after], share.reshape(-1, *[1] * (values.dim() - 1)))


def _heading(track: LegTrack, one: FootPrint) -> Tensor:
    """() where a foot points in its contact, in the source [rad]."""
    arm = track.lower[one.frames, :, 2] if track.ball is None else track.ball[one.frames] - track.ankle[one.frames]
    x, z = functional.normalize(arm[:, [0, 2]], dim=-1).mean(dim=0).unbind()
    return torch.atan2(x, z) if math.hypot(float(x), float(z)) > 0 else torch.zeros_like(x)
