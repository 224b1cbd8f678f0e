"""Timings, kept for comparison: pytest tests/benchmarks -m slow. Nothing here asserts a time."""

from __future__ import annotations

import pytest
import torch
from pytest_benchmark.fixture import BenchmarkFixture

from hopdiff.config import build_job, compose
from hopdiff.tasks.job import search_run

pytestmark = pytest.mark.slow


@pytest.mark.parametrize("with_grad", [False, True], ids=["value", "gradient"])
@pytest.mark.parametrize("dtype", ["float32", "float64"])
@pytest.mark.parametrize("size", [1, 64, 4096])
@pytest.mark.parametrize("model", ["smooth", "thesis"])
def test_evaluation(benchmark: BenchmarkFixture, model: str, size: int, dtype: str, with_grad: bool) -> None:
    problem = build_job(compose([f"model={model}", f"dtype={dtype}"])).problem
    genes = torch.rand(size, problem.dimension, dtype=problem.dtype, generator=torch.Generator().manual_seed(0))
    result = benchmark.pedantic(problem.evaluate, (genes, with_grad), rounds=5, warmup_rounds=1)
    assert bool(torch.isfinite(result.cost).any())


@pytest.mark.parametrize("search", ["ga", "gradient", "hybrid", "cmaes", "random"])
def test_search(benchmark: BenchmarkFixture, search: str) -> None:
    job = build_job(compose([f"search={search}"]))
    run = benchmark.pedantic(search_run, (job,), rounds=1)
    assert run.metrics["cost"] < 10.0
