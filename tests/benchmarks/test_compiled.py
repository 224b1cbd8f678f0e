"""How much quicker compiled kernels are, side by side: pytest tests/benchmarks -m slow -s -k compiled.

Compiles what is not compiled yet, in some minutes, in the folder that HOPDIFF_BENCH_CACHE names, or for this time only.
Prints milliseconds of processor time an evaluation, with and without gradient, and seconds a default search with the
run of least cost before it. Nothing is asserted but that both price alike.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import torch

from hopdiff.composing import compose
from hopdiff.config import build_job
from hopdiff.effort import problem as body_module
from hopdiff.effort.problem import BodyProblem
from hopdiff.job import find
from hopdiff.kernels import store

pytestmark = pytest.mark.slow
SIZES = (1, 2, 18, 64)
ROUNDS = 7
SPEEDS = ("3", "5", "8")


def seconds(action: Callable[..., Any], *given: Any) -> float:
    began = time.process_time()
    action(*given)
    return time.process_time() - began


def problem(compiling: str) -> BodyProblem:
    found = build_job(compose(["speed=5", "beta=0.2", f"compile={compiling}"])).problem
    assert isinstance(found, BodyProblem)
    return found


def searched(speed: str, compiling: str) -> float:
    body_module._found.clear()
    job = build_job(compose([f"speed={speed}", "beta=0.7", f"compile={compiling}"]))
    return find(job).best_cost


@pytest.mark.skipif(store.compiler() is None, reason="there is no C++ compiler")
def test_compiled_beside_not_compiled(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv(store.CACHE, os.environ.get("HOPDIFF_BENCH_CACHE", str(tmp_path)))
    pair = {name: problem(name) for name in ("false", "true")}
    print("\n| candidates | gradient | not compiled ms | compiled ms | ratio |\n| ---: | --- | ---: | ---: | ---: |")
    for size in SIZES:
        noise = torch.randn(
            size, pair["false"].dimension, generator=torch.Generator().manual_seed(0), dtype=torch.float64
        )
        genes = (pair["false"].start + 0.03 * noise).clamp(0.0, 1.0)
        for with_grad in (False, True):
            merits = [one.evaluate(genes, with_grad).merit for one in pair.values()]
            torch.testing.assert_close(merits[0], merits[1], rtol=1e-6, atol=0.0)
            taken: dict[str, list[float]] = {name: [] for name in pair}
            for _ in range(ROUNDS):
                for name, one in pair.items():
                    taken[name].append(seconds(one.evaluate, genes, with_grad))
            plain, compiled = (sorted(taken[name])[ROUNDS // 2] for name in pair)
            print(f"| {size} | {with_grad} | {1e3 * plain:.1f} | {1e3 * compiled:.1f} | {plain / compiled:.1f} |")
    print("\n| speed | not compiled s | compiled s | ratio |\n| ---: | ---: | ---: | ---: |")
    for speed in SPEEDS:
        plain, compiled = (seconds(searched, speed, name) for name in pair)
        print(f"| {speed} | {plain:.1f} | {compiled:.1f} | {plain / compiled:.1f} |")
