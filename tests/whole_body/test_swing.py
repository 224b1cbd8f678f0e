"""Curves through the air: values and rates where they are given."""

from __future__ import annotations

import pytest
import torch

from hopdiff.whole_body.swing import ANKLE_MOMENTS, MOMENTS, swing_basis
from tests.whole_body.bodies import DTYPE


@pytest.mark.parametrize("moments", [MOMENTS, ANKLE_MOMENTS, ()])
@pytest.mark.parametrize("smooth", [0, 1, 2])
def test_a_curve_has_what_it_is_given(moments: tuple[float, ...], smooth: int) -> None:
    """Ends and rates at both ends, and values in between; the rates by automatic differentiation."""
    count = 2 * (smooth + 1) + len(moments)
    given = torch.randn(1, count, generator=torch.Generator().manual_seed(0), dtype=DTYPE)
    phase = torch.tensor([[0.0, *moments, 1.0]], dtype=DTYPE, requires_grad=True)
    rates = [(swing_basis(phase, moments, smooth) @ given.unsqueeze(-1))[..., 0]]
    for _ in range(smooth):
        rates += torch.autograd.grad(rates[-1].sum(), phase, create_graph=True)
    found = [rates[order][0, 0] for order in range(smooth + 1)]
    found += list(rates[0][0, 1:-1])
    found += [rates[order][0, -1] for order in range(smooth + 1)]
    torch.testing.assert_close(torch.stack(found), given[0], rtol=0.0, atol=1e-9)


def test_a_cubic_is_met_exactly() -> None:
    phase = torch.linspace(0.0, 1.0, 21, dtype=DTYPE)
    x = phase

    def curve(x: torch.Tensor) -> torch.Tensor:
        return 0.3 - 2.0 * x + 0.5 * x**2 + 1.7 * x**3

    def rate(x: torch.Tensor) -> torch.Tensor:
        return -2.0 + x + 5.1 * x**2

    ends = torch.tensor([0.0, 1.0], dtype=DTYPE)
    for moments in (MOMENTS, ANKLE_MOMENTS, ()):
        inner = curve(torch.tensor(moments, dtype=DTYPE))
        first, last = (torch.stack((curve(end), rate(end))) for end in ends)
        found = swing_basis(phase.unsqueeze(0), moments, 1)[0] @ torch.cat((first, inner, last))
        torch.testing.assert_close(found, curve(x), rtol=0.0, atol=1e-12)
