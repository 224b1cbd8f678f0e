"""Folders of runs: who writes in them, how it ended, and what is never cleared away."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from hopdiff.io.run_folder import Note, RefusedError, identity_of, is_complete, opened, read_status, record_failure
from hopdiff.types import HopdiffError

SETTINGS = {"speed": 5.0, "overwrite": False}
ROOT = Path(__file__).resolve().parents[2]


def status(folder: Path) -> dict[str, object]:
    content: dict[str, object] = json.loads((folder / "status.json").read_text())
    return content


def finish(folder: Path, name: str = "motion.bvh") -> None:
    with opened(folder, "run", ["speed=5"], SETTINGS):
        (folder / name).write_text("motion")


def test_a_run_that_ends_well(tmp_path: Path) -> None:
    folder = tmp_path / "run"
    with opened(folder, "run", ["speed=5", "seed=1"], SETTINGS) as run:
        assert status(folder)["status"] == "running"
        (folder / "motion.bvh").write_text("motion")
        run.notes.append(Note("energy_off_target", "energy 23 % off."))
    told = status(folder)
    assert (told["version"], told["status"], told["sentence"], told["task"]) == (1, "complete", None, "run")
    assert told["overrides"] == ["speed=5", "seed=1"]
    assert told["notes"] == [{"flag": "energy_off_target", "sentence": "energy 23 % off."}]
    assert told["files"] == ["motion.bvh"]
    assert told["started"] <= told["ended"]  # type: ignore[operator]
    assert sorted(path.name for path in folder.iterdir()) == ["motion.bvh", "status.json"]


def test_a_run_that_was_broken_off(tmp_path: Path) -> None:
    with opened(tmp_path, "run", [], SETTINGS) as run:
        run.interrupted = True
    assert status(tmp_path)["status"] == "interrupted"
    assert not is_complete(tmp_path, SETTINGS)
    with pytest.raises(KeyboardInterrupt), opened(tmp_path, "run", [], SETTINGS):
        raise KeyboardInterrupt
    assert status(tmp_path)["status"] == "interrupted"


@pytest.mark.parametrize(
    ("error", "said"), [(HopdiffError("No luck."), "No luck."), (KeyError("x"), "KeyError: 'x'")], ids=["user", "ours"]
)
def test_a_run_that_failed(error: Exception, said: str, tmp_path: Path) -> None:
    with pytest.raises(type(error)), opened(tmp_path, "run", [], SETTINGS):
        raise error
    assert (status(tmp_path)["status"], status(tmp_path)["sentence"]) == ("failed", said)
    # The same run may be made anew in its place.
    finish(tmp_path)
    assert status(tmp_path)["status"] == "complete"


def test_a_folder_that_holds_a_run_is_refused(tmp_path: Path) -> None:
    finish(tmp_path)
    before = status(tmp_path)
    with pytest.raises(RefusedError, match="holds this very run, complete: set overwrite=true"):
        finish(tmp_path)
    with (
        pytest.raises(RefusedError, match="holds a run with other settings"),
        opened(tmp_path, "run", [], {"speed": 4.0}),
    ):
        pass
    assert status(tmp_path) == before
    assert (tmp_path / "motion.bvh").read_text() == "motion"


def test_a_run_of_an_older_version_is_refused_too(tmp_path: Path) -> None:
    (tmp_path / "metrics.json").write_text("{}")
    with pytest.raises(RefusedError, match="holds another run"):
        finish(tmp_path)


def test_files_of_others_are_no_run(tmp_path: Path) -> None:
    (tmp_path / "notes.txt").write_text("mine")
    finish(tmp_path)
    assert (tmp_path / "notes.txt").read_text() == "mine"


def test_overwrite_clears_the_run_and_nothing_else(tmp_path: Path) -> None:
    finish(tmp_path, "hero.glb")  # an export by a name of its user's
    (tmp_path / "events.out.tfevents.1.host").write_text("")
    (tmp_path / "mine.txt").write_text("mine")
    (tmp_path.parent / "outside.txt").write_text("outside")
    told = status(tmp_path)
    told["files"] = [*told["files"], "../outside.txt"]  # type: ignore[misc]
    (tmp_path / "status.json").write_text(json.dumps(told))
    with opened(tmp_path, "run", [], {"speed": 4.0}, overwrite=True):
        assert sorted(path.name for path in tmp_path.iterdir()) == [".lock", "mine.txt", "status.json"]
    assert (tmp_path.parent / "outside.txt").exists()


def test_overwrite_clears_the_runs_folders_and_no_others(tmp_path: Path) -> None:
    run_folder = tmp_path / "run"
    with opened(run_folder, "run", [], SETTINGS) as run:
        for name in ("motion_frames", "mine", "deep"):
            (run_folder / name).mkdir()
            (run_folder / name / "0001.png").write_text("")
        (run_folder / "deep" / "deeper").mkdir()
        run.folders += ["motion_frames", "deep"]
    (tmp_path / "outside").mkdir()
    (run_folder / ".motion_frames.1234.part").mkdir()
    told = status(run_folder)
    assert told["folders"] == ["deep", "motion_frames"]
    told["folders"] = ["motion_frames", "deep", "..", ".", "", "../outside"]
    (run_folder / "status.json").write_text(json.dumps(told))
    with opened(run_folder, "run", [], {"speed": 4.0}, overwrite=True):
        assert sorted(path.name for path in run_folder.iterdir()) == [".lock", "deep", "mine", "status.json"]
    assert (tmp_path / "outside").is_dir()


def test_a_broken_status_is_no_reason_to_clear(tmp_path: Path) -> None:
    (tmp_path / "status.json").write_text("{")
    with pytest.raises(RefusedError, match="holds another run"):
        finish(tmp_path)
    with pytest.raises(HopdiffError, match=r"status\.json, line 1: not JSON"):
        read_status(tmp_path)
    (tmp_path / "status.json").write_text('{"status": "odd"}')
    with pytest.raises(HopdiffError, match="is not the status of a run"):
        read_status(tmp_path)


def test_identity_is_that_of_the_settings() -> None:
    assert identity_of({"a": 1, "b": [1.0, None]}) == identity_of({"b": [1.0, None], "a": 1, "overwrite": True})
    assert identity_of({"a": 1}) != identity_of({"a": 2})


def test_what_is_complete_is_known_by_its_settings(tmp_path: Path) -> None:
    assert not is_complete(tmp_path / "none", SETTINGS)
    finish(tmp_path)
    assert is_complete(tmp_path, SETTINGS)
    assert is_complete(tmp_path, SETTINGS | {"overwrite": True})
    with pytest.raises(RefusedError, match=r"a run with other settings \(complete\)"):
        is_complete(tmp_path, {"speed": 4.0})


def test_a_job_that_could_not_begin_is_recorded(tmp_path: Path) -> None:
    record_failure(tmp_path / "job", "run", ["speed=-1"], SETTINGS, "speed must be above 0.")
    told = status(tmp_path / "job")
    assert (told["status"], told["sentence"], told["overrides"]) == ("failed", "speed must be above 0.", ["speed=-1"])


HOLDER = """
import sys, time
from pathlib import Path
from hopdiff.io.run_folder import opened
with opened(Path(sys.argv[1]), "run", [], {"speed": 5.0, "overwrite": False}):
    print("in", flush=True)
    time.sleep(60)
"""


def test_a_folder_in_use_is_refused_and_a_killed_run_is_not_in_use(tmp_path: Path) -> None:
    holder = subprocess.Popen(
        [sys.executable, "-c", HOLDER, str(tmp_path)], cwd=ROOT, stdout=subprocess.PIPE, text=True
    )
    try:
        assert holder.stdout is not None
        assert holder.stdout.readline() == "in\n"
        assert (read_status(tmp_path) or {})["status"] == "running"
        with pytest.raises(RefusedError, match="is in use"), opened(tmp_path, "run", [], SETTINGS, overwrite=True):
            pass
        assert (read_status(tmp_path) or {})["status"] == "running"
    finally:
        holder.kill()
        holder.communicate()
    told = read_status(tmp_path) or {}
    assert (told["status"], told["sentence"]) == ("interrupted", "The run was killed before it could end.")
    finish(tmp_path)
    assert status(tmp_path)["status"] == "complete"


def test_sigterm_keeps_the_best_run_so_far(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "hopdiff", "model=smooth", "pictures=false", "search=random"]
    run = subprocess.Popen(
        [*command, "search.population=50", "budget.evaluations=10000000", f"hydra.run.dir={tmp_path / 'run'}"],
        cwd=ROOT,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, "MPLBACKEND": "Agg"},
    )
    try:
        while not (tmp_path / "run" / "config.yaml").exists():
            assert run.poll() is None, run.communicate()
            time.sleep(0.1)
        time.sleep(2.0)  # some steps of the search
        run.send_signal(signal.SIGTERM)
        out, err = run.communicate(timeout=60)
    finally:
        run.kill()
    assert run.returncode == 130, err
    assert "best run so far" in out
    told = status(tmp_path / "run")
    assert told["status"] == "interrupted"
    assert {"genes.json", "metrics.json", "history.csv", "motion.bvh"} <= set(told["files"])  # type: ignore[call-overload]


def test_files_that_lay_there_before_are_not_the_runs(tmp_path: Path) -> None:
    (tmp_path / "mine.txt").write_text("mine")
    (tmp_path / "motion.bvh").write_text("of another program")
    for overwrite in (False, True):
        with opened(tmp_path, "run", [], SETTINGS | {"overwrite": overwrite}, overwrite):
            (tmp_path / "motion.bvh").write_text("ours")
            (tmp_path / "hero.glb").write_text("exported")
        assert status(tmp_path)["files"] == ["hero.glb", "motion.bvh"]
        assert (tmp_path / "mine.txt").read_text() == "mine"
    record_failure(tmp_path, "run", [], SETTINGS, "No luck.")
    assert "mine.txt" not in status(tmp_path)["files"]  # type: ignore[operator]


def test_ctrl_c_after_the_search_says_what_is_there(tmp_path: Path) -> None:
    with pytest.raises(KeyboardInterrupt), opened(tmp_path, "run", [], SETTINGS):
        (tmp_path / "genes.json").write_text("{}")
        raise KeyboardInterrupt
    assert "while its files were written" in str(status(tmp_path)["sentence"])


def test_a_reader_that_has_gone_does_not_fail_the_run(tmp_path: Path) -> None:
    """As `| head -1` does: what is printed last finds nobody to read it."""
    words = ["model=smooth", "search=ordinary", "pictures=false", f"hydra.run.dir={tmp_path / 'run'}"]
    done = subprocess.run(
        f"{sys.executable} -m hopdiff {' '.join(words)} | true; exit ${{PIPESTATUS[0]}}",
        shell=True,
        executable="/bin/bash",
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    assert (done.returncode, done.stderr) == (0, "")
    assert status(tmp_path / "run")["status"] == "complete"
