"""The nearest frames in which something is so."""

from __future__ import annotations

import torch
from torch import Tensor


def apart(flags: Tensor) -> Tensor:
    """(T,) frames to the nearest one that is true; far where there is none."""
    if not bool(flags.any()):
        return torch.full((len(flags),), 1e9, dtype=torch.float64)
    frames = torch.arange(len(flags))
    return (frames - nearest(flags)).abs().double()


def nearest(flags: Tensor) -> Tensor:
    """(T,) the nearest frame that is true; 0 where there is none."""
    true = flags.nonzero().flatten()
    frames = torch.arange(len(flags))
    if not len(true):
        return torch.zeros_like(frames)
    after = torch.searchsorted(true, frames).clamp_max(len(true) - 1)
    before = (after - 1).clamp_min(0)
    nearer = (true[after] - frames).abs() < (true[before] - frames).abs()
    return torch.where(nearer, true[after], true[before])
