"""Timing a sweep as it is typed, and who else had the processors meanwhile."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import threading
from collections.abc import Sequence
from pathlib import Path
from time import monotonic, sleep
from typing import NamedTuple

ROOT = Path(__file__).resolve().parents[2]
TICK = os.sysconf("SC_CLK_TCK")
POLL = 0.2  # s between two looks at the processes
LOOK = 3.0  # s over which a quiet moment is looked for
HYDRA_OWN = "basic"
# Ray would talk to itself over the address of the network; this one is on the loopback too.
ON_LOOPBACK = {"ray": ["+hydra.launcher.ray.init._node_ip_address=127.0.0.2"]}
ENVIRONMENT = {"OMP_NUM_THREADS": "1", "MPLBACKEND": "Agg", "RAY_USAGE_STATS_ENABLED": "0"}


class Taken(NamedTuple):
    """wall: seconds. cpu: seconds of all processes of the sweep. others: share of the cores that anybody else used."""

    wall: float
    cpu: float
    others: float


def sweep(launcher: str, words: Sequence[str], runs: int, folder: Path) -> Taken:
    """Time `python -m hopdiff -m WORDS` with a launcher into an empty folder.

    Raises RuntimeError unless so many runs are complete at its end.
    """
    shutil.rmtree(folder, ignore_errors=True)
    command = [sys.executable, "-m", "hopdiff", "-m", "pictures=false", *words, f"hydra.sweep.dir={folder}"]
    if launcher != HYDRA_OWN:
        command += [f"hydra/launcher={launcher}", *ON_LOOPBACK.get(launcher, [])]
    busy, begun = _busy(), monotonic()
    with open(os.devnull, "w") as nothing:
        process = subprocess.Popen(
            command, cwd=ROOT, env={**os.environ, **ENVIRONMENT}, stdout=nothing, stderr=nothing, start_new_session=True
        )
    clock = _Clock(process.pid)
    status = process.wait()
    wall = monotonic() - begun
    cpu = clock.stop()
    others = (_busy() - busy - cpu) / (wall * (os.cpu_count() or 1))
    complete = sum('"status": "complete"' in path.read_text() for path in folder.rglob("status.json"))
    if status or complete != runs:
        raise RuntimeError(f"{' '.join(command)}: status {status}, {complete} of {runs} runs are complete")
    return Taken(wall, cpu, max(0.0, others))


def wait_for_quiet(share: float, patience: float) -> bool:
    """Wait until other programs use no more than this share of the cores; False if that took too long [s]."""
    end = monotonic() + patience
    while monotonic() < end:
        busy, begun = _busy(), monotonic()
        sleep(LOOK)
        if (_busy() - busy) / ((monotonic() - begun) * (os.cpu_count() or 1)) <= share:
            return True
    return False


class _Clock:
    """Adds up the processor time of all processes of a session, those that have ended included."""

    def __init__(self, session: int) -> None:
        self.session, self.seen, self.going = session, dict[int, float](), True
        self.thread = threading.Thread(target=self._watch, daemon=True)
        self.thread.start()

    def stop(self) -> float:
        """Seconds."""
        self.going = False
        self.thread.join()
        return sum(self.seen.values())

    def _watch(self) -> None:
        while self.going:
            for path in Path("/proc").glob("[0-9]*/stat"):
                try:
                    values = path.read_text().rpartition(")")[2].split()
                except OSError:
                    continue
                if int(values[3]) == self.session:
                    self.seen[int(path.parent.name)] = (int(values[11]) + int(values[12])) / TICK
            sleep(POLL)


def _busy() -> float:
    """Seconds that all cores have worked since the machine was started."""
    user, nice, system, _, _, interrupts, soft, *_ = map(int, re.findall(r"\d+", _first_line("/proc/stat")))
    return (user + nice + system + interrupts + soft) / TICK


def _first_line(path: str) -> str:
    with open(path) as file:
        return file.readline()
