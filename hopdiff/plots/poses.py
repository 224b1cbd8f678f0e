"""Which moments of a stride to draw, and the poses at these moments."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hopdiff.motion import Motion, Phase
from hopdiff.plots.body import Array


@dataclass(frozen=True)
class Moment:
    """A time within a stride [s]. name: what happens then, or ""; side: whose step it belongs to;
    carries: whether that side's foot is on the ground."""

    time: float
    name: str
    side: str
    carries: bool


def key_moments(motion: Motion, poses: int = 10) -> list[Moment]:
    """The key poses of a stride and even steps between them.

    Every phase is cut into an even number of equal parts, so that touchdown, mid-stance, take-off and the middle of
    the flight (apex) are always there. poses: about how many there should be.
    """
    stride = motion.phases[-1].end - motion.phases[0].start
    names = {"stance": ("touchdown", "mid-stance"), "flight": ("take-off", "apex")}
    moments = []
    for phase in motion.phases:
        parts = 2 * max(1, round((phase.end - phase.start) * poses / stride / 2))
        for part in range(parts):
            time = phase.start + (phase.end - phase.start) * part / parts
            name = names[phase.kind][0] if part == 0 else names[phase.kind][1] if 2 * part == parts else ""
            moments.append(Moment(time, name, phase.side, phase.kind == "stance" or part == 0))
    first = motion.phases[0]
    last_name = names[first.kind][0]
    return [*moments, Moment(motion.phases[-1].end, last_name, first.side, True)]


def sample(times: Array, track: Array, at: Sequence[float] | Array) -> Array:
    """A track (T, ...) at other times, linear between frames; `at` is held within the first and last frame."""
    place = np.interp(np.asarray(at, dtype=float), times, np.arange(len(times)))
    lower = np.minimum(place.astype(int), max(len(times) - 2, 0))
    share = (place - lower).reshape(-1, *(1,) * (track.ndim - 1))
    return track[lower] * (1 - share) + track[np.minimum(lower + 1, len(times) - 1)] * share


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
