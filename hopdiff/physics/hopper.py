"""The one-leg hopper: a mass on a massless spring leg that travels at constant horizontal speed.

Kang (1999), section 3.1. HIP is the mass point, FOOT the contact point, `l` the rest length of the leg,
theta_0 the angle of the leg from the vertical at touchdown; equations (1) to (4). Heights y are above the
ground, forward distances z are relative to the planted foot. All quantities are per candidate, shape (P,).
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import torch
from torch import Tensor
from torch.nn import functional

from hopdiff.numerics import (
    GRAVITY,
    chebyshev_interpolate,
    chebyshev_nodes,
    constant,
    differentiation_matrix,
    mirrored_half,
    safe_sqrt,
    second_differentiation_matrix,
)

STANCE_NODES = 12  # on half a stance; 12 nodes leave an error below 1e-9 of the leg length in the gene box
NEWTON_STEPS = {True: 5, False: 12}  # with the flight time given, and with the stiffness given, which is harder


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
    forward = -torch.sin(angle).unsqueeze(-1) * (1.0 - 2.0 * surging(0.5 * nodes, surge.unsqueeze(-1)))
    equations = _Equations.of(angle, gravity, forward, known, by_rate)
    shares = constant((*(0.5,) * STANCE_NODES, 0.7), torch.float64, length.device)

    with torch.no_grad():
        found = _first_guess(angle, gravity, forward, nodes, known, by_rate)
        for _ in range(NEWTON_STEPS[by_rate]):
            step = _solve(*equations.linearised(found))
            # A step that would throw HIP through the ground or turn the spring round is shortened.
            limit = (shares * found / step.abs().clamp_min(1e-30)).amin(-1, keepdim=True).clamp(max=1.0)
            found = found - limit * step
        error = equations.residual(found).abs().amax(-1)
        rate = found[:, :-1] @ first[0]
        sound = (found[:, :-1].amin(-1) > 0.05) & (found[:, -1] > 0) & (rate < 0)
        converged = (error < 1e-8) & sound & torch.isfinite(error)
        upright = torch.cat(
            (torch.cos(angle).unsqueeze(-1).expand(-1, STANCE_NODES), torch.ones_like(found[:, :1])), -1
        )
        found = torch.where(converged.unsqueeze(-1), found, upright)
        matrix, _ = equations.linearised(found)
    # Where nothing converged there is no gradient to carry.
    found = found - _solve(matrix, equations.residual(found)) * converged.unsqueeze(-1)
    height, push = found[:, :-1], found[:, -1]

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


class _Equations(NamedTuple):
    """What half a stance has to obey, in lengths of l and times of half the contact time.

    Unknowns (P, n + 1): heights on the nodes, and the push of the spring. Rows: touchdown height, equation of motion at
    the inner nodes, mid-stance rate, the quantity that is given.
    linear: (n + 1, n + 1) part of the rows that is the same for all. right: (P, n + 1) what they come to.
    forward_square: (P, n) of the way of HIP from the foot.
    """

    linear: Tensor
    right: Tensor
    forward_square: Tensor

    @classmethod
    def of(cls, angle: Tensor, gravity: Tensor, forward: Tensor, known: Tensor, by_rate: bool) -> _Equations:
        inner = gravity.unsqueeze(-1).expand(-1, STANCE_NODES - 2)
        ends = (torch.cos(angle), torch.zeros_like(known), known)
        touchdown, middle, excess = (end.unsqueeze(-1) for end in ends)
        right = torch.cat((touchdown, -inner, middle, excess), dim=-1)
        return cls(_linear_rows(STANCE_NODES, by_rate, angle.device), right, forward**2)

    def residual(self, found: Tensor) -> Tensor:
        """(P, n + 1)."""
        height = found[:, :-1]
        stretch = torch.rsqrt((self.forward_square + height**2).clamp_min(1e-12)) - 1.0
        return self._rows(found, found[:, -1:] * stretch * height)

    def _rows(self, found: Tensor, pull: Tensor) -> Tensor:
        return found @ self.linear.T - self.right - functional.pad(pull[:, 1:-1], (1, 2))

    def linearised(self, found: Tensor) -> tuple[Tensor, Tensor]:
        """Slopes of the residual (P, n + 1, n + 1) by the unknowns, and the residual."""
        n = STANCE_NODES
        height, push = found[:, :-1], found[:, -1:]
        square = height**2
        inverse = torch.rsqrt((self.forward_square + square).clamp_min(1e-12))
        lift = (inverse - 1.0) * height
        matrix = self.linear.repeat(len(found), 1, 1)
        matrix[:, 1 : n - 1, n] = -lift[:, 1:-1]
        inner = matrix.diagonal(dim1=1, dim2=2)[:, 1 : n - 1]
        inner -= (push * (inverse - 1.0 - square * inverse**3))[:, 1:-1]
        return matrix, self._rows(found, push * lift)


@lru_cache
def _linear_rows(n: int, by_rate: bool, device: torch.device) -> Tensor:
    """(n + 1, n + 1) rows of `_Equations` as far as they are linear and the same for all."""
    first = differentiation_matrix(n, torch.float64, device)
    rows = torch.zeros(n + 1, n + 1, dtype=torch.float64, device=device)
    rows[0, 0] = 1.0
    rows[1 : n - 1, :n] = second_differentiation_matrix(n, torch.float64, device)[1:-1]
    rows[n - 1, :n] = first[-1]
    if by_rate:
        rows[n, :n] = first[0]
    else:
        rows[n, n] = 1.0
    return rows


def _solve(matrix: Tensor, right: Tensor) -> Tensor:
    """Batched linear solve that gives numbers that are not finite for a singular member, and raises nothing."""
    found: Tensor = torch.linalg.solve_ex(matrix, right.unsqueeze(-1))[0].squeeze(-1)
    return found


def _first_guess(
    angle: Tensor, gravity: Tensor, forward: Tensor, nodes: Tensor, known: Tensor, by_rate: bool
) -> Tensor:
    """(P, n + 1) a quarter sine of height that fits the touchdown rate, and the spring that carries the mean force."""
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
        return torch.cat((height, known.unsqueeze(-1)), dim=-1)
    pull = (1.0 / torch.sqrt(forward**2 + height**2) - 1.0) * height
    push = (gravity - rate) / pull.mean(-1).clamp_min(1e-3)
    return torch.cat((height, push.unsqueeze(-1)), dim=-1)
