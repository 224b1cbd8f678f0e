"""Is a joined motion smooth at its seams, and does it stand? Read from the files alone, as no code of hopdiff does."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from experiments.bvh_reading import Body, Floats, body
from experiments.joins.cases import Case

ACCELERATION, SPEED = 1.2, 1.2  # times the largest in the three clips
SKATE = 0.03  # m/s more than in the clips
SUNK = 0.02  # m that a foot is lower than in any of the clips
ZONE = 1.2  # s of the walk at a seam that are looked at
HIGH = 0.025  # m above the floor at which a sliding foot no longer counts


@dataclass(frozen=True)
class Verdict:
    """exact: whether the frames of the clips before and after are theirs, number for number. acceleration, speed:
    largest at the seams against that of the three clips. skate: mean speed of the feet at the seams, weighted by how
    near to the floor they are; skate_own: the same in the clips [m/s]. sunk: of a foot below the clips' lowest [m]."""

    exact: bool
    acceleration: float
    speed: float
    skate: float
    skate_own: float
    sunk: float

    @property
    def failed(self) -> list[str]:
        bars = {
            "exact": self.exact,
            "acceleration": self.acceleration <= ACCELERATION,
            "speed": self.speed <= SPEED,
            "skate": self.skate <= self.skate_own + SKATE,
            "sunk": self.sunk <= SUNK,
        }
        return [name for name, good in bars.items() if not good]


def judge(case: Case, run: Path) -> Verdict:
    """The motion in a run's folder. Raises ValueError for a file that is not the joined clips."""
    walk = body(case.walk)
    before, after, made = (body(path, walk) for path in (case.before, case.after, run / "edited.bvh"))
    head, tail = before.frames, after.frames
    exact = np.array_equal(made.bvh.values[:head], before.bvh.values)
    exact = exact and np.array_equal(made.bvh.values[made.frames - tail :], after.bvh.values)
    zone = round(ZONE / made.frame_time)
    middle = (head + made.frames - tail) // 2
    here = np.zeros(made.frames, dtype=bool)
    for seam, low, high in ((head - 1, 0, middle), (made.frames - tail, middle, made.frames)):
        here[max(low, seam - zone) : min(high, seam + zone)] = True
    here[: head - 3] = here[made.frames - tail + 3 :] = False
    clips = (before, walk, after)
    ratios = [
        _rate(made, order)[here[order:] & here[:-order]].max() / max(_rate(one, order).max() for one in clips)
        for order in (2, 1)
    ]
    floor = [min(float(one.places[:, foot, 1].min()) for one in clips) for foot in _feet(walk)]
    skates = [_skate(one, floor) for one in clips]
    own = max(float(skate.mean()) for skate in skates)
    sunk = max(low - float(made.places[:, foot, 1].min()) for low, foot in zip(floor, _feet(walk), strict=True))
    return Verdict(
        bool(exact), float(ratios[0]), float(ratios[1]), float(_skate(made, floor)[here[1:]].mean()), own, sunk
    )


def said(run: Path) -> dict[str, float]:
    """What the run says of itself."""
    found: dict[str, float] = json.loads((run / "metrics.json").read_text())
    return found


def _rate(one: Body, order: int) -> Floats:
    """(T - order,) largest of any joint [m a frame, to the order]."""
    joints = one.places[:, : len(one.bvh.names)]
    found: Floats = np.linalg.norm(np.diff(joints, n=order, axis=0), axis=-1).max(axis=1)
    return found


def _feet(one: Body) -> list[int]:
    return [foot for leg in one.legs for foot in leg.feet]


def _skate(one: Body, floor: list[float]) -> Floats:
    """(T - 1,) speed of the feet over the ground, each weighted by how near to its floor it is [m/s]."""
    places = one.places[:, _feet(one)]
    pace = np.linalg.norm(np.diff(places[..., ::2], axis=0), axis=-1) / one.frame_time
    near = np.clip(2.0 - 2.0 ** ((places[1:, :, 1] - np.array(floor)) / HIGH), 0.0, 1.0)
    found: Floats = (pace * near).mean(axis=1)
    return found
