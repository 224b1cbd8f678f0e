"""Bones of what is no part of a body."""

from __future__ import annotations

import numpy as np

from hopdiff.export.body.build import SHORT, UP, Build, unit
from hopdiff.export.body.loft import Rings, around, loft, moved

BONE = 0.12  # thickness in the length


def bones(body: Build) -> None:
    """Plain bones to joints and ends that no surface holds."""
    inside = body.covered | body.taken
    for joint, parent in enumerate(body.skeleton.parents):
        if body.whole and joint not in body.parts.values():
            continue
        # Fingers lie in the hand.
        if body.taken.intersection((joint, *body.skeleton.above(joint))):
            continue
        pairs = [(parent, body.places[joint])] if parent >= 0 and joint not in body.covered else []
        tip = body.end(joint)
        pairs += [(joint, tip)] if tip is not None and joint not in inside else []
        for owner, place in pairs:
            start = body.places[owner]
            length = float(np.linalg.norm(place - start))
            if length < SHORT:
                continue
            way = unit(place - start)
            deep = body.ahead if abs(float(way @ body.ahead)) < 0.8 else UP
            deep = unit(deep - (deep @ way) * way)
            share, size = np.array([0.05, 0.25, 0.95]), BONE * length * np.array([0.7, 1.0, 0.4])
            round_ = np.stack((size, size), axis=-1)
            rings = Rings.straight(start + share[:, None] * length * way, np.cross(way, deep), deep, round_, round_)
            side = "middle" if abs(place[0]) < 1e-3 else "left" if place[0] > 0 else "right"
            body.made[side].append(moved(loft(rings, around(10), 0.05 * length, 0.05 * length), {owner: np.ones(1)}))
