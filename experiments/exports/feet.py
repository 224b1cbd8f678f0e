"""How still feet stand in a motion, and how smoothly a loop goes on."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d
from torch import Tensor

from hopdiff.editing.leg_joints import SIDES
from hopdiff.export.anatomy import parts_of
from hopdiff.export.take import Take
from hopdiff.feet.contacts import spans
from hopdiff.geometry.clip import Clip

# Foot skating as in the code of Guided Motion Diffusion (Karunratanakul et al., ICCV 2023), which others use, too.
SKATE_FPS = 20.0  # frames/s
SKATE_HEIGHT = 0.05  # m
SKATE_SPEED = 0.5  # m/s
SKATE_WINDOW = 5  # frames


def toes(clip: Clip) -> Tensor:
    """(T, 2, 3) joints of the toes, at the balls that feet stand on, or of the ankles where there are none [m]."""
    places = clip.joint_positions()
    parts = parts_of(clip.skeleton)
    return places[:, [parts.get(f"{side}_toe", parts[f"{side}_ankle"]) for side in SIDES]]


@dataclass(frozen=True)
class Standing:
    """Of points that should stand: farthest from where they began, over the ground [m], fastest and mean speed [m/s],
    lowest and highest place [m]."""

    drift: float
    fastest: float
    mean: float
    lowest: float
    highest: float


def standing(points: Tensor, contact: Tensor, frame_time: float) -> Standing:
    """How far points (T, 2, 3) move over the ground while contact (T, 2) says that they stand."""
    ground = points[..., [0, 2]]
    pace = ground.diff(dim=0).norm(dim=-1) / frame_time
    drift = 0.0
    for side in range(2):
        for first, last in spans(contact[:, side]):
            own = ground[first : last + 1, side]
            drift = max(drift, float((own - own[0]).norm(dim=-1).max()))
    speed, height = pace[contact[1:] & contact[:-1]], points[..., 1][contact]
    if len(speed) == 0:
        return Standing(drift, math.nan, math.nan, math.nan, math.nan)
    return Standing(drift, float(speed.max()), float(speed.mean()), float(height.min()), float(height.max()))


def skating_ratio(take: Take) -> float:
    """Share of the intervals between frames, at 20 frames/s, in which either foot skates.

    A foot (the joint of its toes) skates if it is lower than 5 cm at both ends of an interval, its horizontal speed in
    it is above 0.5 m/s, and so is the mean of its speed over the 5 intervals about it (zero beyond the ends). The
    ground is at the lowest place of the feet.
    """
    feet = toes(take.resampled(SKATE_FPS, exact=True).clip).numpy()
    return float(np.mean(_skates(feet).any(axis=1)))


def _skates(feet: NDArray[np.float64]) -> NDArray[np.bool_]:
    """(T - 1, 2) when feet (T, 2, 3) skate."""
    speed = np.linalg.norm(np.diff(feet[..., [0, 2]], axis=0), axis=-1) * SKATE_FPS
    mean = uniform_filter1d(speed, SKATE_WINDOW, axis=0, mode="constant")
    low = feet[..., 1] - feet[..., 1].min() < SKATE_HEIGHT
    return low[:-1] & low[1:] & (speed > SKATE_SPEED) & (mean > SKATE_SPEED)


@dataclass(frozen=True)
class Seam:
    """Of a loop that goes on, over all joints. gap: between its last frame and the first of the next time [m].

    kink: change of the velocity of any joint at the seam; elsewhere: the largest between any two other neighbouring
    intervals [m/s].
    """

    gap: float
    kink: float
    elsewhere: float


def seam(clip: Clip) -> Seam:
    """How smoothly a loop that travels straight on goes on from its last frame."""
    places = clip.joint_positions()
    travel = (clip.root_position[-1] - clip.root_position[0]) * clip.root_position.new_tensor((1.0, 0.0, 1.0))
    velocity = places.diff(dim=0) / clip.frame_time
    turns = velocity.diff(dim=0).norm(dim=-1)
    return Seam(
        gap=float((places[0] + travel - places[-1]).norm(dim=-1).max()),
        kink=float((velocity[0] - velocity[-1]).norm(dim=-1).max()),
        elsewhere=float(turns.max()),
    )
