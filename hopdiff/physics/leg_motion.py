"""How a leg moves whose foot moves: rates and accelerations of its joints, in closed form."""

from __future__ import annotations

import torch
from torch import Tensor

from hopdiff.numerics import safe_sqrt
from hopdiff.physics.legs import LegMotion, LegPose, leg_pose


def leg_motion(foot: Tensor, rate: Tensor, acceleration: Tensor, thigh: float, shank: float) -> LegMotion:
    """The pose of `leg_pose` and how it moves, for the foot from the hip joint (3, ...), left, up and forward: its
    place [m], rate [m/s] and acceleration [m/s^2]. A knee that is set straight stands still.

    Near the straight knee rates and accelerations grow without bound: they are exact there, where those of a polynomial
    through the poses are not.
    """
    (left, up, forward), pace, bend = foot.unbind(0), rate.unbind(0), acceleration.unbind(0)
    pose, _ = leg_pose(left, up, forward, thigh, shank)
    # Half the first and second derivative of the squared distance, in the plane across and along the way.
    first = (foot * rate).unbind(0)
    second = (rate**2 + foot * acceleration).unbind(0)
    across = safe_sqrt(left**2 + up**2)
    across_rate = (first[0] + first[1]) / across
    across_bend = (second[0] + second[1] - across_rate**2) / across
    angle = _turning((forward, pace[2], bend[2]), (across, across_rate, across_bend))
    tilt = _turning((left, pace[0], bend[0]), (-up, -pace[1], -bend[1]))
    cosine, sine = torch.cos(pose.knee), torch.sin(pose.knee)
    bent = (left**2 + up**2 + forward**2 < (thigh + shank) ** 2) / (thigh * shank * sine)
    knee_rate = -(first[0] + first[1] + first[2]) * bent
    knee_bend = -(second[0] + second[1] + second[2]) * bent - knee_rate**2 * cosine / sine
    return LegMotion(pose, LegPose(angle[0], knee_rate, tilt[0]), LegPose(angle[1], knee_bend, tilt[1]))


def _turning(y: tuple[Tensor, Tensor, Tensor], x: tuple[Tensor, Tensor, Tensor]) -> tuple[Tensor, Tensor]:
    """First and second derivative of atan2(y, x), from values and derivatives of both."""
    square = y[0] ** 2 + x[0] ** 2
    rate = (y[1] * x[0] - y[0] * x[1]) / square
    return rate, (y[2] * x[0] - y[0] * x[2] - 2.0 * rate * (y[0] * y[1] + x[0] * x[1])) / square


def knee_offset_slopes(knee: Tensor, thigh: float, shank: float) -> tuple[Tensor, Tensor]:
    """First and second derivative of `knee_offset` by the flexion."""
    lean = thigh * shank * torch.cos(knee)
    square = thigh**2 + shank**2 + 2.0 * lean
    bend = thigh * shank * (shank**2 - thigh**2) * torch.sin(knee) / square**2
    return (shank**2 + lean) / square, bend
