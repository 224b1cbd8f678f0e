"""A sweep through Slurm's commands, which are stood in for by scripts that run each task where they are."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("hydra_plugins.hydra_submitit_launcher")
pytestmark = [pytest.mark.cluster, pytest.mark.skipif(sys.platform != "linux", reason="needs a POSIX shell")]

ROOT = Path(__file__).resolve().parents[2]
SBATCH = """#!/bin/sh
for script; do :; done
cp "$script" "$FAKE/submitted.sh"
run() {
  last=$(sed -n 's/^#SBATCH --array=0-\\([0-9]*\\).*/\\1/p' "$FAKE/submitted.sh")
  for task in $(seq 0 "$last"); do
    SLURM_JOB_ID=7$task SLURM_ARRAY_JOB_ID=7 SLURM_ARRAY_TASK_ID=$task SLURM_NTASKS=1 SLURM_PROCID=0 SLURM_LOCALID=0 \\
      SLURM_NODEID=0 SLURM_JOB_NUM_NODES=1 SLURM_JOB_NODELIST=here sh "$FAKE/submitted.sh"
    echo "7_$task|COMPLETED|here" >> "$FAKE/jobs"
  done
}
(exec > "$FAKE/log" 2>&1 < /dev/null; run) &
echo "Submitted batch job 7"
"""
SRUN = """#!/bin/sh
while [ "${1#*python}" = "$1" ]; do shift; done
exec "$@"
"""
SACCT = """#!/bin/sh
echo "JobID|State|NodeList"
cat "$FAKE/jobs" 2> /dev/null
"""


def test_a_sweep_is_one_array_of_tasks(tmp_path: Path) -> None:
    fake = tmp_path / "bin"
    fake.mkdir()
    for name, text in {"sbatch": SBATCH, "srun": SRUN, "sacct": SACCT}.items():
        (fake / name).write_text(text)
        (fake / name).chmod(0o755)
    words = ["model=smooth", "search=ordinary", "pictures=false", "beta=0.2,0.5", "hydra.sweep.dir=sweep"]
    words += ["hydra/launcher=slurm", "hydra.launcher.partition=short", "hydra.launcher.timeout_min=5"]
    done = subprocess.run(
        [sys.executable, "-m", "hopdiff", "-m", *words],
        cwd=tmp_path,
        env={**os.environ, "PATH": f"{fake}:{os.environ['PATH']}", "FAKE": str(fake), "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        timeout=300,
    )
    log = (fake / "log").read_text() if (fake / "log").is_file() else ""
    assert done.returncode == 0, done.stderr + log
    assert "2 runs in sweep: 2 complete." in done.stdout
    assert len([*tmp_path.glob("sweep/*/motion.bvh")]) == 2
    asked = dict(re.findall(r"^#SBATCH --([\w-]+)=(.*)$", (fake / "submitted.sh").read_text(), re.MULTILINE))
    assert asked["array"] == "0-1%2"
    assert asked["partition"] == "short"
    assert asked["time"] == "5"
    assert asked["cpus-per-task"] == "1"
    assert asked["mem"] == "4GB"
    assert asked["signal"] == "USR2@30"
