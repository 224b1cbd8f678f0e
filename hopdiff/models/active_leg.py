"""The active leg of the thesis model: its path while the other leg carries, and how legs go through the air."""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor

from hopdiff.character import Character
from hopdiff.models.steps import Steps
from hopdiff.numerics import safe_acos
from hopdiff.physics.legs import LegPose, flight_alpha, knee_offset

KNEES = ("printed", "flexion", "joined")  # the ways of `ThesisModel.knee`
# How fast the rate of stance fades from a joined knee: 2 makes it a cubic, with which it is stretched beyond straight
# in most runs from 5 m/s on, the everyday one at 7 m/s among them; 4 is the least with which that one is possible.
FADE = 4


class ActiveLeg(NamedTuple):
    """Columns (B, 1) of the leg that is in the air, in rad but for alpha.

    alpha: when theta_c peaks in flight, equation (6). angle_start, angle_end: theta_c when the other foot touches
    down and takes off. knee_start, knee_middle, knee_end: flexion then and half-way between.
    """

    alpha: Tensor
    angle_start: Tensor
    knee_start: Tensor
    knee_middle: Tensor
    angle_end: Tensor
    knee_end: Tensor

    @classmethod
    def of(cls, body: Character, steps: Steps, touchdown: LegPose) -> ActiveLeg:
        """Of a step's own leg, from either table of genes. touchdown: its pose at touchdown (B, 1)."""
        g = {name: value.unsqueeze(-1) for name, value in steps.genes.items()}
        if "alpha" in g:
            # The table of the thesis: theta_c and length of the leg, the parameters of its path.
            knees = (knee_at(body, g[f"active_length_{when}"] * body.leg_length) for when in ("start", "middle", "end"))
            start, middle, end = knees
            return cls(g["alpha"], g["active_angle_start"], start, middle, g["active_angle_end"], end)
        cycle = steps.cycle
        height = cycle.leg_length * torch.cos(cycle.touchdown_angle)
        end_rate = -(cycle.speed * height + cycle.touchdown_rate * cycle.reach) / cycle.leg_length**2
        alpha = flight_alpha(steps.genes["swing_reach"], end_rate, cycle.flight_time).unsqueeze(-1)
        angle_end = touchdown.angle - g["swing_reach"]
        # The other leg is on the ground when this one has to clear it.
        distance = (steps.other(height).unsqueeze(-1) - g["swing_clearance_end"]) / torch.cos(angle_end)
        return cls(
            alpha,
            g["swing_angle_start"],
            g["swing_knee_start"],
            g["swing_knee_middle"],
            angle_end,
            knee_at(body, distance),
        )

    def knee(self, p: Tensor) -> Tensor:
        """Flexion at shares p (B, F) of the way of HIP over the other foot: the parabola through its three values."""
        return (
            self.knee_start * (1 - p) * (1 - 2 * p)
            + 4 * self.knee_middle * p * (1 - p)
            + self.knee_end * p * (2 * p - 1)
        )

    def knee_slope(self) -> Tensor:
        """Slope of `knee` at its end, per share (B, 1)."""
        return self.knee_start - 4 * self.knee_middle + 3 * self.knee_end


def knee_at(body: Character, distance: Tensor) -> Tensor:
    """Flexion of the knee at which the foot is so far from the hip [m]."""
    return safe_acos((distance**2 - body.thigh**2 - body.shank**2) / (2.0 * body.thigh * body.shank))


def standing_knee_rate(
    body: Character, knee: Tensor, place: tuple[Tensor, Tensor], velocity: tuple[Tensor, Tensor]
) -> Tensor:
    """Rate of the knee of a leg whose foot stands [rad/s], from its flexion and HIP over the foot: forward and up."""
    outward = place[0] * velocity[0] + place[1] * velocity[1]
    return -outward / (body.thigh * body.shank * torch.sin(knee).clamp_min(1e-3))


def knee_in_flight(
    way: str, body: Character, p: Tensor, ends: tuple[Tensor, Tensor], rate: Tensor, duration: Tensor
) -> Tensor:
    """Flexion of a knee over the flight (B, F). p: t / T. ends: at its start and end. rate: before take-off [rad/s].

    way: "printed": theta_l, the angle at HIP between FOOT and JOINT, is linear in time, equation (5) with B_l = t / T.
    "flexion": the knee itself is. "joined": that too, but for what is missing of the rate before take-off, which is
    there at first and fades: linear + (rate - slope) t (1 - p)^FADE.
    """
    start, end = ends
    if way != "printed":
        linear = start + (end - start) * p
        jump = rate * duration - (end - start)
        return linear if way == "flexion" else linear + jump * p * (1.0 - p).clamp_min(1e-12) ** FADE
    first, last = (knee_offset(value, body.thigh, body.shank) for value in ends)
    offset = first + (last - first) * p
    # The law of sines in the triangle of HIP, JOINT and FOOT.
    return offset + torch.asin((body.thigh / body.shank * torch.sin(offset)).clamp(-1.0 + 1e-9, 1.0 - 1e-9))
