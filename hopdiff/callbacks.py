"""What Hydra calls: before a run about its folder, after a sweep to count it and, where it is asked for, compare it."""

from __future__ import annotations

import sys
from collections import Counter
from pathlib import Path
from typing import Any

from hydra.core.utils import JobReturn, JobStatus
from hydra.experimental.callback import Callback
from omegaconf import DictConfig

from hopdiff.doors import load
from hopdiff.io.run_folder import COMPLETE, STATUS, RefusedError, read_status
from hopdiff.messages import plural, say
from hopdiff.types import HopdiffError

SHOWN = 5  # sentences of runs that failed
made: list[Path] = []  # the folder of a single run and those above it that were not there before, deepest first
REFUSED = ".refused"  # file of a sweep with the sentences of jobs that had no folder of their own to keep them in


class Sweep(Callback):
    """Lets a sweep go on after jobs that failed, and tells at its end how its runs ended; status 1 if one is missing.

    compare: whether it ends in a comparison of its runs, in the subfolder `compare`:
    `hydra.callbacks.sweep.compare=true`.
    """

    def __init__(self, compare: bool = False) -> None:
        self.compare = compare

    def on_run_start(self, config: DictConfig, **kwargs: Any) -> None:
        """Note what will be made, before Hydra makes it."""
        folder = Path(config.hydra.run.dir)
        made[:] = [one for one in (folder, *folder.parents) if not one.exists()]

    def on_multirun_start(self, config: DictConfig, **kwargs: Any) -> None:
        """Forget what an earlier sweep into this folder refused."""
        (Path(config.hydra.sweep.dir) / REFUSED).unlink(missing_ok=True)

    def on_job_end(self, config: DictConfig, job_return: JobReturn, **kwargs: Any) -> None:
        """A user's error was printed, and is kept in the job's folder; Hydra would end the sweep there."""
        error = job_return._return_value
        if job_return.status == JobStatus.FAILED and isinstance(error, HopdiffError):
            if isinstance(error.__cause__, RefusedError):
                # Jobs may be processes of their own, so this is a file.
                with open(Path(config.hydra.sweep.dir) / REFUSED, "a", encoding="utf-8") as file:
                    file.write(f"{error}\n")
            job_return.status, job_return.return_value = JobStatus.COMPLETED, None

    def on_multirun_end(self, config: DictConfig, **kwargs: Any) -> None:
        """Count and compare; ends the program with status 1 if a run is not complete or nothing can be compared."""
        sweep = Path(config.hydra.sweep.dir)
        ended, said = _endings(sweep)
        if (refused := sweep / REFUSED).is_file():
            lines = refused.read_text(encoding="utf-8").splitlines()
            ended["refused"], said = len(lines), [*lines, *said]
            refused.unlink()
        failed = sum(ended.values()) - ended[COMPLETE]
        if self.compare:
            try:
                load("hopdiff.tasks.compare", "compare")(sweep, sweep / "compare")
            except HopdiffError as error:
                print(f"hopdiff: {error}", file=sys.stderr)
                # Hydra turns any other exception of a callback into a warning.
                sys.exit(1)
        counts = ", ".join(f"{count} {status}" for status, count in ended.items())
        say(f"{plural(sum(ended.values()), 'run')} in {sweep}: {counts}.")
        if failed:
            for line in said[:SHOWN]:
                print(f"hopdiff: {line}", file=sys.stderr)
            more = f" (and {len(said) - SHOWN} more)" if len(said) > SHOWN else ""
            advice = []
            if missing := failed - ended["refused"]:
                advice.append(
                    f"{missing} of the runs are not complete{more}: their status.json says why. The same command with"
                    f" hydra.sweep.dir={sweep} makes only these."
                )
            if ended["refused"]:
                advice.append(
                    f"{ended['refused']} of the runs were not made: a run with other settings has their folder. Take"
                    " another hydra.sweep.dir, or overwrite=true."
                )
            print(f"hopdiff: {' '.join(advice)}", file=sys.stderr)
            sys.exit(1)


def _endings(sweep: Path) -> tuple[Counter[str], list[str]]:
    """How often runs of a sweep ended in which way, and the sentences of those that are not complete."""
    ended: Counter[str] = Counter()
    said = []
    for path in sorted(sweep.rglob(STATUS)):
        try:
            found = read_status(path.parent) or {}
        except HopdiffError as error:
            found = {"status": "unreadable", "sentence": str(error)}
        ended[found["status"]] += 1
        if found["status"] != COMPLETE:
            said.append(f"{path.parent.name}: {found.get('sentence')}")
    return ended, said
