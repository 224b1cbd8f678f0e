"""Runs from Python: no command line, no files."""

from __future__ import annotations

from hopdiff.config import build_job, compose, known_settings
from hopdiff.errors import sentence
from hopdiff.tasks.job import Run, search_run, threads
from hopdiff.types import HopdiffError


def generate(
    speed: float = 5.0,
    beta: float = 0.7,
    *,
    search: str = "gradient",
    seed: int = 0,
    character: str = "human",
    model: str = "smooth",
    fps: float = 60.0,
    evaluations: int = 10_000,
    device: str = "cpu",
    dtype: str = "float64",
    settings: tuple[str, ...] = (),
) -> Run:
    """Search for a run and return it: `.clip`, `.genes`, `.metrics`, `.motion`, `.history`.

    speed [m/s]; beta in [0, 1), 0.2 is ordinary running; fps [frames/s]; evaluations: what the search may spend.
    search, character, model: names of files in conf/. settings: any others, written as on the command line
    ("costs.leg_force=0.1", "search.population=50").
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
        f"budget.evaluations={evaluations}",
        f"device='{device}'",
        f"dtype='{dtype}'",
    ]
    try:
        job = build_job(compose(chosen))
        with threads(job.threads):
            return search_run(job)
    except HopdiffError:
        raise
    except Exception as error:
        if (said := sentence(error, known_settings)) is None:
            raise
        raise HopdiffError(said) from error
