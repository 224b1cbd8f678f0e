"""Where the ground's force acts on a foot, and whether the foot stays on the ground, above it, and does not slide."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.integrate import trapezoid

from experiments.physics.frames import Mask, at, counted, rate_inside, stretches, turning
from experiments.physics.momentum import Analysis
from experiments.physics.recording import SIDES, Array, carried

LOADED = 0.01  # body weights of vertical force from which on the place of the force is looked at


@dataclass(frozen=True, eq=False)
class Foot:
    """One foot: its rigid part moves with a joint, at `place` (T, 3) [m] and turned by `turn` (T, 3, 3).

    points: (T, N, 3) of its sole that may touch the ground, heel first [m]. tip: (T, 3) of the toes [m], if known.
    """

    place: Array
    turn: Array
    points: Array
    tip: Array | None

    @property
    def heading(self) -> Array:
        """(T, 3) horizontal, ahead: square to the foot's axis to the left, which stays nearly level."""
        left = self.turn[..., 0]
        ahead = np.stack((-left[:, 2], np.zeros(len(left)), left[:, 0]), axis=-1)
        return ahead / np.linalg.norm(ahead, axis=-1, keepdims=True)


def foot_of(found: Analysis, side: str) -> Foot | None:
    """A foot of heel, ball and toe; without ankles, the end of the shank; None where there is neither."""
    own = found.recording
    ankle, toe, knee = f"{side}_ankle", f"{side}_toe", f"{side}_knee"
    if ankle in own.names and toe in own.names and own.heel is not None:
        place, turn = found.joint(ankle)
        ball, bend = found.joint(toe)
        points = np.stack((place + carried(turn, own.heel), ball), axis=1)
        tip = ball + carried(bend, own.ends[toe]) if toe in own.ends else None
        return Foot(place, turn, points, tip)
    if knee in own.names and knee in own.ends:
        place, turn = found.joint(knee)
        return Foot(place, turn, (place + carried(turn, own.ends[knee]))[:, None], None)
    return None


def foot_figures(found: Analysis) -> dict[str, float]:
    """Figures of both feet, the worse one of each; none for a body whose feet are not known."""
    sides = [_one(found, foot, k) for k, side in enumerate(SIDES) if (foot := foot_of(found, side)) is not None]
    names = dict.fromkeys(name for one in sides for name in one)
    # NumPy's maximum, unlike Python's, is NaN where any number is.
    return {name: float(np.max([one[name] for one in sides if name in one])) for name in names}


def _one(found: Analysis, foot: Foot, side: int) -> dict[str, float]:
    own = found.recording
    phases = counted(own.frames, own.loop)
    stands = own.contact[:, side]
    lowest = foot.points[..., 1].min(axis=1)
    values = {}
    if (stands & phases).any():
        values["stance_depth_mm"] = -1e3 * float(lowest[stands & phases].min())
        values["stance_gap_mm"] = 1e3 * float(lowest[stands & phases].max())
    if (~stands & phases).any():
        values["swing_depth_mm"] = -1e3 * float(lowest[~stands & phases].min())
    if foot.tip is not None:
        values["toe_depth_mm"] = -1e3 * float(foot.tip[phases, 1].min())
    if own.force is not None and own.cop is not None:
        force, cop = own.force[:, side], own.cop[:, side]
        values |= _place(foot, cop, stands & phases & (force[:, 1] > LOADED * found.weight))
        # Before it presses, the force of a standing foot may have no place.
        missing = ~np.isfinite(cop).all(axis=-1) & (force[:, 1] < LOADED * found.weight)
        return values | slip(found, foot, cop, stands & ~missing)
    return values | (slip(found, foot, foot.points[:, 0], stands) if foot.tip is None else {})


def _place(foot: Foot, cop: Array, loaded: Mask) -> dict[str, float]:
    """How far the place of the force lies outside of heel to toe tip, beside that line, and off the ground."""
    if not loaded.any():
        return {}
    values = {"cop_height_mm": 1e3 * float(np.max(np.abs(cop[loaded, 1])))}
    if foot.tip is None:
        return values
    heel, ahead = foot.points[loaded, 0], foot.heading[loaded]
    aside = np.cross(ahead, (0.0, 1.0, 0.0))
    along, tip = (np.einsum("ti,ti->t", point[loaded] - heel, ahead) for point in (cop, foot.tip))
    outside = np.maximum(np.minimum(tip, 0.0) - along, along - np.maximum(tip, 0.0))
    beside = np.einsum("ti,ti->t", cop[loaded] - heel, aside)
    values["cop_excess_mm"] = 1e3 * float(np.max(np.maximum(outside, 0.0)))
    values["cop_aside_mm"] = 1e3 * float(np.max(np.abs(beside)))
    return values


def slip(found: Analysis, foot: Foot, points: Array, stands: Mask) -> dict[str, float]:
    """Farthest that the material of the rigid foot at some points (T, 3) moves within one stance, and fastest.

    The way is the integral of | v + w x (point - joint) |, differences taken within the stance. stands: (T,).
    """
    own = found.recording
    ways, speeds = [], []
    for frames in stretches(stands, own.loop):
        place, point = (at(values, frames, own.loop, own.travel) for values in (foot.place, points))
        turn = at(foot.turn, frames, own.loop)
        spin = turning(turn, rate_inside(turn, own.frame_time))
        speed = np.linalg.norm(rate_inside(place, own.frame_time) + np.cross(spin, point - place), axis=-1)
        ways.append(trapezoid(speed, dx=own.frame_time))
        speeds.append(speed.max())
    if not ways:
        return {}
    return {"slip_mm": 1e3 * float(np.max(ways)), "slip_speed_mm_s": 1e3 * float(np.max(speeds))}
