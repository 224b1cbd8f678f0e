"""Functions of time on the phases of a movement, each on Chebyshev nodes over its own duration.

P candidates share the number of nodes of every phase, and each has its own durations, so that calculus is one product
with a fixed matrix and one scaling.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
import torch
from torch import Tensor

from hopdiff.numerics import (
    chebyshev_interpolate,
    chebyshev_interpolation_numpy,
    chebyshev_nodes,
    cross,
    differentiation_matrix,
    integration_matrix,
)
from hopdiff.whole_body.plan import FINER


@lru_cache(maxsize=64)
def _derivative(nodes: tuple[int, ...], dtype: torch.dtype, device: torch.device) -> Tensor:
    found: Tensor = torch.block_diag(*(differentiation_matrix(n, dtype, device) for n in nodes)).T.contiguous()
    return found


@lru_cache(maxsize=64)
def _integral(nodes: tuple[int, ...], dtype: torch.dtype, device: torch.device) -> Tensor:
    """(M, M) running integral from the start of the first phase, for values already scaled by the durations."""
    rows = []
    for k, n in enumerate(nodes):
        own = integration_matrix(n, dtype, device)
        before = [integration_matrix(m, dtype, device)[-1].expand(n, -1) for m in nodes[:k]]
        after = [own.new_zeros(n, m) for m in nodes[k + 1 :]]
        rows.append(torch.cat((*before, own, *after), dim=1))
    return torch.cat(rows).T.contiguous()


@lru_cache(maxsize=64)
def _owners(nodes: tuple[int, ...], device: torch.device) -> Tensor:
    """(M,) the phase that each node belongs to."""
    return torch.as_tensor(np.repeat(np.arange(len(nodes)), nodes), device=device)


@lru_cache(maxsize=64)
def _places(nodes: tuple[int, ...], dtype: torch.dtype, device: torch.device) -> tuple[Tensor, Tensor]:
    """(M,) each node's place in its phase, 0 to 1, and its weight in the integral over the phase."""
    places = torch.cat([chebyshev_nodes(n, dtype, device) for n in nodes])
    return places, torch.cat([integration_matrix(n, dtype, device)[-1] for n in nodes])


@lru_cache(maxsize=64)
def _to_fine(nodes: tuple[int, ...], fine: tuple[int, ...], dtype: torch.dtype, device: torch.device) -> Tensor:
    """(M, F) from values on the nodes of every phase to those on more nodes of it."""
    here = torch.device("cpu")
    found = torch.block_diag(
        *(
            torch.as_tensor(chebyshev_interpolation_numpy(n, chebyshev_nodes(f, torch.float64, here).numpy()))
            for n, f in zip(nodes, fine, strict=True)
        )
    )
    rows: Tensor = found.T.to(device, dtype).contiguous()
    return rows


@lru_cache(maxsize=64)
def _cells(fine: tuple[int, ...], dtype: torch.dtype, device: torch.device) -> tuple[Tensor, Tensor]:
    """Of F nodes: (F - 1,) from each to the next in durations of its phase, 0 from phase to phase; and (F, F - 1)
    integrals from each to the next of the cubics through the four nodes about them, less those of straight lines.
    """
    size = sum(fine)
    gaps, bends, first = np.zeros(size - 1), np.zeros((size, size - 1)), 0
    for n in fine:
        places = chebyshev_nodes(n, torch.float64, torch.device("cpu")).numpy()
        for k in range(n - 1):
            gap = places[k + 1] - places[k]
            near = min(max(k - 1, 0), n - 4) + np.arange(4)
            # Exact for 1, x, x^2 and x^3, in gaps from the start of the cell.
            powers = np.vander((places[near] - places[k]) / gap, 4, increasing=True).T
            bends[first + near, first + k] = gap * np.linalg.solve(powers, 1.0 / np.arange(1.0, 5.0))
            bends[first + k : first + k + 2, first + k] -= 0.5 * gap
            gaps[first + k] = gap
        first += n
    gap_row, bend_rows = (torch.as_tensor(x, dtype=dtype, device=device) for x in (gaps, bends))
    return gap_row, bend_rows


@dataclass(frozen=True, eq=False)
class Grid:
    """nodes: how many each of the B phases has, M in all. durations: (P, B) [s].

    Values have shape (P, ..., M); a phase's last node and the next one's first are the same moment.
    """

    nodes: tuple[int, ...]
    durations: Tensor

    def __post_init__(self) -> None:
        durations = self.durations
        places, weights = _places(self.nodes, durations.dtype, durations.device)
        own = durations.index_select(1, _owners(self.nodes, durations.device))
        object.__setattr__(self, "rates", 1.0 / own)
        starts = torch.cumsum(durations, dim=1) - durations
        object.__setattr__(self, "spans", own)
        object.__setattr__(self, "times", starts.index_select(1, _owners(self.nodes, durations.device)) + own * places)
        object.__setattr__(self, "weights", own * weights)

    spans: Tensor = None  # type: ignore[assignment]  # (P, M) duration of each node's phase [s]
    rates: Tensor = None  # type: ignore[assignment]  # (P, M) one over that [1/s]
    times: Tensor = None  # type: ignore[assignment]  # (P, M) since the start of the first phase [s]
    weights: Tensor = None  # type: ignore[assignment]  # (P, M) of the integral over all phases [s]

    @property
    def size(self) -> int:
        return sum(self.nodes)

    @property
    def total(self) -> Tensor:
        """(P,) duration of all phases [s]."""
        return self.durations.sum(-1)

    def slice(self, phase: int) -> slice:
        """The nodes of a phase."""
        first = sum(self.nodes[:phase])
        return slice(first, first + self.nodes[phase])

    def shaped(self, values: Tensor, like: Tensor) -> Tensor:
        """(P, M) as (P, 1, ..., 1, M), to go with values of more dimensions."""
        return values.reshape(values.shape[0], *[1] * (like.dim() - 2), values.shape[-1])

    def derivative(self, values: Tensor) -> Tensor:
        """Rate (P, ..., M) [1/s]; at the ends of a phase that of its own side."""
        matrix = _derivative(self.nodes, values.dtype, values.device)
        return (values @ matrix) * self.shaped(self.rates, values)

    def turning(self, axes: Tensor, weighed: Tensor) -> Tensor:
        """(P, 3, M) sum of N vectors (P, N, 3, M) times, as vectors, the rates of N others [1/s]."""
        moving = weighed @ _derivative(self.nodes, weighed.dtype, weighed.device)
        return cross(axes, moving, dim=2).sum(1) * self.rates.unsqueeze(1)

    def integral(self, values: Tensor) -> Tensor:
        """Running integral (P, ..., M) from the start of the first phase [s]."""
        matrix = _integral(self.nodes, values.dtype, values.device)
        return (values * self.shaped(self.spans, values)) @ matrix

    def total_of(self, values: Tensor) -> Tensor:
        """Integral (P, ...) over all phases [s]."""
        return (values * self.shaped(self.weights, values)).sum(-1)

    def mean_of(self, values: Tensor) -> Tensor:
        """Mean (P, ...) over all phases."""
        total = self.total_of(values)
        return total / self.total.reshape(-1, *[1] * (total.dim() - 1))

    @cached_property
    def fine(self) -> Fine:
        """`FINER` times as many nodes."""
        return Fine(tuple(FINER * n for n in self.nodes), self.durations)

    def finer(self, values: Tensor) -> Tensor:
        """Values (P, ..., M) of smooth curves on the nodes of `fine` (P, ..., F)."""
        return values @ _to_fine(self.nodes, self.fine.nodes, values.dtype, values.device)

    def sample(self, values: Tensor, times: Tensor) -> Tensor:
        """Values (P, C, T) of curves (P, C, M) at times (P, T) since the start of the first phase [s].

        Times beyond the ends take the end values.
        """
        found = None
        start = torch.zeros_like(self.durations[:, :1])
        for phase in range(len(self.nodes)):
            duration = self.durations[:, phase : phase + 1]
            place = ((times - start) / duration).clamp(0.0, 1.0)
            curve = values[:, :, self.slice(phase)]
            here = chebyshev_interpolate(curve, place.unsqueeze(1).expand(-1, values.shape[1], -1))
            found = here if found is None else torch.where((times > start).unsqueeze(1), here, found)
            start = start + duration
        assert found is not None
        return found


@dataclass(frozen=True, eq=False)
class Fine(Grid):
    """More nodes, F in all, for integrals of what is not smooth; see `Grid.fine`."""

    def signed(self, values: Tensor, width: float) -> tuple[Tensor, Tensor]:
        """Integrals (P, C) of the positive and of the negative part of smooth curves (P, C, F), told positive.

        A part is rounded over about `width` and 0 at 0: (p + sqrt(p^2 + width^2) - width) / 2. From node to node the
        root is integrated exactly over a straight line, and what the curve's bend adds where it keeps its sign is put
        in, so that a kink costs no more than the third power of the distance, however sharp it is.
        """
        gaps, bends = _cells(self.nodes, values.dtype, values.device)
        size = torch.sqrt(values**2 + width**2)
        sizes = size[..., :-1] + size[..., 1:]
        slope = (values[..., :-1] + values[..., 1:]) / sizes  # of the root over the line, -1 to 1
        # 2 int sqrt(p^2 + w^2) = p sqrt(p^2 + w^2) + w^2 asinh(p / w), over p_1 - p_0, written so that p_1 = p_0 is
        # no exception.
        steep = 0.5 * sizes * (1.0 - slope**2)
        turn = torch.sqrt((values.diff(dim=-1) * steep / width**2) ** 2 + 1e-12)
        line = 0.25 * sizes * (1.0 + slope**2) + 0.5 * steep * torch.log(turn + torch.sqrt(turn**2 + 1.0)) / turn
        whole = gaps * (line - width) + (values @ bends) * slope
        both = (whole * self.spans[:, None, :-1]).sum(-1)
        total = (values * self.weights.unsqueeze(1)).sum(-1)
        return 0.5 * (both + total), 0.5 * (both - total)
