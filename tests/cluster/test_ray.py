"""Sweeps on a Ray cluster of their own, whose every address is on the loopback."""

from __future__ import annotations

import json
import os
import secrets
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest

pytest.importorskip("hydra_plugins.hydra_ray_launcher")
pytestmark = [pytest.mark.cluster, pytest.mark.skipif(sys.platform != "linux", reason="looks into /proc")]

ROOT = Path(__file__).resolve().parents[2]
HOST = "127.0.0.2"  # Ray turns 127.0.0.1 into the address of the network, but leaves this one alone
PATIENCE = 240.0  # s for anything


class Cluster:
    """place: Ray's own folder, which tells its processes from others. environment: of commands that shall find it."""

    def __init__(self, place: Path, environment: dict[str, str]) -> None:
        self.place, self.environment = place, environment

    def start(self, *words: str) -> subprocess.Popen[str]:
        """`python -m hopdiff -m` on this cluster."""
        command = [sys.executable, "-m", "hopdiff", "-m", "hydra/launcher=ray_cluster", "pictures=false", *words]
        return subprocess.Popen(
            command, cwd=ROOT, env=self.environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
        )

    def workers(self) -> list[int]:
        """Processes that are making a run just now."""
        masters = {pid for pid, words in _processes() if "raylet" in words[:200] and str(self.place) in words}
        return [pid for pid, words in _processes() if words.startswith("ray::_run_job") and _parent(pid) in masters]


@pytest.fixture(scope="module")
def cluster() -> Iterator[Cluster]:
    # The sockets below this folder need a short name.
    with TemporaryDirectory(prefix="ray-", ignore_cleanup_errors=True) as folder, socket.socket() as probe:
        place, log = Path(folder), Path(folder) / "head.log"
        probe.bind((HOST, 0))
        port = probe.getsockname()[1]
        probe.close()
        own = {"RAY_AUTH_MODE": "token", "RAY_AUTH_TOKEN": secrets.token_hex(32), "RAY_USAGE_STATS_ENABLED": "0"}
        environment = {**os.environ, **own, "OMP_NUM_THREADS": "1"}
        command = [sys.executable, "-m", "ray.scripts.scripts", "start", "--head", "--block", "--num-cpus=2"]
        command += [f"--node-ip-address={HOST}", f"--port={port}", f"--temp-dir={place}", "--include-dashboard=false"]
        with log.open("w") as output:
            head = subprocess.Popen(command, cwd=place, env=environment, stdout=output, stderr=output)
        try:
            _wait(lambda: "Ray runtime started" in log.read_text() or head.poll() is not None, "Ray's start")
            assert head.poll() is None, log.read_text()
            yield Cluster(place, {**environment, "RAY_ADDRESS": f"{HOST}:{port}"})
        finally:
            head.terminate()
            try:
                head.wait(60)
            finally:
                head.kill()
                for pid in [pid for pid, words in _processes() if folder in words]:
                    os.kill(pid, signal.SIGKILL)


def test_a_sweep_whose_worker_was_killed_is_completed_by_the_same_command(cluster: Cluster, tmp_path: Path) -> None:
    words = ["model=smooth", "search=random", "budget.evaluations=1500", "speed=3,4,5,6", "seed=0,1,2,3"]
    words += [f"hydra.sweep.dir={tmp_path}/sweep", "hydra.launcher.ray.remote.max_retries=0"]
    first = cluster.start(*words)
    os.kill(_busy(cluster, first, tmp_path, after=3), signal.SIGKILL)
    _, said = first.communicate(timeout=PATIENCE)
    assert first.returncode == 1
    assert "hopdiff: hydra/launcher=ray: " in said
    assert "Traceback" not in said
    kept = _complete(tmp_path)
    assert 3 <= len(kept) < 16
    before = {path: path.stat().st_mtime_ns for path in kept}
    again = cluster.start(*words)
    told, said = again.communicate(timeout=PATIENCE)
    assert again.returncode == 0, said
    assert f"16 runs in {tmp_path}/sweep: 16 complete." in told
    assert len(_complete(tmp_path)) == 16
    # What was there is not made again.
    assert {path: path.stat().st_mtime_ns for path in kept} == before
    assert all((path.parent / "motion.bvh").stat().st_size > 10_000 for path in _complete(tmp_path))


def test_a_run_whose_worker_was_killed_is_begun_again(cluster: Cluster, tmp_path: Path) -> None:
    words = ["model=smooth", "search=random", "budget.evaluations=1500", "seed=0,1,2,3"]
    sweep = cluster.start(*words, f"hydra.sweep.dir={tmp_path}/sweep")
    victim = _busy(cluster, sweep, tmp_path, after=1)
    os.kill(victim, signal.SIGKILL)
    told, said = sweep.communicate(timeout=PATIENCE)
    assert sweep.returncode == 0, said
    assert f"4 runs in {tmp_path}/sweep: 4 complete." in told
    assert victim not in cluster.workers()


def test_runs_land_in_the_folder_of_the_command(cluster: Cluster) -> None:
    with TemporaryDirectory(dir=ROOT, prefix=".sweep-") as folder:
        name = Path(folder).name  # a relative path: the head of this cluster was started elsewhere
        sweep = cluster.start("model=smooth", "search=ordinary", "beta=0.2,0.5", f"hydra.sweep.dir={name}")
        told, said = sweep.communicate(timeout=PATIENCE)
        assert sweep.returncode == 0, said
        assert f"2 runs in {name}: 2 complete." in told
        assert not (cluster.place / name).exists()


def _busy(cluster: Cluster, sweep: subprocess.Popen[str], folder: Path, after: int) -> int:
    """A worker that is making a run, once so many are complete."""
    _wait(lambda: sweep.poll() is not None or len(_complete(folder)) >= after, f"{after} runs")
    assert sweep.poll() is None, sweep.communicate()
    _wait(lambda: bool(cluster.workers()), "a worker at work")
    return cluster.workers()[0]


def _complete(folder: Path) -> list[Path]:
    """The status of all runs that are complete."""
    found = []
    for path in sorted(folder.rglob("status.json")):
        if json.loads(path.read_text(encoding="utf-8"))["status"] == "complete":
            found.append(path)
    return found


def _wait(done: Callable[[], bool], what: str) -> None:
    end = time.monotonic() + PATIENCE
    while not done():
        assert time.monotonic() < end, f"{what} took too long"
        time.sleep(0.1)


def _processes() -> list[tuple[int, str]]:
    """Every process and its command line."""
    found = []
    for folder in Path("/proc").iterdir():
        if folder.name.isdigit():
            try:
                words = (folder / "cmdline").read_bytes().replace(b"\0", b" ").decode(errors="replace")
            except OSError:
                continue
            found.append((int(folder.name), words))
    return found


def _parent(pid: int) -> int:
    try:
        stat = Path(f"/proc/{pid}/stat").read_text()
    except OSError:
        return 0
    return int(stat.rpartition(")")[2].split()[1])
