"""Which moments of a stride to draw, and the poses at these moments."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hopdiff.motion import Motion, Phase
from hopdiff.plots.view import Array


@dataclass(frozen=True)
class Moment:
    """A time within a stride [s]. name: what happens then; side: whose step it belongs to;
    carries: whether that side's foot is on the ground."""

    time: float
    name: str
    side: str
    carries: bool


_NAMES = {"stance": ("touchdown", "mid-stance", "late stance"), "flight": ("take-off", "apex", "late flight")}


def key_moments(motion: Motion) -> list[Moment]:
    """Ten poses of a stride, five a step: start and middle of stance and flight, and one late in the longer of them.

    The end of the stride is not among them: it looks like its start.
    """
    moments = []
    for step in steps(motion):
        longer = max(step, key=lambda phase: phase.end - phase.start)
        for phase in step:
            shares = (0.0, 0.5, 0.75) if phase is longer else (0.0, 0.5)
            for share, name in zip(shares, _NAMES[phase.kind], strict=False):
                time = phase.start + share * (phase.end - phase.start)
                moments.append(Moment(time, name, phase.side, phase.kind == "stance" or share == 0.0))
    return moments


def steps(motion: Motion) -> list[tuple[Phase, ...]]:
    """The phases by step: a stance and the flight after it."""
    return [motion.phases[start : start + 2] for start in range(0, len(motion.phases), 2)]


def sample(times: Array, track: Array, at: Sequence[float] | Array) -> Array:
    """A track (T, ...) at other times, linear between frames; `at` is held within the first and last frame."""
    place = np.interp(np.asarray(at, dtype=float), times, np.arange(len(times)))
    lower = np.minimum(place.astype(int), max(len(times) - 2, 0))
    share = (place - lower).reshape(-1, *(1,) * (track.ndim - 1))
    found: Array = track[lower] * (1 - share) + track[np.minimum(lower + 1, len(times) - 1)] * share
    return found


def contact_points(motion: Motion) -> list[tuple[Phase, Array]]:
    """Where each stance foot stands on average: (phase, (3,) [m]); stances without a frame in contact are left out."""
    times = motion.times.detach().cpu().double().numpy()
    feet = motion.feet.detach().cpu().double().numpy()
    contact = motion.contact.detach().cpu().numpy().astype(bool)
    found = []
    for phase in motion.phases:
        column = 0 if phase.side == "left" else 1
        frames = contact[:, column] & (times >= phase.start - 1e-9) & (times <= phase.end + 1e-9)
        if phase.kind == "stance" and frames.any():
            found.append((phase, feet[frames, column].mean(axis=0)))
    return found
