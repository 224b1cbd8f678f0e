"""Outlines of round-ended bars, ellipses and feet."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import shapely
from scipy.spatial import ConvexHull

from hopdiff.plots.view import Array

_TIP = 0.75  # thickness of the tips of the toes, in that of the sole
_WIDE = {"heel": 0.04, "ball": 0.1, "tip": 0.08}  # half widths between the round edges, in lengths of the foot


def capsule(start: Array, end: Array, radius_start: float, radius_end: float, corners: int = 12) -> Array:
    """Outline (K, 2) of a tapered bar with round ends."""
    axis = end - start
    length = float(np.hypot(*axis))
    if length <= abs(radius_start - radius_end):  # one circle swallows the other
        centre, radius = (start, radius_start) if radius_start >= radius_end else (end, radius_end)
        angle = np.linspace(0, 2 * np.pi, 2 * corners)
        return centre + radius * np.stack((np.cos(angle), np.sin(angle)), axis=1)
    heading = np.arctan2(axis[1], axis[0])
    tangent = np.arccos((radius_start - radius_end) / length)  # where the straight flanks touch both circles
    back = heading + np.linspace(tangent, 2 * np.pi - tangent, corners)
    front = heading + np.linspace(-tangent, tangent, corners)
    return np.concatenate(
        (
            start + radius_start * np.stack((np.cos(back), np.sin(back)), axis=1),
            end + radius_end * np.stack((np.cos(front), np.sin(front)), axis=1),
        )
    )


def ellipse(bottom: Array, top: Array, width: float, corners: int = 32) -> Array:
    """Outline (K, 2) of an ellipse between two points of its long axis; width in lengths of that axis."""
    along = (top - bottom) / 2
    across = width * np.array([-along[1], along[0]])
    angle = np.linspace(0, 2 * np.pi, corners, endpoint=False)[:, None]
    return (bottom + top) / 2 + np.cos(angle) * along + np.sin(angle) * across


def circle(centre: Array, radius: float, corners: int = 20) -> Array:
    """Outline (K, 2) of a circle."""
    angle = np.linspace(0, 2 * np.pi, corners, endpoint=False)
    return np.asarray(centre + radius * np.stack((np.cos(angle), np.sin(angle)), axis=1))


def hull(points: Array) -> Array:
    """The corners (K, 2) of the smallest convex outline around points (N, 2)."""
    found: Array = points[ConvexHull(points).vertices]
    return found


def foot(points: Array, left: Array, radii: tuple[float, float], flat: Callable[[Array], Array]) -> Array:
    """Outline (K, 2) of a foot whose sole lies on its heel, ball and tip, and bends at the ball.

    points: (4, 3) ankle, heel, ball and tip of the toes [m]. left: (3,) unit step to the side. radii: of the ankle, and
    half the thickness of the sole [m]. flat: puts points (..., 3) into the picture (..., 2).
    """
    ankle, heel, ball, tip = points
    length = float(np.linalg.norm(ball - heel) + np.linalg.norm(tip - ball))
    lifts = [radii[1] * _unit(np.cross(way, left)) for way in (ball - heel, tip - ball)]
    sizes = {"heel": radii[1], "ball": radii[1], "tip": _TIP * radii[1]}

    def pad(place: Array, name: str, lift: Array) -> Array:
        """Circles on either side of a point of the sole."""
        aside, raised = _WIDE[name] * length * left, place + sizes[name] / radii[1] * lift
        return np.concatenate([circle(flat(raised + sign * aside), sizes[name]) for sign in (-1.0, 1.0)])

    back = hull(
        np.concatenate((circle(flat(ankle), radii[0]), pad(heel, "heel", lifts[0]), pad(ball, "ball", lifts[0])))
    )
    front = hull(np.concatenate((pad(ball, "ball", lifts[1]), pad(tip, "tip", lifts[1]))))
    together = shapely.union(shapely.Polygon(back), shapely.Polygon(front))
    return np.asarray(together.exterior.coords, dtype=np.float64)[:-1]


def _unit(way: Array) -> Array:
    return np.asarray(way / max(float(np.linalg.norm(way)), 1e-9))
