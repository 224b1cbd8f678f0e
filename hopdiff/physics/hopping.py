"""The hopper alone: where HIP, knees and feet of one or two legs are over many hops.

Kang (1999), sections 3.1 and 3.2, figures 3.3 to 3.7. A leg is two links of half its rest length l; a leg pose is
the angle theta_c of the line from HIP to FOOT from the vertical (foot ahead positive) and the half knee angle
theta_l between that line and the upper link, so that |HIP - FOOT| = l cos(theta_l). The knee points forward.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import torch
from scipy.integrate import solve_ivp
from torch import Tensor

from hopdiff.numerics import GRAVITY, safe_sqrt
from hopdiff.physics.hopper import flight_time, solve_cycle
from hopdiff.physics.stepping import Hops, flight_blend, step_hopper

FALLEN = 0.05  # HIP this share of the leg length above the ground counts as fallen, as in `step_hopper`


class Hopper(NamedTuple):
    """What a hopper is made of; plain numbers.

    leg_length: l [m]. touchdown_angle: theta_0 [rad]. speed: forward [m/s]. stiffness: kappa [N/m]. mass: m [kg].
    """

    leg_length: float
    touchdown_angle: float
    speed: float
    stiffness: float
    mass: float

    @property
    def reach(self) -> float:
        """How far HIP is behind the foot at touchdown [m]."""
        return self.leg_length * math.sin(self.touchdown_angle)

    @property
    def touchdown_height(self) -> float:
        """Height of HIP at touchdown [m]."""
        return self.leg_length * math.cos(self.touchdown_angle)


class Legs(NamedTuple):
    """How the legs move where no ground holds them; angles in rad.

    number: 1 or 2. alpha: when theta_c peaks in flight, equation (6), of two legs. flight_knee: knee flexion of a
    single leg half-way through its flight. angle_start, angle_end: theta_c of the active leg when the other foot
    touches down and takes off. knee_start, knee_middle, knee_end: its knee flexion then and half-way through.
    """

    number: int
    alpha: float
    flight_knee: float
    angle_start: float
    angle_end: float
    knee_start: float
    knee_middle: float
    knee_end: float


class Hopping(NamedTuple):
    """F frames of a hopper from its first touchdown to its last, or to its fall; places are (forward, up) [m].

    times: (F,) [s]. hip: (F, 2). feet, knees: (F, L, 2) of L legs. in_flight: (F,) bool. hop: (F,) from 0.
    carrier: (F,) the leg that stands or stood last. contact_times, flight_times: of every whole stance, a multiple of
    the frame interval, and flight, equation (4) [s]. apex_heights: of HIP in every whole flight [m].
    shortest: the shortest distance of HIP and foot in stance [m]. hops_done: hops that ended in a touchdown.
    fell: whether the last hop could not be ended, because the leg did not lift HIP back to the height of touchdown.
    """

    times: Tensor
    hip: Tensor
    feet: Tensor
    knees: Tensor
    in_flight: Tensor
    hop: Tensor
    carrier: Tensor
    contact_times: list[float]
    flight_times: list[float]
    apex_heights: list[float]
    shortest: float
    hops_done: int
    fell: bool


class FirstHop(NamedTuple):
    """The first hop between the frames; NaN where it does not get so far.

    contact, flight: [s]. landing_rate: vertical speed at the touchdown that ends it [m/s].
    """

    contact: float
    flight: float
    landing_rate: float


def periodic_rate(hopper: Hopper) -> float | None:
    """Vertical speed at touchdown (negative, m/s) of the hop that repeats itself, or None if there is none."""
    length, angle, speed = _column(hopper.leg_length), _column(hopper.touchdown_angle), _column(hopper.speed)
    cycle = solve_cycle(length, angle, speed, stiffness=_column(hopper.stiffness / hopper.mass))
    if not bool(cycle.converged):
        return None
    rate = float(cycle.touchdown_rate)
    # The cycle is solved for half a stance and mirrored; that could hide a leg that is stretched before its time.
    return rate if math.isclose(first_hop(hopper, rate).landing_rate, rate, rel_tol=1e-3) else None


def first_hop(hopper: Hopper, touchdown_rate: float) -> FirstHop:
    """Stance (2) and flight (3), (4) of a hop in the limit of no frame interval.

    touchdown_rate: vertical speed at touchdown, negative [m/s].
    """
    length, push = hopper.leg_length, hopper.stiffness / hopper.mass

    def slope(time: float, state: np.ndarray) -> tuple[float, float]:
        distance = math.hypot(hopper.speed * time - hopper.reach, state[0])
        return state[1], push * (length - distance) * state[0] / distance - GRAVITY

    def stretched(time: float, state: np.ndarray) -> float:
        return math.hypot(hopper.speed * time - hopper.reach, state[0]) - length

    def fallen(time: float, state: np.ndarray) -> float:
        found: float = state[0] - FALLEN * length
        return found

    stretched.terminal = fallen.terminal = True  # type: ignore[attr-defined]
    stretched.direction = 1.0  # type: ignore[attr-defined]
    # HIP moves on at its speed, so the leg is stretched at the latest when HIP is one leg length past the foot.
    stance = solve_ivp(
        slope,
        (0.0, 1.01 * (hopper.reach + length) / hopper.speed),
        (hopper.touchdown_height, touchdown_rate),
        method="DOP853",
        events=(stretched, fallen),
        rtol=1e-10,
        atol=1e-12,
    )
    if len(stance.t_events[0]) == 0:
        return FirstHop(math.nan, math.nan, math.nan)
    height, rate = stance.y_events[0][0]
    air = float(flight_time(_column(height), _column(rate), _column(hopper.touchdown_height)))
    air = air if air > 0 else math.nan
    return FirstHop(float(stance.t_events[0][0]), air, float(rate) - GRAVITY * air)


def hop_along(
    hopper: Hopper, legs: Legs, touchdown_rate: float, step: float, hops: int, max_frames: int
) -> Hopping | None:
    """Step a hopper for a number of hops and pose its legs on every frame.

    touchdown_rate: vertical speed at the first touchdown, negative [m/s]. step: h [s]. A fall ends it early.
    Returns None if it takes more than max_frames frames.
    """
    # One hop more is begun, so that the frame of the last touchdown is among the frames.
    stepped = step_hopper(
        _column(hopper.leg_length),
        _column(hopper.touchdown_angle),
        _column(hopper.speed),
        _column(hopper.stiffness / hopper.mass),
        _column(touchdown_rate),
        step,
        hops + 1,
        max_frames,
    )
    upright = stepped.alive[0]
    hop = stepped.hop[0]
    landed = int(hop[upright].max())
    if landed < hops and bool(upright[-1]):
        return None
    # All frames of the hops asked for, and the one on which the last of them touches down.
    count = int((upright & (hop < hops)).sum()) + (landed >= hops)
    frames = Hops(*(column[0, :count] for column in stepped))
    feet, knees = _pose(hopper, legs, frames)
    return _measured(legs, frames, feet, knees, step, min(landed, hops), landed < hops)


def _measured(legs: Legs, frames: Hops, feet: Tensor, knees: Tensor, step: float, done: int, fell: bool) -> Hopping:
    hip = torch.stack((frames.forward, frames.height), dim=-1)
    whole = [(frames.hop == k) & frames.in_flight for k in range(int(frames.hop.max()) + 1)]
    whole = [flying for flying in whole if bool(flying.any())]
    standing = ~frames.in_flight
    distance = torch.linalg.vector_norm(hip - torch.stack((frames.foot, torch.zeros_like(frames.foot)), -1), dim=-1)
    return Hopping(
        times=step * torch.arange(len(hip), dtype=torch.float64),
        hip=hip,
        feet=feet,
        knees=knees,
        in_flight=frames.in_flight,
        hop=frames.hop,
        carrier=frames.hop % legs.number,
        contact_times=[round(step * int((standing & (frames.hop == k)).sum()), 9) for k in range(len(whole))],
        flight_times=[float(frames.flight[flying][0]) for flying in whole],
        apex_heights=[float(frames.height[flying].max()) for flying in whole],
        shortest=float(distance[standing].min()),
        hops_done=done,
        fell=fell,
    )


def _pose(hopper: Hopper, legs: Legs, frames: Hops) -> tuple[Tensor, Tensor]:
    """Feet and knees (F, L, 2) [m] on all frames, hop by hop."""
    length = hopper.leg_length
    angle = torch.zeros(len(frames.hop), legs.number, dtype=torch.float64)
    fold = torch.zeros_like(angle)  # theta_l
    for k in range(int(frames.hop.max()) + 1):
        carrier, active = k % legs.number, (k + 1) % legs.number
        standing = ((frames.hop == k) & ~frames.in_flight).nonzero()[:, 0]
        flying = ((frames.hop == k) & frames.in_flight).nonzero()[:, 0]
        # The pose of the carrying leg follows from HIP, on the first frame of flight too: its foot is still there.
        held = torch.cat((standing, flying[:1]))
        ahead = frames.foot[held] - frames.forward[held]
        distance = safe_sqrt(ahead**2 + frames.height[held] ** 2)
        angle[held, carrier] = torch.atan2(ahead, frames.height[held])
        fold[held, carrier] = torch.acos((distance / length).clamp(max=1.0))
        if legs.number == 2:
            angle[held, active], fold[held, active] = _active_leg(legs, len(held))
        if len(flying) == 0:
            continue
        phase = frames.phase[flying]
        start_angle, start_fold = angle[flying[0]].clone(), fold[flying[0]].clone()
        if legs.number == 1:
            angle[flying, 0] = start_angle + (hopper.touchdown_angle - start_angle) * phase
            fold[flying, 0] = _fold_of_single_leg(phase, legs.flight_knee)
        else:
            turn = flight_blend(phase.unsqueeze(0), _column(legs.alpha))[0].unsqueeze(-1)
            end_angle, end_fold = torch.zeros(2, 2, dtype=torch.float64)
            end_angle[carrier], end_angle[active] = legs.angle_start, hopper.touchdown_angle
            end_fold[carrier] = 0.5 * legs.knee_start
            angle[flying] = start_angle + (end_angle - start_angle) * turn
            fold[flying] = start_fold + (end_fold - start_fold) * phase.unsqueeze(-1)
    hip = torch.stack((frames.forward, frames.height), dim=-1).unsqueeze(1)
    feet = hip + length * torch.cos(fold).unsqueeze(-1) * _downward(angle)
    knees = hip + 0.5 * length * _downward(angle + fold)
    return feet, knees


def _active_leg(legs: Legs, count: int) -> tuple[Tensor, Tensor]:
    """theta_c and theta_l of the active leg on `count` frames from touchdown to take-off of the other one.

    The thesis leaves its path open ("a function that expresses the motion of the foot"): here both angles ease from
    value to value.
    """
    share = torch.linspace(0.0, 1.0, count, dtype=torch.float64)
    angle = legs.angle_start + (legs.angle_end - legs.angle_start) * _ease(share)
    early = legs.knee_start + (legs.knee_middle - legs.knee_start) * _ease(2.0 * share)
    late = legs.knee_middle + (legs.knee_end - legs.knee_middle) * _ease(2.0 * share - 1.0)
    return angle, 0.5 * torch.where(share < 0.5, early, late)


def _fold_of_single_leg(phase: Tensor, flight_knee: float) -> Tensor:
    """theta_l of a single leg in flight: shorter by a parabola over the flight, so that its foot clears the ground.

    A length that changes at a steady rate lifts the foot at once; theta_l itself starts like a square root.
    """
    return torch.acos(1.0 - (1.0 - math.cos(0.5 * flight_knee)) * 4.0 * phase * (1.0 - phase))


def _ease(share: Tensor) -> Tensor:
    """From 0 to 1, at rest at both ends, and held there."""
    x = share.clamp(0.0, 1.0)
    return x**2 * (3.0 - 2.0 * x)


def _downward(angle: Tensor) -> Tensor:
    """Unit vectors (forward, up) that point down, turned forward by an angle."""
    return torch.stack((torch.sin(angle), -torch.cos(angle)), dim=-1)


def _column(value: float) -> Tensor:
    return torch.tensor([value], dtype=torch.float64)
