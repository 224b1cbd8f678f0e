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


def support_path(phase: Tensor, behind: Tensor, ahead: Tensor) -> Tensor:
    """Forward position of the target relative to HIP during flight (P, M) [m], equation (7).

    phase: (P, M) share of the flight. behind: (P,) how far the foot that left stays behind HIP at take-off; ahead:
    (P,) how far the other is ahead at touchdown [m]. In stance the target is the foot.
    """
    behind, ahead = behind.unsqueeze(-1), ahead.unsqueeze(-1)
    return (behind + ahead) * phase - behind


def support_side(kind: str, phase: Tensor, half_width: Tensor) -> Tensor:
    """Sideways position of the target during a left stance and the flight after it (P, M) [m], left positive."""
    side = half_width.unsqueeze(-1)
    return side.expand_as(phase) if kind == "stance" else side * (1.0 - 2.0 * phase)


def periodic_sway(
    forcing: Tensor, stiffness: Tensor, durations: Tensor, sign: float | Tensor, steps: int = 1
) -> Tensor:
    """Periodic solution of dU/dt + k U = r over `steps` steps, each seen as a left one.

    forcing: r (S P, ..., 2, N) on the Chebyshev nodes of stance and flight, the first step of all P candidates first.
    stiffness: k (S P, ...), positive [1/s]. durations: (S P, 2) [s]. sign: (...) +1 if U is handed over from step to
    step as it is (fore-aft), -1 if with the other sign (sideways, since every other step is seen in the mirror).
    Returns U (S P, ..., 2, N).
    """
    n = forcing.shape[-1]
    nodes = chebyshev_nodes(n, forcing.dtype, forcing.device)
    integral = integration_matrix(n, forcing.dtype, forcing.device)
    spans = durations.view(len(durations), *(1 for _ in stiffness.shape[1:]), 2, 1)
    contact, air = spans.unbind(-2)
    times = torch.stack((contact * nodes, contact + air * nodes), dim=-2)
    growth = torch.exp(stiffness[..., None, None] * times)
    stance, flight = ((growth * forcing) @ integral.T * spans).unbind(-2)
    area = torch.stack((stance, stance[..., -1:] + flight), dim=-2)
    # A step takes U to sign (area + U) / growth; what all steps together leave unchanged is the start.
    areas, growths = area[..., 1, -1].chunk(steps), growth[..., 1, -1].chunk(steps)
    offset, factor = torch.zeros_like(areas[0]), torch.ones_like(areas[0])
    for step_area, step_growth in zip(areas, growths, strict=True):
        offset, factor = sign * (step_area + offset) / step_growth, sign * factor / step_growth
    begin = [offset / (1.0 - factor)]
    for step_area, step_growth in zip(areas[:-1], growths[:-1], strict=True):
        begin.append(sign * (step_area + begin[-1]) / step_growth)
    return (torch.cat(begin)[..., None, None] + area) / growth
