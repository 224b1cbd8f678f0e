"""The edits that every clip is asked for, as words of the command line, and what each of them then has to meet."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from experiments.bvh_reading import Body, Floats
from experiments.edits.judge import Bound, Height

ASIDE, MOST_ASIDE = 0.3, 1.5  # of the way walked, and m
WANDERS = 0.25  # of the way walked: a clip whose ends are nearer to each other wanders
PIECES = 8  # of the way of a clip that wanders, bound where it is made longer or shorter
BEFORE = 0.8  # m from the start to where ground begins to rise
SLOPE_DEG, RISE, RUN, STEPS = 10.0, 0.17, 0.29, 10


@dataclass(frozen=True)
class Ask:
    """words: of the command line. bound: what they ask for. ground: heights, None for a flat floor. frame_0: whether
    the clip must begin where it began."""

    words: tuple[str, ...]
    bound: tuple[Bound, ...]
    ground: Height | None = None
    frame_0: bool = True


@dataclass(frozen=True)
class Way:
    """The way of a clip over the ground. place: (T, 2). arc: (T,) walked until then."""

    place: Floats
    arc: Floats
    frame_time: float

    @staticmethod
    def of(body: Body) -> Way:
        place = body.places[:, body.mover, ::2]
        steps = np.linalg.norm(np.diff(place, axis=0), axis=-1)
        return Way(place, np.concatenate(([0.0], np.cumsum(steps))), body.frame_time)

    @property
    def last(self) -> int:
        return len(self.place) - 1

    @property
    def length(self) -> float:
        return float(self.arc[-1])

    @property
    def net(self) -> Floats:
        found: Floats = self.place[-1] - self.place[0]
        return found

    @property
    def wanders(self) -> bool:
        return float(np.hypot(*self.net)) < WANDERS * self.length

    @property
    def aside(self) -> float:
        return min(ASIDE * self.length, MOST_ASIDE)

    def left(self, frame: int) -> Floats:
        """To the left of the way at a frame, of length 1: of the net way, or of the way there if the clip wanders."""
        ahead = self.net if not self.wanders else self.ahead(frame)
        x, z = ahead / max(float(np.hypot(*ahead)), 1e-9)
        return np.array([z, -x])

    def ahead(self, frame: int) -> Floats:
        """Where the way goes round a frame, over .3 m at least or the whole clip."""
        for half in range(1, self.last + 1):
            before, after = max(frame - half, 0), min(frame + half, self.last)
            if np.hypot(*(moved := self.place[after] - self.place[before])) > 0.3:
                return np.asarray(moved)
        return np.array([0.0, 1.0])

    def at(self, share: float) -> int:
        return round(share * self.last)

    def walked(self, share: float) -> int:
        """Frame in which a share of the way is walked."""
        return int(np.searchsorted(self.arc, share * self.length).clip(0, self.last))


def constrained(wishes: Sequence[tuple[int, Floats | None, str | None]]) -> Ask:
    """Frames, places and headings (keep, free, or none said, which keeps)."""
    texts, bound = [], []
    for frame, place, heading in wishes:
        entries = [f"frame: {frame}"]
        if place is not None:
            entries.append(f"position: [{place[0]:.9g}, {place[1]:.9g}]")
        if heading is not None:
            entries.append(f"heading: {heading}")
        texts.append("{" + ", ".join(entries) + "}")
        where = None if place is None else (float(place[0]), float(place[1]))
        bound.append(Bound(frame, where, None if heading == "free" else 0.0))
    return Ask((f"constraints=[{', '.join(texts)}]",), tuple(bound))


def turned(way: Way, shift: Floats, degrees: float, *more: str) -> Ask:
    """The last frame shifted and turned, counted from where the clip ends."""
    net = way.net / max(float(way.net @ way.net), 1e-12)
    ahead, left = float(shift @ net), float(shift @ np.array([net[1], -net[0]]))
    x, z = way.place[-1] + shift
    words = (f"target.position=[{left:.12g},{ahead:.12g}]", f"target.heading={degrees:g}", "target.relative=true")
    return Ask((*words, *more), (Bound(way.last, (float(x), float(z)), degrees),))


def position(way: Way) -> Ask:
    return constrained([(way.last, way.place[-1] + way.aside * way.left(way.last), "free")])


def left_90(way: Way) -> Ask:
    return turned(way, np.zeros(2), 90.0)


def right_90(way: Way) -> Ask:
    return turned(way, np.zeros(2), -90.0)


def half_turn(way: Way) -> Ask:
    """Back to beside the start, or, where a clip ends near its start, to beside its end."""
    if way.wanders:
        return turned(way, way.aside * way.left(way.last), 180.0)
    x, z = way.net
    return turned(way, -way.net + 0.5 * np.array([z, -x]), 180.0)


def waypoints(way: Way) -> Ask:
    """A slalom: a twentieth of the way aside to the left, the right and the left."""
    wide = min(0.05 * way.length, 0.3)
    frames = [way.at(share) for share in (0.25, 0.5, 0.75)]
    return constrained(
        [(k, way.place[k] + side * wide * way.left(k), "free") for k, side in zip(frames, (1, -1, 1), strict=True)]
    )


def curve(way: Way) -> Ask:
    """An S as long as the way, from where the clip begins, the way that it then goes."""
    first = way.net if not way.wanders else way.ahead(0)
    ahead = first / max(float(np.hypot(*first)), 1e-9)
    left, wide = np.array([ahead[1], -ahead[0]]), min(0.1 * way.length, 0.5)
    points = [
        way.place[0] + share * way.length * ahead + side * wide * left
        for share, side in ((0.0, 0), (1 / 3, 1), (2 / 3, -1), (1.0, 0))
    ]
    text = ",".join(f"[{x:.9g},{z:.9g}]" for x, z in points)
    ends = (Bound(0, (points[0][0], points[0][1])), Bound(way.last, (points[-1][0], points[-1][1])))
    return Ask((f"path.points=[{text}]",), ends, frame_0=False)


def scaled(way: Way, factor: float) -> Ask:
    if not way.wanders:
        return constrained([(way.last, way.place[0] + factor * way.net, "keep")])
    frames = [way.at(k / PIECES) for k in range(1, PIECES + 1)]
    return constrained([(k, way.place[0] + factor * (way.place[k] - way.place[0]), "keep") for k in frames])


def longer(way: Way) -> Ask:
    return scaled(way, 1.5)


def shorter(way: Way) -> Ask:
    return scaled(way, 0.5)


def sideways(way: Way) -> Ask:
    return constrained([(way.last, way.place[-1] + way.aside * way.left(way.last), "keep")])


def stop_early(way: Way) -> Ask:
    """Where 70 % of the way are walked, from 80 % of the time on."""
    stop = way.place[way.walked(0.7)]
    return constrained([(way.at(share), stop, "free") for share in (0.8, 0.9, 1.0)])


def two_apart(way: Way) -> Ask:
    """The frame a second before the end shifted aside, and the last one turned where it is."""
    frame = max(1, way.last - round(1.0 / way.frame_time))
    # Where the first of them comes early, little of the way is there to go aside on.
    wide = min(0.1 * way.length, 0.2, ASIDE * float(way.arc[frame]))
    early = constrained([(frame, way.place[frame] + wide * way.left(frame), "keep")])
    late = turned(way, np.zeros(2), 30.0)
    return Ask((*early.words, *late.words), (*early.bound, *late.bound))


def uphill(way: Way, ask: Ask, before: float, *words: str) -> tuple[Ask, Height]:
    """An edit on ground that rises where the way goes first, some metres after its start; and how far along that a
    place is."""
    ahead = way.net if not way.wanders else way.ahead(0)
    ahead = ahead / max(float(np.hypot(*ahead)), 1e-9)
    x, z = way.place[0] + before * ahead
    heading = math.degrees(math.atan2(ahead[0], ahead[1]))
    start = (f"ground.start=[{x:.9g},{z:.9g}]", f"ground.heading={heading:.9g}")
    return Ask((*ask.words, *words, *start), ask.bound), lambda p, q: (p - x) * ahead[0] + (q - z) * ahead[1]


def slope(way: Way) -> Ask:
    """As far as before, uphill."""
    ask, along = uphill(way, turned(way, np.zeros(2), 0.0), BEFORE, "ground=slope", f"ground.angle={SLOPE_DEG:g}")
    steep = math.tan(math.radians(SLOPE_DEG))
    return Ask(ask.words, ask.bound, lambda x, z: steep * np.maximum(along(x, z), 0.0))


def stairs(way: Way) -> Ask:
    """Half as far as before, as people shorten their steps on stairs, and up."""
    words = ("ground=stairs", f"ground.rise={RISE:g}", f"ground.run={RUN:g}", f"ground.steps={STEPS}")
    ask, along = uphill(way, scaled(way, 0.5), BEFORE, *words)
    return Ask(ask.words, ask.bound, lambda x, z: RISE * np.clip(np.floor(along(x, z) / RUN) + 1.0, 0.0, STEPS))


KINDS: dict[str, Callable[[Way], Ask]] = {
    "position": position,
    "90 deg left": left_90,
    "90 deg right": right_90,
    "180 deg": half_turn,
    "waypoints": waypoints,
    "curve": curve,
    "1.5 x": longer,
    "0.5 x": shorter,
    "sideways": sideways,
    "stop early": stop_early,
    "two 1 s apart": two_apart,
    "slope": slope,
    "stairs": stairs,
}
NOT_YET = ("slope", "stairs")  # edits over uneven ground
