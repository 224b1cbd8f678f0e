"""Where the time of one tiny run goes, in a process that has imported everything."""

from __future__ import annotations

import contextlib
import cProfile
import io
import pstats
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory

from hopdiff.composing import compose
from hopdiff.perform import perform

# Functions by module and name, and what they are for.
PARTS = {
    ("config.py", "typed"): "settings checked for their types (OmegaConf)",
    ("record.py", "write_settings"): "config.yaml written (OmegaConf, YAML)",
    ("problem.py", "evaluate"): "candidates priced",
    ("job.py", "make_run"): "motion and metrics",
    ("record.py", "git_state"): "git.json (four calls of git)",
    ("record.py", "versions"): "versions.json",
    ("events.py", "write_events"): "TensorBoard events",
    ("tables.py", "write_npz"): "motion.npz",
    ("bvh.py", "write_bvh"): "BVH files",
    ("run_folder.py", "write"): "status.json",
}


def inside(words: Sequence[str], rounds: int) -> tuple[float, float, list[tuple[str, float, float]]]:
    """Milliseconds of processor time of the composition of a run, and of the run itself (medians), and of its parts by
    what they are for: calls a run and share of the run under the profiler."""
    with TemporaryDirectory() as place, contextlib.redirect_stdout(io.StringIO()):
        numbers = iter(range(10**6))

        def run() -> None:
            perform(config, Path(place) / str(next(numbers)), list(words))

        config = compose(words)
        run()
        composed, ran = (_median(call, rounds) for call in (lambda: compose(words), run))
        profile = cProfile.Profile(time.process_time)
        profile.enable()
        for _ in range(rounds):
            run()
        profile.disable()
    stats = pstats.Stats(profile).stats  # type: ignore[attr-defined]
    whole = next(entry[3] for (file, _, name), entry in stats.items() if name == "perform" and "hopdiff" in file)
    parts = []
    for (module, name), use in PARTS.items():
        found = [
            entry
            for (file, _, function), entry in stats.items()
            if function == name and Path(file).name == module and "hopdiff" in Path(file).parts
        ]
        if found:
            parts.append((use, sum(entry[1] for entry in found) / rounds, sum(entry[3] for entry in found) / whole))
    return composed, ran, parts


def _median(call: Callable[[], object], rounds: int) -> float:
    taken = []
    for _ in range(rounds):
        begun = time.process_time()
        call()
        taken.append(1e3 * (time.process_time() - begun))
    return median(taken)
