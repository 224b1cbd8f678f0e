"""How fast and how hard the joints of a body move, and how far its knees are bent back: of the two files alone.

Nothing here knows hopdiff. Lengths are metres, times seconds, angles degrees.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.ndimage import uniform_filter1d

from experiments.bvh_reading import Body, Floats

GLANCE = 1.0 / 30.0  # s
RESTING = 0.25  # of the fastest part: what any other may reach before its own speed counts


def below(parents: Sequence[int], joint: int) -> list[int]:
    """A joint and all that hangs on it."""
    found = [joint]
    for k, above in enumerate(parents):
        if above in found:
            found.append(k)
    return found


def parts(body: Body) -> dict[str, list[int]]:
    """Points by the part of the body whose largest speeds are compared."""
    found = {"knee": [leg.knee for leg in body.legs], "ankle": [leg.ankle for leg in body.legs]}
    toes = [leg.toe for leg in body.legs if leg.toe is not None]
    if toes:
        found["toe"] = toes
    legs = {point for leg in body.legs for point in below(body.parents, leg.hip)}
    others = [k for k in range(body.places.shape[1]) if k not in legs and k != body.mover]
    return found | ({"others": others} if others else {})


def steady(body: Body) -> Floats:
    """(T, P, 3) points round the joint that carries the body, along the way it faces: its turns and shifts are out."""
    turn = body.turns[:, body.mover]
    yaw = np.arctan2(turn[:, 0, 2] - turn[:, 2, 0], turn[:, 0, 0] + turn[:, 2, 2])
    c, s = np.cos(yaw)[:, None], np.sin(yaw)[:, None]
    x, y, z = np.moveaxis(body.places - body.places[:, [body.mover]], -1, 0)
    return np.stack((c * x - s * z, y, s * x + c * z), axis=-1)


def strides(body: Body) -> tuple[int, ...]:
    """Frames over which differences are taken: one, and 1/30 s, so that cameras' noise does not hide what is there."""
    return tuple(sorted({1, max(1, round(GLANCE / body.frame_time))}))


def paces(body: Body) -> dict[str, float]:
    """Largest speed in 1/30 s: of points of the legs against the root [m/s], and of joints in their parent's frame
    [rad/s]."""
    apart = strides(body)[-1]
    if body.frames <= apart:
        return {}
    moved = steady(body)
    fast = np.linalg.norm(moved[apart:] - moved[:-apart], axis=-1) / (apart * body.frame_time)
    found = {f"{name} m/s": float(fast[:, points].max()) for name, points in parts(body).items()}
    for name, joints in {**parts(body), "hip": [leg.hip for leg in body.legs]}.items():
        own = [k for k in joints if k < body.turns.shape[1]]
        if own:
            above = [max(body.parents[k], 0) for k in own]
            local = np.swapaxes(body.turns[:, above], -1, -2) @ body.turns[:, own]
            found[f"{name} rad/s"] = float(angles(local, apart).max()) / (apart * body.frame_time)
    return found


def angles(turns: Floats, apart: int) -> Floats:
    """Angles [rad] between turns (T, J, 3, 3) some frames apart."""
    between = np.swapaxes(turns[:-apart], -1, -2) @ turns[apart:]
    # From the sine too: the cosine alone rounds small angles away.
    sine = np.stack([between[..., i, j] - between[..., j, i] for i, j in ((2, 1), (0, 2), (1, 0))], axis=-1)
    cosine = np.trace(between, axis1=-2, axis2=-1) - 1.0
    found: Floats = np.arctan2(np.linalg.norm(sine, axis=-1), cosine)
    return found


def jerks(body: Body) -> dict[str, float]:
    """Largest third difference of points of each part against the root [m/s3], from frame to frame and over 1/30 s."""
    found: dict[str, float] = {}
    for apart in strides(body):
        if body.frames <= 3 * apart:
            continue
        smooth = uniform_filter1d(steady(body), apart, axis=0, mode="nearest") if apart > 1 else steady(body)
        third = smooth[3 * apart :] - 3.0 * smooth[2 * apart : -apart] + 3.0 * smooth[apart : -2 * apart]
        third = np.linalg.norm(third - smooth[: -3 * apart], axis=-1) / (apart * body.frame_time) ** 3
        found |= {f"{name}, {apart} frames": float(third[:, points].max()) for name, points in parts(body).items()}
    return found


def kind_of(name: str) -> str:
    """What is measured: the unit of a speed, the frames of a jerk."""
    return name.split()[-1] if "/" in name else name.partition(",")[2]


def ratio_of_largest(new: dict[str, float], old: dict[str, float]) -> float:
    """The largest of all parts against the source's, of each kind of measure; the largest of these."""
    ratios = [1.0]
    for kind in {kind_of(name) for name in old}:
        most, was = (max(value for name, value in one.items() if kind_of(name) == kind) for one in (new, old))
        ratios.append(most / max(was, 1e-9))
    return max(ratios)


def largest_ratio(new: dict[str, float], old: dict[str, float]) -> float:
    """Largest of any part against its own in the source; parts that lay still in it count little."""
    least: dict[str, float] = {}
    for name, value in old.items():
        kind = kind_of(name)
        least[kind] = max(least.get(kind, 0.0), RESTING * value)
    ratios = [value / max(old[name], least[kind_of(name)], 1e-9) for name, value in new.items()]
    return max(ratios, default=1.0)


def bend_axis(body: Body, side: int) -> Floats:
    """(3,) axis in the thigh's own frame about which a knee bends, weighted by how far it is bent."""
    thigh, shank = _bones(body, side)
    turn = body.turns[:, body.legs[side].hip]
    local = np.einsum("tji,tj->ti", turn, np.cross(thigh, shank))
    total = local.sum(axis=0)
    found: Floats = total / max(float(np.linalg.norm(total)), 1e-12)
    return found


def beyond(body: Body, side: int, axis: Floats) -> float:
    """How far a knee is bent beyond straight about an axis of its thigh, at most [deg]; below zero if never."""
    thigh, shank = _bones(body, side)
    world = body.turns[:, body.legs[side].hip] @ axis
    sine = np.einsum("ti,ti->t", np.cross(thigh, shank), world)
    bend = np.degrees(np.arctan2(sine, np.einsum("ti,ti->t", thigh, shank)))
    return max(0.0, -float(bend.min()))


def _bones(body: Body, side: int) -> tuple[Floats, Floats]:
    leg = body.legs[side]
    return body.places[:, leg.knee] - body.places[:, leg.hip], body.places[:, leg.ankle] - body.places[:, leg.knee]
