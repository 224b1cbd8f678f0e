"""The periodic sway against a plain integration in time."""

from __future__ import annotations

import pytest
import torch
from numpy.polynomial.chebyshev import Chebyshev

from hopdiff.numerics import chebyshev_nodes, differentiation_matrix
from hopdiff.physics.balance import periodic_sway, support_path, support_side

DTYPE = torch.float64


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_sway_is_where_a_long_run_ends_up(sign: float) -> None:
    durations = torch.tensor([[0.2, 0.13]], dtype=DTYPE)
    stiffness = torch.tensor([6.0], dtype=DTYPE)
    nodes = chebyshev_nodes(12, DTYPE, torch.device("cpu"))

    def push(t: torch.Tensor) -> torch.Tensor:
        return torch.sin(9.0 * t) + 0.3

    starts = torch.tensor([[0.0, 0.2]], dtype=DTYPE)
    sway = periodic_sway(push(starts.unsqueeze(-1) + durations.unsqueeze(-1) * nodes), stiffness, durations, sign)
    step, value = 2e-5, 0.0
    values = push((torch.arange(round(0.33 / step), dtype=DTYPE) + 0.5) * step).tolist()
    # The forcing of every second step has the sign of the symmetry; 20 steps are 40 time constants.
    for repeat in range(20):
        flip = sign**repeat
        for r in values:
            value = (value * (1.0 - 3.0 * step) + flip * r * step) / (1.0 + 3.0 * step)
    assert value == pytest.approx(sign**20 * float(sway[0, 0, 0]), abs=1e-6)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_sway_closes_and_obeys_its_equation(sign: float) -> None:
    durations = torch.tensor([[0.25, 0.1]], dtype=DTYPE)
    stiffness = torch.tensor([1.3], dtype=DTYPE)
    nodes = chebyshev_nodes(14, DTYPE, torch.device("cpu"))
    forcing = torch.stack((torch.cos(3 * nodes), torch.cos(3 + nodes)), dim=0).unsqueeze(0)
    sway = periodic_sway(forcing, stiffness, durations, sign)
    assert float(sway[0, 1, -1]) == pytest.approx(sign * float(sway[0, 0, 0]), abs=1e-12)
    assert float(sway[0, 1, 0]) == pytest.approx(float(sway[0, 0, -1]), abs=1e-12)
    curve = Chebyshev.fit(nodes.numpy(), sway[0, 0].numpy(), 13, domain=[0, 1])
    rate = torch.from_numpy(curve.deriv()(nodes.numpy())) / 0.25
    torch.testing.assert_close(rate + 1.3 * sway[0, 0], forcing[0, 0], atol=1e-6, rtol=0.0)


def test_the_target_runs_from_foot_to_foot() -> None:
    ends = torch.tensor([[0.0, 1.0]], dtype=DTYPE)
    air = support_path(ends, torch.tensor([0.5], dtype=DTYPE), torch.tensor([0.3], dtype=DTYPE))
    torch.testing.assert_close(air, torch.tensor([[-0.5, 0.3]], dtype=DTYPE))
    width = torch.tensor([0.04], dtype=DTYPE)
    assert support_side("stance", ends, width).tolist() == [[0.04, 0.04]]
    assert support_side("flight", ends, width).tolist() == [[0.04, -0.04]]


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("steps", [2, 3])
def test_different_steps_hand_over_to_each_other(sign: float, steps: int) -> None:
    """Two candidates: what the sway is at the end of one step, it is at the start of the next, and all obey the law."""
    rows, n = 2 * steps, 16
    nodes = chebyshev_nodes(n, DTYPE, torch.device("cpu"))
    random = torch.rand(rows, 4, generator=torch.Generator().manual_seed(5), dtype=DTYPE)
    durations, stiffness = 0.1 + 0.2 * random[:, :2], 1.0 + 8.0 * random[:, 2]
    forcing = torch.sin(random[:, 3, None, None] + torch.stack((3.0 * nodes, 3.0 + nodes)))
    sway = periodic_sway(forcing, stiffness, durations, sign, steps)
    begin, end = (values.view(steps, 2) for values in (sway[:, 0, 0], sway[:, 1, -1]))
    torch.testing.assert_close(begin, sign * end.roll(1, 0), rtol=0.0, atol=1e-12)
    torch.testing.assert_close(sway[:, 1, 0], sway[:, 0, -1], rtol=0.0, atol=1e-12)
    rate = sway @ differentiation_matrix(n, DTYPE, nodes.device).T / durations.unsqueeze(-1)
    torch.testing.assert_close(rate + stiffness[:, None, None] * sway, forcing, rtol=0.0, atol=1e-9)
    assert float((begin[0] - begin[1]).abs().min()) > 1e-3


def test_the_target_in_flight_moves_evenly() -> None:
    phase = torch.tensor([[0.25, 0.5]], dtype=DTYPE)
    air = support_path(phase, torch.tensor([0.5], dtype=DTYPE), torch.tensor([0.3], dtype=DTYPE))
    torch.testing.assert_close(air, torch.tensor([[-0.3, -0.1]], dtype=DTYPE))
    side = support_side("flight", phase, torch.tensor([0.04], dtype=DTYPE))
    torch.testing.assert_close(side, torch.tensor([[0.02, 0.0]], dtype=DTYPE))
