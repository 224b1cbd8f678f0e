"""How alike frames of clips are: the window distance of Kovar et al. (2002), for all pairs by matrix products.

Two windows of frames are laid on each other by a turn about y and a shift over the ground, as well as they can be;
the distance is the root of the mean squared distance between their joints then. With ground coordinates as complex
numbers z + i x, each window centred, a turn by t is a product with exp(i t), and the least squared distance is

    |a|^2 + |b|^2 - 2 |sum conj(b) a| + |height difference|^2

where the best turn of b onto a is the argument of the sum. So all pairs take one complex and one real product.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from hopdiff.geometry.clip import Clip
from hopdiff.types import HopdiffError

SAMPLES = 10  # frames of a window that are compared, at most
CHUNK = 16_000_000  # bytes of one row block of distances


@dataclass(frozen=True, eq=False)
class Windows:
    """The windows of one clip, one row for each frame that a whole window starts at.

    ground: (N, D) complex, centred ground coordinates. height: (N, D). Both are weighted so that a sum of squares is
    the mean over the window [m^2]. centre: (N,) complex, what was taken away [m].
    """

    ground: Tensor
    height: Tensor
    centre: Tensor

    @property
    def count(self) -> int:
        return len(self.centre)

    def squares(self) -> Tensor:
        """(N,) mean squared distance of a window from its centre and the ground [m^2]."""
        return (self.ground.abs() ** 2).sum(-1) + (self.height**2).sum(-1)


@dataclass(frozen=True, eq=False)
class Likeness:
    """Pairs of windows that are alike. first, second: (M,) rows. distance: (M,) [m]."""

    first: Tensor
    second: Tensor
    distance: Tensor


def as_complex(place: Tensor) -> Tensor:
    """Ground coordinates x, z (..., 2) as complex numbers z + i x (...)."""
    return torch.complex(place[..., 1], place[..., 0])


def windows_of(clip: Clip, window: int, weights: Sequence[float] | Tensor | None = None) -> Windows:
    """The windows of `window` frames of a clip. weights: (J,) of the joints, None for equal ones.

    Long windows are compared at 10 of their frames. Raises HopdiffError for a clip shorter than a window, a window of
    fewer than two frames, or weights that are not J numbers of 0 or more, one of them above 0.
    """
    if window < 2:
        raise HopdiffError(f"a window needs at least 2 frames, not {window}.")
    if clip.frames < window:
        raise HopdiffError(f"a clip of {clip.frames} frames is shorter than the window of {window} frames.")
    joints = len(clip.skeleton.names)
    share = torch.as_tensor([1.0] * joints if weights is None else weights, dtype=torch.float64)
    if share.shape != (joints,) or not bool(((share >= 0) & share.isfinite()).all()) or not float(share.sum()) > 0:
        raise HopdiffError(f"joint weights must be {joints} numbers of 0 or more, at least one above 0.")
    positions = clip.joint_positions().detach().double().cpu()[:, share > 0]
    share = share[share > 0]
    samples = torch.linspace(0, window - 1, min(window, SAMPLES), dtype=torch.float64).round().long()
    # (N, samples): which frames each window looks at.
    frames = torch.arange(clip.frames - window + 1)[:, None] + samples
    root = (share / share.sum() / len(samples)).sqrt()
    ground = as_complex(positions[..., [0, 2]])[frames]
    centre = (ground * root**2).sum((1, 2))
    ground = (ground - centre[:, None, None]) * root
    height = positions[..., 1][frames] * root
    return Windows(ground.flatten(1), height.flatten(1), centre)


def distances(first: Windows, second: Windows, rows: slice | None = None, columns: slice | None = None) -> Tensor:
    """(N, M) distances between the windows of two clips, or between some rows of them [m]."""
    rows, columns = rows or slice(None), columns or slice(None)
    return _squared(first, second, first.squares(), second.squares(), rows, columns).sqrt()


def alignment(first: Windows, i: Tensor, second: Windows, j: Tensor) -> tuple[Tensor, Tensor]:
    """Turn (M,) [rad] about y and shift (M,) complex [m] after it, that lay windows j of one clip on windows i."""
    product = (first.ground[i] * second.ground[j].conj()).sum(-1)
    turn = product.angle()
    return turn, first.centre[i] - torch.polar(torch.ones_like(turn), turn) * second.centre[j]


def local_minima(first: Windows, second: Windows, threshold: float, apart: int = 0) -> Likeness:
    """The pairs whose distance is below a threshold [m] and no larger than that of their eight neighbours.

    apart: rows between the two of a pair, at least, where both are windows of the same clip (first is second): each
    such pair comes once, the smaller row first. Of neighbours at one distance the first counts. Works through blocks
    of rows, so that memory grows with the windows of one clip and not with the pairs.
    """
    same = first is second
    squares, others = first.squares(), second.squares()
    block = max(1, CHUNK // (16 * second.count))
    found = []
    for start in range(0, first.count, block):
        stop = min(start + block, first.count)
        above = max(start - 1, 0)
        # In a clip's own matrix what lies under the diagonal mirrors what lies over it.
        left = max(start - 1, 0) if same else 0
        rows, columns = slice(above, min(stop + 1, first.count)), slice(left, second.count)
        square = _squared(first, second, squares, others, rows, columns)
        padded = torch.nn.functional.pad(square, (1, 1, 1, 1), value=math.inf)
        inner = square[start - above : stop - above]
        low = inner < threshold**2
        if same:
            low &= torch.arange(left, second.count) - torch.arange(start, stop)[:, None] >= max(apart, 1)
        i, j = low.nonzero(as_tuple=True)
        value = inner[i, j]
        least = torch.ones_like(value, dtype=torch.bool)
        for di in (-1, 0, 1):
            for dj in (-1, 0, 1):
                if (di, dj) != (0, 0):
                    other = padded[i + start - above + 1 + di, j + 1 + dj]
                    least &= value < other if (di, dj) < (0, 0) else value <= other
        found.append((i[least] + start, j[least] + left, value[least].sqrt()))
    return Likeness(*(torch.cat(part) for part in zip(*found, strict=True)))


def _squared(first: Windows, second: Windows, squares: Tensor, others: Tensor, rows: slice, columns: slice) -> Tensor:
    product = (first.ground[rows] @ second.ground[columns].T.conj()).abs()
    product += first.height[rows] @ second.height[columns].T
    return (squares[rows, None] + others[columns] - 2.0 * product).clamp_min_(0.0)
