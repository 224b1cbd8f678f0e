"""Two legs on the hopper: where each leg is over a whole stride.

Kang (1999), section 3.2. One leg is followed from its touchdown through four phases of a symmetric run:
stance, flight, swing (the other leg stands), flight. The other leg does the same half a stride later.
A leg pose is (angle, knee, tilt): the angle of the hip-to-foot line from the vertical in the sagittal plane
(forward positive), knee flexion, and the sideways tilt of the leg plane (foot to the left positive) [rad].

The stance pose follows from geometry (foot pinned, hip carried by the hopper). Through the air the pose runs on
smooth curves that leave and meet the stance with its own rates, so that the foot is at rest on the ground at
take-off and at touchdown.
"""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor

from hopdiff.numerics import hermite_motion, safe_acos, safe_sqrt, smooth_max

FLIGHT_ROOM = 0.8  # share of the way to the straight knee that follow-through may use
TRAIL_ROOM = 0.15  # rad, how far the leg may trail behind its take-off angle before it swings back
STRAIGHTEST_KNEE = 0.06  # rad, the knee never comes closer to straight than this in the air


Piece = tuple[Tensor, ...]  # a cubic: start, end, start_rate, end_rate and duration, columns (P, 1)
Curve = tuple[Tensor, ...]  # values with first and second derivative by time, (P, M) each


class LegPose(NamedTuple):
    angle: Tensor
    knee: Tensor
    tilt: Tensor


class LegMotion(NamedTuple):
    """A leg pose with its rates [rad/s] and accelerations [rad/s^2]."""

    pose: LegPose
    rate: LegPose
    acceleration: LegPose


class SwingGenes(NamedTuple):
    """What is free in the path of the active leg (P,), angles in rad.

    reach: angle that the leg swings forward during the flight before touchdown.
    angle_start: leg angle when the other foot touches down. knee_start, knee_middle: knee flexion when
    the other foot touches down and half-way through its stance. clearance_end: height of the foot above the ground
    when the other foot takes off [m].
    """

    reach: Tensor
    angle_start: Tensor
    knee_start: Tensor
    knee_middle: Tensor
    clearance_end: Tensor


def leg_pose(left: Tensor, up: Tensor, forward: Tensor, thigh: float, shank: float) -> tuple[LegPose, Tensor]:
    """Pose of a two-segment leg that reaches from hip to foot, knee forward.

    left, up, forward: (...) the foot relative to the hip joint [m]. Returns the pose and the reach: distance over
    the length of the straight leg (above 1 the knee is set straight).
    """
    across = left**2 + up**2
    square = across + forward**2
    knee = safe_acos((square - thigh**2 - shank**2) / (2.0 * thigh * shank))
    pose = LegPose(torch.atan2(forward, safe_sqrt(across)), knee, torch.atan2(left, -up))
    return pose, safe_sqrt(square) / (thigh + shank)


def knee_offset(knee: Tensor, thigh: float, shank: float) -> Tensor:
    """Angle between thigh and hip-to-foot line for a knee flexion [rad]."""
    return torch.atan2(shank * torch.sin(knee), thigh + shank * torch.cos(knee))


def leg_reach(knee: Tensor, thigh: float, shank: float) -> Tensor:
    """Distance from hip to foot for a knee flexion [m]."""
    return safe_sqrt(thigh**2 + shank**2 + 2.0 * thigh * shank * torch.cos(knee))


class Swing(NamedTuple):
    """The leg through the air, from its take-off to its next touchdown; every curve is analytic in time.

    All fields are columns (P, 1), so that they meet phases (P, M). contact, flight: phase durations [s].
    alpha: peak time of the leg angle before touchdown, see flight_alpha. knees: flexion at take-off, at the other
    foot's touchdown, half-way through its stance, at its take-off, at touchdown, and their rates. *_power: how fast
    the rates that the stance leaves and asks for fade into the air.
    """

    contact: Tensor
    flight: Tensor
    alpha: Tensor
    start: LegPose
    start_rate: LegPose
    end: LegPose
    end_rate: LegPose
    angle_start: Tensor
    angle_start_rate: Tensor
    angle_end: Tensor
    angle_end_rate: Tensor
    knees: tuple[Tensor, ...]
    knee_rates: tuple[Tensor, ...]
    trail_power: Tensor
    follow_power: Tensor
    reach_power: Tensor

    def first_flight(self, x: Tensor) -> LegMotion:
        """At shares x (P, M) of the flight after take-off."""
        still = torch.zeros_like(self.flight)
        swung = (self.start.angle, self.angle_start, still, self.angle_start_rate, self.flight)
        angle, knee, tilt = _curves(
            (x, swung), (x, self._knee(0, self.flight)), (self._whole_share(x * self.flight), self._tilt())
        )
        leaving = torch.stack((self.start_rate.angle, self.start_rate.knee), dim=1)
        powers = torch.stack((self.trail_power, self.follow_power), dim=1)
        fading = _transient(x.unsqueeze(1), leaving, self.flight.unsqueeze(1), powers)
        trail, follow = zip(*(part.unbind(1) for part in fading), strict=True)
        return _motion(_plus(angle, trail), _plus(knee, follow), tilt)

    def swing(self, x: Tensor) -> LegMotion:
        """At shares x (P, M) of the other leg's stance."""
        swung = (self.angle_start, self.angle_end, self.angle_start_rate, self.angle_end_rate, self.contact)
        half, twice = 0.5 * self.contact, 2.0 * x
        angle, early, late, tilt = _curves(
            (x, swung),
            (twice.clamp(max=1.0), self._knee(1, half)),
            ((twice - 1.0).clamp(min=0.0), self._knee(2, half)),
            (self._whole_share(self.flight + x * self.contact), self._tilt()),
        )
        first = x < 0.5
        knee = tuple(torch.where(first, a, b) for a, b in zip(early, late, strict=True))
        return _motion(angle, knee, tilt)

    def last_flight(self, x: Tensor) -> LegMotion:
        """At shares x (P, M) of the flight before touchdown."""
        # Equation (6) of Kang (1999): this cubic is the parabola in time whose extremum lies at alpha T.
        swung = (self.angle_end, self.end.angle, self.angle_end_rate, self.end_rate.angle, self.flight)
        tilt_share = self._whole_share(self.flight + self.contact + x * self.flight)
        angle, knee, tilt = _curves((x, swung), (x, self._knee(3, self.flight)), (tilt_share, self._tilt()))
        # Seen backwards in time, which turns rates round.
        value, rate, bend = _transient(1.0 - x, -self.end_rate.knee, self.flight, self.reach_power)
        return _motion(angle, _plus(knee, (value, -rate, bend)), tilt)

    def _knee(self, i: int, duration: Tensor) -> Piece:
        """Piece i of the knee's spline."""
        return (*self.knees[i : i + 2], *self.knee_rates[i : i + 2], duration)

    def _tilt(self) -> Piece:
        """One piece over the whole time in the air."""
        whole = 2.0 * self.flight + self.contact
        return self.start.tilt, self.end.tilt, self.start_rate.tilt, self.end_rate.tilt, whole

    def _whole_share(self, time: Tensor) -> Tensor:
        return time / (2.0 * self.flight + self.contact)


def _motion(angle: Curve, knee: Curve, tilt: Curve) -> LegMotion:
    return LegMotion(*(LegPose(*parts) for parts in zip(angle, knee, tilt, strict=True)))


def _plus(a: Curve, b: Curve) -> Curve:
    return tuple(x + y for x, y in zip(a, b, strict=True))


def _curves(*curves: tuple[Tensor, Piece]) -> list[Curve]:
    """Cubics at shares (P, M) of each, all at once."""
    shares, pieces = zip(*curves, strict=True)
    columns = (torch.stack(column, dim=1) for column in zip(*pieces, strict=True))
    found = hermite_motion(torch.stack(torch.broadcast_tensors(*shares), dim=1), *columns)
    return list(zip(*(part.unbind(1) for part in found), strict=True))


def _transient(x: Tensor, rate: Tensor, duration: Tensor, power: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """A curve that starts at zero with `rate`, swings out and fades, and its first and second derivative by time.

    It is rate t (1 - x)^power with t = x duration and a power above 2.
    """
    rest = (1.0 - x).clamp_min(1e-12)
    fading = rest ** (power - 2.0)
    once = fading * rest
    value = rate * duration * x * once * rest
    pace = rate * once * (rest - power * x)
    bend = (rate * power / duration) * ((power - 1.0) * x * fading - 2.0 * once)
    return value, pace, bend


def _fade_powers(
    flight: Tensor, start: LegPose, start_rate: LegPose, end: LegPose, end_rate: LegPose
) -> tuple[Tensor, ...]:
    """Powers of `_transient` for which leg angle and knee after take-off, and the knee before touchdown, keep to their
    room.

    The extremum |rate| T m^m / (m + 1)^(m + 1) is close to |rate| T / (e (m + 1/2)).
    """
    bends = torch.cat((start.knee, end.knee), dim=-1)
    rooms = FLIGHT_ROOM * (bends - STRAIGHTEST_KNEE).clamp_min(0.02)
    rooms = torch.cat((torch.full_like(flight, TRAIL_ROOM), rooms), dim=-1)
    rates = torch.cat((start_rate.angle, start_rate.knee, end_rate.knee), dim=-1)
    wanted = rates.abs() * flight / (torch.e * rooms) - 0.5
    return tuple(smooth_max(wanted, 2.5, 0.5).unsqueeze(-1).unbind(1))


def flight_alpha(reach: Tensor, end_rate: Tensor, duration: Tensor) -> Tensor:
    """alpha (P,) of Kang (1999), equation (6): when the leg angle peaks, as a share of the flight.

    The parabola B_c with its extremum at alpha T sweeps `reach` [rad] and ends with the rate of touchdown
    (`end_rate`, backward, negative [rad/s]); that leaves alpha. Reach > 0 keeps it between its pole at 1/2 and 1.
    """
    ratio = -2.0 * reach / (end_rate * duration)
    return (1.0 + ratio) / (2.0 + ratio)


def make_swing(
    contact: Tensor,
    flight: Tensor,
    start: LegPose,
    start_rate: LegPose,
    end: LegPose,
    end_rate: LegPose,
    genes: SwingGenes,
    hip_height: Tensor,
    thigh: float,
    shank: float,
) -> Swing:
    """Curves through the air between the pose at take-off (start) and at touchdown (end); all arguments (P,).

    hip_height: of the swinging leg's hip joint when the other foot takes off [m].
    """
    contact, flight, hip_height = (x.unsqueeze(-1) for x in (contact, flight, hip_height))
    start, start_rate, end, end_rate = (
        LegPose(*(x.unsqueeze(-1) for x in pose)) for pose in (start, start_rate, end, end_rate)
    )
    genes = SwingGenes(*(x.unsqueeze(-1) for x in genes))
    alpha = flight_alpha(genes.reach, end_rate.angle, flight)
    angle_end = end.angle - genes.reach
    angle_end_rate = -end_rate.angle * alpha / (1.0 - alpha)
    reach = (hip_height - genes.clearance_end) / torch.cos(angle_end)
    knee_end = safe_acos((reach**2 - thigh**2 - shank**2) / (2.0 * thigh * shank))
    # The rate at the inner knot that makes the two cubics share their curvature.
    slope_1 = (genes.angle_start - start.angle) / flight
    slope_2 = (angle_end - genes.angle_start) / contact
    angle_start_rate = (3.0 * (contact * slope_1 + flight * slope_2) - flight * angle_end_rate) / (
        2.0 * (contact + flight)
    )
    knees = (start.knee, genes.knee_start, genes.knee_middle, knee_end, end.knee)
    return Swing(
        contact,
        flight,
        alpha,
        start,
        start_rate,
        end,
        end_rate,
        genes.angle_start,
        angle_start_rate,
        angle_end,
        angle_end_rate,
        knees,
        _spline_rates(knees, (flight, 0.5 * contact, 0.5 * contact, flight)),
        *_fade_powers(flight, start, start_rate, end, end_rate),
    )


def _spline_rates(values: tuple[Tensor, ...], spans: tuple[Tensor, ...]) -> tuple[Tensor, ...]:
    """Rates at five knots of the cubic spline with zero end rates (three inner unknowns, solved by elimination)."""
    h = spans
    value, span = torch.cat(values, dim=-1), torch.cat(spans, dim=-1)
    slope = value.diff(dim=-1) / span
    right = list((3.0 * (span[:, 1:] * slope[:, :-1] + span[:, :-1] * slope[:, 1:])).split(1, dim=-1))
    diagonal = list((2.0 * (span[:, :-1] + span[:, 1:])).split(1, dim=-1))
    # Row i: h[i+1] m_i + 2 (h[i] + h[i+1]) m_(i+1) + h[i] m_(i+2) = right[i]
    w1 = h[2] / diagonal[0]
    diagonal[1] = diagonal[1] - w1 * h[0]
    right[1] = right[1] - w1 * right[0]
    w2 = h[3] / diagonal[1]
    diagonal[2] = diagonal[2] - w2 * h[1]
    right[2] = right[2] - w2 * right[1]
    m3 = right[2] / diagonal[2]
    m2 = (right[1] - h[1] * m3) / diagonal[1]
    m1 = (right[0] - h[0] * m2) / diagonal[0]
    zero = torch.zeros_like(m1)
    return zero, m1, m2, m3, zero
