"""Runs from Python, without the command line."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from hopdiff.config import build_exports, build_job, compose, known_settings
from hopdiff.errors import sentence
from hopdiff.export.write import distinct
from hopdiff.io.record import prepare_folder
from hopdiff.tasks.export import write_all
from hopdiff.tasks.job import Run, search_run, threads
from hopdiff.types import HopdiffError


def generate(
    speed: float = 5.0,
    beta: float = 0.7,
    *,
    search: str = "gradient",
    seed: int = 0,
    character: str = "human",
    model: str = "body",
    fps: float = 60.0,
    evaluations: int | None = None,
    device: str = "cpu",
    dtype: str = "float64",
    settings: tuple[str, ...] = (),
) -> Run:
    """Search for a run and return it: `.clip`, `.genes`, `.metrics`, `.motion`, `.history`. Writes no file.

    speed [m/s]; beta in [0, 1), 0.2 is the run of least effort; fps [frames/s]; evaluations: what the search may spend,
    None: what suits the model.
    search, character, model: names of files in conf/. settings: any others, written as on the command line
    ("costs.torque=0.1", "search.population=50").
    Raises HopdiffError with one sentence if a setting cannot be, or if no valid candidate turned up.
    """
    chosen = [
        *settings,
        f"speed={speed}",
        f"beta={beta}",
        f"search={search}",
        f"seed={seed}",
        f"character={character}",
        f"model={model}",
        f"fps={fps}",
        *([] if evaluations is None else [f"budget.evaluations={evaluations}"]),
        f"device='{device}'",
        f"dtype='{dtype}'",
    ]
    with _one_sentence():
        job = build_job(compose(chosen))
        with threads(job.threads):
            return search_run(job)


def save(
    runs: Run | Sequence[Run], folder: str | os.PathLike[str], *exports: str, settings: tuple[str, ...] = ()
) -> list[Path]:
    """Write runs for other programs: save(run, "out", "glb", "bvh_unreal"). Returns the files.

    exports: names of files in conf/export/. settings: written as on the command line ("exports.glb.cycles=4",
    "retarget.skeleton=hero.glb"). GLB, FBX and HTML files hold all the runs, of other kinds there is a file for each.
    Raises HopdiffError with one sentence if a setting cannot be, or a file cannot be written.
    """
    with _one_sentence():
        wanted = build_exports(compose([f"export=[{','.join(exports)}]", *settings]))
        if not wanted:
            raise HopdiffError("save needs the name of an export, such as glb.")
        takes = [run.take() for run in ([runs] if isinstance(runs, Run) else runs)]
        prepare_folder(Path(folder))
        return [path for path, _ in write_all(distinct(takes), wanted, Path(folder))]


@contextmanager
def _one_sentence() -> Iterator[None]:
    """Turns errors of settings into HopdiffError."""
    try:
        yield
    except HopdiffError:
        raise
    except Exception as error:
        if (said := sentence(error, known_settings)) is None:
            raise
        raise HopdiffError(said) from error
