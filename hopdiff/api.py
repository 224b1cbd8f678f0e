"""Runs from Python, without the command line."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import torch
from omegaconf import OmegaConf

from hopdiff.composing import compose
from hopdiff.config import build_job, checked
from hopdiff.errors import sentence
from hopdiff.export.request import Exports
from hopdiff.export.write import distinct
from hopdiff.io.record import prepare_folder
from hopdiff.job import Run, check_frames, search_run, threads
from hopdiff.objective import Term
from hopdiff.search.base import Problem, Search, check_search
from hopdiff.search.loop import Budget, OnStep, SearchResult, run_search
from hopdiff.tasks.export import write_all
from hopdiff.types import HopdiffError


def generate(
    speed: float = 5.0,
    beta: float = 0.7,
    *,
    search: str | Search = "gradient",
    seed: int = 0,
    character: str | Mapping[str, Any] = "human",
    model: str = "body",
    costs: str | Sequence[Term] | None = None,
    fps: float = 60.0,
    evaluations: int | None = None,
    device: str = "cpu",
    dtype: str = "float64",
    settings: tuple[str, ...] = (),
) -> Run:
    """Search for a run and return it: `.clip`, `.genes`, `.metrics`, `.motion`, `.history`. Writes no file.

    speed [m/s]; beta in [0, 1), 0.2 is the run of least effort; fps [frames/s]; evaluations: what the search may spend,
    None: what suits the model.
    search, character, model, costs: names of files in conf/, or of what installed packages bring. In the place of a
    name, search may be an object that keeps the contract `Search`, character a table such as a file in conf/character
    holds, costs terms of your own, which come on top of those that the model has by itself.
    settings: any others, written as on the command line ("costs.torque=0.1", "search.population=50").
    Raises HopdiffError with one sentence if a setting cannot be, or if no valid candidate turned up.
    """
    chosen = [
        *settings,
        f"speed={speed}",
        f"beta={beta}",
        f"seed={seed}",
        f"model={model}",
        f"fps={fps}",
        *([f"search={search}"] if isinstance(search, str) else []),
        *([f"character={character}"] if isinstance(character, str) else []),
        *([f"costs={costs}"] if isinstance(costs, str) else []),
        *([] if evaluations is None else [f"budget.evaluations={evaluations}"]),
        f"device='{device}'",
        f"dtype='{dtype}'",
    ]
    if not isinstance(search, str):
        check_search(search)
    if not isinstance(character, str | Mapping):
        raise HopdiffError(
            f"character must be the name of a body or a table such as hopdiff.body(), not {character!r}."
        )
    if not (costs is None or isinstance(costs, str) or all(isinstance(term, Term) for term in costs)):
        raise HopdiffError(f"costs must be a name or a list of hopdiff.Term, not {costs!r}.")
    with _one_sentence():
        config = compose(chosen)
        if not isinstance(character, str):
            OmegaConf.update(config, "character", dict(character), merge=False)
        own = None if isinstance(search, str) else search
        terms = () if costs is None or isinstance(costs, str) else tuple(costs)
        job = build_job(config, own, terms)
        check_frames(job)
        with threads(job.threads):
            return search_run(job)


def body(name: str = "human") -> dict[str, Any]:
    """The table of a body: heights and masses of its parts, to be changed and given to `generate`.

    Raises HopdiffError with one sentence for an unknown name.
    """
    with _one_sentence():
        table: dict[str, Any] = OmegaConf.to_container(compose([f"character={name}"]).character)  # type: ignore[assignment]
        return table


def optimise(
    problem: Problem, search: Search, budget: Budget, seed: int = 0, on_step: OnStep | None = None
) -> SearchResult:
    """Any search on any problem, under one budget and one count: what `generate` does inside.

    on_step: called after every step with its row of the history and the result so far. The same seed gives the same
    result. Raises HopdiffError if no valid candidate turned up.
    """
    return run_search(problem, search, budget, torch.Generator().manual_seed(seed), on_step)


def save(
    runs: Run | Sequence[Run], folder: str | os.PathLike[str], *exports: str, settings: tuple[str, ...] = ()
) -> list[Path]:
    """Write runs for other programs: save(run, "out", "glb", "bvh_unreal"). Returns the files.

    exports: names of files in conf/export/. settings: written as on the command line ("exports.glb.cycles=4",
    "retarget.skeleton=hero.glb"). GLB, FBX and HTML files, sprite sheets, events and blend spaces hold all the
    runs; of other kinds there is a file for each. Raises HopdiffError with one sentence if a setting cannot be, or a
    file cannot be written.
    """
    if strange := [name for name in exports if not isinstance(name, str)]:
        raise HopdiffError(f"save takes names of exports one by one, save(run, folder, 'glb'), not {strange[0]!r}.")
    with _one_sentence():
        asked = checked(compose([f"export=[{','.join(exports)}]", *settings]))
        wanted = Exports.build(asked.exports, asked.retarget)
        if not wanted:
            raise HopdiffError("save needs the name of an export, such as glb.")
        takes = [run.take() for run in ([runs] if isinstance(runs, Run) else runs)]
        prepare_folder(Path(folder))
        return [path for path, _ in write_all(distinct(takes), wanted, Path(folder)).files]


@contextmanager
def _one_sentence() -> Iterator[None]:
    """Turns errors of settings into HopdiffError."""
    try:
        yield
    except HopdiffError:
        raise
    except Exception as error:
        if (said := sentence(error)) is None:
            raise
        raise HopdiffError(said) from error
