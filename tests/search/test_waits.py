"""How often a step of a search makes the host wait for the device."""

from __future__ import annotations

import pytest
import torch
from torch.utils._python_dispatch import TorchDispatchMode

from hopdiff.search.ga import GA
from hopdiff.search.gradient import Gradient
from hopdiff.search.hybrid import Hybrid
from hopdiff.search.loop import Budget, run_search
from hopdiff.search.random import Random
from tests.search import problems

# Operations whose answer the host needs before it can go on.
WAITING = {"_local_scalar_dense", "nonzero", "equal", "is_nonzero", "unique_dim", "_unique2", "masked_select", "item"}


class Waits(TorchDispatchMode):
    """Counts them; reading a whole tensor with tolist copies it, one element after the other on the CPU."""

    def __init__(self) -> None:
        super().__init__()
        self.count = 0

    def __torch_dispatch__(self, func, types, args=(), kwargs=None):
        name = func.overloadpacket.__name__
        indexed = name in ("index", "index_put", "index_put_") and any(
            x is not None and x.dtype in (torch.bool, torch.uint8) for x in args[1]
        )
        self.count += name in WAITING or indexed
        return func(*args, **(kwargs or {}))


@pytest.fixture
def reads(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """The tensors that were read whole, by their sizes."""
    found: list[int] = []
    tolist = torch.Tensor.tolist

    def counted(self: torch.Tensor):
        found.append(self.numel())
        return tolist(self)

    monkeypatch.setattr(torch.Tensor, "tolist", counted)
    return found


@pytest.mark.parametrize(
    ("search", "make"),
    [
        (Random(), problems.half_invalid),
        (GA(), problems.half_invalid),
        (Gradient(), problems.kinked),
        (Gradient(method="adam", steps=20), problems.kinked),
        (Gradient(restarts=30), problems.rosenbrock_squares),
        (Hybrid(share=0.2), problems.rosenbrock_squares),
        (Hybrid(climbers=3, write_back=False), problems.kinked),
    ],
    ids=["random", "ga", "bfgs", "adam", "lm", "hybrid", "baldwin"],
)
def test_a_step_reads_once(search, make, reads) -> None:
    problem = make()
    inner = problem.evaluate
    waits = Waits()
    paused = []

    def evaluate(genes, with_grad):
        """What the problem itself does is not the search's."""
        before = waits.count
        result = inner(genes, with_grad)
        paused.append(waits.count - before)
        return result

    problem.evaluate = evaluate
    with waits:
        result = run_search(problem, search, Budget(2000), torch.Generator().manual_seed(0))
    steps = len(result.history)
    assert steps > 10
    assert len(reads) == steps
    assert waits.count - sum(paused) == 0
