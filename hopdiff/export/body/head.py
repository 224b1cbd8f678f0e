"""A head whose face tells from afar where it looks: skull, jaw, brow, nose and ears."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from hopdiff.export.body.build import DENSITY, UP, Build, unit
from hopdiff.export.body.loft import Floats, Rings, around, ball, eased, joined, loft, moved

SKULL = 0.75  # of the mass of head and neck
HIGH = 0.88  # of the way from the base of the neck to the crown that is head, from chin to crown
# From chin to crown, in the height of the head: height, half width, where the section is widest ahead of the ears, and
# its reach ahead of and behind there.
OUTLINE = np.array(
    [
        (0.005, 0.1, 0.24, 0.1, 0.16),
        (0.035, 0.155, 0.19, 0.185, 0.24),
        (0.09, 0.2, 0.14, 0.25, 0.26),
        (0.15, 0.232, 0.08, 0.305, 0.27),
        (0.21, 0.254, 0.05, 0.333, 0.3),
        (0.26, 0.268, 0.035, 0.342, 0.33),
        (0.31, 0.28, 0.02, 0.352, 0.36),
        (0.36, 0.291, 0.01, 0.362, 0.388),
        (0.42, 0.303, 0.0, 0.372, 0.412),
        (0.48, 0.313, -0.01, 0.382, 0.43),
        (0.54, 0.323, -0.02, 0.397, 0.44),
        (0.62, 0.333, -0.03, 0.41, 0.447),
        (0.72, 0.332, -0.04, 0.4, 0.436),
        (0.82, 0.3, -0.05, 0.357, 0.395),
        (0.9, 0.24, -0.06, 0.28, 0.315),
        (0.96, 0.155, -0.07, 0.18, 0.205),
    ]
)
# Of the face, in the height of the head: place to the side and up; how far it stands out; half width and half height.
FACE = (
    (0.0, 0.335, 0.09, 0.06, 0.055),  # tip of the nose
    (0.0, 0.42, 0.058, 0.05, 0.075),  # its back
    (0.14, 0.475, -0.03, 0.075, 0.05),  # eyes
    (0.11, 0.575, 0.014, 0.13, 0.04),  # brow
    (0.16, 0.35, 0.016, 0.1, 0.08),  # cheek
    (0.0, 0.2, 0.032, 0.11, 0.06),  # lips
    (0.0, 0.07, 0.022, 0.08, 0.04),  # chin
)
EAR = (0.4, -0.04, 0.13, 0.08, 0.045)  # height, ahead, half height, half depth, half thickness
NECK = 0.25  # thickness of a neck in the height of the head


@dataclass(frozen=True)
class Skull:
    """Where a head is: chin (3,) [m], its axis, left and ahead (3,), height from chin to crown [m]; thickness of its
    neck [m]; joint: which moves it; young: see `Build`."""

    chin: Floats
    up: Floats
    left: Floats
    ahead: Floats
    height: float
    neck: float
    joint: int
    young: float

    def at(self, height: float, ahead: float) -> Floats:
        """(3,) a point of the head [m], in its heights."""
        found: Floats = self.chin + self.height * (height * self.up + ahead * self.ahead)
        return found


def skull_of(body: Build, base: Floats | None) -> Skull | None:
    """The head above the base of a neck (3,); where no joint of neck or head is known, on what carries the arms."""
    if base is None:
        return None
    parts = body.parts
    first = parts.get("neck", parts.get("head"))
    joint = parts.get("head", first)
    if joint is None:
        joint = next((parts[part] for part in ("upper_chest", "chest", "waist", "pelvis") if part in parts), 0)
    crown = body.end(joint) if first is not None else None
    # A round head of that mass.
    around_ = (SKULL * body.masses["neck"] / DENSITY * 3.0 / (4.0 * math.pi)) ** (1.0 / 3.0)
    way = 1e-3 * UP if crown is None or (crown - base) @ UP <= 0.0 else crown - base
    # Some skeletons end where the skull begins.
    span = max(float(np.linalg.norm(way)), 2.7 * around_)
    up = unit(way) if float(unit(way) @ UP) > 0.8 else UP
    height = min((HIGH + 0.25 * body.young) * span, 4.0 * around_)
    left = unit(body.left - (body.left @ up) * up)
    neck = max(NECK * min(height, 2.6 * around_), 0.0)
    return Skull(base + (span - height) * up, up, left, np.cross(left, up), height, neck, joint, body.young)


def head(body: Build, skull: Skull) -> None:
    size, young = skull.height, skull.young
    # Large heads are rounder, with more of a skull above a smaller face.
    share, reach = _lower(OUTLINE[:, 0], young), size * OUTLINE[:, 1:]
    reach[:, [0, 2, 3]] *= 1.0 + 1.1 * young
    centre = skull.chin + size * share[:, None] * skull.up + reach[:, 1:2] * skull.ahead
    rings = Rings.straight(centre, skull.left, skull.ahead, reach[:, [0, 0]], reach[:, 2:], (2.15, 2.0))
    shape = loft(rings, around(26, 0.5), 0.004 * size, 0.04 * size, ())
    off = (shape.vertices - skull.chin) / size
    height, aside, front = off @ skull.up, off @ skull.left, off @ skull.ahead
    rise = np.zeros(len(off))
    for x, y, out, wide, tall in FACE:
        y = float(_lower(np.array(y), young))
        for sign in (1.0, -1.0) if x else (1.0,):
            here = np.exp(-(((aside - sign * (1.0 + young) * x) / wide) ** 2) - ((height - y) / tall) ** 2)
            rise += (1.0 - young) * out * here
    rise *= eased((front - 0.05) / 0.2)
    shape.vertices[:] += (size * rise)[:, None] * skull.ahead
    made = [moved(shape, {skull.joint: np.ones(1)})]
    up, ahead, tall, deep, thick = EAR
    for sign in (1.0, -1.0):
        place = (
            skull.at(float(_lower(np.array(up), young)), ahead) + sign * 0.3 * (1.0 + 1.1 * young) * size * skull.left
        )
        turned = unit(skull.ahead - 0.45 * sign * skull.left)
        axis = unit(skull.up - 0.2 * skull.ahead)
        flat = unit(np.cross(axis, turned))
        ear = ball(place, (tall * size * axis, deep * size * turned, thick * size * flat), 8, 4)
        made.append(moved(ear, {skull.joint: np.ones(1)}))
    body.made["middle"].append(joined(made))
    body.taken.add(skull.joint)
    known = {body.parts[part] for part in ("neck", "head") if part in body.parts}
    body.covered |= known | {joint for part in known for joint in body.skeleton.above(part)}


def _lower(height: Floats, young: float) -> Floats:
    """Heights in a head, from chin 0 to crown 1, where the face takes less of it."""
    found: Floats = height - 0.45 * young * np.sin(np.pi * height)
    return found
