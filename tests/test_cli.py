"""The command line as a user types it."""

from __future__ import annotations

import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

from hopdiff.cli import main
from hopdiff.composing import compose
from hopdiff.doors import config_folder

ROOT = Path(__file__).resolve().parents[1]


def hopdiff(*arguments: str, cwd: Path, **environment: str) -> subprocess.CompletedProcess[str]:
    path = os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")])
    return subprocess.run(
        [sys.executable, "-m", "hopdiff", *arguments],
        cwd=cwd,
        capture_output=True,
        text=True,
        timeout=120,
        env={**os.environ, "PYTHONPATH": path, "MPLBACKEND": "Agg", **environment},
    )


def commands(text: str) -> list[list[str]]:
    """The overrides of every `python -m hopdiff` command in a text."""
    found = re.findall(r"(?:^ *|&& )python -m hopdiff (.+?)(?:  +\S.*| +#.*)?$", text, re.MULTILINE)
    return [shlex.split(re.sub("<.+?>", "some", line)) for line in found]


@pytest.mark.parametrize("path", [ROOT / "README.md", config_folder() / "hydra" / "help" / "hopdiff.yaml"])
def test_printed_commands_compose(path: Path) -> None:
    found = [line for line in commands(path.read_text(encoding="utf-8")) if "..." not in line]
    found = [line for line in found if not line[0].startswith("--")]
    assert len(found) >= 5
    jobs = set()
    for line in found:
        # Of a sweep, the first and the last job.
        for pick in (0, -1):
            words = [word.split("=", 1) for word in line if "=" in word and not word.startswith("hydra")]
            jobs.add(tuple(f"{name}={values.split(',')[pick] if '-m' in line else values}" for name, values in words))
    for job in jobs:
        compose(job)


def test_help_is_a_page(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setattr("sys.argv", ["hopdiff", "--help"])
    with pytest.raises(SystemExit) as done:
        main()
    assert done.value.code == 0
    out = capsys.readouterr().out
    for word in ("+experiment=brisk", "speed", "beta", "genes_file", "m/s", "hydra.run.dir", "budget.evaluations"):
        assert word in out
    for group, choices in {
        "model": "body, smooth, thesis",
        "search": "cmaes, ga, ga_thesis, gradient, hybrid, ordinary, random",
        "export": "apng, blendspace, bvh_blender, bvh_unity, bvh_unreal, csv, events, fbx, frames, glb, glb_mixamo,"
        " glb_unreal, html, npz, sprites, usd, vrma",
        "task": "blendspace, body, compare, edit, export, hopper, navigate, path, replay, run",
    }.items():
        assert f"{group}: {choices}" in out
    # Hydra puts all choices of a group on one line.
    assert max(len(line) for line in out.splitlines() if not line.startswith(("experiment/", "export: "))) <= 120
    assert len(out.splitlines()) <= 70
    assert "Powered by Hydra" not in out
    assert "$" not in out


def test_a_mistake_in_a_process_of_its_own(tmp_path: Path) -> None:
    done = hopdiff("speed=-3", cwd=tmp_path)
    assert done.returncode == 1
    assert done.stdout == ""
    assert done.stderr == "hopdiff: speed must be a number above 0 [m/s], not -3.\n"
    assert list(tmp_path.iterdir()) == []


@pytest.mark.thorough
def test_the_trace_in_a_process_of_its_own(tmp_path: Path) -> None:
    done = hopdiff("speed=-3", cwd=tmp_path, HYDRA_FULL_ERROR="1")
    assert done.returncode == 1
    assert "Traceback" in done.stderr
    assert "speed must be a number above 0" in done.stderr


@pytest.mark.thorough
def test_a_sweep_side_by_side(tmp_path: Path) -> None:
    pytest.importorskip("hydra_plugins.hydra_joblib_launcher")
    done = hopdiff(
        "-m",
        "speed=3,5",
        "model=smooth",
        "search=random",
        "budget.evaluations=50",
        "hydra/launcher=joblib",
        "hydra.launcher.n_jobs=2",
        "hydra.sweep.dir=sweep",
        cwd=tmp_path,
    )
    assert done.returncode == 0, done.stderr
    assert len(list((tmp_path / "sweep").rglob("metrics.json"))) == 2
