"""Numbers of a foot in the air made smooth over time, while those of its contacts stay as they are."""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.linalg import solveh_banded
from scipy.ndimage import uniform_filter1d
from torch import Tensor
from torch.nn import functional

from hopdiff.feet.frames import apart

ORDER = 3  # of the differences that are made small: jerk
BANDS = np.convolve([1.0, -1.0], np.convolve([1.0, -1.0], [1.0, -1.0]))  # of a third difference

WIDE, WIDER, ROUNDS = 0.04, 1.5, 4  # s round what is rough that is made smooth at first, times more each round
HOLDS, FIRM, EXACT = 8, 10.0, 1e-3  # times that something is held up, how firmly, and by how much it may be lower
GLANCE = 1.0 / 30.0  # s over which differences are taken, so that the noise of fast cameras does not hide them

Floats = NDArray[np.float64]


def jerk(values: Tensor, frame_time: float) -> Tensor:
    """(T, 2) largest third difference of numbers (T, K) that a frame has a part in, over a frame and over a glance [per
    s³]."""
    values = values.reshape(len(values), -1)
    found = []
    for step in (1, max(1, round(GLANCE / frame_time))):
        if len(values) <= ORDER * step:
            found.append(values.new_zeros(len(values)))
            continue
        third = values if step == 1 else averaged(values, step)
        for _ in range(ORDER):
            third = third[step:] - third[:-step]
        size = third.norm(dim=-1) / (step * frame_time) ** ORDER
        size = functional.pad(size, (ORDER * step, ORDER * step))
        found.append(functional.max_pool1d(size[None], ORDER * step + 1, stride=1)[0])
    return torch.stack(found, dim=-1)


def averaged(values: Tensor, wide: int) -> Tensor:
    """(T, K) means over a window of so many frames."""
    return torch.from_numpy(uniform_filter1d(values.numpy(), wide, axis=0, mode="nearest"))


def calmed(
    values: Tensor,
    base: Tensor,
    fixed: Tensor,
    stiff: Tensor,
    most: Tensor,
    frame_time: float,
    least: Tensor | None = None,
) -> Tensor:
    """Numbers (T, K) whose difference from base (T, K) is made even where their jerk is above most (2,), that over a
    frame and over a glance; elsewhere they stay as they are. fixed: (T,) bool, frames that stay in any case. stiff:
    (T,) how dear it is that others do not, against jerks. least: (T, K) that they do not get below."""
    wide, found = WIDE / frame_time, values
    rough = torch.zeros_like(fixed)
    for _ in range(ROUNDS):
        bad = (jerk(found, frame_time) > most).any(dim=-1) & ~fixed
        if not bool(bad.any()):
            break
        rough = rough | (apart(bad) <= wide)
        weight = 1.0 + stiff * wide ** (2 * ORDER)
        found = base + smoothest(values - base, fixed | ~rough, wide, weight)
        if least is not None:
            found = _above(values, base, fixed | ~rough, wide, weight, least, found)
        wide *= WIDER
    return found


def _above(
    values: Tensor, base: Tensor, fixed: Tensor, wide: float, weight: Tensor, least: Tensor, found: Tensor
) -> Tensor:
    """The same, held up where they would get below something: first where they would the most."""
    wanted = values - base
    for _ in range(HOLDS):
        below = (least - found).masked_fill(fixed[:, None], 0.0)
        if float(below.max()) < EXACT:
            break
        held = below > torch.clamp(0.5 * below.max(), min=EXACT)
        wanted = torch.where(held, least - base, wanted)
        weight = torch.where(held.any(dim=-1), FIRM * wide ** (2 * ORDER), weight)
        found = base + smoothest(wanted, fixed, wide, weight)
    return torch.where(fixed[:, None], found, torch.maximum(found, least))


def smoothest(wanted: Tensor, fixed: Tensor, wide: float, weight: Tensor | None = None) -> Tensor:
    """(T, ...) numbers near those wanted (T, ...), and as smooth as can be: the least sum of squares of what they are
    off and of their third differences over a time of wide frames (Whittaker 1923). fixed: (T,) bool, where they are
    those wanted. weight: (T,) of what they are off, 1 if None.
    """
    count = len(wanted)
    if count <= ORDER or bool(fixed.all()):
        return wanted
    flat = wanted.reshape(count, -1).numpy()
    firm = fixed.numpy()
    near = np.ones(count) if weight is None else weight.numpy()
    bands = wide ** (2 * ORDER) * _squared(count)
    bands[0] += near
    right = near[:, None] * flat
    # What is fixed goes to the right-hand side.
    held = np.where(firm[:, None], flat, 0.0)
    right -= _times(bands, held)
    right[firm] = flat[firm]
    for k in range(1, ORDER + 1):
        bands[k, :-k][firm[:-k] | firm[k:]] = 0.0
    bands[0, firm] = 1.0
    found: Floats = solveh_banded(bands, right, lower=True, check_finite=False)
    return torch.from_numpy(found.reshape(wanted.shape))


def _squared(count: int) -> Floats:
    """(4, T) the diagonal and the three below it of transposed third differences times third differences."""
    bands = np.zeros((ORDER + 1, count))
    for k in range(ORDER + 1):
        for j in range(ORDER + 1 - k):
            bands[k, j : count - ORDER + j] += BANDS[j] * BANDS[j + k]
    return bands


def _times(bands: Floats, values: Floats) -> Floats:
    """A symmetric banded matrix times values (T, K)."""
    found: Floats = bands[0][:, None] * values
    for k in range(1, len(bands)):
        found[k:] += bands[k, :-k, None] * values[:-k]
        found[:-k] += bands[k, :-k, None] * values[k:]
    return found
