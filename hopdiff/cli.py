"""The command line: `python -m hopdiff`."""

from __future__ import annotations

import os
import sys
from pathlib import Path

import hydra
from hydra.core.hydra_config import HydraConfig
from hydra.types import RunMode
from omegaconf import DictConfig

from hopdiff.config import HYDRA_BASE, as_typed, config_folder, known_settings, register_schema, with_new_names
from hopdiff.errors import sentence
from hopdiff.perform import perform
from hopdiff.types import HopdiffError

INTERRUPTED = 130


class _Failed(BaseException):
    """Carries a job's error past Hydra, which would report it in lines of its own."""


def main() -> int:
    """Run the command line in `sys.argv`; returns the exit status.

    Whatever the user can put right becomes one sentence on stderr and status 1; HYDRA_FULL_ERROR=1 shows the trace.
    """
    wish = os.environ.get("HYDRA_FULL_ERROR")
    os.environ["HYDRA_FULL_ERROR"] = "1"  # so that Hydra hands its errors over instead of printing them
    sys.argv[1:] = with_new_names(sys.argv[1:])
    try:
        register_schema()
        hydra.main(config_path=str(config_folder()), config_name="config", **HYDRA_BASE)(job)()
    except KeyboardInterrupt:
        print("hopdiff: interrupted.", file=sys.stderr)
        return INTERRUPTED
    except _Failed as failed:
        return _report(failed.__cause__, wish == "1")
    except Exception as error:
        return _report(error, wish == "1")
    finally:
        if wish is None:
            del os.environ["HYDRA_FULL_ERROR"]
        else:
            os.environ["HYDRA_FULL_ERROR"] = wish
    return 0


def job(config: DictConfig) -> None:
    """One run of the application, or one job of a sweep. Leaves no empty folder behind when it fails."""
    info = HydraConfig.get()
    folder = Path(info.runtime.output_dir)
    try:
        interrupted = perform(config, folder, list(info.overrides.task))
    except BaseException as error:
        _remove_if_empty(folder)
        if not isinstance(error, Exception):
            raise
        if info.mode == RunMode.RUN:
            raise _Failed from error
        if (said := sentence(error, known_settings)) is None:
            raise
        named = HopdiffError(as_typed(f"job {info.job.num} ({' '.join(info.overrides.task)}): {said}"))
        print(f"hopdiff: {named}", file=sys.stderr, flush=True)
        raise named from error
    if interrupted:
        sys.exit(INTERRUPTED)


def _report(error: BaseException | None, trace: bool) -> int:
    assert error is not None
    said = sentence(error, known_settings)
    if trace or said is None:
        raise error from error.__cause__
    print(f"hopdiff: {as_typed(said)}", file=sys.stderr)
    return 1


def _remove_if_empty(folder: Path) -> None:
    for empty in (folder, folder.parent):
        try:
            empty.rmdir()
        except OSError:
            return
