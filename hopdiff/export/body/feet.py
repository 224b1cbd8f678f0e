"""Feet: wedges in shoes, from heel to toes, that bend at the ball."""

from __future__ import annotations

import numpy as np

from hopdiff.export.body.build import FOOT, SHORT, UP, Build, thickness, unit
from hopdiff.export.body.limbs import SHANK
from hopdiff.export.body.loft import Floats, Rings, around, eased, loft, moved
from hopdiff.whole_body.skeleton import HEEL, TOE_TIP

# From heel to tip: share of the foot's length; its half width in that length, out and in; how high its back is, in the
# ankle's height; how far its sole is off the ground, in the same; and how square its back is.
OUTLINE = np.array(
    [
        (0.03, 0.085, 0.085, 0.8, 0.05, 2.2),
        (0.1, 0.136, 0.132, 1.14, 0.0, 2.6),
        (0.19, 0.154, 0.148, 1.28, 0.0, 3.4),
        (0.31, 0.154, 0.146, 1.22, 0.02, 3.4),
        (0.42, 0.146, 0.133, 1.0, 0.06, 2.6),
        (0.53, 0.158, 0.145, 0.8, 0.06, 2.2),
        (0.64, 0.18, 0.165, 0.64, 0.02, 2.1),
        (0.74, 0.187, 0.18, 0.54, 0.0, 2.1),
        (0.84, 0.168, 0.178, 0.47, 0.0, 2.1),
        (0.92, 0.128, 0.155, 0.41, 0.01, 2.1),
        (0.975, 0.075, 0.11, 0.33, 0.05, 2.1),
    ]
)
SOLE = 3.6  # how square it is below
STURDY = 0.1  # thickness of a shank in its length with the foot, of ordinary legs
BENT = 0.09  # of a foot's length before and after the ball over which it bends


def foot(body: Build, side: str) -> None:
    """The foot of a leg that has an ankle."""
    if f"{side}_ankle" not in body.parts or f"{side}_knee" not in body.parts:
        return
    joint, toe = body.parts[f"{side}_ankle"], body.parts.get(f"{side}_toe")
    ankle, size = body.places[joint], 1.16 * body.bone(f"{side}_knee", f"{side}_ankle")  # of shank and foot together
    if size < SHORT:
        return
    ball = None if toe is None else body.places[toe]
    tip = body.end(joint if toe is None else toe)
    far = tip if tip is not None else ball
    ahead = (body.ahead if far is None else far - ankle) * np.array([1.0, 0.0, 1.0])
    if np.linalg.norm(ahead) < 1e-3:
        return
    ahead = unit(ahead)
    sole = min(float(point[1]) for point in (ball, tip, ankle - 0.08 * size * UP) if point is not None)
    # Thick legs stand on big feet.
    mass = (1.0 - FOOT) * body.masses[f"{side}_knee"]
    thick = thickness(mass, max(body.bone(f"{side}_knee", f"{side}_ankle"), SHORT), SHANK)
    stout = float(np.clip(thick / (STURDY * size), 1.0, 2.0))
    reach = stout**0.4 * max(TOE_TIP * size, 0.0 if far is None else float((far - ankle) @ ahead))
    heel = stout**0.4 * HEEL * size
    length, high = reach + heel, float(ankle[1]) - sole
    across = np.cross(UP, ahead) * (1.0 if np.cross(UP, ahead) @ body.outwards(side) > 0.0 else -1.0)
    share, low = OUTLINE[:, 0], OUTLINE[:, 4] * high
    back = OUTLINE[:, 3] * high
    middle = sole + low + 0.32 * (back - low)
    centre = ankle + (share * length - heel)[:, None] * ahead
    centre[:, 1] = middle
    tall = np.stack((sole + back - middle, middle - sole - low), axis=-1)
    power = np.stack((OUTLINE[:, 5], np.full(len(share), SOLE)), axis=-1)
    across, up = np.tile(across, (len(share), 1)), np.tile(UP, (len(share), 1))
    rings = Rings(centre, across, up, stout**0.7 * length * OUTLINE[:, 1:3], tall, power)
    shape = loft(rings, around(12), 0.03 * length, 0.025 * length, (0.7,))
    shape.vertices[:, 1] = np.maximum(shape.vertices[:, 1], sole)
    shares: dict[int, Floats] = {joint: np.ones(1)}
    if toe is not None:
        assert ball is not None
        past = (shape.vertices - ball) @ ahead
        toes = eased(0.5 + 0.5 * past / (BENT * length))
        shares = {joint: 1.0 - toes, toe: toes}
        body.covered.add(toe)
        body.taken.add(toe)
    body.made[side].append(moved(shape, shares))
    body.taken.add(joint)
