"""Whether an edited clip passes for a take: judged from the files before and after, and nothing that made them.

Nothing here knows hopdiff. Lengths are metres, times seconds, angles degrees.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d, minimum_filter1d, percentile_filter, uniform_filter1d

from experiments.bvh_reading import Body, Floats
from experiments.edits.joints import GLANCE, below, bend_axis, beyond, jerks, largest_ratio, paces, ratio_of_largest

Flags = NDArray[np.bool_]
Height = Callable[[Floats, Floats], Floats]  # of the ground at x, z

LOW, STILL, HASTE = 0.04, 0.35, 0.15  # m; m/s; share of the body's speed that a runner's foot may move
SHORTEST, GAP = 0.08, 0.05  # s
CLIMB = 0.35  # s before and after a frame over which the ground under a body is averaged
LIFT = 0.03  # m of the lowest point of a foot that makes a step
OFF, LEAVING = 0.005, 0.15  # m by which it is off the ground just before and after that, and s for which it may be
RAISED = 0.005  # m over the source by which a heel is up on uneven ground
AROUND = 1.5  # s in which a foot's own floor is looked for, so that a slope does not end its contacts
LEG = 0.9  # m, for which LOW is meant
# What passes, beyond the source where there is one.
BARS = {
    "frame 0": 1e-4,  # m, any joint
    "last pose": 1e-4,  # m, any joint, seen from the root
    "arrival": 1e-3,  # m
    "turn": 0.1,  # deg
    "slide": 0.02,  # m/s more
    "drift": 0.01,  # m more, of each contact
    "height": 0.01,  # m that a foot in contact floats or sinks
    "root drop": 0.08,  # m
    "speed": 1.5,  # times the source's
    "jerk": 2.0,  # times the source's
    "knee": 1.0,  # deg beyond straight more
    "contact": 0.1,  # share of the frames less
}
SHOWN = {"frame 0": 1000, "last pose": 1000, "arrival": 1000, "drift": 100, "height": 100, "root drop": 100}
UNITS = {
    **dict.fromkeys(("frame 0", "last pose", "arrival"), "mm"),
    **dict.fromkeys(("drift", "height", "root drop"), "cm"),
    **dict.fromkeys(("turn", "knee"), "deg"),
    **dict.fromkeys(("speed", "jerk"), "x"),
    "slide": "m/s",
    "contact": "",
}


@dataclass(frozen=True)
class Bound:
    """Where the edit was asked to be. frame: counted from 0. place: x and z of the joint that carries the body, or
    None. turn: to the left against the source [deg], or None."""

    frame: int
    place: tuple[float, float] | None = None
    turn: float | None = None


@dataclass(frozen=True)
class Verdict:
    """numbers: by bar, as BARS counts them. others: what is measured and has no bar."""

    numbers: dict[str, float]
    others: dict[str, float] = field(default_factory=dict)

    @property
    def failed(self) -> dict[str, float]:
        """The bars that are missed, and by what. What is not a number misses."""
        return {name: value for name, value in self.numbers.items() if not value <= BARS[name]}

    @property
    def passed(self) -> bool:
        return not self.failed

    def words(self) -> str:
        """pass, or the bars that are missed."""
        found = [
            f"{name} {SHOWN.get(name, 1) * value:.3g} {UNITS[name]}".strip() for name, value in self.failed.items()
        ]
        return ", ".join(found) or "pass"


def judge(
    source: Body,
    edited: Body,
    bound: Sequence[Bound],
    ground: Height | None = None,
    frame_0: bool = True,
) -> Verdict:
    """How an edit compares with its source.

    ground: heights of the ground, counted from the floor of the source; None: flat. Legs may then stand otherwise in
    the last pose. frame_0: whether the first frame must stay where it is; on a curve it goes where that begins, so
    that it is judged up to the root's place and turn.
    Raises ValueError for another number of frames.
    """
    if source.frames != edited.frames:
        raise ValueError(f"{edited.frames} frames, {source.frames} in the source")
    level: Height = ground or (lambda x, z: np.zeros_like(x))
    floor = Floor.of(source)
    own = contacts(edited, level)
    touching = contacts(source)
    touching &= ~stepping(edited, own, floor, level)
    if ground:
        touching &= ~rolling(source, edited, own, level)
    mover = source.mover
    legs = {joint for leg in source.legs for joint in below(source.parents, leg.hip)} if ground else set()
    rest = [k for k in range(source.places.shape[1]) if k not in legs]
    moved, old_moved = places_of(edited, touching), places_of(source, touching)
    rise = level(edited.places[..., 0], edited.places[..., 2])
    # Stairs are climbed as a slope is.
    lifted = np.concatenate([rise[:, leg.feet] for leg in source.legs], axis=1)
    wide = 1 + 2 * round(CLIMB / edited.frame_time)
    under = uniform_filter1d(rise[:, mover], wide, mode="nearest")
    # Soon before and after a foot stands lower, a body is no higher than that leg lets it be.
    lowest = minimum_filter1d(np.where(own, lifted, np.inf).min(axis=1), wide, mode="nearest")
    drop = source.places[:, mover, 1] - edited.places[:, mover, 1] + np.minimum(under, lowest)
    off = moved[..., 1] - lifted - old_moved[..., 1]
    speed, jerk = paces(edited), jerks(edited)
    old_speed, old_jerk = paces(source), jerks(source)
    axes = [bend_axis(source, k) for k in range(2)]
    first = edited.places[0] - source.places[0] if frame_0 else seen(edited, 0) - seen(source, 0)
    numbers = {
        "frame 0": farthest(first[rest]),
        "last pose": farthest((seen(edited, -1) - seen(source, -1))[rest]),
        **arrival(source, edited, bound),
        "slide": slide(moved, touching, edited.frame_time) - slide(old_moved, touching, source.frame_time),
        "drift": float((drifts(moved, touching) - drifts(old_moved, touching)).max(initial=0.0)),
        "height": off_ground(edited, off, touching),
        "root drop": float(drop.max()),
        "speed": ratio_of_largest(speed, old_speed),
        "jerk": ratio_of_largest(jerk, old_jerk),
        "knee": max(beyond(edited, k, axes[k]) - beyond(source, k, axes[k]) for k in range(2)),
        "contact": share(contacts(source)) - share(own),
    }
    return Verdict(
        numbers,
        {
            "slide": slide(moved, touching, edited.frame_time),
            "slide source": slide(old_moved, touching, source.frame_time),
            "own slide": slide(moved, own, edited.frame_time),
            "own drift": float(drifts(moved, own).max(initial=0.0)),
            "skid": skid(moved, old_moved, touching),
            "share": share(own),
            "share source": share(contacts(source)),
            "depth": float((floor.heights - moved[..., 1] + lifted).max()),
            "part speed": largest_ratio(speed, old_speed),
            "part jerk": largest_ratio(jerk, old_jerk),
            "world speed": float(world_pace(edited) / max(world_pace(source), 1e-9)),
        },
    )


def off_ground(body: Body, off: Floats, touching: Flags) -> float:
    """Farthest that a foot in contact floats, with all of its points that touch, or that one of them sinks. A heel
    may reach over the edge of a tread."""
    most = 0.0
    for points in columns(body):
        lowest = np.where(touching[:, points], off[:, points], np.inf).min(axis=1)
        most = max(most, float(np.abs(lowest[np.isfinite(lowest)]).max(initial=0.0)))
    return most


def farthest(offsets: Floats) -> float:
    return float(np.linalg.norm(offsets, axis=-1).max())


def seen(body: Body, frame: int) -> Floats:
    """(P, 3) points of a frame as the joint sees them that carries the body."""
    found: Floats = (body.places[frame] - body.places[frame, body.mover]) @ body.turns[frame, body.mover]
    return found


def arrival(source: Body, edited: Body, bound: Sequence[Bound]) -> dict[str, float]:
    """Largest distance from where bound frames were asked to be, and from how they were asked to face."""
    place, turn, mover = 0.0, 0.0, source.mover
    for one in bound:
        if one.place is not None:
            gap = edited.places[one.frame, mover, ::2] - np.array(one.place)
            place = max(place, float(np.hypot(*gap)))
        if one.turn is not None:
            change = edited.turns[one.frame, mover] @ source.turns[one.frame, mover].T
            found = math.degrees(math.atan2(change[0, 2] - change[2, 0], change[0, 0] + change[2, 2]))
            turn = max(turn, abs(math.remainder(found - one.turn, 360.0)))
    return {"arrival": place, "turn": turn}


# Feet


def places_of(body: Body, touching: Flags) -> Floats:
    """(T, C, 3) points of the feet, in the order of the columns of `contacts`."""
    points = [point for leg in body.legs for point in leg.feet]
    assert touching.shape[1] == len(points)
    found: Floats = body.places[:, points]
    return found


def columns(body: Body) -> Iterator[slice]:
    """Of each leg the columns of `contacts`."""
    first = 0
    for leg in body.legs:
        yield slice(first, first + len(leg.feet))
        first += len(leg.feet)


@dataclass(frozen=True)
class Floor:
    """heights: (C,) of each point of the feet while it stands, in the whole clip."""

    heights: Floats

    @staticmethod
    def of(body: Body) -> Floor:
        points = [point for leg in body.legs for point in leg.feet]
        return Floor(np.quantile(body.places[:, points, 1], 0.05, axis=0))


def contacts(body: Body, level: Height | None = None) -> Flags:
    """(T, C) when points of the feet stand: low over their floor round about, and still, for a while. level: of the
    ground, where it is known."""
    points = [point for leg in body.legs for point in leg.feet]
    feet, step = body.places[:, points], body.frame_time
    above = feet[..., 1] if level is None else feet[..., 1] - level(feet[..., 0], feet[..., 2])
    leg = body.legs[0]
    length = float(np.linalg.norm(np.diff(body.places[0, [leg.hip, leg.knee, leg.ankle]], axis=0), axis=-1).sum())
    wide = 2 * max(1, round(0.5 * AROUND / step)) + 1
    floor = percentile_filter(above, 5, size=(wide, 1), mode="nearest")
    way = np.linalg.norm(np.diff(body.places[:, body.mover, ::2], axis=0), axis=-1).sum()
    still = max(STILL, HASTE * float(way) / max(step * (body.frames - 1), step))
    low = above - floor < LOW * length / LEG
    found = low & (pace(feet, step) < still)
    return np.stack([lasting(column, step) for column in found.T], axis=1)


def stepping(edited: Body, own: Flags, floor: Floor, level: Height) -> Flags:
    """(T, C) when a foot makes a step: off the ground from one contact to the next, and lifted by LIFT in between.

    Where a body has to go elsewhere while it stood in the source, a step is right and sliding is wrong.
    """
    moved = places_of(edited, own)
    above = moved[..., 1] - floor.heights - level(moved[..., 0], moved[..., 2])
    found = np.zeros_like(own)
    for points in columns(edited):
        lift = above[:, points].min(axis=1)
        away = ~own[:, points].any(axis=1)
        near = maximum_filter1d(away, 1 + 2 * round(LEAVING / edited.frame_time), mode="nearest")
        for first, after in runs(away | (near & (lift > OFF))):
            found[first:after, points] = lift[first:after].max() >= LIFT
    return found


def rolling(source: Body, edited: Body, own: Flags, level: Height) -> Flags:
    """(T, C) when a point of a foot is up, unlike in the source, while another point of that foot stands: where ground
    rises a heel leaves it sooner, and slides no more than one that left it anyway."""
    moved, old = places_of(edited, own), places_of(source, own)
    up = moved[..., 1] - level(moved[..., 0], moved[..., 2]) - old[..., 1] > RAISED
    found = np.zeros_like(own)
    for points in columns(edited):
        found[:, points] = up[:, points] & ~own[:, points] & own[:, points].any(axis=1, keepdims=True)
    return found


def pace(points: Floats, step: float) -> Floats:
    """(T, C) speeds of points (T, C, 3) over 1/30 s."""
    half = max(1, round(0.5 * GLANCE / step))
    at = np.arange(len(points))
    before, after = np.maximum(at - half, 0), np.minimum(at + half, len(points) - 1)
    moved = np.linalg.norm(points[after] - points[before], axis=-1)
    found: Floats = moved / (np.maximum(after - before, 1) * step)[:, None]
    return found


def runs(flags: Flags) -> Iterator[tuple[int, int]]:
    """First frame of every run of true, and the one after its last."""
    edges = np.flatnonzero(np.diff(np.concatenate(([0], flags.astype(int), [0]))))
    yield from zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True)


def lasting(flags: Flags, step: float) -> Flags:
    """Short gaps filled and short contacts dropped, those at the ends of the clip aside."""
    found = flags.copy()
    for value, shortest in ((True, GAP), (False, SHORTEST)):
        for first, after in list(runs(found != value)):
            if first > 0 and after < len(found) and (after - first) * step < shortest:
                found[first:after] = value
    return found


def slide(points: Floats, touching: Flags, step: float) -> float:
    """Mean speed over the ground of points while they touch it."""
    both = touching[1:] & touching[:-1]
    fast = np.linalg.norm(np.diff(points[..., ::2], axis=0), axis=-1)
    return float(fast[both].mean()) / step if both.any() else 0.0


def drifts(points: Floats, touching: Flags) -> Floats:
    """Of every contact the farthest that its point gets over the ground from where it came down."""
    own = [points[first:after, k, ::2] for k, first, after in stands(touching)]
    return np.array([farthest(one - one[0]) for one in own])


def skid(points: Floats, old: Floats, touching: Flags) -> float:
    """Farthest that a point gets in a contact from what it did in the source, laid there by one turn and shift."""
    most = 0.0
    for k, first, after in stands(touching):
        new, was = (one[first:after, k, 2] + 1j * one[first:after, k, 0] for one in (points, old))
        new, was = new - new.mean(), was - was.mean()
        along = complex(np.vdot(was, new))
        turn = along / abs(along) if abs(along) > 1e-12 else 1.0
        most = max(most, float(np.abs(new - turn * was).max()))
    return most


def stands(touching: Flags) -> Iterator[tuple[int, int, int]]:
    """Point, first frame, and the one after the last, of every contact."""
    for k in range(touching.shape[1]):
        yield from ((k, first, after) for first, after in runs(touching[:, k]))


def share(touching: Flags) -> float:
    return float(touching.any(axis=1).mean())


def world_pace(body: Body) -> float:
    """Largest speed of any point in the world over 1/30 s."""
    return float(pace(body.places, body.frame_time).max())
