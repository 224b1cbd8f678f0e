"""How long a newcomer waits: pytest tests/benchmarks -m slow -k start_up. Ratios are printed, none is asserted.

Each is against `import torch, hydra`, which nothing that runs can do without; processes alternate, so that a busy
machine slows all alike.
"""

from __future__ import annotations

import statistics
import subprocess
import sys
from time import perf_counter

import pytest
from pytest_benchmark.fixture import BenchmarkFixture

pytestmark = pytest.mark.slow
ROUNDS = 7
BASE = ("-c", "import torch, hydra")
ASKED = {
    "help": ("-m", "hopdiff", "--help"),
    "misspelt": ("-m", "hopdiff", "spead=3"),
    "misspelt search setting": ("-m", "hopdiff", "search.populaton=3"),
    "out of range": ("-m", "hopdiff", "speed=-3"),
}


def seconds(words: tuple[str, ...]) -> float:
    begun = perf_counter()
    subprocess.run([sys.executable, *words], capture_output=True, check=False)
    return perf_counter() - begun


@pytest.mark.parametrize("what", list(ASKED))
def test_start_up(benchmark: BenchmarkFixture, what: str, capsys: pytest.CaptureFixture[str]) -> None:
    pairs = [(seconds(BASE), seconds(ASKED[what])) for _ in range(ROUNDS)]
    ratio = statistics.median(asked / base for base, asked in pairs)
    benchmark.extra_info["ratio to import torch, hydra"] = round(ratio, 2)
    benchmark.pedantic(seconds, (ASKED[what],), rounds=1)
    with capsys.disabled():
        print(f"\n{what}: {ratio:.2f} of import torch, hydra")
