"""The thesis' own way of moving: frame by frame, with a fixed frame interval h.

Kang (1999), equations (1) to (6) and (10), (11). The hopper steps from any state for any number of hops; legs and
balance follow on the same frames. Contact ends on the first frame on which the leg is as long as at rest, so times
are multiples of h; `hopdiff.physics.hopper` finds the same run between the frames.
"""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor

from hopdiff.numerics import GRAVITY, safe_sqrt
from hopdiff.physics.hopper import flight_time


class Hops(NamedTuple):
    """Frames (P, F) of a hopper; a frame with `alive` False lies beyond what was asked or after a failure.

    forward, height: HIP [m]. foot: forward position of the contact point, planted or last planted [m].
    hop: number of the hop, from 0. in_flight: bool. phase: share of the stance distance, or of the flight, in [0, 1].
    takeoff_forward, takeoff_height: HIP at the take-off of this hop, zero before [m]. flight: duration T (4), zero
    before take-off [s].
    """

    forward: Tensor
    height: Tensor
    foot: Tensor
    hop: Tensor
    in_flight: Tensor
    phase: Tensor
    takeoff_forward: Tensor
    takeoff_height: Tensor
    flight: Tensor
    alive: Tensor


def step_hopper(
    leg_length: Tensor,
    touchdown_angle: Tensor,
    speed: Tensor,
    stiffness: Tensor,
    touchdown_rate: Tensor,
    step: float,
    hops: int,
    max_frames: int,
    landing_height: Tensor | None = None,
    flight_speed: Tensor | None = None,
) -> Hops:
    """Step a hopper through stance (2) and flight (3), (4) from touchdown (1).

    leg_length [m], touchdown_angle [rad], speed [m/s], stiffness kappa / m [1/s^2], touchdown_rate: vertical speed at
    the first touchdown [m/s]; all (P,). step: h [s]. landing_height: of HIP at the next touchdown [m], if the legs
    differ. flight_speed: forward speed in flight [m/s], if it is not that of stance. Ends after `hops` hops or
    `max_frames` frames. A hopper that falls to the ground or cannot rise again stops being alive.
    """
    reach, start_height = leg_length * torch.sin(touchdown_angle), leg_length * torch.cos(touchdown_angle)
    landing_height = start_height if landing_height is None else landing_height
    flight_speed = speed if flight_speed is None else flight_speed
    zero = torch.zeros_like(leg_length)
    forward, foot = -reach, zero
    height = start_height
    # The frame before the first: (2) needs it, and it carries the touchdown rate to second order in h.
    before = height - step * touchdown_rate - 0.5 * step**2 * GRAVITY
    hop = torch.zeros_like(leg_length, dtype=torch.long)
    in_flight = torch.zeros_like(leg_length, dtype=torch.bool)
    alive = torch.ones_like(in_flight)
    time, duration, takeoff_rate = zero, zero, zero
    takeoff_forward, takeoff_height = zero, zero
    frames: list[tuple[Tensor, ...]] = []
    for _ in range(max_frames):
        stance_phase = ((forward - foot + reach) / (2.0 * reach)).clamp(0.0, 1.0)
        phase = torch.where(in_flight, time / duration.clamp_min(1e-9), stance_phase)
        frames.append((forward, height, foot, hop, in_flight, phase, takeoff_forward, takeoff_height, duration, alive))
        if not bool(alive.any()):
            break
        length = safe_sqrt((forward - foot) ** 2 + height**2)
        lift = stiffness * (leg_length - length) * height / length - GRAVITY
        stance_next = lift * step**2 + 2.0 * height - before
        next_time = time + step
        flight_next = takeoff_height + takeoff_rate * next_time - 0.5 * GRAVITY * next_time**2
        next_forward = forward + torch.where(in_flight, flight_speed, speed) * step
        lands = in_flight & (next_time >= duration)
        next_height = torch.where(in_flight, torch.where(lands, landing_height, flight_next), stance_next)
        next_length = safe_sqrt((next_forward - foot) ** 2 + next_height**2)
        leaves = ~in_flight & (next_length >= leg_length)

        rate = (next_height - height) / step
        air = flight_time(next_height, rate, landing_height)
        takeoff_forward = torch.where(leaves, next_forward, torch.where(lands, zero, takeoff_forward))
        takeoff_height = torch.where(leaves, next_height, torch.where(lands, zero, takeoff_height))
        landing_rate = takeoff_rate - GRAVITY * duration
        takeoff_rate = torch.where(leaves, rate, takeoff_rate)
        fails = (leaves & ~(air > 0)) | (~in_flight & (next_height <= 0.05 * leg_length))
        duration = torch.where(leaves, torch.nan_to_num(air), torch.where(lands, zero, duration))
        time = torch.where(leaves | lands, zero, next_time)
        before = torch.where(lands, landing_height - step * landing_rate - 0.5 * step**2 * GRAVITY, height)
        foot = torch.where(lands, next_forward + reach, foot)
        hop = hop + (lands & alive)
        in_flight = (in_flight | leaves) & ~lands
        alive = alive & ~fails & (hop < hops)
        # A dead hopper stays where it is, so that nothing grows without bound.
        forward, height = torch.where(alive, next_forward, forward), torch.where(alive, next_height, height)
    return Hops(*(torch.stack(column, dim=-1) for column in zip(*frames, strict=True)))


def flight_blend(phase: Tensor, alpha: Tensor) -> Tensor:
    """B_c of equation (6), repaired: the parabola from 0 to 1 over the flight with its extremum at alpha.

    phase: t / T (P, F). alpha: (P,), above 1/2, its pole. As printed the linear term has T + (1 - 2 alpha) in its
    denominator, which is neither 1 at t = T nor free of units; a product is meant.
    """
    a = alpha.unsqueeze(-1)
    return (phase**2 - 2.0 * a * phase) / (1.0 - 2.0 * a)


def step_balance(previous: tuple[Tensor, Tensor, Tensor], error: Tensor, step: float, speed: Tensor) -> Tensor:
    """Equation (10) with (11) for a gain of one: the next angle from the last three (newest first) and the error.

    Rates are backward differences, so that (Zdot + Zddot h) h = 2 Z1 - 3 Z2 + Z3.
    """
    z1, z2, z3 = previous
    return z1 + 0.5 * (2.0 * z1 - 3.0 * z2 + z3 + error * step / speed)
