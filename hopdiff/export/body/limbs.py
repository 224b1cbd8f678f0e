"""Legs down to the ankles, arms, and hands."""

from __future__ import annotations

import numpy as np

from hopdiff.export.body.build import FOOT, HAND, SHORT, Build, axes, thickness, unit
from hopdiff.export.body.loft import Floats, Rings, Shape, around, ball, eased, loft, moved, through
from hopdiff.whole_body.skeleton import WRIST

# Along a bone: share of its length, then reach of the section outwards, inwards, ahead and back, in its mean radius.
THIGH = np.array(
    [
        (0.0, 1.0, 0.94, 1.08, 1.22),
        (0.1, 1.06, 1.02, 1.16, 1.28),
        (0.3, 1.05, 1.06, 1.17, 1.13),
        (0.5, 0.98, 1.0, 1.1, 0.98),
        (0.7, 0.85, 0.9, 0.94, 0.88),
        (0.86, 0.72, 0.77, 0.82, 0.77),
        (0.95, 0.7, 0.74, 0.8, 0.72),
        (1.0, 0.68, 0.72, 0.8, 0.7),
    ]
)
SHANK = np.array(
    [
        (0.0, 1.2, 1.27, 1.42, 1.24),
        (0.05, 1.17, 1.24, 1.32, 1.2),
        (0.13, 1.12, 1.17, 1.06, 1.28),
        (0.28, 1.14, 1.18, 0.95, 1.52),
        (0.42, 1.04, 1.1, 0.88, 1.4),
        (0.58, 0.86, 0.9, 0.8, 1.04),
        (0.75, 0.69, 0.7, 0.72, 0.76),
        (0.9, 0.63, 0.66, 0.66, 0.7),
        (1.0, 0.66, 0.68, 0.68, 0.72),
    ]
)
UPPER_ARM = np.array(
    [
        (0.0, 1.22, 1.0, 1.22, 1.22),
        (0.12, 1.34, 0.98, 1.28, 1.26),
        (0.28, 1.22, 0.9, 1.18, 1.14),
        (0.5, 0.94, 0.88, 1.14, 1.06),
        (0.72, 0.84, 0.84, 0.98, 0.94),
        (0.9, 0.86, 0.86, 0.8, 0.8),
        (1.0, 0.86, 0.88, 0.76, 0.8),
    ]
)
FOREARM = np.array(
    [
        (0.0, 0.98, 1.0, 0.87, 0.91),
        (0.12, 1.12, 1.1, 1.04, 0.98),
        (0.3, 1.14, 1.08, 1.1, 1.04),
        (0.5, 0.96, 0.95, 1.02, 0.98),
        (0.75, 0.68, 0.7, 0.84, 0.84),
        (0.92, 0.52, 0.56, 0.74, 0.74),
        (1.0, 0.5, 0.54, 0.74, 0.74),
    ]
)
# A hand: share of its length, reach outwards, inwards, ahead and back in its length, and how far it is curled [rad].
PALM = np.array(
    [
        (0.12, 0.095, 0.11, 0.22, 0.215, 0.03),
        (0.3, 0.1, 0.125, 0.275, 0.25, 0.1),
        (0.46, 0.095, 0.11, 0.285, 0.265, 0.2),
        (0.6, 0.085, 0.085, 0.27, 0.25, 0.42),
        (0.74, 0.08, 0.075, 0.255, 0.24, 0.72),
        (0.88, 0.07, 0.065, 0.235, 0.22, 1.0),
        (0.98, 0.05, 0.045, 0.2, 0.185, 1.15),
    ]
)
THUMB = np.array(
    [
        (0.0, 0.09, 0.09, 0.1, 0.1),
        (0.35, 0.09, 0.09, 0.095, 0.095),
        (0.6, 0.072, 0.072, 0.075, 0.075),
        (0.9, 0.06, 0.06, 0.065, 0.065),
    ]
)
LEG_RINGS = ((0.02, 0.12, 0.27, 0.45, 0.63, 0.78, 0.88, 0.94), (0.0, 0.06, 0.13, 0.22, 0.33, 0.46, 0.62, 0.8, 0.95))
ARM_RINGS = ((0.02, 0.12, 0.27, 0.5, 0.72, 0.86, 0.94), (0.0, 0.07, 0.16, 0.3, 0.48, 0.68, 0.86, 0.97))
BEND = 0.98  # thicknesses of a joint over which its skin passes from one bone to the next, either way
FOLDED = 1e-3  # length of the sum of two unit vectors below which it has no direction
JOINT = 0.95  # size of the ball in a bent joint against the skin about it


def leg(body: Build, side: str) -> None:
    """Thigh and shank, if they are there."""
    parts = body.parts
    if f"{side}_hip" not in parts or f"{side}_knee" not in parts:
        return
    hip, knee, ankle = (parts.get(f"{side}_{part}") for part in ("hip", "knee", "ankle"))
    assert hip is not None
    assert knee is not None
    foot = body.end(knee) if ankle is None else body.places[ankle]
    if foot is None or min(body.bone(f"{side}_hip", f"{side}_knee"), _far(foot, body.places[knee])) < SHORT:
        return
    masses = body.masses[f"{side}_hip"], (1.0 if ankle is None else 1.0 - FOOT) * body.masses[f"{side}_knee"]
    bones = _Bones(body, side, (body.places[hip], body.places[knee], foot), masses, (THIGH, SHANK))
    # Thighs do not reach over the middle.
    apart = 0.97 * abs(float(body.left @ (body.places[hip] - body.places[body.parts.get("pelvis", hip)])))
    rings = bones.rings(LEG_RINGS, inner=apart if apart > 0.5 * bones.thick[0] else None)
    last = 0.5 * float(rings.tall[-1].sum())
    shape = loft(rings, around(16), 0.92 * bones.thick[0], last, (0.5, 0.85))
    knees = bones.passed(shape, 1)
    shares = {hip: 1.0 - knees, knee: knees}
    if ankle is not None:
        beyond = eased(0.5 + 0.5 * bones.past(shape, 2) / last)
        shares = {hip: 1.0 - knees, knee: knees * (1.0 - beyond), ankle: knees * beyond}
    body.made[side] += [moved(shape, shares), moved(bones.joint(), {hip: np.ones(1)})]
    body.covered |= {knee} | (set() if ankle is None else {ankle})
    body.taken |= {knee} if ankle is None else set()


def arm(body: Build, side: str) -> None:
    """Upper arm, forearm and hand, if they are there; the hand of a forearm without a wrist moves with it."""
    parts = body.parts
    if f"{side}_shoulder" not in parts or f"{side}_elbow" not in parts:
        return
    shoulder, elbow, wrist = (parts.get(f"{side}_{part}") for part in ("shoulder", "elbow", "wrist"))
    assert shoulder is not None
    assert elbow is not None
    whole = body.end(elbow)
    at = body.places[elbow]
    place = body.places[wrist] if wrist is not None else whole
    if wrist is None and whole is not None and _far(whole, at) > body.bone(f"{side}_shoulder", f"{side}_elbow"):
        # Hand and all: a forearm alone is shorter than an upper arm.
        place = at + WRIST * (whole - at)
    if place is None or min(body.bone(f"{side}_shoulder", f"{side}_elbow"), _far(place, at)) < SHORT:
        return
    masses = body.masses[f"{side}_shoulder"], (1.0 - HAND) * body.masses[f"{side}_elbow"]
    bones = _Bones(body, side, (body.places[shoulder], at, place), masses, (UPPER_ARM, FOREARM))
    rings = bones.rings(ARM_RINGS)
    tip = whole if wrist is None else body.end(wrist)
    length = 0.0 if tip is None else _far(tip, place)
    length = (length if length > 0.3 * _far(place, at) else 0.72 * _far(place, at)) * (1.0 + 1.6 * body.young)
    hand = _hand(bones, length)
    rings = Rings(*(np.concatenate(pair) for pair in zip(vars(rings).values(), vars(hand).values(), strict=True)))
    shape = loft(rings, around(12), 1.04 * bones.thick[0], 0.06 * length, (0.6, 0.9))
    elbows = bones.passed(shape, 1)
    shares = {shoulder: 1.0 - elbows, elbow: elbows}
    end = elbow if wrist is None else wrist
    if wrist is not None:
        beyond = eased(0.5 + bones.past(shape, 2) / (0.3 * length))
        shares = {shoulder: 1.0 - elbows, elbow: elbows * (1.0 - beyond), wrist: elbows * beyond}
    body.made[side] += [
        moved(shape, shares),
        moved(bones.joint(), {shoulder: np.ones(1)}),
        moved(_thumb(bones, length), {end: np.ones(1)}),
    ]
    body.covered |= {elbow} | (set() if wrist is None else {wrist})
    body.taken.add(end)


class _Bones:
    """Two bones of a limb, one after the other. places: (3,) of its three joints; thick: mean radii [m]."""

    def __init__(
        self,
        body: Build,
        side: str,
        places: tuple[Floats, Floats, Floats],
        masses: tuple[float, float],
        profiles: tuple[Floats, Floats],
    ) -> None:
        self.places, self.profiles = places, profiles
        self.ways = [places[k + 1] - places[k] for k in range(2)]
        self.lengths = [float(np.linalg.norm(way)) for way in self.ways]
        self.ways = [unit(way) for way in self.ways]
        self.thick = [thickness(masses[k], self.lengths[k], profiles[k]) for k in range(2)]
        self.axes = [axes(way, body.ahead, body.outwards(side)) for way in self.ways]
        # Both bones are as thick where they meet.
        self.middle = 0.5 * (self.thick[0] * profiles[0][-1, 1:] + self.thick[1] * profiles[1][0, 1:])

    def rings(self, shares: tuple[tuple[float, ...], ...], inner: float | None = None) -> Rings:
        """Sections at shares of both bones. inner: how far the first one may reach inwards where it begins [m]."""
        parts: list[list[Floats]] = [[] for _ in range(5)]
        for k in range(2):
            share = np.array(shares[k])
            reach = self.thick[k] * through(self.profiles[k])(share)
            near = eased(1.0 - (1.0 - share if k == 0 else share) / 0.25)[:, None]
            reach = reach + near * (self.middle - self.thick[k] * self.profiles[k][-1 if k == 0 else 0, 1:])
            if k == 0 and inner is not None:
                reach[:, 1] = np.minimum(reach[:, 1], inner)
            across, deep = self.axes[k]
            blend = 0.5 * near * (share[:, None] if k == 0 else 1.0)
            other = self.axes[1 - k]
            for part, values in zip(
                parts,
                (
                    self.places[k] + share[:, None] * self.lengths[k] * self.ways[k],
                    (1.0 - blend) * across + blend * other[0],
                    (1.0 - blend) * deep + blend * other[1],
                    reach[:, :2],
                    reach[:, 2:],
                ),
                strict=True,
            ):
                part.append(values)
        centre, across, deep, wide, tall = (np.concatenate(part) for part in parts)
        return Rings(centre, across, deep, wide, tall, np.full((len(centre), 2), 2.1))

    def past(self, shape: Shape, joint: int) -> Floats:
        """(V,) how far vertices are beyond the second or third joint, along its bones [m]."""
        way = self.ways[0] + self.ways[1] if joint == 1 else self.ways[1]
        found: Floats = (shape.vertices - self.places[joint]) @ unit(way)
        return found

    def passed(self, shape: Shape, joint: int) -> Floats:
        """(V,) share of the bone beyond a joint in the skin about it."""
        return eased(0.5 + 0.5 * self.past(shape, joint) / (BEND * float(self.middle.mean())))

    def joint(self) -> Shape:
        """A ball about the middle joint: skin that bends would sink in there."""
        wide, tall = JOINT * 0.5 * self.middle[:2].sum(), JOINT * float(self.middle[2:].min())
        pairs = [(self.axes[0][k], self.axes[1][k]) for k in range(2)] + [(self.ways[0], self.ways[1])]
        # Of bones that are folded back on each other the directions cancel out.
        out, deep, way = (unit(a + b) if np.linalg.norm(a + b) > FOLDED else a for a, b in pairs)
        return ball(self.places[1], (wide * out, tall * deep, tall * way))


def _hand(bones: _Bones, length: float) -> Rings:
    """Palm and fingers from the wrist on, curled towards the palm."""
    way, (out, deep) = bones.ways[1], bones.axes[1]
    share, curl = PALM[:, 0], PALM[:, 5]
    steps = np.diff(share, prepend=0.0)
    turn = 0.5 * (curl + np.concatenate(([0.0], curl[:-1])))
    ways = np.cos(turn)[:, None] * way - np.sin(turn)[:, None] * out
    centre = bones.places[2] + length * np.cumsum(steps[:, None] * ways, axis=0)
    across = np.cos(curl)[:, None] * out + np.sin(curl)[:, None] * way
    size = length * PALM[:, 1:5]
    return Rings(
        centre, across, np.tile(deep, (len(share), 1)), size[:, :2], size[:, 2:], np.full((len(share), 2), 2.5)
    )


def _thumb(bones: _Bones, length: float) -> Shape:
    """From the front edge of the palm ahead and down."""
    way, (out, deep) = bones.ways[1], bones.axes[1]
    start = bones.places[2] + length * (0.2 * way + 0.12 * deep - 0.02 * out)
    ahead = unit(0.75 * way + 0.62 * deep - 0.35 * out)
    later = unit(1.0 * way + 0.2 * deep - 0.45 * out)
    share = THUMB[:, :1]
    centre = start + 0.5 * length * (share * ahead + 0.5 * share**2 * (later - ahead))
    across, front = axes(ahead, deep, out)
    rings = Rings.straight(centre, across, front, length * THUMB[:, 1:3], length * THUMB[:, 3:5])
    return loft(rings, around(6), 0.0, 0.055 * length, (0.6,))


def _far(a: Floats, b: Floats) -> float:
    return float(np.linalg.norm(a - b))
