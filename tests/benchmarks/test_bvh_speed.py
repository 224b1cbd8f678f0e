"""Ten minutes at 120 frames/s, kept for comparison: pytest tests/benchmarks/test_bvh_speed.py -m slow.

No time is asserted, only how much memory reading takes.
"""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest
import torch
from pytest_benchmark.fixture import BenchmarkFixture

from hopdiff.io.bvh import BvhFile, BvhJoint, read_bvh

FRAMES, JOINTS = 72_000, 31
BYTES = 1 << 30  # the most memory that the whole process may hold while it reads
pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def long_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Five limbs of six joints below a root, 96 channels of numbers with four decimals."""
    turns = ("Zrotation", "Yrotation", "Xrotation")
    joints = [BvhJoint("Hips", -1, (0.0, 0.0, 0.0), ("Xposition", "Yposition", "Zposition", *turns))]
    joints += [BvhJoint(f"Joint{at}", at - 1 if at % 6 != 1 else 0, (1.0, -5.0, 0.5), turns) for at in range(1, JOINTS)]
    generator = torch.Generator().manual_seed(0)
    values = 40 * torch.randn(FRAMES, 3 + 3 * JOINTS, generator=generator, dtype=torch.float64)
    path = tmp_path_factory.mktemp("long") / "long.bvh"
    BvhFile(tuple(joints), values.round(decimals=4), 1 / 120, 4, 4).write(path)
    return path


def test_reading(benchmark: BenchmarkFixture, long_file: Path) -> None:
    file = benchmark.pedantic(read_bvh, (long_file,), rounds=3)
    assert file.values.shape == (FRAMES, 96)


def test_memory_of_reading(long_file: Path) -> None:
    """Of a process of its own, PyTorch and all."""
    code = (
        "import resource, sys; from hopdiff.io.bvh import read_bvh; file = read_bvh(sys.argv[1]); "
        "print(file.frames, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)"
    )
    root = Path(__file__).resolve().parents[2]
    command = [sys.executable, "-c", code, str(long_file)]
    done = subprocess.run(command, cwd=root, capture_output=True, text=True, check=True)
    frames, kibibytes = map(int, done.stdout.split())
    assert frames == FRAMES
    assert 1024 * kibibytes < BYTES


def test_clip(benchmark: BenchmarkFixture, long_file: Path) -> None:
    clip = benchmark.pedantic(read_bvh(long_file).clip, rounds=1)
    assert clip.frames == FRAMES


def test_editing(benchmark: BenchmarkFixture, long_file: Path) -> None:
    file = read_bvh(long_file)
    edited = benchmark.pedantic(file.with_motion, (file.clip().in_place(),), rounds=1)
    assert torch.equal(edited.values[:, 3:], file.values[:, 3:])


def test_writing(benchmark: BenchmarkFixture, long_file: Path, tmp_path: Path) -> None:
    benchmark.pedantic(read_bvh(long_file).write, (tmp_path / "again.bvh",), rounds=1)
    assert (tmp_path / "again.bvh").read_bytes() == long_file.read_bytes()
