"""The command line: `python -m hopdiff`. Nothing here loads PyTorch before there is something to do."""

from __future__ import annotations

import os
import signal
import sys
import threading
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import FrameType
from typing import Any

import hydra
from hydra.core.hydra_config import HydraConfig
from hydra.types import RunMode
from omegaconf import DictConfig, OmegaConf

from hopdiff import __version__, callbacks
from hopdiff.composing import HYDRA_BASE, as_typed, register_choices, with_new_names
from hopdiff.doors import config_folder, load
from hopdiff.errors import sentence
from hopdiff.io.run_folder import RefusedError, record_failure
from hopdiff.types import HopdiffError

INTERRUPTED = 130


class _Failed(BaseException):
    """Carries a job's error past Hydra, which would report it in lines of its own."""


def main() -> int:
    """Run the command line in `sys.argv`; returns the exit status.

    Whatever the user can put right becomes one sentence on stderr and status 1; HYDRA_FULL_ERROR=1 shows the trace.
    """
    if "--version" in sys.argv[1:]:
        print(f"hopdiff {__version__} (Hydra {hydra.__version__})")
        return 0
    wish = os.environ.get("HYDRA_FULL_ERROR")
    os.environ["HYDRA_FULL_ERROR"] = "1"  # so that Hydra hands its errors over instead of printing them
    sys.argv[1:] = with_new_names(sys.argv[1:])
    try:
        register_choices()
        hydra.main(config_path=str(config_folder()), config_name="config", **HYDRA_BASE)(job)()
    except KeyboardInterrupt:
        print("hopdiff: interrupted.", file=sys.stderr)
        return INTERRUPTED
    except _Failed as failed:
        return _report(failed.__cause__, failed.args[0], wish == "1")
    except Exception as error:
        return _report(error, sentence(error), wish == "1")
    finally:
        if wish is None:
            del os.environ["HYDRA_FULL_ERROR"]
        else:
            os.environ["HYDRA_FULL_ERROR"] = wish
    return 0


def job(config: DictConfig) -> None:
    """One run of the application, or one job of a sweep. Leaves no empty folder behind when it fails."""
    info = HydraConfig.get()
    folder, words = Path(info.runtime.output_dir), list(info.overrides.task)
    sweep = info.mode == RunMode.MULTIRUN
    try:
        with _sigterm_interrupts():
            interrupted = load("hopdiff.perform", "perform")(config, folder, words, resume=sweep)
    except BaseException as error:
        _remove_if_empty([folder, folder.parent] if sweep else callbacks.made)
        if not isinstance(error, Exception):
            raise
        said = sentence(error)  # here, where Hydra still knows which files were chosen
        if not sweep:
            raise _Failed(said) from error
        if said is None:
            raise
        settings: Any = OmegaConf.to_container(config, resolve=True)
        if not isinstance(error, RefusedError):
            record_failure(folder, str(config.task.name), words, settings, said)
        named = HopdiffError(as_typed(f"job {info.job.num} ({' '.join(words)}): {said}"))
        print(f"hopdiff: {named}", file=sys.stderr, flush=True)
        raise named from error
    if interrupted:
        sys.exit(INTERRUPTED)


@contextmanager
def _sigterm_interrupts() -> Iterator[None]:
    """SIGTERM, which schedulers send before they kill, ends a search as Ctrl-C does: the best so far is kept."""
    if threading.current_thread() is not threading.main_thread():
        yield  # signals reach the main thread only
        return

    def interrupt(number: int, frame: FrameType | None) -> None:
        raise KeyboardInterrupt

    before = signal.signal(signal.SIGTERM, interrupt)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


def _report(error: BaseException | None, said: str | None, trace: bool) -> int:
    assert error is not None
    if trace or said is None:
        raise error from error.__cause__
    print(f"hopdiff: {as_typed(said)}", file=sys.stderr)
    return 1


def _remove_if_empty(folders: Iterable[Path]) -> None:
    """Remove folders, the deepest first, up to one that holds something."""
    for empty in folders:
        try:
            empty.rmdir()
        except OSError:
            return
