"""What Hydra calls during a sweep: a sweep that ends in its comparison."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

from hydra.core.utils import JobReturn, JobStatus
from hydra.experimental.callback import Callback
from omegaconf import DictConfig

from hopdiff.tasks.compare import compare
from hopdiff.types import HopdiffError

FAILED = "failed.txt"


class CompareRuns(Callback):
    """Compares the runs of a sweep when all are done, in its subfolder `compare`; jobs that failed are left out.

    Named in an experiment: `hydra.callbacks.compare._target_: hopdiff.callbacks.CompareRuns`.
    """

    def on_multirun_start(self, config: DictConfig, **kwargs: Any) -> None:
        """Forget the failures of an earlier sweep into the same folder."""
        (Path(config.hydra.sweep.dir) / FAILED).unlink(missing_ok=True)

    def on_job_end(self, config: DictConfig, job_return: JobReturn, **kwargs: Any) -> None:
        """Keep a user's error (already printed) in a list, since Hydra would end a sweep with a failed job there."""
        error = job_return._return_value
        if job_return.status == JobStatus.FAILED and isinstance(error, HopdiffError):
            # Jobs may be processes of their own, so the list is a file.
            with open(Path(config.hydra.sweep.dir) / FAILED, "a", encoding="utf-8") as file:
                file.write(f"{error}\n")
            job_return.status, job_return.return_value = JobStatus.COMPLETED, None

    def on_multirun_end(self, config: DictConfig, **kwargs: Any) -> None:
        """Compare; ends the program with status 1 if that cannot be done or a job failed."""
        sweep = Path(config.hydra.sweep.dir)
        try:
            compare(sweep, sweep / "compare")
        except HopdiffError as error:
            print(f"hopdiff: {error}", file=sys.stderr)
            # Hydra turns any other exception of a callback into a warning.
            sys.exit(1)
        if (failed := sweep / FAILED).is_file():
            count = len(failed.read_text(encoding="utf-8").splitlines())
            print(f"hopdiff: {count} of the jobs failed and are not compared: see {failed}.", file=sys.stderr)
            sys.exit(1)
