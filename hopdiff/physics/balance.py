"""Balance of the upper body: every joint answers the error of the centre of mass with its own gain eta.

Kang (1999), section 3.3. The target of the centre of mass is the supporting foot, or runs from one foot to the
next during flight (7); delta is the error on the ground plane (9); a joint angle Z follows (10) and (11). For a
vanishing frame step (10) becomes the first-order law dZ/dt = eta delta / v, which is what is solved here. All
angles about one axis then share one integral of the error, the sway U with dU/dt = delta: Z_j = eta_j U / v.
Stepping (10) frame by frame, as printed, is in `hopdiff.physics.stepping`.
"""

from __future__ import annotations

import torch
from torch import Tensor

from hopdiff.numerics import chebyshev_nodes, integration_matrix


def support_path(kind: str, phase: Tensor, contact: Tensor, flight: Tensor, speed: Tensor) -> Tensor:
    """Forward position of the target relative to HIP over one step (P, M) [m], equation (7).

    kind: "stance" or "flight". phase: (P, M) share of that phase. contact, flight, speed: (P,).
    """
    contact, flight, speed = contact.unsqueeze(-1), flight.unsqueeze(-1), speed.unsqueeze(-1)
    half = 0.5 * speed * contact
    if kind == "stance":
        return half * (1.0 - 2.0 * phase)
    # The target covers one step while HIP covers the flight.
    return half * (2.0 * phase - 1.0)


def support_side(kind: str, phase: Tensor, half_width: Tensor) -> Tensor:
    """Sideways position of the target during a left stance and the flight after it (P, M) [m], left positive."""
    side = half_width.unsqueeze(-1)
    return side.expand_as(phase) if kind == "stance" else side * (1.0 - 2.0 * phase)


def periodic_sway(forcing: Tensor, stiffness: Tensor, durations: Tensor, sign: float) -> Tensor:
    """Periodic solution of dU/dt + k U = r over one step.

    forcing: r (P, 2, N) on the Chebyshev nodes of stance and flight. stiffness: k (P,), positive [1/s].
    durations: (P, 2) [s]. sign: +1 if U repeats every step (fore-aft), -1 if it changes sign (sideways).
    Returns U (P, 2, N).
    """
    n = forcing.shape[-1]
    nodes = chebyshev_nodes(n, forcing.dtype, forcing.device)
    integral = integration_matrix(n, forcing.dtype, forcing.device)
    starts = torch.cat((torch.zeros_like(durations[:, :1]), durations[:, :1]), dim=-1)
    times = starts.unsqueeze(-1) + durations.unsqueeze(-1) * nodes
    growth = torch.exp(stiffness[:, None, None] * times)
    area = (growth * forcing) @ integral.T * durations.unsqueeze(-1)
    area = torch.stack((area[:, 0], area[:, 0, -1:] + area[:, 1]), dim=1)
    whole = growth[:, 1, -1]
    start = area[:, 1, -1] / (sign * whole - 1.0) if sign > 0 else -area[:, 1, -1] / (whole + 1.0)
    return (start[:, None, None] + area) / growth
