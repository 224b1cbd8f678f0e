"""The least that the written operations can take on this core: their arithmetic at the speed of its largest matrix
product, and what they read and write at the speed of its best sum."""

from __future__ import annotations

import time
from collections.abc import Callable
from math import prod
from typing import Any, NamedTuple

import torch
from torch.utils._python_dispatch import TorchDispatchMode
from torch.utils._pytree import tree_leaves

VIEWS = ("view", "unsqueeze", "squeeze", "select", "slice", "permute", "transpose", "expand", "unbind", "split", "t.")
VIEWS += ("as_strided", "detach", "alias", "diagonal", "_unsafe_view", "unflatten", "empty", "reshape")


class Core(NamedTuple):
    """flops: of a matrix product [1/s]. bandwidth: of a sum of two tensors that fit into the cache [bytes/s]."""

    flops: float
    bandwidth: float


class Work(TorchDispatchMode):
    """Counts what the operations below it do. seconds: the roofline, operation by operation; calls: that do something;
    waits: times that the host asks for a number or a shape that the device has to work out first."""

    WAITS = ("_local_scalar_dense", "nonzero", "equal.default", "is_nonzero", "masked_select", "unique")

    def __init__(self, core: Core) -> None:
        super().__init__()
        self.core = core
        self.seconds = 0.0
        self.calls = self.waits = 0

    def __torch_dispatch__(self, func: Any, types: Any, args: Any = (), kwargs: Any = None) -> Any:
        found = func(*args, **(kwargs or {}))
        name = str(func).removeprefix("aten.")
        self.waits += name.startswith(self.WAITS)
        if name.startswith("index.Tensor"):  # by a mask, whose count of rows is not known
            self.waits += any(isinstance(x, torch.Tensor) and x.dtype == torch.bool for x in tree_leaves(args))
        if name.startswith(VIEWS):
            return found
        self.calls += 1
        tensors = [x for x in tree_leaves((args, kwargs, found)) if isinstance(x, torch.Tensor)]
        moved = sum(x.numel() * x.element_size() for x in tensors)
        arithmetic = 0.0
        if name.startswith(("mm", "bmm", "addmm", "baddbmm")):
            arithmetic = 2.0 * prod(found.shape) * args[0].shape[-1]
        self.seconds += max(moved / self.core.bandwidth, arithmetic / self.core.flops)
        return found


def core(dtype: torch.dtype) -> Core:
    """This core's two speeds, the best of many tries."""
    square = torch.rand(512, 512, dtype=dtype)
    row = torch.rand(1 << 15, dtype=dtype)
    out = torch.empty_like(row)
    product, summed = _best(lambda: square @ square), _best(lambda: torch.add(row, row, out=out))
    return Core(2.0 * 512**3 / product, 3.0 * row.numel() * row.element_size() / summed)


def counted(call: Callable[[], Any], on: Core) -> Work:
    """What a call does."""
    with Work(on) as work:
        call()
    return work


def _best(call: Callable[[], Any], tries: int = 200) -> float:
    best = float("inf")
    for _ in range(tries):
        start = time.perf_counter()
        call()
        best = min(best, time.perf_counter() - start)
    return best
