"""The one-leg hopper: a mass on a massless spring leg that travels at constant horizontal speed.

Kang (1999), section 3.1. HIP is the mass point, FOOT the contact point, `l` the rest length of the leg,
theta_0 the angle of the leg from the vertical at touchdown; equations (1) to (4). Heights y are above the
ground, forward distances z are relative to the planted foot. All quantities are per candidate, shape (P,).
"""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor

from hopdiff.numerics import (
    GRAVITY,
    chebyshev_interpolate,
    chebyshev_nodes,
    differentiation_matrix,
    mirrored_half,
    safe_sqrt,
    second_differentiation_matrix,
)

STANCE_NODES = 12  # on half a stance; 12 nodes leave an error below 1e-9 of the leg length in the gene box
NEWTON_STEPS = {True: 6, False: 12}  # with the flight time given, and with the stiffness given, which is harder


class Cycle(NamedTuple):
    """A periodic hop: symmetric stance, then flight back to the touchdown state.

    leg_length: rest length l [m]. touchdown_angle: theta_0 [rad]. speed: in flight [m/s].
    contact_time, flight_time [s]. stiffness: kappa / m [1/s^2]. touchdown_rate: vertical speed at touchdown,
    negative [m/s]. half_stance: (P, STANCE_NODES) heights of HIP over the first half of stance [m].
    converged: (P,) bool. surge: by what share the mean speed of stance exceeds that of flight.
    """

    leg_length: Tensor
    touchdown_angle: Tensor
    speed: Tensor
    contact_time: Tensor
    flight_time: Tensor
    stiffness: Tensor
    touchdown_rate: Tensor
    half_stance: Tensor
    converged: Tensor
    surge: Tensor

    @property
    def step_time(self) -> Tensor:
        return self.contact_time + self.flight_time

    @property
    def reach(self) -> Tensor:
        """How far HIP is behind the foot at touchdown, and ahead of it at take-off (P,) [m]."""
        return self.leg_length * torch.sin(self.touchdown_angle)

    def stance_height(self, phase: Tensor) -> Tensor:
        """Height of HIP (P, M) at stance phases (P, M), 0 at touchdown, 1 at take-off [m]."""
        return chebyshev_interpolate(self.half_stance, 1.0 - (1.0 - 2.0 * phase).abs())

    def stance_height_nodes(self, nodes: int) -> Tensor:
        """Height of HIP (P, nodes) at the Chebyshev nodes of the whole stance [m]."""
        half = self.half_stance
        return half @ mirrored_half(nodes, half.shape[-1], half.dtype, half.device).T

    def stance_forward(self, phase: Tensor) -> Tensor:
        """Forward position of HIP relative to the planted foot (P, M) [m]."""
        return (2.0 * surging(phase, self.surge.unsqueeze(-1)) - 1.0) * self.reach.unsqueeze(-1)

    def flight_height(self, phase: Tensor) -> Tensor:
        """Height of HIP (P, M) at flight phases (P, M), equation (3) [m]."""
        time = phase * self.flight_time.unsqueeze(-1)
        height = self.leg_length * torch.cos(self.touchdown_angle)
        return height.unsqueeze(-1) - self.touchdown_rate.unsqueeze(-1) * time - 0.5 * GRAVITY * time**2

    def leg_force_bw(self, forward: Tensor, height: Tensor) -> Tensor:
        """Force along the leg in body weights for HIP positions (P, M) relative to the foot."""
        length = safe_sqrt(forward**2 + height**2)
        return self.stiffness.unsqueeze(-1) * (self.leg_length.unsqueeze(-1) - length) / GRAVITY


def surging(phase: Tensor, surge: Tensor) -> Tensor:
    """Share of the stance distance covered at a stance phase, both in [0, 1].

    With no surge the speed is constant. Otherwise it starts and ends at the speed of flight and swells smoothly in
    between, the same forwards and backwards in time, so that stance is shorter by 1 / (1 + surge).
    """
    swell = phase**3 * (10.0 - 15.0 * phase + 6.0 * phase**2)
    return (phase + surge * swell) / (1.0 + surge)


def flight_time(height: Tensor, rate: Tensor, end_height: Tensor) -> Tensor:
    """Duration of flight, equation (4): from `height` with vertical `rate` down to `end_height` [s].

    NaN where the end height is never reached.
    """
    radicand = rate**2 - 2.0 * GRAVITY * (end_height - height)
    duration = (rate + safe_sqrt(radicand)) / GRAVITY
    return torch.where(radicand > 0, duration, torch.full_like(duration, torch.nan))


def solve_cycle(
    leg_length: Tensor,
    touchdown_angle: Tensor,
    speed: Tensor,
    flight_time: Tensor | None = None,
    stiffness: Tensor | None = None,
    surge: Tensor | None = None,
) -> Cycle:
    """The periodic hop for a leg, an angle and a speed, given either its flight time or its stiffness kappa / m.

    With a forward speed that is the same forwards and backwards in time (constant, but for `surge`, see `surging`)
    a periodic stance is symmetric in time, so half of it is a boundary-value
    problem: touchdown height and vertical speed on one side, no vertical speed on the other. It is solved by
    Newton's method on Chebyshev nodes, without gradient, in float64; one more Newton step at the solution
    carries the gradient (implicit function theorem), with respect to all arguments.

    Arguments: (P,) each, in m, rad, m/s, s, 1/s^2 and 1. One stiffness can belong to two hops if the leg folds deeply;
    the one nearer to a linear spring is found then. Candidates without a solution come back with
    converged False and finite, meaningless numbers.
    """
    if (flight_time is None) == (stiffness is None):
        raise ValueError("give either flight_time or stiffness")
    dtype = leg_length.dtype
    given = flight_time if flight_time is not None else stiffness
    assert given is not None
    surge = torch.zeros_like(leg_length) if surge is None else surge
    length, angle, pace, given, surge = (
        x.double() for x in torch.broadcast_tensors(leg_length, touchdown_angle, speed, given, surge)
    )
    half_time = length * torch.sin(angle) / (pace * (1.0 + surge))
    contact_time = 2.0 * half_time
    # Lengths in units of l, times in units of half the contact time.
    gravity = GRAVITY * half_time**2 / length
    # What is given fixes the rate at touchdown or the push of the spring.
    by_rate = flight_time is not None
    known = -0.5 * GRAVITY * given * half_time / length if by_rate else given * half_time**2

    nodes = chebyshev_nodes(STANCE_NODES, torch.float64, length.device)
    first = differentiation_matrix(STANCE_NODES, torch.float64, length.device)
    second = second_differentiation_matrix(STANCE_NODES, torch.float64, length.device)
    forward = -torch.sin(angle).unsqueeze(-1) * (1.0 - 2.0 * surging(0.5 * nodes, surge.unsqueeze(-1)))

    def residual(height: Tensor, push: Tensor) -> Tensor:
        """Rows: touchdown height, equation of motion at the inner nodes, mid-stance rate, the known quantity."""
        stretch = 1.0 / safe_sqrt(forward**2 + height**2) - 1.0
        motion = height @ second.T + gravity.unsqueeze(-1) - push.unsqueeze(-1) * stretch * height
        start = height[:, 0] - torch.cos(angle)
        middle = height @ first[-1]
        excess = (height @ first[0] if by_rate else push) - known
        return torch.cat((start.unsqueeze(-1), motion[:, 1:-1], middle.unsqueeze(-1), excess.unsqueeze(-1)), dim=-1)

    def jacobian(height: Tensor, push: Tensor) -> Tensor:
        n = STANCE_NODES
        square = forward**2 + height**2
        inverse = 1.0 / safe_sqrt(square)
        matrix = height.new_zeros(height.shape[0], n + 1, n + 1)
        matrix[:, 0, 0] = 1.0
        matrix[:, 1 : n - 1, :n] = second[1:-1]
        slope = push.unsqueeze(-1) * (inverse - 1.0 - height**2 * inverse**3)
        inner = torch.arange(1, n - 1, device=height.device)
        matrix[:, inner, inner] -= slope[:, 1:-1]
        matrix[:, 1 : n - 1, n] = -((inverse - 1.0) * height)[:, 1:-1]
        matrix[:, n - 1, :n] = first[-1]
        if by_rate:
            matrix[:, n, :n] = first[0]
        else:
            matrix[:, n, n] = 1.0
        return matrix

    with torch.no_grad():
        height, push = _first_guess(angle, gravity, forward, nodes, known, by_rate)
        for _ in range(NEWTON_STEPS[by_rate]):
            step = _solve(jacobian(height, push), residual(height, push))
            # A step that would throw HIP through the ground or turn the spring round is shortened.
            limit = torch.minimum(
                (0.5 * height / step[:, :-1].abs().clamp_min(1e-30)).amin(-1),
                0.7 * push / step[:, -1].abs().clamp_min(1e-30),
            ).clamp(max=1.0)
            height = height - limit.unsqueeze(-1) * step[:, :-1]
            push = push - limit * step[:, -1]
        error = residual(height, push).abs().amax(-1)
        rate = height @ first[0]
        converged = (error < 1e-8) & (height.amin(-1) > 0.05) & (push > 0) & (rate < 0) & torch.isfinite(error)
        height = torch.where(converged.unsqueeze(-1), height, torch.cos(angle).unsqueeze(-1).expand_as(height))
        push = torch.where(converged, push, torch.ones_like(push))
        matrix = jacobian(height, push)
    # Where nothing converged there is no gradient to carry.
    correction = _solve(matrix, residual(height, push)) * converged.unsqueeze(-1)
    height = height - correction[:, :-1]
    push = push - correction[:, -1]

    rate = (height @ first[0]) * length / half_time
    flight = given if by_rate else -2.0 * rate / GRAVITY
    return Cycle(
        leg_length=length.to(dtype),
        touchdown_angle=angle.to(dtype),
        speed=pace.to(dtype),
        contact_time=contact_time.to(dtype),
        flight_time=flight.to(dtype),
        stiffness=(push / half_time**2).to(dtype),
        touchdown_rate=rate.to(dtype),
        half_stance=(height * length.unsqueeze(-1)).to(dtype),
        converged=converged,
        surge=surge.to(dtype),
    )


def _solve(matrix: Tensor, right: Tensor) -> Tensor:
    """Batched linear solve that gives numbers that are not finite for a singular member, and raises nothing."""
    found: Tensor = torch.linalg.solve_ex(matrix, right.unsqueeze(-1))[0].squeeze(-1)
    return found


def _first_guess(
    angle: Tensor, gravity: Tensor, forward: Tensor, nodes: Tensor, known: Tensor, by_rate: bool
) -> tuple[Tensor, Tensor]:
    """A quarter sine of height that fits the touchdown rate, and the spring that carries the mean force."""
    if by_rate:
        rate = known
    else:
        # A linear spring of this push swings with frequency sqrt(push); from its half period the rate follows.
        omega = torch.sqrt(known)
        beyond = torch.tan((omega - 0.5 * torch.pi).clamp(0.05, 1.3))
        rate = -(gravity / omega) * beyond.reciprocal().clamp(0.1, 5.0)
    depth = (-rate * 2.0 / torch.pi).clamp(max=0.6)
    height = torch.cos(angle).unsqueeze(-1) - depth.unsqueeze(-1) * torch.sin(0.5 * torch.pi * nodes)
    if not by_rate:
        return height, known.clone()
    pull = (1.0 / torch.sqrt(forward**2 + height**2) - 1.0) * height
    return height, (gravity - rate) / pull.mean(-1).clamp_min(1e-3)
