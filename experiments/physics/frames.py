"""Differences between frames, stretches of frames, and which frames lie far enough from touchdown and take-off."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from experiments.physics.recording import Array

Mask = NDArray[np.bool_]
REACH = 2  # frames on either side that a difference looks at

# Weights of the fourth-order first difference at each of five frames in a row, times 12.
FIRST = np.array(
    (
        (-25.0, 48.0, -36.0, 16.0, -3.0),
        (-3.0, -10.0, 18.0, -6.0, 1.0),
        (1.0, -8.0, 0.0, 8.0, -1.0),
        (-1.0, 6.0, -18.0, 10.0, 3.0),
        (3.0, -16.0, 36.0, -48.0, 25.0),
    )
)
SECOND = (-1.0, 16.0, -30.0, 16.0, -1.0)


def widened(values: Array, count: int, loop: bool, travel: Array | float) -> Array:
    """Values (T, ...) with `count` frames more on either side: of the strides before and after, or NaN.

    travel: by how much the values of the next stride differ. The last frame of a loop is the first of the next stride.
    """
    if loop:
        return np.concatenate((values[-1 - count : -1] - travel, values, values[1 : 1 + count] + travel))
    nothing = np.full((count, *values.shape[1:]), np.nan)
    return np.concatenate((nothing, values, nothing))


def rate(values: Array, step: float, loop: bool, travel: Array | float = 0.0) -> Array:
    """(T, ...) central first difference of fourth order; NaN at the ends of what is no loop."""
    return _central(values, FIRST[REACH], loop, travel) / (12.0 * step)


def acceleration(values: Array, step: float, loop: bool, travel: Array | float = 0.0) -> Array:
    """(T, ...) central second difference of fourth order; NaN at the ends of what is no loop."""
    return _central(values, SECOND, loop, travel) / (12.0 * step**2)


def _central(values: Array, weights: Array | tuple[float, ...], loop: bool, travel: Array | float) -> Array:
    wide = widened(values, REACH, loop, travel)
    return np.sum([weight * wide[i : i + len(values)] for i, weight in enumerate(weights)], axis=0)


def rate_inside(values: Array, step: float) -> Array:
    """(N, ...) first difference of fourth order that looks at these frames only, one-sided at their ends."""
    if len(values) < len(FIRST):
        return np.gradient(values, step, axis=0) if len(values) > 1 else np.zeros_like(values)
    first = np.clip(np.arange(len(values)) - REACH, 0, len(values) - len(FIRST))
    weights = FIRST[np.arange(len(values)) - first]
    near = values[first[:, None] + np.arange(len(FIRST))]
    return np.einsum("nk,nk...->n...", weights, near) / (12.0 * step)


def turning(turns: Array, rates: Array) -> Array:
    """Angular velocity in the world (..., 3) [rad/s] of rotations (..., 3, 3) with rates of the same shape."""
    spin = np.einsum("...ij,...kj->...ik", rates, turns)
    spin = 0.5 * (spin - np.swapaxes(spin, -1, -2))
    return np.stack((spin[..., 2, 1], spin[..., 0, 2], spin[..., 1, 0]), axis=-1)


def counted(frames: int, loop: bool) -> Mask:
    """(T,) every frame of a stride once: not the last of a loop, which is its first again."""
    mask = np.ones(frames, dtype=bool)
    mask[-1] = not loop
    return mask


def switches(contact: Mask) -> NDArray[np.intp]:
    """Frames after which a foot touches down or takes off. contact: (T, 2), of a loop the same at both ends."""
    return np.flatnonzero((contact[1:] != contact[:-1]).any(axis=1))


def steady(contact: Mask, margin: int, loop: bool) -> Mask:
    """(T,) counted frames with no switch of contact (T, 2) among the `margin` frames before and after."""
    frames = len(contact)
    mask = counted(frames, loop)
    for switch in switches(contact):
        near = np.arange(switch - margin + 1, switch + margin + 1)
        mask[near % (frames - 1) if loop else near[(near >= 0) & (near < frames)]] = False
    if not loop:
        ends = max(margin, 2 * REACH)  # the rate of a momentum takes two differences
        mask[:ends] = mask[frames - ends :] = False
    return mask


def stretches(mask: Mask, loop: bool) -> list[NDArray[np.intp]]:
    """Frames in a row for which a mask (T,) holds; of a loop, frames below 0 belong to the stride before.

    The last frame of a loop is left out.
    """
    inside = mask & counted(len(mask), loop)
    edges = np.flatnonzero(np.diff(np.concatenate(([False], inside, [False])).astype(int)))
    found = [np.arange(first, end) for first, end in edges.reshape(-1, 2)]
    period = len(mask) - 1
    if loop and len(found) > 1 and inside[0] and inside[period - 1]:
        last = found.pop()
        found[0] = np.concatenate((last - period, found[0]))
    return found


def at(values: Array, frames: NDArray[np.intp], loop: bool, travel: Array | float = 0.0) -> Array:
    """Values (N, ...) at frames that may lie in the stride before."""
    if not loop:
        return values[frames]
    strides, within = np.divmod(frames, len(values) - 1)
    shift = strides.reshape(-1, *[1] * (values.ndim - 1)) * travel
    return values[within] + shift
