"""Timings, kept for comparison: pytest tests/benchmarks -m slow. Nothing here asserts a time."""

from __future__ import annotations

from pathlib import Path

import pytest
import torch
from pytest_benchmark.fixture import BenchmarkFixture

from hopdiff.composing import compose
from hopdiff.config import build_job
from hopdiff.job import search_run
from hopdiff.search.box import Box

ROOT = Path(__file__).resolve().parents[2]
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


@pytest.mark.parametrize("with_grad", [False, True], ids=["value", "gradient"])
@pytest.mark.parametrize("size", [1, 3, 16, 64])
def test_whole_body_evaluation(benchmark: BenchmarkFixture, size: int, with_grad: bool) -> None:
    """Points where searches begin."""
    problem = build_job(compose(["model=body", "speed=3.5", "beta=0.2"])).problem
    genes = Box.of(problem).first(size, torch.Generator().manual_seed(0))
    result = benchmark.pedantic(problem.evaluate, (genes, with_grad), rounds=5, warmup_rounds=1)
    assert bool(torch.isfinite(result.merit).any())


@pytest.mark.parametrize("beta", ["0.2", "0.7"])
def test_whole_body_search(benchmark: BenchmarkFixture, beta: str) -> None:
    """The default search; at 0.7 with the search for the run of least cost before it."""
    run = benchmark.pedantic(
        lambda: search_run(build_job(compose(["model=body", "speed=3.5", f"beta={beta}"]))), rounds=1
    )
    assert run.metrics["cost"] < 1.0


@pytest.mark.parametrize("search", ["ga", "gradient", "hybrid", "cmaes", "random"])
def test_search(benchmark: BenchmarkFixture, search: str) -> None:
    job = build_job(compose(["model=smooth", f"search={search}"]))
    run = benchmark.pedantic(search_run, (job,), rounds=1)
    assert run.metrics["cost"] < 10.0


@pytest.mark.parametrize("times", ["all at once", "one by one"])
@pytest.mark.parametrize("size", [1, 256])
@pytest.mark.parametrize("model", ["smooth", "thesis"])
def test_playback(
    benchmark: BenchmarkFixture, monkeypatch: pytest.MonkeyPatch, model: str, size: int, times: str
) -> None:
    """Two seconds at 60 frames/s; solving is not counted."""
    monkeypatch.syspath_prepend(str(ROOT))
    from experiments.bench.playback import frames, possible

    problem = build_job(compose([f"model={model}"])).problem
    gait = problem.gait(possible(problem, size))
    moments = torch.arange(120, dtype=problem.dtype) / 60.0
    batches = moments.split(120 if times == "all at once" else 1)
    made = benchmark.pedantic(lambda: [frames(gait, batch) for batch in batches], rounds=5, warmup_rounds=1)
    assert all(bool(torch.isfinite(part).all()) for frame in made for part in frame)
