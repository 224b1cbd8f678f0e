"""A finished run: the clip and everything about it that plots and metrics show."""

from __future__ import annotations

from dataclasses import dataclass

from torch import Tensor

from hopdiff.geometry.clip import Clip

SIDES = ("left", "right")


@dataclass(frozen=True)
class Phase:
    """One phase of a stride. kind: "stance" or "flight"; side: the leg that carries (stance) or carried last."""

    kind: str
    side: str
    start: float
    end: float


@dataclass(frozen=True)
class Motion:
    """One stride (left stance, flight, right stance, flight), first and last frame one stride apart.

    clip: the full-body frames. times: (T,) [s].
    contact: (T, 2) bool, left and right foot on the ground.
    feet: (T, 2, 3) contact points of both feet in the world [m].
    com, com_target: (T, 3) actual centre of mass and the ground point it is steered to [m] (target y is 0).
    leg_force: (T, 2) force along each leg in body weights.
    angles: curves (T,) [rad] by name: "left_hip", "right_hip", "left_knee", "right_knee", "trunk",
        "left_shoulder", "right_shoulder", "left_elbow", "right_elbow"; flexion and forward lean positive.
    phases: the four phases in order of time.
    force, cop: (T, 2, 3) ground force on each foot in body weights, and its centre of pressure [m] (where the foot is
        in the air that of the nearest moment on the ground); None where the model knows no ground force.
    """

    clip: Clip
    times: Tensor
    contact: Tensor
    feet: Tensor
    com: Tensor
    com_target: Tensor
    leg_force: Tensor
    angles: dict[str, Tensor]
    phases: tuple[Phase, ...]
    force: Tensor | None = None
    cop: Tensor | None = None
